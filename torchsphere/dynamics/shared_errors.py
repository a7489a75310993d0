"""Errors that all frames share: of scale, circle, frame rate and mass, and the steady error of the steps."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from torchsphere.dynamics.scale import Scale
from torchsphere.motion.track import Track
from torchsphere.runtime.arrays import Array

#: Error of a step, px, per px of error of the radius and rad of rotation: by pairs, and on a map (docs/constants.toml).
STEP_PER_RADIUS, STEP_PER_RADIUS_ON_MAP = 3.0, 1.3

#: Relative change of the rotation per relative change of the radius: by pairs, and on a map (docs/constants.toml).
ROTATION_PER_RADIUS, ROTATION_PER_RADIUS_ON_MAP = 2.1, 0.85

#: Rotation about z by an error (d_x, d_y) of the centre, per ``(w_x d_x + w_y d_y) / R`` (docs/constants.toml).
ROTATION_Z_PER_CENTRE = -0.85

#: Change of the steady error from the start of a flight to its end, as a share of that error (docs/constants.toml).
STEADY_CHANGE = 1.4

#: Sources of the errors that all frames share, by their names in a budget.
SHARED = ("radius", "scale", "centre", "steady_error", "frame_rate", "mass")


def per_radius(track: Track) -> tuple[float, float]:
    """Error of a step, px per px of the radius and rad, and of rotations, relative per relative error of the radius.

    On a map of the ball the poses of a flight hold each other, and steps do not add up.
    """
    if track.findings.is_on_map:
        return STEP_PER_RADIUS_ON_MAP, ROTATION_PER_RADIUS_ON_MAP
    return STEP_PER_RADIUS, ROTATION_PER_RADIUS


@dataclass(frozen=True)
class InputErrors:
    """Drawn errors (s,) of the numbers that were given with a recording."""

    faster: Array  # factor on the frame rate
    length: Array  # error of the given diameter or pixel size, in its standard deviations
    mass: Array  # error of the mass, in its standard deviations


@dataclass(frozen=True)
class SharedErrors:
    """Standard deviations of the errors that all frames share.

    Scale and radius are taken as independent, although the scale may come from the radius: the sign of their sum
    depends on the direction of the rotation.
    """

    steady: Array  # of all steps of a flight (5,), px and rad per frame
    scale: float  # of all lengths, relative
    step: float  # of a step by the radius, px per rad of rotation
    rotation: float  # of all rotations by the radius, relative
    centre: Array  # of the followed point from the ball's centre (2,), px; the point turns with the ball about z
    rotation_z: float  # factor of the centre's error: rotation about z per px and per rad of rotation about x and y
    adds_up: bool  # whether positions are sums of steps, so that errors of the steps add up in them
    given: float = 0.0  # part of ``scale`` by the given diameter or pixel size, relative
    frame_rate: float = 0.0  # relative
    length_sds: float = 1.0  # of the drawn errors of the length, in its own: 0 without them
    mass_sds: float = 1.0  # likewise of the mass

    @staticmethod
    def of(track: Track, scale: Scale, relative_sd_frame_rate: float = 0.0) -> SharedErrors:
        """Shared errors of a track; a circle without an uncertainty adds no error, and the summary says so."""
        sd_radius = float(np.nan_to_num(track.circle.sd_radius))
        sd_centre = np.nan_to_num([track.circle.sd_x, track.circle.sd_y])
        # A steady error of the steps moves the followed point away from the centre, by half of the total on average.
        # A map, or a ball that stays in its place, prevents that.
        by_step, by_rotation = per_radius(track)
        adds_up = not (track.settings.get("in_place") or track.findings.is_on_map)
        drift = track.sd_steady[:2] * len(track.increment) / 2 if adds_up else 0.0
        return SharedErrors(
            steady=track.sd_steady,
            scale=scale.sd_m_per_px / scale.m_per_px,
            step=by_step * sd_radius,
            rotation=by_rotation * sd_radius / track.circle.radius,
            centre=np.hypot(sd_centre, drift),
            rotation_z=ROTATION_Z_PER_CENTRE / track.circle.radius,
            adds_up=adds_up,
            given=scale.relative_sd_given,
            frame_rate=relative_sd_frame_rate,
        )

    def by_sources(self, sources: Sequence[str]) -> SharedErrors:
        """The errors of some sources of `SHARED` alone; a scale by the outline belongs to the radius."""
        has = {source: float(source in sources) for source in SHARED}
        by_outline = np.sqrt(max(self.scale**2 - self.given**2, 0.0))
        return replace(
            self,
            steady=has["steady_error"] * self.steady,
            scale=float(np.hypot(has["radius"] * by_outline, has["scale"] * self.given)),
            step=has["radius"] * self.step,
            rotation=has["radius"] * self.rotation,
            centre=has["centre"] * self.centre,
            given=has["scale"] * self.given,
            frame_rate=has["frame_rate"] * self.frame_rate,
            length_sds=has["scale"],
            mass_sds=has["mass"],
        )

    def sd_of_path(self, frames: Array, rate: Array) -> Array:
        """Standard deviations (n, 2), px, of positions at the times ``frames`` (n,) since the first by errors of steps.

        ``rate`` (n, 5) per frame. The steady error adds up with the frames, that by the radius with the turn.
        """
        if not self.adds_up:
            return np.zeros((len(frames), 2))
        passed = frames - frames[0]
        turned = np.concatenate(
            (np.zeros((1, 2)), (np.nan_to_num(rate[:-1, [3, 2]]) * np.diff(frames)[:, None]).cumsum(0))
        )
        return np.hypot(passed[:, None] * self.steady[:2], self.step * turned)

    def total_sd(self, values: Array, own_sd: Array, spin_z: Array | None = None) -> Array:
        """Standard deviations (n, 5) of rates or accelerations, from the frames' ``own_sd`` and the shared errors.

        ``spin_z`` (n,) is the spin about z, for accelerations.
        """
        # A point beside the centre moves on a circle around the centre.
        by_centre = np.abs(values[:, 4:]) * self.centre[::-1]
        if spin_z is not None:
            by_centre = np.hypot(by_centre, spin_z[:, None] ** 2 * self.centre)
        by_scale = self.scale * values[:, :2]
        total = np.hypot(own_sd, self._sd_by_radius(values))
        total[:, :2] = np.hypot(np.hypot(total[:, :2], np.nan_to_num(by_centre)), by_scale)
        tilt = np.nan_to_num(values[:, 2:4]) * self.centre
        total[:, 4] = np.hypot(total[:, 4], self.rotation_z * np.hypot(tilt[:, 0], tilt[:, 1]))
        return total

    def _sd_by_radius(self, values: Array) -> Array:
        """Standard deviations (n, 5) of rates or accelerations by the radius alone."""
        # The error of a step along x is proportional to the rotation about y, along y to the rotation about x.
        size = np.abs(np.nan_to_num(values))
        return np.concatenate((self.step * size[:, [3, 2]], self.rotation * size[:, 2:]), 1)

    def steady_change(self, frames: Array, contact: Array | None, rate: Array) -> Array:
        """Standard deviation (n, 5) of the steady error's change per frame, at the times ``frames`` (n,).

        Along a flight the steady error may change by `STEADY_CHANGE`, and the radius' effect on the ``rate`` (n, 5) by
        its own size: both come from the texture at the limb, which another texture replaces as the ball turns. In the
        ``contact``, start and end (2,) in frames, another steady error takes the place of the first.
        """
        begin, stop = frames[[0, -1]]
        start, end = (stop, stop) if contact is None else contact
        lengths = np.maximum([start - begin, (end - start) / np.sqrt(2), stop - end], 1.0)
        part = np.where(start < end, (frames > start).astype(int) + (frames >= end), 0)
        in_flight = (part != 1)[:, None] * self._sd_by_radius(rate)
        # In the contact the change is the difference of two steady errors.
        own = np.where(part == 1, 1.0, STEADY_CHANGE)[:, None] * self.steady
        return np.hypot(own, in_flight) / lengths[part][:, None]

    def draw(self, rate: Array, acceleration: Array, frames: Array, contact: Array) -> tuple[Array, Array]:
        """Drawn rates and accelerations (s, n, 5), each with a scale, a circle and steady errors of its own.

        ``frames`` (n,) are their times, and ``contact`` (s, 2) start and end of the contact in frames.
        """
        normal = _normals(len(rate))
        steady = self.steady * normal.steady
        # The steady error depends on the rotation, so that it changes in the contact.
        length = np.maximum(contact[:, 1:] - contact[:, :1], 1e-9)
        passed = np.nan_to_num(np.clip((frames - contact[:, :1]) / length, 0, 1))[..., None]
        centre = self.centre * normal.centre
        across = centre[..., ::-1] * [-1, 1]

        def disturbed(values: Array) -> Array:
            by_radius = self.step * normal.step * np.nan_to_num(values[..., [3, 2]])
            by_centre = across * np.nan_to_num(values[..., 4:])
            translation = (values[..., :2] + by_radius + by_centre) * (1 + self.scale * normal.scale)
            turn = values[..., 2:] * (1 + self.rotation * normal.rotation)
            turn[..., 2] += self.rotation_z * (centre * np.nan_to_num(values[..., 2:4])).sum(-1)
            return np.concatenate((translation, turn), -1)

        change = (steady[1] - steady[0]) / length[..., None] * ((passed > 0) & (passed < 1))
        change[..., :2] -= centre * np.nan_to_num(rate[..., 4:]) ** 2
        return disturbed(rate + steady[0] * (1 - passed) + steady[1] * passed), disturbed(acceleration + change)

    def draw_inputs(self, count: int) -> InputErrors:
        """Errors of frame rate, length and mass of ``count`` motions, those of `draw`."""
        normal = _normals(count)
        # The length has a part of the scale's error: its correlation with the scale is the ratio of both.
        common = min(self.given / self.scale, 1.0) if self.given > 0 else 0.0
        length = common * normal.scale[:, 0, 0] + np.sqrt(1 - common**2) * normal.length
        # The exponential function keeps the rate positive.
        faster = np.exp(self.frame_rate * normal.frame_rate)
        return InputErrors(faster, self.length_sds * length, self.mass_sds * normal.mass)


@dataclass(frozen=True)
class _Normals:
    """Standard normal errors of s motions."""

    steady: Array  # (2, s, 1, 5), before and after the contact
    scale: Array  # (s, 1, 1)
    step: Array  # (s, 1, 1)
    rotation: Array  # (s, 1, 1)
    centre: Array  # (s, 1, 2)
    length: Array  # (s,)
    frame_rate: Array  # (s,)
    mass: Array  # (s,)


@functools.cache
def _normals(count: int) -> _Normals:
    """The same errors for every call with the same ``count``."""
    generator = np.random.default_rng(0)
    steady = generator.normal(size=(2, count, 1, 5))
    scale, step, rotation = generator.normal(size=(3, count, 1, 1))
    centre = generator.normal(size=(count, 1, 2))
    # Numbers at even shares of the distribution have its standard deviation and quantiles without sampling error.
    even = np.array([NormalDist().inv_cdf((k + 0.5) / count) for k in range(count)])
    length, frame_rate, mass = (generator.permutation(even) for _ in range(3))
    return _Normals(steady, scale, step, rotation, centre, length, frame_rate, mass)
