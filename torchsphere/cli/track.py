"""The command ``torchsphere track``: its options from a file, its progress bar and what it prints."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import sys
import tomllib
from pathlib import Path
from typing import Any, NoReturn

from tqdm import tqdm

from torchsphere.cli.arguments.track import frames, numbers
from torchsphere.measure import Measurement, measure
from torchsphere.request import Request
from torchsphere.results.writer import status_counts


def _configured(path: Path) -> dict[str, Any]:
    """Options from a TOML file, by the names of the command line."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: is no TOML file ({error}); see the README for one") from error
    known = {f.name for f in dataclasses.fields(Request)} - {"input", "out"}
    options = {}
    for key, value in table.items():
        name = key.replace("-", "_")
        if name not in known:
            hint = "; write report = false" if name == "no_report" else ""
            raise ValueError(f"{path}: unknown option {key!r}{hint}; expected one of {', '.join(sorted(known))}")
        if name in options:
            raise ValueError(f"{path}: {name} stands there twice, with '-' and with '_'; leave one out")
        options[name] = _typed(path, name, value)
    return options


#: Options of `Request` that are on or off; and those for what follows from the track, each a number.
SWITCHES = ("refine", "in_place", "lab_frame", "overwrite", "report", "overlay", "paraview")
KINEMATIC = ("scale_sd_percent", "shell_mm", "inertia_kg_m2", "normal_deg")
NUMBERS = ("fps", "diameter_mm", "mm_per_px", "mass_g", "roi", "focal_px", "distance_mm", *KINEMATIC)

#: Options that are several numbers, and how they are written.
LISTS = {"circle": "[X, Y, R]", "principal_px": "[X, Y]", "distortion": "[K1, K2, K3]"}


def _typed(path: Path, name: str, value: Any) -> Any:
    """The value as `Request` takes it; ValueError where the file has another kind of value."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if name in LISTS and isinstance(value, list) and len(value) == LISTS[name].count(",") + 1:
        return numbers(len(value), name)(",".join(map(str, value)))
    if name == "frames" and isinstance(value, str):
        return frames(value)
    if name == "ignore" and isinstance(value, (str, list)):
        return [value] if isinstance(value, str) else [str(v) for v in value]
    if name in NUMBERS and number:
        return float(value)
    if name in ("window", "order") and isinstance(value, int) and number:
        return value
    if name in ("model", "device", "map", "method") and isinstance(value, str):
        return value
    if name in SWITCHES and isinstance(value, bool):
        return value
    raise ValueError(f"{path}: {name} = {value!r} is not what this option takes; write {name} = {_written(name)}")


def _written(name: str) -> str:
    """How the option is written in a file."""
    if name in LISTS:
        return f"{LISTS[name]}, in square brackets"
    if name in NUMBERS or name in ("window", "order"):
        return f"{'a number' if name in NUMBERS else 'a whole number'}, without quotation marks"
    if name in SWITCHES:
        return "true or false"
    return '"A:B"' if name == "frames" else '"...", in quotation marks'


class _Bar:
    """A progress bar on stderr that appears with the first progress, so that a refusal stands alone."""

    def __init__(self) -> None:
        self._bar: tqdm[NoReturn] | None = None

    def __call__(self, done: int, total: int) -> None:
        if self._bar is None:
            self._bar = tqdm(total=total, unit="frame", file=sys.stderr, leave=False, desc="tracking")
        if done < self._bar.n:
            self._bar.reset(total)
            self._bar.set_description("on the map")
        self._bar.update(done - self._bar.n)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()


def measured(
    request: Request, quiet: bool, extra: dict[str, Path] | None = None, name: str | None = None
) -> Measurement:
    """`measure`, with a progress bar unless ``quiet``."""
    if quiet:
        return measure(request, None, extra, name=name)
    with contextlib.closing(_Bar()) as bar:
        return measure(request, bar, extra, name=name)


def run(options: dict[str, Any]) -> int:
    """Measure one recording and print what came of it; 0 when the result was written.

    Raises
    ------
    ValueError, OSError
        With one sentence on what is wrong; then nothing has been written.
    """
    config, quiet = options.pop("config"), options.pop("quiet")
    given = {name: value for name, value in options.items() if value is not None}
    from_file = {} if config is None else _from_file(config, given)
    done = measured(Request(**(from_file | given)), quiet)
    if not quiet:
        _print_result(done, given["out"])
    return 0


def _from_file(config: Path, given: dict[str, Any]) -> dict[str, Any]:
    try:
        options = _configured(config)
    except argparse.ArgumentTypeError as error:
        raise ValueError(f"{config}: {error}") from error
    # A scale on the command line takes the place of the other kind of scale in the file.
    if {"diameter_mm", "mm_per_px"} & given.keys():
        options = {k: v for k, v in options.items() if k not in ("diameter_mm", "mm_per_px")}
    return options


def _print_result(done: Measurement, out: Path) -> None:
    tracked = done.track
    counts = ", ".join(f"{count} {name}" for name, count in status_counts(tracked).items())
    circle = tracked.circle
    print(f"{len(tracked.status)} frames: {counts}")
    print(f"circle  {circle.text()} px in frame {done.first_frame + circle.frame}")
    for sentence in done.warnings:
        print(f"note    {sentence}")
    print(f"result  {out}")
