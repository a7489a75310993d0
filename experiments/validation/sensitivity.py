"""What half and twice the value of a constant do: ``python -m experiments.validation.sensitivity``.

Claim: with half and with twice the value of a constant of this table no frame changes its status, no number changes by
more than a tenth of its standard deviation, no standard deviation by more than a tenth of itself, and no sentence comes
or goes; or the errors against the truth are no less than with the value itself.

A constant is tried on recordings that read it: a profile of the calls says in which functions these have been, and the
code of these which constants it reads. Of each kind of recordings (`sensitivity_recordings`) it takes those in which
its part of the program has most to do, and the first `MOST` of all.
A number of things becomes a whole number; a share or correlation of a half and more changes in its distance from 1; a
power of ten by the logarithm of 2. A constant that another one is computed from at import, or that a compiled loop
holds, cannot be changed in this way and is not in the table.

Where not a digit changes the recordings tell only that they are far from the limit that the constant is.

Results are kept in ``experiments/cache``. The table has the constants of ``docs/constants.toml`` that name this
command; ``--constant NAME`` measures these alone, anew, and prints them.
"""

from __future__ import annotations

import argparse
import ast
import functools
import importlib
import math
import sys
import threading
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from types import CodeType, FrameType, ModuleType
from typing import Any

import numpy as np

from experiments.experiment import CACHE, DOCS, cached, key_of, publish, table
from experiments.validation.sensitivity_recordings import BUSY, Measurement, Outcome, recordings

#: Recordings of a kind on which every constant is tried.
MOST = 3

#: Kinds of recordings on which the constants of a package are tried, if not on images and impacts.
KINDS = {"estimation": ("impacts",), "benchmark": ("baselines",)}

#: Change of a number that counts as none, in its standard deviations: that of the law of continuity.
NEGLIGIBLE_SD = 0.1

#: Growth of the errors that is no growth: that of a root mean square of a hundred numbers by chance.
NO_GROWTH = 0.05

#: The command that measures a constant again.
COMMAND = "python -m experiments.validation.sensitivity"

#: Constants by their names, with the rows of the file of the constants.
ROWS: dict[str, dict[str, Any]] = {
    f"{package}.{name}": row
    for package, entries in tomllib.loads((DOCS / "constants.toml").read_text(encoding="utf-8")).items()
    for name, row in entries.items()
}


@dataclass(frozen=True)
class Effect:
    """What another value of a constant changed, over the recordings on which it was tried."""

    value: str
    statuses: int = 0  # frames with another status
    ok: int = 0  # change of the number of "ok" frames
    silent: int = 0  # change of the number of frames that are wrong without a word
    sentences: int = 0  # that came or went
    largest_sd: float = 0.0  # largest change of a number in its standard deviations, or of one of these in itself
    errors: float = 1.0  # ratio of the root mean squares of the errors, geometric mean over the recordings
    refused: str = ""  # the sentence of a failure

    @property
    def is_none(self) -> bool:
        """Whether nothing changed that counts."""
        changed = self.statuses or self.sentences or self.refused
        return not changed and self.largest_sd <= NEGLIGIBLE_SD

    @property
    def is_worse(self) -> bool:
        """Whether the recordings are measured no better than with the value itself."""
        return bool(self.refused) or (self.ok <= 0 and self.silent >= 0 and self.errors >= 1 - NO_GROWTH)

    def cells(self) -> tuple[str, ...]:
        """Cells of the table."""
        if self.refused:
            return self.value, "fails", "", ""
        said = f", {self.sentences} sentences" if self.sentences else ""
        counts = f"{self.statuses} ({self.ok:+d} ok, {self.silent:+d} silent)" if self.statuses else "0"
        return self.value, counts + said, f"{self.largest_sd:.3f}", f"{self.errors:.3f}"


@dataclass(frozen=True)
class Sensitivity:
    """Half and twice the value of a constant."""

    name: str
    tried: tuple[str, ...]  # recordings
    half: Effect
    twice: Effect

    @property
    def verdict(self) -> str:
        """A few words: "not a digit", "no effect", "none better", or "open"."""
        effects = self.half, self.twice
        if all(effect.is_none for effect in effects):
            return "no effect" if any(effect.largest_sd for effect in effects) else "not a digit"
        return "none better" if all(effect.is_none or effect.is_worse for effect in effects) else "open"


def other(value: Any, unit: str, factor: float) -> Any:
    """The value of a constant, half or twice as large by its unit; None where it has no such value."""
    if isinstance(value, tuple):
        parts = tuple(other(part, unit, factor) for part in value)
        return None if None in parts else parts
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    if unit.startswith("powers of ten"):
        return value + math.log10(factor)
    if 0.5 <= value < 1 and (unit == "-" or unit.startswith(("share", "correlation"))):
        return 1 - (1 - value) * factor
    return round(value * factor) if isinstance(value, int) else value * factor


def shown(value: Any) -> str:
    """A value to four digits."""
    if isinstance(value, tuple):
        return f"({', '.join(map(shown, value))})"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def kinds_of(constant: str) -> tuple[str, ...]:
    """Kinds of recordings on which a constant is tried."""
    return KINDS.get(constant.split(".")[0], ("images", "impacts"))


def modules() -> dict[str, ModuleType]:
    """All modules of the program that are loaded."""
    return {name: module for name, module in sys.modules.items() if name.startswith("torchsphere.")}


def names_of_constants() -> dict[tuple[str, str], str]:
    """Constants by the modules and the names that they have there: in their own, and where they are imported."""
    found = {}
    for constant in ROWS:
        own, name = constant.rsplit(".", 1)
        found[f"torchsphere.{own}", name] = constant
    for home, module in modules().items():
        for node in ast.walk(ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                taken = {alias.asname or alias.name: (str(node.module), alias.name) for alias in node.names}
                found |= {(home, name): found[origin] for name, origin in taken.items() if origin in found}
    return found


def constants_read(measurement: Measurement, known: dict[tuple[str, str], str]) -> frozenset[str]:
    """Constants in the code that a measurement calls."""
    called: set[tuple[str, CodeType]] = set()

    def note(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_globals.get("__name__", "").startswith("torchsphere."):
            called.add((frame.f_globals["__name__"], frame.f_code))

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        measured(measurement)
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return frozenset(constant for home, code in called for constant in _constants_in(home, code, known))


def _constants_in(home: str, code: CodeType, known: dict[tuple[str, str], str]) -> Iterator[str]:
    for name in code.co_names:
        if (home, name) in known:
            yield known[home, name]
        # A constant of a module that was imported as a whole.
        part = getattr(sys.modules[home], name, None)
        if isinstance(part, ModuleType):
            yield from (known[part.__name__, other] for other in code.co_names if (part.__name__, other) in known)


@contextmanager
def changed(constant: str, value: Any, known: dict[tuple[str, str], str]) -> Iterator[None]:
    """The program with another value of a constant."""
    places = [(sys.modules[home], name) for (home, name), one in known.items() if one == constant]
    before = [getattr(module, name) for module, name in places]
    try:
        for module, name in places:
            setattr(module, name, value)
        _forget()
        yield
    finally:
        for (module, name), old in zip(places, before, strict=True):
            setattr(module, name, old)
        _forget()


def _forget() -> None:
    """Empty the caches of all functions: what they hold may depend on a constant."""
    for module in modules().values():
        for part in vars(module).values():
            getattr(part, "cache_clear", lambda: None)()


def measured(measurement: Measurement) -> Outcome | str:
    """The outcome, or the sentence of a refusal or a failure."""
    try:
        return measurement()
    except Exception as failure:  # any value may be one that the program cannot run with
        return f"{type(failure).__name__}: {failure}"


def effect(value: Any, pairs: Sequence[tuple[Outcome | str, Outcome | str]]) -> Effect:
    """What changed from the first to the second outcome of each recording."""
    both = [(a, b) for a, b in pairs if isinstance(a, Outcome) and isinstance(b, Outcome)]
    refused = [str(b if isinstance(b, str) else a) for a, b in pairs if isinstance(a, str) != isinstance(b, str)]
    differences = [
        (sum(x != y for x, y in zip(a.status, b.status, strict=True)), b.status.count("ok") - a.status.count("ok"))
        for a, b in both
    ]
    return Effect(
        value=shown(value),
        statuses=sum(statuses for statuses, _ in differences),
        ok=sum(ok for _, ok in differences),
        silent=sum(b.silent - a.silent for a, b in both),
        sentences=sum(len(a.said ^ b.said) for a, b in both),
        largest_sd=max((_largest_change(a, b) for a, b in both), default=0.0),
        errors=math.exp(np.mean([_growth(a, b) for a, b in both])) if both else 1.0,
        refused=refused[0] if refused else "",
    )


def _largest_change(one: Outcome, two: Outcome) -> float:
    sds = np.where(one.sd > 0, one.sd, np.nan)
    changes = np.stack((np.abs(two.number - one.number), np.abs(two.sd - one.sd))) / sds
    return float(np.nanmax(changes)) if np.isfinite(changes).any() else 0.0


def _growth(one: Outcome, two: Outcome) -> float:
    """Logarithm of the ratio of the root mean squares of the errors of the numbers that both have."""
    shared = np.isfinite(one.error) & np.isfinite(two.error)
    squares = [float(np.sum(outcome.error[shared] ** 2)) for outcome in (one, two)]
    return 0.5 * math.log(squares[1] / squares[0]) if min(squares) > 0 else 0.0


@dataclass(frozen=True)
class Bench:
    """The recordings, what the program makes of them, and which constants each reads."""

    measurements: dict[str, dict[str, Measurement]]
    base: dict[str, Outcome | str]
    read: dict[str, frozenset[str]]
    known: dict[tuple[str, str], str]

    @classmethod
    def made(cls, constants: Sequence[str]) -> Bench:
        """Make and measure once all recordings on which these ``constants`` may be tried."""
        wanted = {kind for constant in constants for kind in kinds_of(constant)}
        kinds = {kind: made for kind, made in recordings().items() if kind in wanted}
        every = {name: measurement for kind in kinds.values() for name, measurement in kind.items()}
        base = {name: measured(measurement) for name, measurement in every.items()}
        known = names_of_constants()  # all modules are loaded now
        read = {name: constants_read(measurement, known) for name, measurement in every.items()}
        return cls(kinds, base, read, known)

    def sensitivity(self, constant: str) -> Sensitivity | None:
        """Half and twice a constant; None where no recording reads it, or it has no such values."""
        module, name = constant.rsplit(".", 1)
        value, unit = getattr(importlib.import_module(f"torchsphere.{module}"), name), ROWS[constant]["unit"]
        tried = [one for kind in kinds_of(constant) for one in self._readers(self.measurements[kind], constant)]
        values = [other(value, unit, factor) for factor in (0.5, 2.0)]
        if not tried or None in values:
            return None
        return Sensitivity(constant, tuple(tried), *(self._effect(constant, v, value, tried) for v in values))

    def _readers(self, kind: dict[str, Measurement], constant: str) -> list[str]:
        home = constant.rsplit(".", 1)[0]
        busy = (*BUSY.get(home, ()), *BUSY.get(home.split(".")[0], ()))
        reading = [name for name in kind if constant in self.read[name]]
        return list(dict.fromkeys([name for name in busy if name in reading] + reading[:MOST]))

    def _effect(self, constant: str, value: Any, present: Any, tried: Sequence[str]) -> Effect:
        if value == present:
            return effect(value, [])
        every = {name: measurement for kind in self.measurements.values() for name, measurement in kind.items()}
        with changed(constant, value, self.known):
            return effect(value, [(self.base[name], measured(every[name])) for name in tried])


@dataclass(frozen=True)
class LateBench:
    """A bench that is made when a first constant is not in the cache."""

    names: tuple[str, ...]

    @functools.cached_property
    def made(self) -> Bench:
        """The bench."""
        return Bench.made(self.names)

    def plain_sensitivity(self, constant: str) -> dict[str, Any] | None:
        """As the cache holds it."""
        found = self.made.sensitivity(constant)
        return None if found is None else asdict(found)


def compute(names: Sequence[str], *, anew: bool = False) -> list[Sensitivity]:
    """The constants that some recording reads."""
    bench, found = LateBench(tuple(names)), []
    for name in names:
        settings = {"constant": name, "value": ROWS[name]["value"]}
        if anew:
            (CACHE / f"{key_of('sensitivity', settings)}.json").unlink(missing_ok=True)
        one = cached("sensitivity", settings, functools.partial(bench.plain_sensitivity, name))
        if one is not None:
            effects = {side: Effect(**one[side]) for side in ("half", "twice")}
            found.append(Sensitivity(one["name"], tuple(one["tried"]), **effects))
    return found


def rows(found: Sequence[Sensitivity]) -> str:
    """The table."""
    effect_of = ("other statuses", "sd", "errors")
    head = ("constant", "value", "recordings", "verdict", "half", *effect_of, "twice", *effect_of)
    lines = [
        (f"`{one.name}`", ROWS[one.name]["value"], len(one.tried), one.verdict, *one.half.cells(), *one.twice.cells())
        for one in found
    ]
    return table(head, lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure the constants that name this command, or some without a table."""
    parser = argparse.ArgumentParser(prog=f"python -m experiments.validation.{Path(__file__).stem}")
    parser.add_argument(
        "--constant", choices=ROWS, metavar="NAME", action="append", help="only this one; may be repeated"
    )
    options = parser.parse_args(arguments)
    if options.constant:
        print(rows(compute(options.constant, anew=True)))
    else:
        chosen = [name for name, row in ROWS.items() if row.get("command") == COMMAND]
        publish("sensitivity", "validation.sensitivity", rows(compute(chosen)))


if __name__ == "__main__":
    main()
