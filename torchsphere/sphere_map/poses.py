"""Absolute poses of all frames by one map of the ball: what bounds the drift and reaches the limit of the images.

Steps from frame to frame add their errors up. A map of the ball's texture, adjusted together with the poses of
keyframes spread over the recording, is a memory that does not: each frame is then registered on the map, and its
outline against the still background. The map also knows the radius better than anything else.

How certain the steps between frames on a map of the ball are.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.geometry.circle import Circle
from torchsphere.imaging import background
from torchsphere.recording.frame_source import Source
from torchsphere.runtime import threads
from torchsphere.sphere_map import bundle_adjustment
from torchsphere.sphere_map import registration as register
from torchsphere.sphere_map.bundle_adjustment import Bundle
from torchsphere.sphere_map.projection import Pose
from torchsphere.sphere_map.registration import Registration
from torchsphere.sphere_map.window import Window, cut_window

Array = NDArray[np.float64]


def step_covariances(n: int, found: dict[int, Registration], keys: list[int], adjusted: Bundle) -> Array:
    """Covariance (n - 1, 5, 5) of the steps between frames that are both on the map.

    Between keyframes it is that of the adjustment. Elsewhere it is that of the noise of both images, with as much noise
    as `Registration.misfit` finds: the profile is that of images that made the map, and these leave less than their
    noise; all others leave more, by what the map is off by where their pixels fall. Neighbours see that error at other
    places between its cells, so that little of it cancels in a step. What the equations say agrees: the covariance of
    the map's coefficients, radius and outline, carried into every step, adds 1 to 18 % to the variances of the noise,
    and a misfit 6 to 16 %.

    Measured on 100 frames of balls of 20 to 50 px at 0.2 to 5 deg per frame, noise of 0.5 to 6 grey levels and speckle
    of 3 to 6 px: errors of 2277 steps beside the keyframes are 1.05 times what is stated (0.85 to 1.22 by kind of
    ball). Too narrow, 1.13 (1.4 at 20 px and 0.5 deg), is the step in x of a ball that turns about y: only the limb
    tells it from that turn, and there the model errs alike in neighbouring pixels, which no residual shows.
    """
    unit = np.array([1.0, 1.0, *3 * [1 / adjusted.ball.radius]])
    to_units = np.outer(unit, unit)
    between = np.full((n - 1, 5, 5), np.nan)
    place = {i: k for k, i in enumerate(keys)}
    misfits = [registration.misfit for i, registration in found.items() if i not in place]
    # A keyframe's own residual says nothing of the map's errors: it was fitted to it.
    typical = float(np.median(misfits)) if misfits else 1.0

    def own(i: int) -> Array:
        return (typical if i in place else found[i].misfit) * found[i].covariance.numpy()

    for i in range(n - 1):
        if i in place and i + 1 in place:
            between[i] = _difference(adjusted, place[i], place[i + 1]) * to_units
        elif i in found and i + 1 in found:
            between[i] = (own(i) + own(i + 1)) * to_units
    return between


def _difference(adjusted: Bundle, a: int, b: int) -> Array:
    """Covariance (5, 5) of the step from the adjusted pose number ``a`` to number ``b``."""
    spread, first, second = adjusted.covariance, slice(5 * a, 5 * a + 5), slice(5 * b, 5 * b + 5)
    shared = spread[first, second]
    return spread[first, first] + spread[second, second] - shared - shared.T


#: Keyframes at most, and frames that are too few to make a map of.
KEYFRAMES, FEWEST = 36, 6

#: Variance of the residual within the disc, against that of the frames' own noise, from which the model is not
#: believed: perspective, a light that the shading cannot hold, a ball that is not round.
MAX_MISFIT = 4.0

#: Misfit of a frame, against that of the keyframes, from which it keeps what the correlation found; and how far it may
#: have moved on the map, as a share of the radius.
MAX_FRAME_MISFIT, MAX_MOVE = 2.0, 0.1

#: Blur of the outline, px, from which what is there is no outline: where a plate shades and hides the ball's edge, 2.4
#: and 2.9 px were found, with radii that were off by 0.20 and 0.36 px.
MAX_EDGE_BLUR_PX = 2.0

#: What the radius may be off by as a share of it, beyond what the images' noise tells: 0.0001 with nothing but a still
#: background around the ball, 0.0004 to 0.0032 (rms 0.0021) before a target that shades and hides its edge.
SYSTEMATIC_RADIUS_SHARE = 0.002

#: Share of the radius by which the map may correct it.
MAX_RADIUS_CHANGE = 0.05


@dataclass(frozen=True)
class Mapped:
    """Poses on the map.

    Attributes
    ----------
    position, orientation : ndarray
        (n, 2), px, and (n, 3, 3) since the first known frame; NaN where a frame is not on the map.
    between : ndarray
        Covariance (n - 1, 5, 5) of the step from each frame to the next: px and rad.
    circle : Circle
        The outline, with the map's radius and the first pose's centre.
    keyframes : int
    edge_blur : float
        Of the optics at the outline, px.
    misfit : float
        Variance of the residual against that of the images' noise.
    """

    position: Array
    orientation: Array
    between: Array
    circle: Circle
    keyframes: int
    edge_blur: float
    misfit: float


def poses_on_map(
    source: Source,
    position: Array,
    orientation: Array,
    noise_share: float,
    circle: Circle,
    ignore: Tensor | None,
    progress: Callable[[int, int], None] | None = None,
) -> Mapped | str:
    """Register all frames on a map of the ball.

    Parameters
    ----------
    source : Source
        The images.
    position, orientation : ndarray
        What the correlation found: (n, 2), px, and (n, 3, 3); NaN where nothing. Right to within half a speckle,
        drift included.
    noise_share : float
        Variance of the images' noise over that of their grey levels.
    circle : Circle
        The outline.
    ignore : Tensor, optional
        (h, w), True where the images are not to be used.
    progress : callable, optional
        Called as ``progress(done, total)`` with numbers of frames that are on the map.

    Returns
    -------
    Mapped or str
        Or, in words, why the images do not allow it.
    """
    known = np.flatnonzero(np.isfinite(position[:, 0]) & np.isfinite(orientation[:, 0, 0]))
    if len(known) < FEWEST:
        return f"only {len(known)} frames are known well enough to make a map of the ball"
    behind = background.background(source, position, circle.radius)
    usable = None if ignore is None else ~ignore.cpu()
    keys = known[np.unique(np.linspace(0, len(known) - 1, KEYFRAMES).round().astype(int))]
    starts = {i: Pose(torch.from_numpy(position[i]), torch.from_numpy(orientation[i])) for i in known.tolist()}

    def window(i: int, pose: Pose, radius: float) -> Window:
        image = source.images(i, i + 1)[0].cpu()
        return cut_window(image, behind, pose.centre, radius, usable)

    windows = [window(i, starts[i], circle.radius) for i in keys.tolist()]
    texture = float(np.median([float(each.levels.var()) for each in windows]))
    noise = max(noise_share * texture, 1 / 12)  # what rounding alone leaves

    def adjusting(share: float) -> None:
        if progress is not None:
            progress(round(share * len(keys)), len(known))

    adjusting(0.0)
    adjusted = bundle_adjustment.adjust(windows, [starts[i] for i in keys.tolist()], circle.radius, noise, adjusting)
    misfit = float(adjusted.profile.variance[0]) / noise
    refusal = _refusal(adjusted, circle.radius, misfit)
    if refusal:
        return refusal
    found = _register_all(known.tolist(), keys.tolist(), starts, adjusted, window, progress)
    return _assemble(len(position), found, keys.tolist(), adjusted, circle, misfit)


def _refusal(adjusted: Bundle, radius: float, misfit: float) -> str:
    """Why the adjustment is not to be believed, in words; empty where it is."""
    if not adjusted.settled:
        return "the map of the ball and the poses did not settle"
    if misfit > MAX_MISFIT:
        return f"a map of the ball leaves {misfit**0.5:.1f} times the noise: perspective, moving light, or not a sphere"
    if adjusted.ball.edge_blur > MAX_EDGE_BLUR_PX:
        return f"the map finds the outline blurred by {adjusted.ball.edge_blur:.1f} px: something hides or shades it"
    if abs(adjusted.ball.radius - radius) > MAX_RADIUS_CHANGE * radius:
        return f"the map asks for a radius of {adjusted.ball.radius:.1f} px instead of {radius:.1f}"
    return ""


def _register_all(
    known: list[int],
    keys: list[int],
    starts: dict[int, Pose],
    adjusted: Bundle,
    window: Callable[[int, Pose, float], Window],
    progress: Callable[[int, int], None] | None,
) -> dict[int, Registration]:
    """Registration of every known frame; the keyframes' own come from the adjustment."""
    corrected = dict(zip(keys, adjusted.poses, strict=True))
    ball, profile = adjusted.ball, adjusted.profile

    def guessed(i: int) -> Pose:
        near = keys[int(np.argmin(np.abs(np.array(keys) - i)))]
        # The drift up to here is about that of the nearest keyframe.
        turn = corrected[near].orientation @ starts[near].orientation.T
        centre = starts[i].centre + corrected[near].centre - starts[near].centre
        return Pose(centre, turn @ starts[i].orientation, corrected[near].gain, corrected[near].offset)

    def registered(guess: Pose, own: Window) -> Registration | None:
        registration = register.register(own, guess, ball, profile)
        moved = float((registration.pose.centre - guess.centre).norm()) < MAX_MOVE * ball.radius
        good = registration.converged and moved and registration.misfit < MAX_FRAME_MISFIT
        return registration if good else None

    found = {}
    others = [i for i in known if i not in corrected]
    for first in range(0, len(others), KEYFRAMES):
        # As many images at once as the adjustment had in memory.
        some = others[first : first + KEYFRAMES]
        guesses = [guessed(i) for i in some]
        windows = [window(i, guess, ball.radius) for i, guess in zip(some, guesses, strict=True)]
        each = threads.each(registered, guesses, windows)
        for done, (i, registration) in enumerate(zip(some, each, strict=True), len(keys) + first + 1):
            if progress is not None:
                progress(done, len(known))
            if registration is not None:
                found[i] = registration
    for key, on_map, pose in zip(keys, adjusted.windows, adjusted.poses, strict=True):
        own = register.own_covariance(on_map, pose, ball, profile)
        found[key] = Registration(pose, own, True, 1.0)
    return found


def _assemble(
    n: int, found: dict[int, Registration], keys: list[int], adjusted: Bundle, circle: Circle, misfit: float
) -> Mapped:
    position, orientation = np.full((n, 2), np.nan), np.full((n, 3, 3), np.nan)
    first = min(found)
    turned = found[first].pose.orientation.T
    for i, registration in found.items():
        position[i] = registration.pose.centre.numpy()
        orientation[i] = (registration.pose.orientation @ turned).numpy()
    spread, k = adjusted.covariance, keys.index(first) if first in keys else 0
    sd_x, sd_y = np.sqrt(np.diag(spread)[5 * k : 5 * k + 2])
    size = 5 * len(keys)
    outline = dataclasses.replace(
        circle,
        x=float(position[first, 0]),
        y=float(position[first, 1]),
        radius=adjusted.ball.radius,
        sd_guessed=False,
        sd_x=float(sd_x),
        sd_y=float(sd_y),
        sd_radius=float(np.hypot(np.sqrt(spread[size, size]), SYSTEMATIC_RADIUS_SHARE * adjusted.ball.radius)),
    )
    steps = step_covariances(n, found, keys, adjusted)
    return Mapped(position, orientation, steps, outline, len(keys), adjusted.ball.edge_blur, misfit)
