"""Signals from the files of loggers and oscilloscopes: times in s, and columns of numbers with their units."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torchsphere.instruments.delay import MIN_SAMPLES
from torchsphere.instruments.sample_times import (
    MAX_UNEVENNESS,
    clock_times,
    epoch_unit,
    evened,
    is_clock_time,
    last_digits,
    uneven_step,
)
from torchsphere.instruments.signal_text import Column, Table, is_number, read_table
from torchsphere.instruments.units import TIME, converted
from torchsphere.runtime.arrays import Array
from torchsphere.runtime.warning_levels import severe
from torchsphere.settings.limits import SettingError, require_one_of, require_positive

#: Names of a column of times.
_TIME_NAMES = re.compile(
    r"(rel\w*\W*|abs\w*\W*|date\W*)?(time|timestamp|t|zeit|uhrzeit|temps|tiempo|tempo)(?![a-z0-9])", re.IGNORECASE
)


@dataclass(frozen=True)
class Signals:
    """Columns of a file.

    Attributes
    ----------
    path : Path
        The file.
    time_s : ndarray
        Times (n,), rising and even to 1 %.
    values : dict
        Values (n,) by the names of their columns, in the file's units.
    units : dict
        Texts of these units; empty where neither brackets nor a line of units state one.
    lines : ndarray
        Numbers (n,) of their lines.
    times : str
        Where the times are from.
    warnings : tuple of str
        On the times.
    """

    path: Path
    time_s: Array
    values: dict[str, Array]
    units: dict[str, str]
    lines: NDArray[np.int64]
    times: str
    warnings: tuple[str, ...]

    def signal(self, name: str) -> Array:
        """The values of a column; ValueError where one is not finite, with its line, or all are the same."""
        values = self.values[name]
        wrong = np.flatnonzero(~np.isfinite(values))
        if len(wrong):
            raise ValueError(
                f"{self.path}, line {self.lines[wrong[0]]}: {name!r} is {values[wrong[0]]:g}, as in {len(wrong)} lines "
                "in all; give a part without them, or fill them in"
            )
        if not np.ptp(values) > 0:
            raise ValueError(f"{self.path}: {name!r} is {values[0]:g} in all lines; give the column with the event")
        return values


def read_signals(
    path: str | Path, *, time_column: str | None = None, time_unit: str | None = None, sampling_hz: float | None = None
) -> Signals:
    """Read a text file of a logger or an oscilloscope: columns of numbers, as a rule one of times.

    Commas, semicolons, tabs or blanks part the columns; the decimal sign is a point or a comma. Names, a line of units
    and other lines may stand above. Times that the logger rounded are made even; times of day, and those since 1970,
    count from the first sample.

    Parameters
    ----------
    path : str or Path
        Text in UTF-8, UTF-16 or Latin-1.
    time_column : str, optional
        Name of the column of times; by default that whose name or unit says so, or else the first one, if it rises.
    time_unit : str, optional
        "s", "ms", "us" or "ns"; by default as the file states, or else "s".
    sampling_hz : float, optional
        Samples per second, in place of the times in the file.

    Raises
    ------
    ValueError
        If the file is no text, a line does not hold the numbers that the others do, two columns share a name, no
        column has times, or the times do not rise evenly.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    if time_unit is not None:
        require_one_of(tuple(TIME.factors))("time_unit", time_unit)
    table = read_table(path)
    names = [column.name for column in table.columns]
    repeated = next((name for name in names if names.count(name) > 1), None)
    if repeated is not None:
        raise ValueError(f"{path}: has two columns {repeated!r}; give each a name of its own")
    if len(table.lines) < MIN_SAMPLES:
        raise ValueError(f"{path}: expected {MIN_SAMPLES} or more lines of numbers, got {len(table.lines)}")
    numbers = {column.name: _numbers(path, column, table.lines) for column in table.columns}
    column = _time_column(path, table.columns, numbers, time_column)
    if sampling_hz is not None:
        times, said, warnings = _given_times(sampling_hz, len(table.lines), _stated_interval(table, column, numbers))
    elif column is None or (time_unit is None and _counts(column, numbers[column.name])):
        times, said, warnings = _counted_times(path, table)
    else:
        times, said, warnings = _times(path, table.lines, column, numbers[column.name], time_unit)
    # Numbers of the samples before their times are no signal.
    before = () if column is None else table.columns[: table.columns.index(column)]
    left_out = [column, *(other for other in before if _counts(other, numbers[other.name]))]
    others = [other for other in table.columns if other not in left_out]
    return Signals(
        path,
        times,
        {other.name: numbers[other.name] for other in others},
        {other.name: other.unit for other in others},
        np.array(table.lines),
        said,
        warnings,
    )


def _numbers(path: Path, column: Column, lines: Sequence[int]) -> Array:
    """The numbers of a column; times of day in s after the first."""
    is_clock = is_clock_time(column.cells[0])
    try:
        return clock_times(column.cells)[0] if is_clock else np.array(column.cells, dtype=np.float64)
    except ValueError:
        fits, expected = (is_clock_time, "a time of day") if is_clock else (is_number, "a number")
        wrong = next(k for k, cell in enumerate(column.cells) if not fits(cell))
        raise ValueError(
            f"{path}, line {lines[wrong]}: expected {expected} in column {column.name!r}, got "
            f"{column.cells[wrong]!r}; mend this line, or cut the file above it"
        ) from None


def _time_column(
    path: Path, columns: Sequence[Column], numbers: Mapping[str, Array], given: str | None
) -> Column | None:
    """The column of times: the given one, one that says so, or the first one, if it rises."""
    if given is not None:
        named = [column for column in columns if given.strip() == column.name]
        if not named:
            listed = ", ".join(repr(column.name) for column in columns)
            raise SettingError(f"{path}: has no column {given!r} of numbers for `time_column`; it has {listed}")
        return named[0]
    says_so = (
        lambda column: is_clock_time(column.cells[0]),
        lambda column: _TIME_NAMES.match(column.name),
        lambda column: TIME.stated(column.name, column.unit),
    )
    for says in says_so:
        for column in columns:
            if says(column):
                return column
    first = numbers[columns[0].name]
    return columns[0] if first[-1] > first[0] and (np.diff(first) >= 0).all() else None


def _counts(column: Column, numbers: Array) -> bool:
    """Whether a column counts the samples: whole steps of no unit, which do not begin in 1970 either."""
    bare = TIME.stated(column.name, column.unit) is None and epoch_unit(numbers[0]) is None
    return bare and bool((np.diff(numbers) == 1).all())


def _given_times(sampling_hz: float, count: int, stated_s: float | None) -> tuple[Array, str, tuple[str, ...]]:
    """Times by a given rate, how they were read, and a warning where the file states another."""
    require_positive("sampling_hz", sampling_hz)
    interval = 1 / sampling_hz
    differs = stated_s is not None and abs(stated_s / interval - 1) > MAX_UNEVENNESS
    warning = f"The file has a sample every {stated_s or 0:.6g} s, and `sampling_hz` says {interval:.6g} s"
    times = interval * np.arange(count, dtype=np.float64)
    return times, f"by {sampling_hz:g} samples per second, as given", (severe(warning),) * differs


def _stated_interval(table: Table, column: Column | None, numbers: Mapping[str, Array]) -> float | None:
    """The mean interval of the samples by times with a unit, or as stated above them, s."""
    if column is not None:
        times = numbers[column.name]
        unit = TIME.si if is_clock_time(column.cells[0]) else TIME.stated(column.name, column.unit)
        if unit is not None:
            return TIME.factors[unit] * float(times[-1] - times[0]) / (len(times) - 1)
    return table.interval_s


def _counted_times(path: Path, table: Table) -> tuple[Array, str, tuple[str, ...]]:
    """Times by the interval that the file states."""
    if table.interval_s is None or not table.interval_s > 0:
        listed = ", ".join(repr(column.name) for column in table.columns)
        raise SettingError(
            f"{path}: no column has times, among {listed}; name it with `time_column`, give its unit with `time_unit` "
            "if it counts units of time, or give the samples per second with `sampling_hz`"
        )
    times = table.interval_s * np.arange(len(table.lines), dtype=np.float64)
    return (table.start_s or 0.0) + times, "as the file states", ()


def _times(
    path: Path, lines: Sequence[int], column: Column, numbers: Array, given: str | None
) -> tuple[Array, str, tuple[str, ...]]:
    """Even times of a column, s, how they were read, and warnings."""
    texts: Sequence[str] = column.cells
    warnings: tuple[str, ...] = ()
    if is_clock_time(texts[0]):
        factor, said = 1.0, f"of {column.name!r}, after {texts[0]}"
        texts = clock_times(texts)[1]
    else:
        factor, said, warnings = _time_scale(path, column, numbers, given)
    times = factor * numbers
    if epoch_unit(times[0]) == TIME.si:
        times, said = factor * (numbers - numbers[0]), f"{said}, after {texts[0]}"
    wrong = uneven_step(times)
    if wrong is None:
        return times, said, warnings
    digits = factor * last_digits(texts, numbers)
    even = evened(times, digits)
    if even is None:
        steps = np.diff(times)
        raise SettingError(
            f"{path}, line {lines[wrong]}: a step of {steps[wrong - 1]:g} s in {column.name!r}, where most are of "
            f"{np.median(steps):g} s; give a part without gaps, resample it, or, if the samples are even, give "
            "`sampling_hz`"
        )
    return even, f"{said}, rounded to {np.median(digits):.2g} s and made even", warnings


def _time_scale(path: Path, column: Column, numbers: Array, given: str | None) -> tuple[float, str, tuple[str, ...]]:
    """The factor of times to s, where it is from, and warnings."""
    if given is None and column.unit and TIME.unit(column.unit) is None:
        raise SettingError(
            f"{path}: column {column.name!r} states {column.unit!r}, none of the units {', '.join(TIME.factors)}; give "
            "its `time_unit`, or another `time_column`"
        )
    bare = given is None and TIME.stated(column.name, column.unit) is None
    epoch = epoch_unit(numbers[0]) if bare else None
    factor, unit, warnings = converted(TIME, column.name, column.unit, given or epoch)
    return factor, f"of {column.name!r} in {f'{epoch} since 1970' if epoch else unit}", warnings
