"""The suites of the benchmark: small TOML files that describe what is rendered.

A file has ``title``, ``seed``, ``frames`` (numbers for ``smoke`` and ``standard``) and a table ``[shot]``, as in a
preset of the renderer. ``like = "plain"`` takes all other values from another file. ``[smoke.shot]`` changes the shot
at the size ``smoke``, where few frames have to show the same difficulty.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torchsphere.settings.limits import SettingError

#: The suites of the package.
FOLDER = Path(__file__).parent / "suites"

#: Repetitions of each suite by size, each with another seed. A second pattern tells more than a longer recording,
#: because the ball crosses the image in a given number of frames.
SIZES = {"smoke": 1, "standard": 1, "full": 10}

#: Distance of the seeds of two repetitions, so that no two recordings share a seed.
NEXT_SEED = 1000

_KEYS = ("title", "like", "seed", "frames", "shot", "smoke")


@dataclass(frozen=True)
class Recipe:
    """One recording to be made; name, kind, title and seed as in `torchsphere.benchmark.folder.Suite`."""

    name: str
    kind: str
    title: str
    seed: int
    shot: dict[str, Any]  # preset of the renderer, with the number of frames

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.shot["frames"])


def names() -> list[str]:
    """Names of the package's suites: "plain" first, the others in alphabetical order."""
    return sorted((path.stem for path in FOLDER.glob("*.toml")), key=lambda name: (name != "plain", name))


def recipes(suites: Sequence[str] | None, size: str, seed: int | None = None) -> list[Recipe]:
    """The recordings of a benchmark; ValueError for an unknown suite or size, or an invalid file.

    ``suites`` are names or paths of ``.toml`` files, by default all of the package; ``size`` is of `SIZES`; ``seed`` is
    added to the seed of each suite, for new patterns and noise.
    """
    if size not in SIZES:
        raise ValueError(f"size {size!r} is not known: expected one of {', '.join(SIZES)}")
    if seed is not None and seed < 0:
        raise SettingError(f"`seed` = {seed}: expected a whole number of at least 0")
    chosen = names() if suites is None else list(suites)
    made = [recipe for name in chosen for recipe in _repetitions(find(name), size, seed or 0)]
    twice = sorted({recipe.kind for recipe in made if [r.name for r in made].count(recipe.name) > 1})
    if twice or not made:
        problem = f"{twice[0]!r} is given twice" if twice else "none is given"
        raise SettingError(f"`suite`: {problem}; expected names from {', '.join(names())}, each once")
    return made


def find(name: str) -> Path:
    """The file of a suite; ValueError if there is none."""
    path = Path(name)
    if path.suffix == ".toml":
        if not path.is_file():
            raise SettingError(
                f"`suite` = {name}: there is no such file; give its path, or one of {', '.join(names())}"
            )
        return path
    if name not in names():
        raise SettingError(
            f"`suite` = {name} is not known: expected one of {', '.join(names())}, or a .toml file's path"
        )
    return FOLDER / f"{name}.toml"


def _repetitions(path: Path, size: str, seed: int) -> list[Recipe]:
    """The recordings of a suite at a size."""
    table = _resolved(path)
    smoke = size == "smoke"
    shot = table["shot"] | {"frames": table["frames"]["smoke" if smoke else "standard"]}
    if smoke:
        shot = merged(shot, table.get("smoke", {}).get("shot", {}))
    count, kind = SIZES[size], path.stem
    return [
        Recipe(
            name=kind if count == 1 else f"{kind}.{i + 1}",
            kind=kind,
            title=table["title"],
            seed=table["seed"] + seed + NEXT_SEED * i,
            shot=shot,
        )
        for i in range(count)
    ]


def _resolved(path: Path) -> dict[str, Any]:
    """The checked table of a suite, with the values of the suite that ``like`` names."""
    own = _read(path)
    table = own
    if "like" in own:
        if own["like"] not in names() or path == find(own["like"]):
            raise ValueError(f"{path}: like = {own['like']!r}: expected the name of another suite of the package")
        # The other suite's changes at the size smoke fit its own motion only.
        other = {key: value for key, value in _resolved(find(own["like"])).items() if key in ("frames", "shot")}
        table = merged(other, own)
    _check(path, table)
    return table


def _read(path: Path) -> dict[str, Any]:
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: is no TOML file: {error}") from error
    unknown = [key for key in table if key not in _KEYS]
    if unknown:
        raise ValueError(f"{path}: {unknown[0]} is not known: expected {', '.join(_KEYS)}")
    return table


def _check(path: Path, table: dict[str, Any]) -> None:
    """Raise ValueError for an invalid suite; the renderer checks the shot."""
    words = {str: "a text", int: "a whole number", dict: "a table"}
    for key, kind in {"title": str, "seed": int, "frames": dict, "shot": dict}.items():
        if not isinstance(table.get(key), kind):
            raise ValueError(f"{path}: {key} = {table.get(key)!r}: expected {words[kind]}")
    for size in ("smoke", "standard"):
        count = table["frames"].get(size)
        # Fewer than three frames have no two increments to compare.
        if not isinstance(count, int) or count < 3:
            raise ValueError(f"{path}: frames.{size} = {count!r}: expected a whole number of at least 3")


def merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """``base`` with ``changes``: tables are merged, all other values, lists included, are replaced."""
    both = dict(base)
    for key, value in changes.items():
        old = both.get(key)
        both[key] = merged(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return both
