"""Errors that all frames of a recording share: of the scale, of the radius, and what steps are steadily off by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.scale import Scale
from torchsphere.tracking.drift import STEP_PER_RADIUS
from torchsphere.tracking.track import Track

#: Relative change of the rotation for a relative change of the radius. Measured at 0.5 deg per frame and R = 50 px: an
#: error of 1 px in the radius (2 %) changes the rotation by 0.021 deg (4.2 %).
ROTATION_PER_RADIUS = 2.1

#: What a circle off the ball's centre by d px adds to the rotation about z, over ``(w_x d_x + w_y d_y) / R``: the
#: surface is taken for deeper on one side than on the other, and what that does to a turn out of the image's plane
#: looks like one about z. Over a region of 0.95 R it is 0.90; with the points' weights 0.83 to 0.91 were measured
#: (R = 30 and 50 px, two kinds of texture, four patterns each).
ABOUT_Z_PER_CENTRE = -0.85

#: Change of the steady error from the start of a flight to its end, as a share of it. Measured on rendered flights of
#: 26 and 30 frames without noise, four patterns: from one half to the other 0.7 of what `steady_error` states.
CHANGE = 1.4

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shared:
    """Standard deviations of what all frames share.

    The scale's and the radius's are taken as independent, although one may come from the other: how they add up
    differs with the direction of the rotation.

    Attributes
    ----------
    steady : ndarray
        Of all steps of a flight (5,), px and rad per frame.
    scale : float
        Of all lengths, relative.
    step : float
        By the radius, px per frame for each rad per frame of rotation.
    rotation : float
        Of all rotations by the radius, relative.
    centre : ndarray
        Of the point that is followed from the ball's centre (2,), px. It turns with the ball about z.
    about_z : float
        Rotation about z that comes of it, per px along the rotation in the image's plane, as a share of that.
    """

    steady: Array
    scale: float
    step: float
    rotation: float
    centre: Array
    about_z: float

    @staticmethod
    def of(track: Track, scale: Scale) -> Shared:
        """What the frames of a track share; a circle without an uncertainty adds none, and the summary says so."""
        sd_radius = float(np.nan_to_num(track.circle.sd_radius))
        sd_centre = np.nan_to_num([track.circle.sd_x, track.circle.sd_y])
        # Steps that are off alike lead away from the centre; on average over the recording half of the way. A map keeps
        # to it, and so does a ball that stays in its place.
        kept = track.settings.get("in_place") or track.settings.get("sphere_map", {}).get("used")
        strayed = 0.0 if kept else track.sd_steady[:2] * len(track.increment) / 2
        return Shared(
            steady=track.sd_steady,
            scale=scale.sd_m_per_px / scale.m_per_px,
            step=STEP_PER_RADIUS * sd_radius,
            rotation=ROTATION_PER_RADIUS * sd_radius / track.circle.radius,
            centre=np.hypot(sd_centre, strayed),
            about_z=ABOUT_Z_PER_CENTRE / track.circle.radius,
        )

    def sd(self, values: Array, own: Array, spin: Array | None = None) -> Array:
        """Standard deviations (n, 5) of rates or accelerations, with what each has of its ``own``.

        ``spin`` (n,) is that about z, for accelerations.
        """
        # A point off the centre goes round it.
        of_centre = np.abs(values[:, 4:]) * self.centre[::-1]
        if spin is not None:
            of_centre = np.hypot(of_centre, spin[:, None] ** 2 * self.centre)
        of_scale = self.scale * values[:, :2]
        found = np.hypot(own, self._of_radius(values))
        found[:, :2] = np.hypot(np.hypot(found[:, :2], np.nan_to_num(of_centre)), of_scale)
        along = np.nan_to_num(values[:, 2:4]) * self.centre
        found[:, 4] = np.hypot(found[:, 4], self.about_z * np.hypot(along[:, 0], along[:, 1]))
        return found

    def _of_radius(self, values: Array) -> Array:
        """Standard deviations (n, 5) of rates or accelerations by the radius alone."""
        # The error of a step goes with the rotation: that of x with the one about y.
        size = np.abs(np.nan_to_num(values))
        return np.concatenate((self.step * size[:, [3, 2]], self.rotation * size[:, 2:]), 1)

    def steady_change(self, frames: Array, contact: Array | None, rate: Array) -> Array:
        """Standard deviation (n, 5) of the steady error's change per frame, at the times ``frames`` (n,).

        Along a flight it may change by `CHANGE`, and what the radius does at the ``rate`` (n, 5) by its own size: both
        come from the texture at the limb, which is another one after a while. (Radii off by 0.5 of 40 px moved the
        steps of two rendered flights by 0.003 to 0.009 px, and by 0.006 px more at the end than at the beginning.) In
        the contact, start and end (2,) in frames, the steady error becomes another.
        """
        begin, stop = frames[[0, -1]]
        start, end = (stop, stop) if contact is None else contact
        lengths = np.maximum([start - begin, (end - start) / np.sqrt(2), stop - end], 1.0)
        part = np.where(start < end, (frames > start).astype(int) + (frames >= end), 0)
        in_flight = (part != 1)[:, None] * self._of_radius(rate)
        # In the contact, the difference of two.
        own = np.where(part == 1, 1.0, CHANGE)[:, None] * self.steady
        return np.hypot(own, in_flight) / lengths[part][:, None]

    def draw(self, rate: Array, acceleration: Array, frames: Array, edges: Array) -> tuple[Array, Array]:
        """Drawn rates and accelerations (s, n, 5), each with a scale, a radius and steady errors of its own.

        ``frames`` (n,) are their times and ``edges`` (s, 2) start and end of the contact.
        """
        generator = np.random.default_rng(0)
        steady = self.steady * generator.normal(size=(2, len(rate), 1, 5))
        # The steady error goes with the rotation, so that it changes in the contact.
        length = np.maximum(edges[:, 1:] - edges[:, :1], 1e-9)
        after = np.nan_to_num(np.clip((frames - edges[:, :1]) / length, 0, 1))[..., None]
        scale, step, rotation = generator.normal(size=(3, len(rate), 1, 1))
        centre = self.centre * generator.normal(size=(len(rate), 1, 2))
        across = centre[..., ::-1] * [-1, 1]

        def disturbed(values: Array) -> Array:
            of_radius = self.step * step * np.nan_to_num(values[..., [3, 2]])
            of_centre = across * np.nan_to_num(values[..., 4:])
            moved = (values[..., :2] + of_radius + of_centre) * (1 + self.scale * scale)
            turned = values[..., 2:] * (1 + self.rotation * rotation)
            turned[..., 2] += self.about_z * (centre * np.nan_to_num(values[..., 2:4])).sum(-1)
            return np.concatenate((moved, turned), -1)

        becoming = (steady[1] - steady[0]) / length[..., None] * ((after > 0) & (after < 1))
        becoming[..., :2] -= centre * np.nan_to_num(rate[..., 4:]) ** 2
        return disturbed(rate + steady[0] * (1 - after) + steady[1] * after), disturbed(acceleration + becoming)
