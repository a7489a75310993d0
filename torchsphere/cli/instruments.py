"""The command ``torchsphere instruments``: a light gate or an accelerometer beside the result of a track."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchsphere.cli.console import say
from torchsphere.cli.options import add_command, add_quiet

if TYPE_CHECKING:
    from torchsphere.instruments.signals import Signals
    from torchsphere.results.reader import SIMotion

#: Units of times in a file, s.
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}

Lines = list[tuple[str, str]]


def add(commands: Any) -> None:
    """Add the command to the parser."""
    text = "Compare a result with the signals of a light gate or of an accelerometer."
    example = (
        "examples:  torchsphere instruments result --gate gate.csv --spacing-mm 40   or   torchsphere instruments "
        "result --accelerometer sensor.csv --direction-deg 180"
    )
    parser = add_command(commands, "instruments", run, text, example)
    parser.description += " A signal is a CSV file with a line of names, a column of times and columns of numbers."
    parser.add_argument("folder", type=Path, metavar="DIR", help="what 'track' wrote, with frame rate and scale")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--gate", type=Path, metavar="CSV", help="signals of two barriers, in the order of passage")
    source.add_argument("--accelerometer", type=Path, metavar="CSV", help="an accelerometer's signal, m/s^2")
    parser.add_argument("--spacing-mm", type=_positive, metavar="L", help="distance of the barriers; --gate needs it")
    parser.add_argument("--sd-spacing-mm", type=_length, default=0.0, metavar="SD", help="its standard deviation [0]")
    parser.add_argument(
        "--direction-deg",
        type=_number,
        default=0.0,
        metavar="A",
        help="direction in which the accelerometer measures, from x towards y of the result's frame [0]",
    )
    parser.add_argument("--columns", metavar="NAME[,NAME]", help="columns of the signals [the first after the times]")
    parser.add_argument("--time-column", default="time_s", metavar="NAME", help="column of the times [time_s]")
    parser.add_argument("--time-unit", choices=TIME_UNITS, default="s", help="unit of the times [s]")
    parser.add_argument("--plot", type=Path, metavar="PNG", help="draw the accelerometer over the track")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON instead of a table")
    add_quiet(parser, "no table")


def run(options: dict[str, Any]) -> int:
    """Compare and print; raises ValueError or OSError where a file cannot be used."""
    from torchsphere.instruments.signals import read_signals
    from torchsphere.results import reader

    result = reader.read(options["folder"])
    if result.motion is None:
        raise ValueError(
            f"{result.path}: has no velocities, as frame rate or scale are not known; track again with --fps and "
            "--diameter-mm"
        )
    path, unit = options["gate"] or options["accelerometer"], TIME_UNITS[options["time_unit"]]
    signals = read_signals(path, time=options["time_column"], time_unit_s=unit)
    if options["gate"]:
        numbers, lines = _gate(signals, result.motion, result.contact_s, options)
    else:
        numbers, lines = _accelerometer(signals, result.motion, options)
    if options["json"]:
        print(json.dumps(numbers, indent=2, allow_nan=False))
        return 0
    for label, value in lines:
        say(options["quiet"], f"{label:<20}  {value}")
    return 0


def _gate(
    signals: Signals, motion: SIMotion, contact_s: tuple[float, float] | None, options: Mapping[str, Any]
) -> tuple[dict[str, Any], Lines]:
    """Numbers and lines of the velocity by the gate beside the track's before the contact."""
    from torchsphere.instruments.signals import light_gate, mean_speed
    from torchsphere.report.summary_tables import with_sd

    if options["spacing_mm"] is None:
        raise ValueError("--gate needs --spacing-mm, the distance of the two barriers")
    if options["plot"] is not None:
        raise ValueError("--plot draws an accelerometer; leave it out with --gate")
    first, second = _columns(signals, options, 2)
    found = light_gate(
        signals.time_s,
        first,
        second,
        spacing_m=1e-3 * options["spacing_mm"],
        sd_spacing_m=1e-3 * options["sd_spacing_mm"],
    )
    speed, sd = mean_speed(motion, math.inf if contact_s is None else contact_s[0])
    difference, sd_difference = found.velocity_m_s - speed, math.hypot(found.sd_velocity_m_s, sd)
    numbers = dataclasses.asdict(found) | {
        "track_speed_m_s": speed,
        "sd_track_speed_m_s": sd,
        "difference_m_s": difference,
        "sd_difference_m_s": sd_difference,
    }
    lines = [
        ("light gate", with_sd(found.velocity_m_s, found.sd_velocity_m_s, "m/s")),
        ("its delay", with_sd(found.delay_s, found.sd_delay_s, "us", 1e6)),
        ("correlation", f"{found.correlation:.4f}"),
        ("track before contact" if contact_s else "track", with_sd(speed, sd, "m/s")),
        ("gate less track", with_sd(difference, sd_difference, "m/s")),
    ]
    return numbers, lines


def _accelerometer(signals: Signals, motion: SIMotion, options: Mapping[str, Any]) -> tuple[dict[str, Any], Lines]:
    """Numbers and lines of the accelerometer aligned with the track; draws both if asked to."""
    import numpy as np

    from torchsphere.instruments.signals import align
    from torchsphere.report.summary_tables import with_sd

    (signal,) = _columns(signals, options, 1)
    angle = math.radians(options["direction_deg"])
    found = align(motion, signals.time_s, signal, direction=np.array([math.cos(angle), math.sin(angle)]))
    if options["plot"] is not None:
        _plot(found, options["plot"])
    arrays = ("time_s", "track_m_s2", "sensor_m_s2")
    numbers = {name: value for name, value in dataclasses.asdict(found).items() if name not in arrays}
    lines = [
        ("time 0 of the track", f"{with_sd(found.delay_s, found.sd_delay_s, 'ms', 1e3)} of the sensor"),
        ("correlation", f"{found.correlation:.4f}"),
        ("sensor over track", with_sd(found.gain, found.sd_gain, "")),
        ("peak", f"track {found.peak_track_m_s2:.4g}, sensor {found.peak_sensor_m_s2:.4g} m/s^2"),
        ("change of velocity", f"track {found.change_track_m_s:.4g}, sensor {found.change_sensor_m_s:.4g} m/s"),
        ("rms difference", f"{found.rms_difference_m_s2:.3g} m/s^2"),
    ]
    return numbers, lines + ([("figure", str(options["plot"]))] if options["plot"] is not None else [])


def _plot(found: Any, path: Path) -> None:
    from torchsphere.report.instrument_figure import alignment_figure
    from torchsphere.results.atomic_output import atomic_path

    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as part:
        alignment_figure(found).savefig(part, format="png")


def _columns(signals: Signals, options: Mapping[str, Any], count: int) -> list[Any]:
    """The signals of ``count`` columns, those named or else the first."""
    given = options["columns"]
    names = list(signals.values)[:count] if given is None else [name.strip() for name in given.split(",")]
    missing = [name for name in names if name not in signals.values]
    if len(names) != count or missing:
        wanted = "two columns, one for each barrier" if count == 2 else "one column"
        problem = f"got {', '.join(map(repr, names)) or 'none'}"
        raise ValueError(
            f"--columns: expected {wanted}, {problem}; the file has {', '.join(map(repr, signals.values)) or 'none'}"
        )
    return [signals.values[name] for name in names]


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"expected a finite number, got {text!r}")
    return value


def _positive(text: str) -> float:
    value = _number(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"expected a positive length in mm, got {text!r}")
    return value


def _length(text: str) -> float:
    value = _number(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"expected a length in mm, 0 or more, got {text!r}")
    return value
