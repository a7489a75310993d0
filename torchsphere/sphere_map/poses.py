"""Absolute poses of all frames on one texture map of the ball, which do not drift as the sum of increments does.

The map is adjusted together with the poses of keyframes. All other frames are then registered on the map in batches,
over the still background.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from kornia.geometry.liegroup import So3
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.geometry.camera import Camera
from torchsphere.geometry.circle import Circle
from torchsphere.imaging.background import background
from torchsphere.recording.frame_source import Source
from torchsphere.runtime import threads
from torchsphere.runtime.arrays import Array
from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import exposure, radius_error, residual_scatter
from torchsphere.sphere_map.ball import Poses
from torchsphere.sphere_map.decision import NoMap, few_poses, refusal, refused_as_unsettled
from torchsphere.sphere_map.elimination import COMMON, PER_IMAGE
from torchsphere.sphere_map.falloff import falloff
from torchsphere.sphere_map.keyframes import choose_keyframes, choose_map_frames
from torchsphere.sphere_map.known_frames import KnownFrames, register_frames
from torchsphere.sphere_map.lens import Lens
from torchsphere.sphere_map.level import NEW_MAP_STEPS, Adjustment
from torchsphere.sphere_map.nearness import UNKNOWN_SD, nearness_of
from torchsphere.sphere_map.nearness_decision import tells_nearness
from torchsphere.sphere_map.perspective import Optics, orthographic
from torchsphere.sphere_map.pose_errors import step_covariances, without_leverage
from torchsphere.sphere_map.registration import Registration
from torchsphere.sphere_map.settling import settle
from torchsphere.sphere_map.state import State, drawn, fit_map, reweighted, unexplained
from torchsphere.sphere_map.tone_curve import is_on_one_side
from torchsphere.sphere_map.window import texture_variance

#: Pixels of the images that make the map, all in all (docs/constants.toml).
MAP_PIXELS = 700_000

#: Pixels of plain arithmetic that the forward model of a pixel is worth: it decides how images are shared out.
PIXELS_PER_PIXEL = 16.0

#: Width of the map's cells in units of the texture's width, and its limits, px (docs/constants.toml).
CELLS_PER_TEXTURE, MIN_CELL_PX, MAX_CELL_PX = 0.75, 1.0, 1.2

#: Variance of the noise over that of the texture from which the cells are wider, and by which factor: narrow cells take
#: up the noise, at the outline most (docs/constants.toml).
NOISY, WIDER_CELLS = 0.1, 1.7

#: Systematic error of the radius as a share of it, where the model explains the images down to white noise, and more
#: where it does not, by the factor in the steps' errors less 1, up to `MAX_EXCESS` (docs/constants.toml).
RADIUS_ERROR_SHARE, RADIUS_ERROR_SHARE_MORE, MAX_EXCESS = 0.00015, 0.001, 1.0

#: Standard deviation of the nearness of the camera per unit of that excess (docs/constants.toml).
SD_NEARNESS_MORE = 0.003

#: Images without blur, and a lens that bends nothing.
SHARP, NO_LENS = exposure.Blur(), Lens()


@dataclass(frozen=True)
class MapPoses:
    """Poses of n frames on the map."""

    position: Array  # (n, 2), px; NaN for a frame that is not on the map
    orientation: Array  # rotation (n, 3, 3) since the first known frame; NaN for a frame that is not on the map
    radius: Array  # radius (n,) of the outline, px; NaN for a frame that is not on the map
    step_covariance: Array  # covariance (n - 1, 5, 5) of the step from each frame to the next: px and rad
    sd_growth: Array  # standard deviation (n - 1,) of the relative change of the radius from each frame to the next
    circle: Circle  # the outline, with the radius of the map and the centre of the first known frame
    keyframes: int
    edge_blur: float  # blur of the outline by the optics, px
    misfit: float  # variance of the residual over the variance of the images' noise
    frame_misfit: Array  # (n,): mean square of each frame's weighted residual; NaN for a frame that is not on the map
    nearness: float = 0.0  # radius over the camera's distance, and its standard deviation
    sd_nearness: float = 0.0
    edge_bend: float = 0.0  # of the outline by the tone curve
    open_share: float = 0.0  # exposure over the time between frames
    falloff: float = 0.0  # of the ball's brightness to the image's corner
    lens: Lens = NO_LENS
    off_outline: float = 0.0  # error of the radius by what the outline tells, px: `radius_error.by_outline`
    # (5,): factors in the steps' standard deviations by an error that neighbouring pixels share
    widening: Array = field(default_factory=lambda: np.ones(5))


@dataclass(frozen=True)
class MapRequest:
    """Images of a ball, its motion by the correlation, and what is known of both, for a map."""

    source: Source
    # Position (n, 2), px, and orientation (n, 3, 3) of the frames err by at most half a speckle, drift within a turn
    # included; NaN where unknown.
    position: Array
    orientation: Array
    radius: Array  # of the outline (n,), px, nearly; NaN where unknown
    noise_share: float  # variance of the images' noise over that of their grey levels
    circle: Circle
    ignore: Tensor | None  # (h, w), True for pixels to ignore
    fineness: float  # of the texture's slopes over its variance, 1/px^2
    camera: Camera | None = None  # with a known focal length; without one its distance is found
    telecentric: bool = False
    grows: bool = False  # whether the ball comes nearer or goes away: its radius in each frame is an unknown
    stays: bool = False  # whether it turns without leaving its place
    progress: Callable[[int, int], None] | None = None
    blur: exposure.Blur = SHARP

    def report(self, done: int) -> None:
        """Tell the ``progress`` how many frames are done."""
        if self.progress is not None:
            self.progress(done, len(self.known))

    @property
    def is_distance_known(self) -> bool:
        """Whether the camera's distance was stated."""
        return self.camera is not None or self.telecentric

    @functools.cached_property
    def known(self) -> NDArray[np.int64]:
        """Numbers of the frames with a known pose."""
        return np.flatnonzero(np.isfinite(self.position[:, 0]) & np.isfinite(self.orientation[:, 0, 0]))

    @functools.cached_property
    def middle(self) -> Circle:
        """The outline with the radius that the map is made for: halfway between smallest and largest of those known."""
        if not self.grows:
            return self.circle
        known = self.radius[self.known]
        return replace(self.circle, radius=math.sqrt(float(known.min() * known.max())))


def poses_on_map(asked: MapRequest) -> MapPoses | NoMap:
    """Register all frames on a map of the ball: their poses, or why no map is possible.

    Singular equations of the map raise LinAlgError.
    """
    source, known, circle, blur = asked.source, asked.known, asked.middle, asked.blur
    lacking = few_poses(len(known))
    if lacking:
        return lacking
    frames = _known_frames(asked)
    keys = choose_keyframes(known, asked.orientation, circle.radius)
    windows = frames.windows(keys, frames.poses(np.array(keys)), circle.radius)
    noise = max(asked.noise_share * texture_variance(windows), source.rounding_variance)
    texture_px = circle.radius / asked.circle.radius / np.sqrt(asked.fineness)
    cell_px = float(np.clip(CELLS_PER_TEXTURE * texture_px, MIN_CELL_PX, MAX_CELL_PX))
    cell_px *= WIDER_CELLS if asked.noise_share > NOISY else 1.0
    asked.report(0)
    with threads.row_runner(source.device, PIXELS_PER_PIXEL * windows.levels[0].numel()) as shared:
        settled = settle(
            frames,
            keys,
            circle.radius,
            noise,
            cell_px,
            blur,
            shared,
            lambda share: asked.report(round(share * len(keys))),
            is_distance_known=asked.is_distance_known,
            is_lens_known=asked.camera is not None,
            grows=asked.grows,
            stays=asked.stays,
        )
        adjustment = settled.adjustment
        ball, turned = adjustment.state.ball, adjustment.state.poses.orientation
        # The first frame, with the outline that was given, is a keyframe.
        first_radius = _first_outline_radius(adjustment.state, is_camera_known=asked.camera is not None)
        off_outline = radius_error.by_outline(first_radius, turned, asked.circle)
        # A tone curve that the images cannot tell may look like the blur of a lens.
        outline_px = blur.outline_px if is_on_one_side(adjustment.state) else blur.optics_px
        by_blur = radius_error.by_blur(float(ball.edge_blur), outline_px, circle)
        error_px = math.hypot(by_blur, off_outline)
        # The equations of the last step are the largest arrays, and are not needed any more.
        adjustment = replace(adjustment.with_radius_error(error_px), last=None)
        settled = replace(settled, adjustment=adjustment)
        misfit = adjustment.residual_variance / noise
        shown = first_radius, asked.circle.radius, float(ball.edge_blur), blur.optics_px, misfit
        refused = refusal(*shown) or refused_as_unsettled(adjustment.settled)
        if refused:
            return refused
        numbers, found, widened = _on_map(settled.frames, keys, settled.initial, adjustment, shared, asked.report)
    assembled = _assemble(len(asked.position), numbers, found, keys, adjustment, circle, misfit)
    middle = orthographic(settled.frames.background.shape, source.device).principal
    darker = falloff(found.poses, float(ball.coefficients.mean()), middle)
    assembled = replace(assembled, off_outline=off_outline, open_share=settled.open_share, falloff=darker)
    assembled = _widened(assembled, widened, is_distance_known=asked.is_distance_known)
    optics = settled.frames.optics
    return assembled if optics is None else _through_lens(replace(assembled, lens=settled.lens), optics)


def _first_outline_radius(state: State, *, is_camera_known: bool) -> float:
    """Radius, px, that the circle of the first keyframe has: that at the ball's depth where the camera was known."""
    radius, optics = float(state.poses.radii(state.ball.radius)[0]), state.windows.optics
    return radius if is_camera_known or optics is None else optics.outline_radius(state.poses.centre[0], radius)


def _known_frames(asked: MapRequest) -> KnownFrames:
    """The images with what is known of them; images, poses and camera are all on one device."""
    source, known, circle = asked.source, asked.known, asked.middle
    optics = None if asked.camera is None else Optics.of(asked.camera, source.device)
    radius = np.where(np.isfinite(asked.radius), asked.radius, circle.radius)
    seen = torch.from_numpy(asked.position).to(source.device)
    centres = seen if optics is None else optics.straightened(seen)
    largest = float(radius[known].max())
    reach = largest * (1.0 if optics is None else optics.enlargement(centres[known], largest))
    motion = _motion(asked.position, asked.orientation, radius, source.durations(0, source.count))
    return KnownFrames(
        source,
        known,
        centres,
        torch.from_numpy(asked.orientation).to(source.device),
        torch.from_numpy(radius - circle.radius).to(source.device),
        background(source, asked.position, reach).to(source.device, torch.float32),
        None if asked.ignore is None else ~asked.ignore.to(source.device),
        optics,
        exposure.moments(motion, asked.blur.open_share, circle.radius),
    )


def _motion(position: Array, orientation: Array, radius: Array, durations: Array) -> Tensor:
    """Motion (n, 5) of all frames by the steps to their neighbours, px per interval.

    Rotations are times the ``radius`` (n,). ``durations`` (n - 1,) are the times of the steps, in frame intervals. 0
    where no neighbour is known.
    """
    turns = orientation[1:] @ np.swapaxes(orientation[:-1], 1, 2)
    known = np.asarray(np.isfinite(turns).all((1, 2)))
    turned = So3.from_matrix(torch.from_numpy(np.where(known[:, None, None], turns, np.eye(3)))).log().numpy()
    turned *= np.where(known, radius[1:], np.nan)[:, None]
    steps = np.concatenate((np.diff(position, axis=0), turned), 1)
    steps = np.pad(steps / durations[:, None], ((1, 1), (0, 0)), constant_values=np.nan)
    around = np.stack((steps[:-1], steps[1:]))
    measured = np.isfinite(around)
    return torch.from_numpy(np.where(measured, around, 0.0).sum(0) / measured.sum(0).clip(1))


def _widened(found: MapPoses, factors: Array, *, is_distance_known: bool) -> MapPoses:
    """The poses with errors that neighbouring pixels share, `residual_scatter.widening`, and what follows from them."""
    circle, excess = found.circle, min(float(factors.max()) - 1, MAX_EXCESS)
    by_model = (RADIUS_ERROR_SHARE + RADIUS_ERROR_SHARE_MORE * excess) * circle.radius
    outline = replace(
        circle,
        sd_x=float(circle.sd_x * factors[0]),
        sd_y=float(circle.sd_y * factors[1]),
        sd_radius=float(np.hypot(circle.sd_radius, by_model)),
    )
    covariance, sd_nearness = found.step_covariance * np.outer(factors[:5], factors[:5]), found.sd_nearness
    if sd_nearness and not is_distance_known:
        sd_nearness = math.hypot(sd_nearness, SD_NEARNESS_MORE * excess)
        if not tells_nearness(float(factors.max())):
            sd_nearness = max(sd_nearness, UNKNOWN_SD)
    widened = {"step_covariance": covariance, "sd_growth": factors[5] * found.sd_growth, "widening": factors[:5]}
    return replace(found, circle=outline, sd_nearness=sd_nearness, **widened)


def _through_lens(found: MapPoses, optics: Optics) -> MapPoses:
    """Positions, and the covariances of their steps, as the lens bends them."""
    if not optics.is_distorted:
        return found
    straight = torch.from_numpy(found.position).to(optics.principal.device)
    position = optics.bent(straight).cpu().numpy()
    unit = torch.eye(2, dtype=straight.dtype, device=straight.device)
    by_place = torch.stack([(optics.bent(straight + step) - optics.bent(straight - step)) / 2 for step in unit], -1)
    motion = np.zeros((len(position) - 1, 5, 5))
    motion[:, :2, :2], motion[:, 2:, 2:] = by_place[:-1].cpu().numpy(), np.eye(3)
    covariance = motion @ found.step_covariance @ np.swapaxes(motion, 1, 2)
    first = np.flatnonzero(np.isfinite(position[:, 0]))[0]
    circle = replace(found.circle, x=float(position[first, 0]), y=float(position[first, 1]))
    return replace(found, position=position, step_covariance=covariance, circle=circle)


def _on_map(
    frames: KnownFrames,
    keys: list[int],
    initial: Poses,
    adjustment: Adjustment,
    shared: RowRunner,
    report: Callable[[int], None],
) -> tuple[NDArray[np.int64], Registration, Array]:
    """Numbers (k,) and registrations of all frames on the map, and the `residual_scatter.widening` (6,) of their poses.

    The keyframes have settled what all images share. A map of more frames has less noise, and then all frames are
    registered on it.
    """
    state, anchors = adjustment.state, (keys, initial, adjustment.state.poses)
    chosen = choose_map_frames(frames.known, keys, MAP_PIXELS // state.windows.levels[0].numel())
    numbers, poses = np.array(keys), state.poses
    if len(chosen) > len(keys):
        others, found = register_frames(frames, np.setdiff1d(chosen, keys), anchors, state, shared, lambda done: None)
        order = torch.from_numpy(np.argsort(np.concatenate((keys, others))))
        numbers, poses = np.union1d(keys, others), Poses.joined([poses, found.poses]).take(order)
    state, leverage = _of_more_frames(state, frames, numbers, poses, shared)
    registered, found = register_frames(frames, frames.known, anchors, state, shared, report)
    some = residual_scatter.spread_out(len(registered))
    poses = found.poses.take(torch.from_numpy(some).to(found.misfit.device))
    windows = frames.windows(registered[some].tolist(), poses, state.ball.radius)
    widened = residual_scatter.widening(windows, poses, state.ball, state.profile).cpu().numpy()
    found = replace(found, misfit=without_leverage(found.misfit, registered, numbers, leverage))
    return registered, found, widened


def _of_more_frames(
    state: State, frames: KnownFrames, numbers: NDArray[np.int64], poses: Poses, shared: RowRunner
) -> tuple[State, Tensor]:
    """The state with a map of the frames with these ``numbers`` (m,) and ``poses``, and the frames' leverage (m,)."""
    windows = frames.windows(numbers.tolist(), poses, state.ball.radius)
    state = replace(state, windows=windows, poses=poses)
    design = drawn(state, shared)
    residual = unexplained(state, design, shared)
    state = reweighted(state, residual, torch.zeros_like(residual), shared)
    state, equations = fit_map(state, shared, NEW_MAP_STEPS, design)
    leverage, visible = equations.leverage(), windows.visibility > 0
    mean = (visible * leverage).sum((1, 2)) / visible.sum((1, 2)).clamp_min(1)
    return reweighted(state, unexplained(state, design, shared), leverage, shared), mean


def _assemble(
    n: int,
    numbers: NDArray[np.int64],
    found: Registration,
    keys: list[int],
    adjustment: Adjustment,
    circle: Circle,
    misfit: float,
) -> MapPoses:
    """Arrays over all ``n`` frames from the registrations, and the outline with its standard deviations."""
    position, orientation, radii = (np.full((n, *shape), np.nan) for shape in ((2,), (3, 3), ()))
    position[numbers] = found.poses.centre.cpu().numpy()
    orientation[numbers] = (found.poses.orientation @ found.poses.orientation[0].T).cpu().numpy()
    ball, variances = adjustment.state.ball, adjustment.covariance.diagonal().cpu().numpy()
    radii[numbers] = found.poses.radii(ball.radius).cpu().numpy()
    first = int(numbers[0])
    k = keys.index(first) if first in keys else 0
    sd_x, sd_y = np.sqrt(variances[PER_IMAGE * k : PER_IMAGE * k + 2])
    outline = replace(
        circle,
        x=float(position[first, 0]),
        y=float(position[first, 1]),
        radius=float(radii[first]),
        sd_guessed=False,
        sd_x=float(sd_x),
        sd_y=float(sd_y),
        sd_radius=float(np.sqrt(variances[-COMMON])),
    )
    steps = step_covariances(n, numbers, found, keys, adjustment)
    motion, growth = steps[:, :5, :5], np.sqrt(steps[:, 5, 5].clip(0))
    near, sd_near = float(nearness_of(adjustment.state)), adjustment.sd_nearness
    misfits = np.full(n, np.nan)
    misfits[numbers] = found.misfit.cpu().numpy()
    blur = float(ball.edge_blur)
    poses = position, orientation, radii, motion, growth
    return MapPoses(*poses, outline, len(keys), blur, misfit, misfits, near, sd_near, ball.edge_bend)
