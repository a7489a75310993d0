"""The ledger of errors: all sources in one order, and what each adds to the uncertainty of a track."""

from __future__ import annotations

import dataclasses

import numpy as np

from torchsphere.errors import (
    ball_in_place,
    camera_shake,
    coded_video,
    edge_leakage,
    first_circle,
    frame_memory,
    frames,
    growing_ball,
    hidden_ball,
    interlaced_video,
    lens,
    map_radius,
    missing_frames,
    motion_model,
    nearness,
    outline_shape,
    raw_mosaic,
    residual_scatter,
    steady_error,
    steps_without_map,
    stretched_pixels,
    tone_curve,
    uneven_light,
)
from torchsphere.errors.evidence import Evidence
from torchsphere.errors.source import ErrorSource
from torchsphere.motion.ledger import Entry
from torchsphere.motion.track import Track
from torchsphere.runtime.arrays import Array
from torchsphere.runtime.warning_levels import by_level

#: All sources of error, in the order in which a reader is told of them. They are applied from the last to the first:
#: from the pixels of one image to what concerns the whole recording. Missing images are told by the noise of single
#: steps: beside what others add, a step of twice the length would be none.
SOURCES = (
    ErrorSource("frames not measured", sentences=frames.sentences),
    ErrorSource("object in front of the ball", hidden_ball.detect, hidden_ball.widen, sentences=hidden_ball.sentences),
    ErrorSource("first circle", sentences=first_circle.sentences),
    ErrorSource("motion unseen by the outlines", widen=ball_in_place.widen, sentences=ball_in_place.sentences),
    ErrorSource("steps without a map", sentences=steps_without_map.sentences),
    ErrorSource("radius against outline", without=map_radius.without, sentences=map_radius.sentences),
    ErrorSource("growth of the ball", sentences=growing_ball.sentences),
    ErrorSource("interlaced video", sentences=interlaced_video.sentences),
    ErrorSource("colour mosaic", sentences=raw_mosaic.sentences),
    ErrorSource("memory of the images", frame_memory.detect, frame_memory.widen, sentences=frame_memory.sentences),
    ErrorSource("codec", coded_video.detect, coded_video.widen, sentences=coded_video.sentences),
    ErrorSource("lens", sentences=lens.sentences),
    ErrorSource("tone curve", sentences=tone_curve.sentences),
    ErrorSource("shape of the outline", outline_shape.detect, sentences=outline_shape.sentences),
    ErrorSource("distance of the camera", nearness.detect, nearness.widen, sentences=nearness.sentences),
    ErrorSource("background over the edge", edge_leakage.detect, edge_leakage.widen, sentences=edge_leakage.sentences),
    ErrorSource("shake of the camera", camera_shake.detect, sentences=camera_shake.sentences),
    ErrorSource("motion model", sentences=motion_model.sentences),
    ErrorSource("uneven light", uneven_light.detect, uneven_light.widen, sentences=uneven_light.sentences),
    ErrorSource("pixels not square", stretched_pixels.detect, stretched_pixels.widen),
    ErrorSource("texture and view", steady_error.detect, steady_error.widen),
    ErrorSource("residual alike over pixels", without=residual_scatter.without, sentences=residual_scatter.sentences),
    ErrorSource("missing images", missing_frames.detect, sentences=missing_frames.sentences),
)

#: Name of what is left without all sources.
NOISE = "noise of the images"

#: Name of the diameter, or size of a pixel, that was given with an uncertainty.
STATED_SCALE = "scale as given"


def applied(track: Track, evidence: Evidence) -> Track:
    """The ``track`` with the findings, the uncertainty and the ledger of all sources."""
    held, inner = [], track
    for source in SOURCES:
        narrower = source.without(inner, evidence)
        held += _added(source.name, narrower, inner)
        inner = narrower
    exact = dataclasses.replace(inner, calibration=dataclasses.replace(inner.calibration, relative_sd_scale=0.0))
    entries = [*_added(NOISE, None, exact), *_added(STATED_SCALE, exact, inner), *reversed(held)]
    for source in reversed(SOURCES):
        track = dataclasses.replace(track, findings=source.detect(track, evidence))
        wider = source.widen(track, evidence)
        entries += _added(source.name, track, wider)
        track = wider
    return dataclasses.replace(track, ledger=tuple(entries))


def sentences(track: Track, evidence: Evidence) -> tuple[str, ...]:
    """What a reader of the numbers must know, the severe sentences first."""
    return by_level(sentence for source in SOURCES for sentence in source.sentences(track, evidence))


def _added(source: str, track: Track | None, wider: Track) -> list[Entry]:
    """The entry of what ``source`` added to a ``track``, which is ``wider`` with it; none if it added nothing.

    All that ``wider`` states where there is no ``track``.
    """
    if wider is track:
        return []
    before, after = (None if track is None else _variances(track)), _variances(wider)
    added = [part if before is None else part - before[k] for k, part in enumerate(after)]
    # What narrows an error adds nothing.
    step, steady, circle, scale = (tuple(np.sqrt(np.clip(part, 0.0, None)).tolist()) for part in added)
    entry = Entry(source, step, steady, circle, scale[0])
    return [] if entry.is_nothing else [entry]


def _variances(track: Track) -> tuple[Array, Array, Array, Array]:
    """Of one increment (5,), of what all have in common (5,), of x, y and radius (3,), and of the scale (1,).

    px and rad; the median of the increments. 0 where nothing was measured, or nobody stated it.
    """
    every = np.diagonal(track.covariance, axis1=1, axis2=2)
    known, step = np.isfinite(every).any(0), np.zeros(5)
    step[known] = np.nanmedian(every[:, known], axis=0)
    outline = np.square(np.nan_to_num([track.circle.sd_x, track.circle.sd_y, track.circle.sd_radius]))
    stated = track.calibration
    scale = 0.0
    if stated.diameter_m is not None:
        # The diameter gives the scale by the radius.
        scale = stated.relative_sd_scale**2 + float(outline[2]) / track.circle.radius**2
    elif stated.m_per_px is not None:
        scale = stated.relative_sd_scale**2
    return step, track.sd_steady**2, outline, np.array([scale])
