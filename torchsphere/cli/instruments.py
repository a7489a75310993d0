"""The command ``torchsphere instruments``: light gate, accelerometer or strain gauge beside the result of a track."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchsphere.cli.console import say
from torchsphere.cli.exit_codes import UsageError
from torchsphere.cli.options import add_command, add_quiet
from torchsphere.runtime import steps

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from torchsphere.instruments.bar import Bar
    from torchsphere.instruments.signals import Signals
    from torchsphere.instruments.strain_gauge import BarForce
    from torchsphere.results.reader import ResultFolder, SIMotion

#: Units of times in a file, s.
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}

#: Units of strain in a file.
STRAIN_UNITS = {"strain": 1.0, "percent": 1e-2, "microstrain": 1e-6}

#: Options of the bar, and their values unless given.
BAR_OPTIONS: dict[str, Any] = {
    "bar_diameter_mm": None,
    "bar_area_mm2": None,
    "bar_modulus_gpa": None,
    "bar_density_kg_m3": None,
    "bar_wave_speed_m_s": None,
    "bar_length_mm": None,
    "gauge_distance_mm": None,
    "sd_bar_percent": 0.0,
    "strain_unit": "strain",
    "compression_positive": False,
    "delay_ms": None,
    "sd_delay_ms": 0.0,
}

Lines = list[tuple[str, str]]


def add(commands: Any) -> None:
    """Add the command to the parser."""
    text = "Compare a result with the signals of a light gate, of an accelerometer, or of strain gauges on a bar."
    example = (
        "examples:  torchsphere instruments result --gate gate.csv --spacing-mm 40   or   torchsphere instruments "
        "result --accelerometer sensor.csv --direction-deg 180   or   torchsphere instruments result --strain-gauge "
        "bar.csv --strain-unit microstrain --bar-diameter-mm 40 --bar-modulus-gpa 210 --bar-density-kg-m3 7850 "
        "--gauge-distance-mm 500 --bar-length-mm 3000"
    )
    parser = add_command(commands, "instruments", run, text, example)
    parser.description += " A signal is a CSV file with a line of names, a column of times and columns of numbers."
    parser.add_argument("folder", type=Path, metavar="DIR", help="what 'track' wrote, with frame rate and scale")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--gate", type=Path, metavar="CSV", help="signals of two barriers, in the order of passage")
    source.add_argument("--accelerometer", type=Path, metavar="CSV", help="an accelerometer's signal, m/s^2")
    source.add_argument("--strain-gauge", type=Path, metavar="CSV", help="strain of a long bar that the ball hits")
    parser.add_argument("--spacing-mm", type=_positive, metavar="L", help="distance of the barriers; --gate needs it")
    parser.add_argument(
        "--sd-spacing-mm", type=_magnitude, default=0.0, metavar="SD", help="its standard deviation [0]"
    )
    parser.add_argument(
        "--direction-deg",
        type=_number,
        metavar="A",
        help="direction in which the accelerometer measures [0], or from the bar to the ball [the impact's normal], "
        "from x towards y of the result's frame",
    )
    columns = "columns of the signals [the first after the times]; of several strain gauges the mean is taken"
    parser.add_argument("--columns", metavar="NAME[,NAME]", help=columns)
    parser.add_argument("--time-column", default="time_s", metavar="NAME", help="column of the times [time_s]")
    parser.add_argument("--time-unit", choices=TIME_UNITS, default="s", help="unit of the times [s]")
    parser.add_argument(
        "--plot", type=Path, metavar="PNG", help="draw the accelerometer, or the bar's force, over the track"
    )
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON instead of a table")
    add_quiet(parser, "no table")
    _add_bar(parser.add_argument_group("the bar with the strain gauge"))


def _add_bar(group: Any) -> None:
    """Add the options of the bar."""
    section, waves = group.add_mutually_exclusive_group(), group.add_mutually_exclusive_group()
    section.add_argument("--bar-diameter-mm", type=_positive, metavar="D", help="diameter of a round, solid bar, mm")
    section.add_argument("--bar-area-mm2", type=_positive, metavar="A", help="or its cross-section, mm^2")
    group.add_argument("--bar-modulus-gpa", type=_positive, metavar="E", help="Young's modulus, GPa")
    waves.add_argument("--bar-density-kg-m3", type=_positive, metavar="RHO", help="density, kg/m3")
    waves.add_argument("--bar-wave-speed-m-s", type=_positive, metavar="C", help="or speed of a long wave, m/s")
    group.add_argument("--gauge-distance-mm", type=_magnitude, metavar="L", help="from the struck end to the gauge, mm")
    length = "from the struck end to the far end, mm: the force ends where the reflection arrives [no reflection]"
    group.add_argument("--bar-length-mm", type=_positive, metavar="L", help=length)
    percent = "standard deviation of modulus times cross-section times the gauge's sensitivity, %% [0]"
    group.add_argument("--sd-bar-percent", type=_magnitude, default=0.0, metavar="SD", help=percent)
    group.add_argument("--strain-unit", choices=STRAIN_UNITS, default="strain", help="unit of the strains [strain]")
    sign = "the record shows compression as positive [negative]"
    group.add_argument("--compression-positive", action="store_true", help=sign)
    delay = "time of the record's clock at time 0 of the track, ms [where both forces agree best]"
    group.add_argument("--delay-ms", type=_number, metavar="T", help=delay)
    group.add_argument("--sd-delay-ms", type=_magnitude, default=0.0, metavar="SD", help="its standard deviation [0]")


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
    if options["strain_gauge"] is None:
        given = [f"--{name.replace('_', '-')}" for name, usual in BAR_OPTIONS.items() if options[name] != usual]
        if given:
            raise UsageError(f"{', '.join(given)}: of a bar; add --strain-gauge, or leave it out")
    path = options["gate"] or options["accelerometer"] or options["strain_gauge"]
    steps.tell_if_large([path], "reading %s", path)
    signals = read_signals(path, time=options["time_column"], time_unit_s=TIME_UNITS[options["time_unit"]])
    if options["strain_gauge"]:
        numbers, lines = _strain_gauge(signals, result, options)
    elif options["gate"]:
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
        raise UsageError("--gate needs --spacing-mm, the distance of the two barriers")
    if options["plot"] is not None:
        raise UsageError("--plot draws an accelerometer or a bar's force; leave it out with --gate")
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
    angle = math.radians(options["direction_deg"] or 0.0)
    found = align(motion, signals.time_s, signal, direction=np.array([math.cos(angle), math.sin(angle)]))
    if options["plot"] is not None:
        from torchsphere.report.instrument_figure import alignment_figure

        _save(alignment_figure(found), options["plot"])
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


def _strain_gauge(signals: Signals, result: ResultFolder, options: Mapping[str, Any]) -> tuple[dict[str, Any], Lines]:
    """Numbers and lines of the bar's force beside that of the track; draws both if asked to."""
    import numpy as np

    from torchsphere.instruments.strain_gauge import compare_bar

    bar = _bar(options)
    mass_g, contact, angle = result.summary["settings"].get("mass_g"), result.contact_s, _normal_deg(result, options)
    if mass_g is None:
        raise ValueError(f"{result.path}: has no mass, so that there is no force; track again with --mass-g")
    if contact is None:
        raise ValueError(f"{result.path}: no contact was found in it, so that there is no force to compare")
    assert result.motion is not None  # the caller has refused a result without
    names = 1 if options["columns"] is None else options["columns"].count(",") + 1
    scale = STRAIN_UNITS[options["strain_unit"]]
    found = compare_bar(
        result.motion,
        signals.time_s,
        [scale * column for column in _columns(signals, options, names)],
        bar,
        mass_kg=1e-3 * mass_g,
        contact_s=contact,
        direction=np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))]),
        delay_s=None if options["delay_ms"] is None else 1e-3 * options["delay_ms"],
        sd_delay_s=1e-3 * options["sd_delay_ms"],
        compression_positive=options["compression_positive"],
    )
    if options["plot"] is not None:
        from torchsphere.report.instrument_figure import bar_figure

        _save(bar_figure(found), options["plot"])
    arrays = ("time_s", "track_N", "sd_track_N", "bar_N", "sd_bar_N")
    numbers = {name: value for name, value in dataclasses.asdict(found).items() if name not in arrays}
    curves = {name: [float(v) if math.isfinite(v) else None for v in getattr(found, name)] for name in arrays}
    lines = _bar_lines(found)
    return numbers | curves, lines + ([("figure", str(options["plot"]))] if options["plot"] is not None else [])


def _bar(options: Mapping[str, Any]) -> Bar:
    """The bar of the options; raises ValueError, with the options' names, if a value is missing."""
    from torchsphere.instruments.bar import bar

    needed = (
        (("bar_diameter_mm", "bar_area_mm2"), "its diameter or its cross-section"),
        (("bar_modulus_gpa",), "its modulus"),
        (("bar_density_kg_m3", "bar_wave_speed_m_s"), "its density or its wave speed"),
        (("gauge_distance_mm",), "the gauge's distance from the struck end"),
    )
    for names, words in needed:
        if all(options[name] is None for name in names):
            listed = " or ".join(f"--{name.replace('_', '-')}" for name in names)
            raise UsageError(f"--strain-gauge needs {words}: give {listed}")

    def given(name: str, factor: float) -> float | None:
        return None if options[name] is None else factor * options[name]

    return bar(
        modulus_pa=1e9 * options["bar_modulus_gpa"],
        distance_m=1e-3 * options["gauge_distance_mm"],
        area_m2=given("bar_area_mm2", 1e-6),
        diameter_m=given("bar_diameter_mm", 1e-3),
        density_kg_m3=options["bar_density_kg_m3"],
        wave_speed_m_s=options["bar_wave_speed_m_s"],
        length_m=given("bar_length_mm", 1e-3),
        relative_sd=0.01 * options["sd_bar_percent"],
    )


def _normal_deg(result: ResultFolder, options: Mapping[str, Any]) -> float:
    """Direction from the bar to the ball: as given, or the normal of the impact."""
    if options["direction_deg"] is not None:
        return float(options["direction_deg"])
    normal = ((result.summary.get("impact") or {}).get("normal_direction") or {}).get("value")
    if normal is None:
        raise ValueError(f"{result.path}: has no impact with a normal; give --direction-deg, from the bar to the ball")
    return float(normal)


def _bar_lines(found: BarForce) -> Lines:
    """The comparison as lines of a table."""
    from torchsphere.report.summary_tables import with_sd

    def both(name: str, unit: str, factor: float = 1.0) -> str:
        pairs = ((getattr(found, f"{name}_{of}"), getattr(found, f"sd_{name}_{of}")) for of in names)
        track, by_bar = (with_sd(value, sd, unit, factor) for value, sd in pairs)
        return f"track {track}, bar {by_bar}"

    names = ("track_N", "bar_N")
    lines = [
        ("time 0 of the track", f"{with_sd(found.delay_s, found.sd_delay_s, 'ms', 1e3)} of the record"),
        ("travel to the gauge", f"{1e3 * found.travel_s:.4f} ms"),
        ("correlation", f"{found.correlation:.4f}"),
        ("bar over track", with_sd(found.gain, found.sd_gain, "")),
        ("peak force", both("peak", "kN", 1e-3)),
    ]
    names = ("track_N_s", "bar_N_s")
    lines.append(("impulse", both("impulse", "N s")))
    rms = with_sd(found.rms_difference_N, found.sd_rms_difference_N, "N")
    lines.append(("rms difference", f"{rms}; {found.expected_rms_difference_N:.3g} N by both uncertainties"))
    if found.valid_until_s is not None:
        lines.append(("reflection arrives", f"{1e3 * found.valid_until_s:.4f} ms of the track; no force from there on"))
    return lines


def _save(figure: Figure, path: Path) -> None:
    """Write the figure as a PNG file."""
    from torchsphere.results.atomic_output import atomic_path

    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_path(path) as part:
        figure.savefig(part, format="png")


def _columns(signals: Signals, options: Mapping[str, Any], count: int) -> list[Any]:
    """The signals of ``count`` columns, those named or else the first."""
    given = options["columns"]
    names = list(signals.values)[:count] if given is None else [name.strip() for name in given.split(",")]
    missing = [name for name in names if name not in signals.values]
    if len(names) != count or missing:
        wanted = "two columns, one for each barrier" if options["gate"] else "columns of the file, one or several"
        if options["accelerometer"]:
            wanted = "one column"
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
        raise argparse.ArgumentTypeError(f"expected a positive number, got {text!r}")
    return value


def _magnitude(text: str) -> float:
    value = _number(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"expected a number, 0 or more, got {text!r}")
    return value
