"""Absolute poses of all frames on one texture map of the ball, which do not drift as the sum of increments does.

The map is adjusted together with the poses of keyframes, which are spread over the recording. Each other frame is then
registered on the map, over the still background.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.geometry.circle import Circle
from torchsphere.imaging.background import background
from torchsphere.recording.frame_source import Source
from torchsphere.runtime import threads
from torchsphere.sphere_map import bundle_adjustment, registration
from torchsphere.sphere_map.bundle_adjustment import Adjustment
from torchsphere.sphere_map.forward_model import Pose
from torchsphere.sphere_map.pixel_weights import ROUNDING_VARIANCE
from torchsphere.sphere_map.registration import Registration
from torchsphere.sphere_map.window import Window, cut_window

Array = NDArray[np.float64]

#: Largest number of keyframes, and smallest number of frames for a map (docs/constants.md).
MAX_KEYFRAMES, MIN_FRAMES = 36, 6

#: Residual variance within the disc, in variances of the noise, from which the map is refused (docs/constants.md).
MAX_MISFIT = 4.0

#: Largest misfit of a frame on the map, and largest move by its registration, radii (docs/constants.md).
MAX_FRAME_MISFIT, MAX_MOVE = 2.0, 0.1

#: Blur of the outline, px, from which the map is refused: a blur by an object in front (docs/constants.md).
MAX_EDGE_BLUR_PX = 2.0

#: Systematic error of the radius as a share of the radius, beyond the noise of the images (docs/constants.md).
RADIUS_ERROR_SHARE = 0.002

#: Largest correction of the radius by the map, as a share of the radius (docs/constants.md).
MAX_RADIUS_CHANGE = 0.05


@dataclass(frozen=True)
class MapPoses:
    """Poses of n frames on the map."""

    position: Array  # (n, 2), px; NaN for a frame that is not on the map
    orientation: Array  # rotation (n, 3, 3) since the first known frame; NaN for a frame that is not on the map
    step_covariance: Array  # covariance (n - 1, 5, 5) of the step from each frame to the next: px and rad
    circle: Circle  # the outline, with the radius of the map and the centre of the first known frame
    keyframes: int
    edge_blur: float  # blur of the outline by the optics, px
    misfit: float  # variance of the residual over the variance of the images' noise


@dataclass(frozen=True)
class _Frames:
    """The images with their initial poses, their background (h, w), and a mask (h, w) of the usable pixels."""

    source: Source
    initial: dict[int, Pose]
    keys: list[int]
    background: Tensor
    usable: Tensor | None

    def window(self, i: int, pose: Pose, radius: float) -> Window:
        image = self.source.images(i, i + 1)[0].cpu()
        return cut_window(image, self.background, pose.centre, radius, self.usable)


def poses_on_map(
    source: Source,
    position: Array,
    orientation: Array,
    noise_share: float,
    circle: Circle,
    ignore: Tensor | None,
    progress: Callable[[int, int], None] | None = None,
) -> MapPoses | str:
    """Register all frames on a map of the ball: their poses, or a sentence with the reason why no map is possible.

    ``position`` (n, 2), px, and ``orientation`` (n, 3, 3) by the correlation err by at most half a speckle, drift
    included; NaN where unknown. ``noise_share`` is the variance of the images' noise over that of their grey levels.
    ``ignore`` (h, w) is True for pixels to ignore. Singular equations of the map raise LinAlgError.
    """
    known = np.flatnonzero(np.isfinite(position[:, 0]) & np.isfinite(orientation[:, 0, 0]))
    if len(known) < MIN_FRAMES:
        return f"a map of the ball needs {MIN_FRAMES} frames with a known pose, and this recording has {len(known)}"
    frames = _Frames(
        source,
        {i: Pose(torch.from_numpy(position[i]), torch.from_numpy(orientation[i])) for i in known.tolist()},
        known[np.unique(np.linspace(0, len(known) - 1, MAX_KEYFRAMES).round().astype(int))].tolist(),
        background(source, position, circle.radius),
        None if ignore is None else ~ignore.cpu(),
    )
    poses = [frames.initial[i] for i in frames.keys]
    windows = [frames.window(i, pose, circle.radius) for i, pose in zip(frames.keys, poses, strict=True)]
    texture = float(np.median([float(window.levels.var()) for window in windows]))
    noise = max(noise_share * texture, ROUNDING_VARIANCE)

    def report(done: int) -> None:
        if progress is not None:
            progress(done, len(known))

    report(0)
    adjustment = bundle_adjustment.adjust(
        windows, poses, circle.radius, noise, lambda share: report(round(share * len(poses)))
    )
    misfit = float(adjustment.state.profile.variance[0]) / noise
    refusal = _refusal(adjustment, circle.radius, misfit)
    if refusal:
        return refusal
    found = _register_all(frames, adjustment, report)
    return _assemble(len(position), found, frames.keys, adjustment, circle, misfit)


def _refusal(adjustment: Adjustment, radius: float, misfit: float) -> str:
    """Why the adjustment is refused, in words; empty if it is accepted."""
    ball = adjustment.state.ball
    if not adjustment.settled:
        return "the adjustment of the ball's map and poses did not converge"
    if misfit > MAX_MISFIT:
        return (
            f"the residual on a map of the ball is {misfit**0.5:.1f} times the noise: perspective, moving light, or "
            "not a sphere"
        )
    if ball.edge_blur > MAX_EDGE_BLUR_PX:
        return f"the outline is blurred by {ball.edge_blur:.1f} px on the map: something hides or shades the outline"
    if abs(ball.radius - radius) > MAX_RADIUS_CHANGE * radius:
        return f"the map needs a radius of {ball.radius:.1f} px instead of {radius:.1f} px"
    return ""


def _register_all(frames: _Frames, adjustment: Adjustment, report: Callable[[int], None]) -> dict[int, Registration]:
    """Registration of every known frame; those of the keyframes come from the adjustment."""
    keys, state = frames.keys, adjustment.state
    ball, profile = state.ball, state.profile
    adjusted = dict(zip(keys, state.poses, strict=True))

    def register(pose: Pose, window: Window) -> Registration | None:
        found = registration.register(window, pose, ball, profile)
        move = float((found.pose.centre - pose.centre).norm())
        accepted = found.converged and move < MAX_MOVE * ball.radius and found.misfit < MAX_FRAME_MISFIT
        return found if accepted else None

    found = {}
    others = [i for i in frames.initial if i not in adjusted]
    for first in range(0, len(others), MAX_KEYFRAMES):
        # Memory holds as many images at once as in the adjustment.
        chunk = others[first : first + MAX_KEYFRAMES]
        poses = [_undrifted(i, frames, adjusted) for i in chunk]
        windows = [frames.window(i, pose, ball.radius) for i, pose in zip(chunk, poses, strict=True)]
        registrations = zip(chunk, threads.parallel_map(register, poses, windows), strict=True)
        for done, (i, registered) in enumerate(registrations, len(keys) + first + 1):
            report(done)
            if registered is not None:
                found[i] = registered
    for key, window, pose in zip(keys, state.windows, state.poses, strict=True):
        covariance = registration.pose_covariance(window, pose, ball, profile)
        found[key] = Registration(pose, covariance, True, 1.0)
    return found


def _undrifted(i: int, frames: _Frames, adjusted: dict[int, Pose]) -> Pose:
    """Initial pose of frame ``i`` without its drift, which is about that of the nearest keyframe."""
    key = frames.keys[int(np.argmin(np.abs(np.array(frames.keys) - i)))]
    pose, before, after = frames.initial[i], frames.initial[key], adjusted[key]
    rotation = after.orientation @ before.orientation.T
    centre = pose.centre + after.centre - before.centre
    return Pose(centre, rotation @ pose.orientation, after.gain, after.offset)


def _assemble(
    n: int, found: dict[int, Registration], keys: list[int], adjustment: Adjustment, circle: Circle, misfit: float
) -> MapPoses:
    """Arrays over all ``n`` frames from the registrations, and the outline with its standard deviations."""
    position, orientation = np.full((n, 2), np.nan), np.full((n, 3, 3), np.nan)
    first = min(found)
    to_first = found[first].pose.orientation.T
    for i, registered in found.items():
        position[i] = registered.pose.centre.numpy()
        orientation[i] = (registered.pose.orientation @ to_first).numpy()
    ball, variances = adjustment.state.ball, np.diag(adjustment.covariance)
    k = keys.index(first) if first in keys else 0
    sd_x, sd_y = np.sqrt(variances[5 * k : 5 * k + 2])
    sd_radius = np.hypot(np.sqrt(variances[5 * len(keys)]), RADIUS_ERROR_SHARE * ball.radius)
    outline = replace(
        circle,
        x=float(position[first, 0]),
        y=float(position[first, 1]),
        radius=ball.radius,
        sd_guessed=False,
        sd_x=float(sd_x),
        sd_y=float(sd_y),
        sd_radius=float(sd_radius),
    )
    steps = step_covariances(n, found, keys, adjustment)
    return MapPoses(position, orientation, steps, outline, len(keys), ball.edge_blur, misfit)


def step_covariances(n: int, found: dict[int, Registration], keys: list[int], adjustment: Adjustment) -> Array:
    """Covariance (n - 1, 5, 5) of the steps between frames that are both on the map; px and rad, NaN elsewhere.

    Between keyframes, the covariance is that of the adjustment. Elsewhere it is the noise of both images, scaled by
    `Registration.misfit`: the residual of such a frame also holds the map's error at its pixels, which cancels little
    in a step. A keyframe has no such residual and gets the median misfit of the other frames.
    """
    units = np.array([1.0, 1.0, *3 * [1 / adjustment.state.ball.radius]])
    scale = np.outer(units, units)
    covariance = np.full((n - 1, 5, 5), np.nan)
    numbers = {i: k for k, i in enumerate(keys)}
    misfits = [registered.misfit for i, registered in found.items() if i not in numbers]
    typical = float(np.median(misfits)) if misfits else 1.0

    def of_frame(i: int) -> Array:
        return (typical if i in numbers else found[i].misfit) * found[i].covariance.numpy()

    for i in range(n - 1):
        if i in numbers and i + 1 in numbers:
            covariance[i] = _difference_covariance(adjustment.covariance, numbers[i], numbers[i + 1]) * scale
        elif i in found and i + 1 in found:
            covariance[i] = (of_frame(i) + of_frame(i + 1)) * scale
    return covariance


def _difference_covariance(covariance: Array, a: int, b: int) -> Array:
    """Covariance (5, 5) of the step from pose number ``a`` to number ``b``, from that of all poses."""
    first, second = slice(5 * a, 5 * a + 5), slice(5 * b, 5 * b + 5)
    shared = covariance[first, second]
    return covariance[first, first] + covariance[second, second] - shared - shared.T
