"""What a notebook shows of a recording, a circle, a track, a motion, an impact or a result: a figure and a table."""

from __future__ import annotations

import contextlib
import functools
import io
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.dynamics.si_units import largest
from torchsphere.geometry.circle import Circle
from torchsphere.motion.track import Track, status_counts
from torchsphere.notebook import drawings
from torchsphere.notebook.loaded import Result
from torchsphere.recording import Recording
from torchsphere.report.summary_tables import IMPACT, with_sd

#: Longest side of the image of a recording, px.
IMAGE_PX = 240

#: Numbers of an impact in the table, of those in the report.
SHOWN = (
    *("speed_before", "speed_after", "contact_start", "duration", "peak_force", "impulse_size"),
    *("restitution_normal", "angle_of_impact", "angle_of_exit", "spin_rate_before", "spin_rate_after", "energy_given"),
)

#: Most warnings in full.
MOST_WARNINGS = 4

Row = tuple[str, str]


@functools.singledispatch
def html(subject: Any) -> str:
    """The figure and the table of a result as HTML; TypeError for other objects."""
    raise TypeError(f"html: expected a result of torchsphere, got {type(subject).__name__}")


def _shown(title: str, figures: Sequence[str], rows: Sequence[Row], notes: Sequence[str] = ()) -> str:
    """A title, figures beside a table, and notes below them."""
    cell = "text-align:left;vertical-align:top;padding:1px 10px 1px 0;border:0;background:none"
    body = "".join(
        f'<tr style="background:none"><th style="{cell};font-weight:normal;opacity:.75;white-space:nowrap">'
        f'{escape(name)}</th><td style="{cell}">{escape(value)}</td></tr>'
        for name, value in rows
    )
    table = f'<table style="border-collapse:collapse;margin:0;border:0;color:inherit;font-size:inherit">{body}</table>'
    pictures = "".join(f"<div>{figure}</div>" for figure in figures if figure)
    more = len(notes) - MOST_WARNINGS
    shown = [*notes[:MOST_WARNINGS], *([f"and {more} more: see .warnings"] if more > 0 else [])]
    below = "".join(f'<div style="margin-top:2px">&#9888; {escape(sentence)}</div>' for sentence in shown)
    return (
        f'<div style="font-size:13px;line-height:1.4"><strong>{escape(title)}</strong>'
        '<div style="display:flex;flex-wrap:wrap;gap:8px 20px;align-items:flex-start;margin-top:4px">'
        f"<div>{pictures}</div>{table}</div>{below}</div>"
    )


@html.register
def _(recording: Recording) -> str:
    n, height, width = recording.shape
    rate, exposure = recording.frame_rate, recording.exposure_s
    facts = (
        ("path", str(recording.path)),
        ("kind", recording.kind),
        ("images", f"{n} of {width} x {height} px"),
        ("bit depth", "not stated" if recording.bit_depth is None else str(recording.bit_depth)),
        ("frame rate", "not stated" if rate is None else f"{rate:,.10g} frames/s"),
        ("exposure", "not stated" if exposure is None else f"{1e6 * exposure:.4g} µs"),
    )
    return _shown("Recording", [_image(recording)], facts, recording.notes)


def _image(recording: Recording) -> str:
    """The image in the middle, small; none where it cannot be read."""
    from PIL import Image

    with contextlib.suppress(OSError, ValueError):
        middle = len(recording) // 2
        image = recording.images(middle, middle + 1)[0]
        step = max(1, -(-max(image.shape) // IMAGE_PX))
        image = image[::step, ::step]
        low, high = np.percentile(image, (0.5, 99.5))
        grey = ((image - low) * (255 / max(high - low, 1e-6))).clip(0, 255).astype(np.uint8)
        stream = io.BytesIO()
        Image.fromarray(grey).save(stream, "PNG")
        return f"{drawings.picture(stream.getvalue(), f'image {middle}')}<div>image {middle}</div>"
    return ""


@html.register
def _(circle: Circle) -> str:
    figure = drawings.path(np.array([[circle.x, circle.y]]), circle.radius, "circle")
    rows = [
        ("x", with_sd(circle.x, circle.sd_x, "px")),
        ("y", with_sd(circle.y, circle.sd_y, "px")),
        ("radius", with_sd(circle.radius, circle.sd_radius, "px")),
        ("frame", str(circle.frame)),
        ("option", f"--circle {circle.text()}"),
    ]
    doubt = [circle.sd_text] if circle.sd_guessed else []
    return _shown("Circle", [figure], rows, [f"the standard deviations are a bound: {d}" for d in doubt])


@html.register
def _(track: Track) -> str:
    radius = float(np.nanmedian(track.radius)) if np.isfinite(track.radius).any() else track.circle.radius
    figures = [drawings.path(track.position, radius, "path of the ball"), drawings.strip(track.status)]
    known, settings = track.calibration, track.settings
    counts = ", ".join(f"{count} {name}" for name, count in status_counts(track).items())
    rows = [("frames", f"{len(track.status)}: {counts}"), ("circle", f"{track.circle.text()} px"), *_mean(track)]
    rows.append(("model", str(settings.get("model", ""))))
    rows.append(("poses", "on a map of the ball" if track.findings.is_on_map else "by pairs of images"))
    for name, value, unit, factor in (
        ("frame rate", known.frame_rate, "frames/s", 1.0),
        ("diameter", known.diameter_m, "mm", 1e3),
        ("size of a pixel", known.m_per_px, "mm", 1e3),
        ("mass", known.mass_kg, "g", 1e3),
    ):
        if value is not None:
            rows.append((name, f"{factor * value:.6g} {unit}"))
    return _shown("Track", figures, rows, track.warnings)


def _mean(track: Track) -> list[Row]:
    """Mean step and turn from frame to frame."""
    known = np.isfinite(track.increment)
    if not known[:, 0].any():
        return [("motion", "not measured")]
    mean = np.where(known, track.increment, 0.0).sum(0) / np.maximum(known.sum(0), 1)
    turn = f", {np.degrees(np.linalg.norm(mean[2:])):.3g} deg" if known[:, 2:].any() else ""
    return [("mean step", f"({mean[0]:.3g}, {mean[1]:.3g}) px{turn}")]


@html.register
def _(motion: Kinematics) -> str:
    ms = 1e3 * motion.time_s
    contact = None if motion.contact_s is None else (1e3 * motion.contact_s[0], 1e3 * motion.contact_s[1])
    pairs = [("velocity (m/s)", motion.velocity_m_s, motion.sd_velocity_m_s)]
    if motion.force_N is not None and motion.sd_force_N is not None:
        pairs.append(("force (kN)", 1e-3 * motion.force_N, 1e-3 * motion.sd_force_N))
    else:
        pairs.append(("acceleration (m/s²)", motion.acceleration_m_s2, motion.sd_acceleration_m_s2))
    pairs.append(("spin (rad/s)", motion.spin_rad_s, motion.sd_spin_rad_s))
    charts = [
        drawings.chart(
            title,
            ms,
            [drawings.Curve("xyz"[k], v, sd) for k, (v, sd) in enumerate(zip(values.T, sds.T, strict=True))],
            "time (ms)",
            contact,
        )
        for title, values, sds in pairs
    ]
    rows = [
        ("frames", f"{len(ms)} at {motion.frame_rate:,.10g} frames/s"),
        ("time", f"{ms[0]:.5g} to {ms[-1]:.5g} ms"),
        ("axes", "lab: y up, z to the camera" if motion.lab_frame else "camera: y down, z away"),
        ("size of a pixel", with_sd(motion.scale.m_per_px, motion.scale.sd_m_per_px, "mm", 1e3)),
        ("mass", "not known" if motion.mass_kg is None else f"{1e3 * motion.mass_kg:.6g} g"),
        ("largest speed", f"{largest(motion.velocity_m_s):.4g} m/s"),
        ("largest spin", f"{largest(motion.spin_rad_s):.4g} rad/s"),
    ]
    if motion.force_N is not None:
        rows.append(("largest force", f"{1e-3 * largest(motion.force_N):.4g} kN"))
    if contact is not None:
        rows.append(("contact", f"{contact[0]:.4f} to {contact[1]:.4f} ms"))
    return _shown("Kinematics (bands: 2 sd)", charts, rows, motion.warnings)


@html.register
def _(impact: Impact) -> str:
    rows = []
    for key, name, unit, factor in IMPACT:
        estimate = getattr(impact, key, None)
        if key in SHOWN and estimate is not None:
            rows.append((name, with_sd(estimate.value, estimate.sd, unit, factor)))
    title = "Impact" if impact.count == 1 else f"Impact (of {impact.count})"
    return _shown(title, [_contact_chart(impact)], rows, (*impact.warnings, *impact.missing))


def _contact_chart(impact: Impact) -> str:
    """Force, or velocity without a mass, around the contact."""
    motion = impact.motion
    if motion is None:
        return ""
    start, end = float(impact.contact_start.value), float(impact.contact_end.value)
    rows = np.flatnonzero((motion.time_s > start - (end - start)) & (motion.time_s < end + (end - start)))
    if len(rows) < 2:
        return ""
    title, values, sds = "velocity (m/s)", motion.velocity_m_s, motion.sd_velocity_m_s
    if motion.force_N is not None and motion.sd_force_N is not None:
        title, values, sds = "force (kN)", 1e-3 * motion.force_N, 1e-3 * motion.sd_force_N
    curves = [drawings.Curve("xy"[k], values[rows, k], sds[rows, k]) for k in range(2)]
    return drawings.chart(title, 1e3 * motion.time_s[rows], curves, "time (ms)", (1e3 * start, 1e3 * end))


@html.register
def _(result: Result) -> str:
    parts = [html(part) for part in (result.track, result.motion, result.impact) if part is not None]
    return f"<div><code>{escape(str(result.folder))}</code></div>{''.join(parts)}"
