"""The frontal impact on the bar, rendered and tracked, for figures 8, 9 and 11.

The motion is that of `bar` with its default numbers, written as a table and rendered by the preset ``paper-bar``: the
paper's optics, three spots, shutter of 1/81 000 s, noise, 512 x 128 px at 36 000 frames per second, 114 frames. The bar
stands still behind the ball in the pictures.

torchsphere gets the images alone: it finds the circle, whose outline is smeared by 3 px, and takes the poses from its
map of the ball. Translations alone start from the true circle. Lengths use the camera's scale, as with a calibrated
camera.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

import torchsphere as ts
from experiments.experiment import BLUE, CACHE, GREEN, VERMILION, Array
from experiments.paper.bar.history import History
from experiments.paper.bar.impact import simulate
from experiments.paper.bar.setup import Setup
from experiments.paper.bar.table import write_table
from experiments.shots import Footage, rendered, rival, tracked
from render import preset
from render.trajectory import Table
from torchsphere.benchmark.baselines import Baseline

#: Time from the first frame to first touch, and the place of the bar's axis. The ball is in the picture in all frames.
BEFORE_S, ORIGIN_M = 0.85e-3, (0.032, -0.001, 0.0)
#: Depth of the bar in the pictures, behind the ball, m.
BEHIND_M = 0.012
#: Time of the table of motion beyond the first and the last frame, for the exposure.
MARGIN_S = 20e-6

#: Colours of the model, of torchsphere, of its smoother, and of translations alone.
MODEL, OURS, SMOOTH, TRANSLATION = GREEN, "black", BLUE, VERMILION


@dataclass(frozen=True)
class Impact:
    """The true impact and its measurements."""

    history: History  # of the model, from first touch on
    footage: Footage  # frame 0 is `BEFORE_S` before first touch
    track: ts.Track  # by torchsphere, from the circle that it finds
    translation_only: Baseline  # by the standard correlation, from the true circle

    @property
    def time_s(self) -> Array:
        """Times of the frames (n,) since first touch."""
        return self.footage.shot.times_s - BEFORE_S

    @property
    def frame_rate_hz(self) -> float:
        """Frames per second."""
        return self.footage.shot.frame_rate_hz

    @property
    def exact(self) -> ts.Track:
        """The track with the true positions and increments at the frames' times."""
        increment = self.footage.true("dx_px", "dy_px", "wx_rad", "wy_rad", "wz_rad")[1:]
        return dataclasses.replace(self.track, position=self.footage.true("x_px", "y_px"), increment=increment)

    def kinematics(self, track: ts.Track, method: str) -> ts.Kinematics:
        """Motion in SI units by one of torchsphere's ways to differentiate."""
        return ts.kinematics(
            track,
            frame_rate=self.frame_rate_hz,
            m_per_px=self.footage.m_per_px,
            mass_kg=self.history.setup.ball_mass_kg,
            method=method,
        )

    def after(self, share: float = 0.0) -> slice:
        """Frames after the last contact, less a first ``share`` of them."""
        first = int(np.searchsorted(self.time_s, self.history.contacts_s[-1][1])) + 1
        return slice(first + round(share * (len(self.time_s) - first)), len(self.time_s))


def compute() -> Impact:
    """The impact, rendered and tracked."""
    history = simulate(Setup())
    shot = preset.load("paper-bar", [f"background.objects.0.centre_m=[{ORIGIN_M[0]}, 0.0, {BEHIND_M}]"])
    CACHE.mkdir(exist_ok=True)
    file = write_table(
        history,
        CACHE / "bar-motion.csv",
        before_s=BEFORE_S + MARGIN_S,
        after_s=float(shot.times_s[-1]) - BEFORE_S + MARGIN_S,
        origin_m=ORIGIN_M,
    )
    motion = Table(file=str(file), start_s=-BEFORE_S, mass_g=1e3 * history.setup.ball_mass_kg)
    footage = rendered(dataclasses.replace(shot, trajectory=motion))
    track = tracked(footage)
    return Impact(history, footage, track, rival(footage, "translation_only", footage.circle))


def shade(axis: Axes, history: History) -> None:
    """Shade the model's contacts on an axis in ms."""
    for begin, end in history.contacts_s:
        axis.axvspan(1e3 * begin, 1e3 * end, color="0.88", lw=0, zorder=0)


def dense(history: History, start_s: float, stop_s: float) -> tuple[Array, Array, Array]:
    """Times (m,) of the model with flight before and after, velocity and spin (m, 3)."""
    time = np.concatenate(((start_s,), history.time_s[::10], (stop_s,)))
    velocity, spin = (
        np.concatenate((values[:1], values[::10], values[-1:])) for values in (history.velocity_m_s, history.spin_rad_s)
    )
    return time, velocity, spin
