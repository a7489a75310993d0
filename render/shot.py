"""A shot: the setup, the motion of the ball, and the times of the frames."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .check import within
from .scene import Setup
from .trajectory import Table, Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shot:
    """Everything that defines a recording.

    Attributes
    ----------
    name, description : str
        Name, and a description in one line.
    frame_rate_hz : float
        Frames per second; frame ``i`` has the middle of its exposure at ``i / frame_rate_hz``.
    frames : int
        Number of frames.
    trajectory : Trajectory
        Motion of the ball.
    setup : Setup
        Everything else.
    """

    name: str
    frame_rate_hz: float
    frames: int
    trajectory: Trajectory
    setup: Setup = field(default_factory=Setup)
    description: str = ""

    def __post_init__(self) -> None:
        """Check the values, alone and together."""
        within("frame_rate_hz", self.frame_rate_hz, 0.0, above=True)
        within("frames", self.frames, 1)
        exposure, interval = self.setup.shutter.exposure_s, 1.0 / self.frame_rate_hz
        if exposure > interval:
            raise ValueError(
                f"shutter.exposure_s = {exposure!r}: longer than the {interval:.6g} s from frame to frame; expected a "
                "shorter exposure or a lower frame_rate_hz"
            )
        self._check_ball()
        self._check_motion()

    @property
    def times_s(self) -> Array:
        """Middle of each frame's exposure (n,), s."""
        return np.arange(self.frames) / self.frame_rate_hz

    def _check_ball(self) -> None:
        diameter = getattr(self.trajectory, "diameter_mm", self.setup.ball.diameter_mm)
        if diameter != self.setup.ball.diameter_mm:
            raise ValueError(
                f"trajectory.diameter_mm = {diameter!r}: the ball's is {self.setup.ball.diameter_mm!r}; expected the "
                "same, or leave it out"
            )

    def _check_motion(self) -> None:
        half = 0.5 * self.setup.shutter.exposure_s
        if isinstance(self.trajectory, Table):
            try:
                self.trajectory(np.array([-half, self.times_s[-1] + half]))
            except ValueError as error:
                raise ValueError(f"trajectory.{error}") from error
        if self.setup.camera.model == "pinhole":
            depth = self.trajectory(self.times_s).position_m[:, 2]
            frame = int(depth.argmin())
            if depth[frame] <= self.setup.ball.radius_m:
                raise ValueError(
                    f"trajectory: in frame {frame} the ball's centre is at z = {depth[frame]:.6g} m; a pinhole camera "
                    f"needs it more than the ball's radius of {self.setup.ball.radius_m:g} m before it"
                )


def seeded(setup: Setup, seed: int) -> Setup:
    """The setup with the seed in each part that has a seed."""
    parts = {f.name: getattr(setup, f.name) for f in dataclasses.fields(setup)}
    new = {name: dataclasses.replace(part, seed=seed) for name, part in parts.items() if hasattr(part, "seed")}
    return dataclasses.replace(setup, **new)
