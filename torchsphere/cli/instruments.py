"""The command ``torchsphere instruments``: light gate, accelerometer or strain gauge beside the result of a track."""

from __future__ import annotations

import dataclasses
import json
import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchsphere.cli.exit_codes import usage
from torchsphere.cli.options import add_command, add_quiet, add_settings
from torchsphere.cli.outcome import LABELS, in_red
from torchsphere.instruments.instrument_request import INSTRUMENT_SETTINGS, InstrumentRequest
from torchsphere.runtime import steps
from torchsphere.runtime.setting_names import as_options
from torchsphere.runtime.shown_text import shown
from torchsphere.runtime.warning_levels import SEVERE
from torchsphere.settings.configuration import given_settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from torchsphere.instruments.bar import Bar
    from torchsphere.instruments.signal_file import Signals
    from torchsphere.instruments.strain_gauge import BarForce
    from torchsphere.results.reader import ResultFolder

Lines = list[tuple[str, str]]


def add(commands: Any) -> None:
    """Add the command to the parser."""
    text = "Compare a result with the signals of a light gate, of an accelerometer, or of strain gauges on a bar."
    example = (
        "examples:  torchsphere instruments result --gate gate.csv --spacing-mm 40   or   torchsphere instruments "
        "result --accelerometer sensor.csv --unit g --direction-deg 180   or   torchsphere instruments result "
        "--strain-gauge bar.csv --unit microstrain --bar-diameter-mm 40 --bar-modulus-gpa 210 --bar-density-kg-m3 7850 "
        "--gauge-distance-mm 500 --bar-length-mm 3000"
    )
    parser = add_command(commands, "instruments", run, text, example)
    parser.description += (
        " A signal is a text file (CSV, LVM) of a logger or an oscilloscope: a column of times, and columns of numbers."
    )
    parser.add_argument("folder", type=Path, metavar="DIR", help="what 'track' wrote, with frame rate and scale")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON instead of a table")
    add_quiet(parser, "no table")
    add_settings(parser, INSTRUMENT_SETTINGS)


def run(options: dict[str, Any]) -> int:
    """Compare and print; raises ValueError or OSError where a file cannot be used."""
    from torchsphere.instruments.signal_file import read_signals
    from torchsphere.results import reader

    with usage():
        request = InstrumentRequest(**given_settings(options, INSTRUMENT_SETTINGS))
    result = reader.read(options["folder"])
    if result.motion is None:
        raise ValueError(
            f"{result.path}: has no velocities, as frame rate or scale are not known; track again with --fps and "
            "--diameter-mm"
        )
    steps.tell_if_large([request.path], "reading %s", request.path)
    signals = read_signals(
        request.path,
        time_column=request.time_column,
        time_unit=request.time_unit,
        sampling_hz=request.sampling_hz,
    )
    names, values, read, warnings = _columns(signals, request)
    if request.gate is not None:
        numbers, lines = _gate(signals, values, result, request)
    elif request.accelerometer is not None:
        numbers, lines = _accelerometer(signals, values, result, request)
    else:
        numbers, lines = _strain_gauge(signals, values, result, request)
    warnings = list(map(as_options, [*warnings, *numbers.get("warnings", ())]))
    if options["json"]:
        numbers |= {"columns": names, "read": dict(read), "warnings": warnings}
        print(json.dumps(numbers, indent=2, allow_nan=False))
        return 0
    if options["quiet"]:
        return 0
    for sentence in warnings:
        print(in_red(shown(f"{LABELS[SEVERE]:<20}  {sentence}"), sys.stdout))
    figure = [("figure", str(request.plot))] if request.plot is not None else []
    for label, value in read + lines + figure:
        print(shown(f"{label:<20}  {value}"))
    return 0


def _columns(signals: Signals, request: InstrumentRequest) -> tuple[list[str], list[Any], Lines, list[str]]:
    """Names of the columns, their values in SI units, how they were read, and warnings."""
    from torchsphere.instruments.units import converted

    given = None if request.columns is None else [name.strip() for name in request.columns.split(",")]
    count = 2 if request.gate else 1 if request.accelerometer or given is None else len(given)
    names = list(signals.values)[:count] if given is None else given
    if len(names) != count or not set(names) <= set(signals.values):
        wanted = (
            "two columns, one for each barrier" if request.gate else "one column" if count == 1 else "columns of it"
        )
        raise ValueError(
            f"--columns: expected {wanted}, got {_listed(names)}; the file has {_listed(signals.values)} and times"
        )
    interval = (signals.time_s[-1] - signals.time_s[0]) / (len(signals.time_s) - 1)
    read = [
        ("signals", f"{_listed(names)}, {len(signals.time_s)} samples from line {signals.lines[0]} on"),
        ("times", f"every {interval:.6g} s, {signals.times}"),
    ]
    values, warnings = [signals.signal(name) for name in names], list(signals.warnings)
    if request.gate is None:
        scales = [converted(request.quantity, name, signals.units[name], request.unit) for name in names]
        values = [factor * column for (factor, _, _), column in zip(scales, values, strict=True)]
        read.append(("unit", "; ".join(dict.fromkeys(said for _, said, _ in scales))))
        warnings += [sentence for _, _, doubts in scales for sentence in doubts]
    return names, values, read, warnings


def _listed(names: Iterable[str]) -> str:
    return ", ".join(map(repr, names)) or "none"


def _gate(
    signals: Signals, values: list[Any], result: ResultFolder, request: InstrumentRequest
) -> tuple[dict[str, Any], Lines]:
    """Numbers and lines of the velocity by the gate beside the track's before the contact."""
    from torchsphere.instruments.signals import gate_warnings, light_gate, mean_speed
    from torchsphere.report.summary_tables import with_sd

    assert result.motion is not None
    assert request.spacing_mm is not None
    found = light_gate(
        signals.time_s, *values, spacing_m=1e-3 * request.spacing_mm, sd_spacing_m=1e-3 * request.sd_spacing_mm
    )
    until_s = math.inf if result.contact_s is None else result.contact_s[0]
    across = None if request.direction_deg is None else _direction(request.direction_deg)
    speed, sd = mean_speed(result.motion, until_s, across)
    difference, sd_difference = found.velocity_m_s - speed, math.hypot(found.sd_velocity_m_s, sd)
    numbers = dataclasses.asdict(found) | {
        "track_speed_m_s": speed,
        "sd_track_speed_m_s": sd,
        "difference_m_s": difference,
        "sd_difference_m_s": sd_difference,
        "warnings": gate_warnings(found.velocity_m_s, speed),
    }
    lines = [
        ("light gate", with_sd(found.velocity_m_s, found.sd_velocity_m_s, "m/s")),
        ("its delay", with_sd(found.delay_s, found.sd_delay_s, "us", 1e6)),
        ("correlation", f"{found.correlation:.4f}"),
        ("track before contact" if result.contact_s else "track", with_sd(speed, sd, "m/s")),
        ("gate less track", with_sd(difference, sd_difference, "m/s")),
    ]
    return numbers, lines


def _accelerometer(
    signals: Signals, values: list[Any], result: ResultFolder, request: InstrumentRequest
) -> tuple[dict[str, Any], Lines]:
    """Numbers and lines of the accelerometer aligned with the track; draws both if asked to."""
    from torchsphere.instruments.signals import align
    from torchsphere.report.summary_tables import with_sd

    assert result.motion is not None
    found = align(result.motion, signals.time_s, values[0], direction=_direction(request.direction_deg or 0.0))
    if request.plot is not None:
        from torchsphere.report.instrument_figure import alignment_figure

        _save(alignment_figure(found), request.plot)
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
    return numbers, lines


def _direction(angle_deg: float) -> Any:
    """The unit vector of an angle."""
    import numpy as np

    return np.array([math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))])


def _strain_gauge(
    signals: Signals, values: list[Any], result: ResultFolder, request: InstrumentRequest
) -> tuple[dict[str, Any], Lines]:
    """Numbers and lines of the bar's force beside that of the track; draws both if asked to."""
    from torchsphere.instruments.strain_gauge import compare_bar

    bar, mass_g, contact = _bar(request), result.summary["settings"].get("mass_g"), result.contact_s
    if mass_g is None:
        raise ValueError(f"{result.path}: has no mass, so that there is no force; track again with --mass-g")
    if contact is None:
        raise ValueError(f"{result.path}: no contact was found in it, so that there is no force to compare")
    assert result.motion is not None
    found = compare_bar(
        result.motion,
        signals.time_s,
        values,
        bar,
        mass_kg=1e-3 * mass_g,
        contact_s=contact,
        direction=_direction(_normal_deg(result, request)),
        delay_s=None if request.delay_ms is None else 1e-3 * request.delay_ms,
        sd_delay_s=1e-3 * request.sd_delay_ms,
        compression_positive=request.compression_positive,
    )
    if request.plot is not None:
        from torchsphere.report.instrument_figure import bar_figure

        _save(bar_figure(found), request.plot)
    arrays = ("time_s", "track_N", "sd_track_N", "bar_N", "sd_bar_N")
    numbers = {name: value for name, value in dataclasses.asdict(found).items() if name not in arrays}
    curves = {name: [float(v) if math.isfinite(v) else None for v in getattr(found, name)] for name in arrays}
    return numbers | curves, _bar_lines(found)


def _bar(request: InstrumentRequest) -> Bar:
    """The bar of the request, which has checked that its numbers are given."""
    from torchsphere.instruments.bar import bar

    def given(value: float | None, factor: float) -> float | None:
        return None if value is None else factor * value

    assert request.bar_modulus_gpa is not None
    assert request.gauge_distance_mm is not None
    return bar(
        modulus_pa=1e9 * request.bar_modulus_gpa,
        distance_m=1e-3 * request.gauge_distance_mm,
        area_m2=given(request.bar_area_mm2, 1e-6),
        diameter_m=given(request.bar_diameter_mm, 1e-3),
        density_kg_m3=request.bar_density_kg_m3,
        wave_speed_m_s=request.bar_wave_speed_m_s,
        length_m=given(request.bar_length_mm, 1e-3),
        relative_sd=0.01 * request.sd_bar_percent,
    )


def _normal_deg(result: ResultFolder, request: InstrumentRequest) -> float:
    """Direction from the bar to the ball: as given, or the normal of the impact."""
    if request.direction_deg is not None:
        return request.direction_deg
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
