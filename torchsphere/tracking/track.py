"""A whole recording, from its images to the ball's motion in px and rad: `track`."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.correlation.options import given_to
from torchsphere.geometry.circle import Circle
from torchsphere.recording.frame_source import Source
from torchsphere.runtime import threads
from torchsphere.settings.arrays import as_mask
from torchsphere.settings.limits import require_switch
from torchsphere.tracking import drift
from torchsphere.tracking.drift import Motion
from torchsphere.tracking.edge_leakage import difference, fitted, leaked
from torchsphere.tracking.follow import Follower, Progress
from torchsphere.tracking.initial_circle import first_circle, shows_ball
from torchsphere.tracking.record import Record
from torchsphere.tracking.steady_error import fineness, sd_steady

#: Change of the radius by the map, as a share of it, after which frames that were not measured are tried again.
WRONG_RADIUS = 0.004


@dataclass(frozen=True)
class Track:
    """Motion of the ball over n frames, px and rad, image and camera frame.

    Attributes
    ----------
    position : ndarray
        Centre in each image (n, 2) as (x, y), px; NaN where it is not known.
    increment : ndarray
        Motion (n - 1, 5) from each frame to the next as (dx, dy, wx, wy, wz), px and rad; NaN where not measured, as
        are all rotations with the model `translation`.
    covariance : ndarray
        Of the increments (n - 1, 5, 5). Successive increments share an image, so that their errors are of opposite
        sign: the covariance of increment i with i + 1 is about minus half of this.
    orientation : ndarray
        Rotation matrices (n, 3, 3) since the first tracked frame; NaN from where a rotation is missing.
    zncc : ndarray
        Correlation coefficient (n,) of each frame with the one it was compared with; NaN for the first.
    iterations : ndarray
        Gauss-Newton steps (n,).
    status : ndarray
        Strings (n,), one of `result.STATUSES`; row i speaks of frame i and of the increment that leads
        to it. A frame found again after a gap is "lost" with a position: no increment leads to it. With the model
        `translation`, which measures no rotation, a frame is "weak_texture" at best.
    radius : ndarray
        Radius of the ball in each image (n,), px; constant but with the model `pinhole6`, NaN where not known.
    sd_growth : ndarray
        Standard deviation (n - 1,) of the radius's relative change from each frame to the next; 0 where the model
        takes it as constant.
    sd_steady : ndarray
        Standard deviation (5,) of what all increments of a flight are off by alike, px and rad: it is not in
        `covariance`, since it does not average out.
    circle : Circle
        The outline in the first tracked frame; with a camera the projected centre and the radius at its depth.
    settings : dict
        Every setting used.
    """

    position: NDArray[np.float64]
    increment: NDArray[np.float64]
    covariance: NDArray[np.float64]
    orientation: NDArray[np.float64]
    zncc: NDArray[np.float64]
    iterations: NDArray[np.int64]
    status: NDArray[np.str_]
    radius: NDArray[np.float64]
    sd_growth: NDArray[np.float64]
    sd_steady: NDArray[np.float64]
    circle: Circle
    settings: dict[str, Any]


@threads.one_each()
def track(
    recording: Any,
    circle: Any = None,
    *,
    ignore: Any = None,
    device: str | torch.device | None = None,
    refine: bool = False,
    in_place: bool = False,
    sphere_map: bool | None = None,
    progress: Progress | None = None,
    dtype: torch.dtype = torch.float32,
    **options: Any,
) -> Track:
    """Follow the ball through a recording.

    Parameters
    ----------
    recording : Recording or array_like
        Images (n, h, w), NumPy or torch, or a `Recording`, which is read as it is needed.
    circle : tuple of float or Circle, optional
        Outline (x, y, radius) of the ball in the first image, px, taken as it is unless a map of the ball corrects
        it; a `Circle` with a camera is the projected centre and the radius at its depth, as in `Track.circle`. By
        default it is found, in the first image that shows the whole ball, and the images before that one are
        "lost".
    ignore : array_like, optional
        (h, w), True where the images are not to be used.
    device : str or torch.device, optional
        Where to compute; by default where the images are, or the CPU.
    refine : bool
        Fit a given circle to the image's edges first.
    in_place : bool
        The ball turns without leaving its place (in a bearing, on an air cushion): the region stays on the circle, and
        so do the positions; the increments are still measured. Without it, the errors of fast rotations add up to a
        drift of the region.
    sphere_map : bool, optional
        Make a map of the ball's texture from all frames together and take every pose from it, the outline included:
        no drift, and about twice the precision, for 0.3 s per frame up to 36 frames and a twentieth beyond. By
        default where the ball turns by more than 90 deg in all, or so fast that the uncertainty of a radius that was
        found would show, unless something near the ball takes light from one side of it. Where the images do not
        allow it, nothing changes and ``settings`` says why.
    progress : callable, optional
        Called as ``progress(done, total)`` with numbers of frames; once more from 0 where a map of the ball is made.
    dtype : torch.dtype
        ``torch.float32`` or ``torch.float64``.
    **options
        Fields of `torchsphere.correlation.options.Options`: ``model``, ``roi``, ``pre_blur`` ...

    Returns
    -------
    Track

    Raises
    ------
    ValueError
        If there are fewer than two images, no ball is found, the circle does not fit the image, or an option is out
        of its range.
    TypeError
        If there is no such option.
    """
    for name, switch in (("refine", refine), ("in_place", in_place)):
        require_switch(name, switch)
    require_switch("sphere_map", sphere_map, "True, False or None")
    settings = given_to(track, options)
    source = Source.open(recording, device, dtype)
    mask = None if ignore is None else as_mask(ignore, source.images(0, 1))
    first, settings = first_circle(source, circle, mask, refine, settings)
    image = source.images(first.frame, first.frame + 1)[0]
    apart = difference(image, first, mask)
    settings = fitted(settings, options, first.radius, apart)

    # A ball that cannot leave its place is where the circle says, unless a map is asked for.
    asked = False if in_place and sphere_map is None else sphere_map

    def followed(first: Circle) -> tuple[Record, Motion]:
        follower = Follower(source, first, mask, settings, progress=progress, in_place=in_place)
        record = follower.run(source.count)
        if circle is not None and not record.is_confirmed(first.frame) and not shows_ball(source, first, settings):
            # A circle around nothing: neither its own image nor any other speaks for it.
            record = record.without(first.frame)
        if settings.model == "translation":
            record = record.without_rotation()
        return record, drift.bound(source, record, first, mask, asked, settings, progress=progress)

    measured, motion = followed(first)
    if abs(motion.circle.radius - first.radius) > WRONG_RADIUS * first.radius and (measured.status != "ok").any():
        # The map knows better how large the ball is than the circle that frames were given up with.
        first = dataclasses.replace(motion.circle, frame=first.frame)
        measured, motion = followed(first)
    fine = fineness(image, motion.circle, mask)
    used = dataclasses.asdict(settings) | {
        "circle_given": circle is not None,
        "circle_refined": circle is None or refine,
        "in_place": in_place,
        "sphere_map": motion.about_map,
        "repeated_frames": measured.repeated,
        "leaked": leaked(apart, motion.circle.radius, settings),
        "device": str(source.device),
        "dtype": str(dtype).removeprefix("torch."),
    }
    return _as_track(measured, motion, first, fine, used)


def _as_track(measured: Record, motion: Motion, first: Circle, fine: float, settings: dict[str, Any]) -> Track:
    """What was ``measured`` from the circle ``first`` on, as the ``motion``; ``fine`` is the texture's fineness."""
    steps, lit = int(np.isfinite(measured.increment[:, 0]).sum()), int(measured.uneven_light.sum())
    radius, on_map = motion.circle.radius, motion.about_map["used"]
    share = lit / max(steps, 1)
    return Track(
        position=motion.position,
        increment=motion.increment,
        covariance=motion.covariance,
        orientation=motion.orientation,
        zncc=measured.zncc,
        iterations=measured.iterations,
        status=measured.status,
        radius=measured.size * (radius / first.radius),
        sd_growth=measured.sd_growth,
        sd_steady=sd_steady(motion.increment, radius, fine, on_map=on_map, lit=share, leaked=settings["leaked"]),
        circle=motion.circle,
        settings=settings,
    )


def track_many(
    recordings: Sequence[Any], circles: Sequence[Any] | None = None, **settings: Any
) -> list[Track | Exception]:
    """`track` for several recordings, one after the other; one that fails does not end the rest.

    Parameters
    ----------
    recordings : sequence
        Each as for `track`.
    circles : sequence, optional
        One for each recording, as for `track`; by default they are found.
    **settings
        Arguments of `track`, the same for all recordings.

    Returns
    -------
    list of Track or Exception
        In the order of the recordings; in place of a track what `track` raised.

    Raises
    ------
    ValueError
        If there is not one circle per recording.
    """
    given = [None] * len(recordings) if circles is None else list(circles)
    if len(given) != len(recordings):
        raise ValueError(f"circles: expected one for each of {len(recordings)} recordings, got {len(given)}")
    tracks: list[Track | Exception] = []
    for recording, circle in zip(recordings, given, strict=True):
        try:
            tracks.append(track(recording, circle, **settings))
        except Exception as error:
            tracks.append(error)
    return tracks
