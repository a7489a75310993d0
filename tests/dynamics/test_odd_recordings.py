"""Recordings with gaps, without rotation, at rest, or of a few frames: a result or one sentence, and no warning.

The tests take every warning of NumPy as an error.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest
from pulses import M_PER_PX, NOISES_M, RATE, pulse

import torchsphere as ts
from torchsphere.dynamics.kinematics import mean_motion
from torchsphere.motion.findings import Findings
from torchsphere.settings.choices import METHODS

FRAMES = 80


def made() -> ts.Track:
    return pulse(1, NOISES_M[0]).track


def part(track: ts.Track, start: int, stop: int) -> ts.Track:
    """The frames from ``start`` to ``stop - 1``."""
    frames, steps = slice(start, stop), slice(start, stop - 1)
    per_frame = ("position", "orientation", "zncc", "iterations", "status", "radius")
    changes = {name: getattr(track, name)[frames] for name in per_frame}
    changes |= {name: getattr(track, name)[steps] for name in ("increment", "covariance", "sd_growth")}
    return replace(track, **changes)


def lost(track: ts.Track, frames: Iterable[int]) -> ts.Track:
    """The track without measurements in some frames."""
    for frame in frames:
        track.position[frame], track.orientation[frame], track.zncc[frame] = np.nan, np.nan, np.nan
        steps = slice(max(frame - 1, 0), frame + 1)
        track.increment[steps], track.covariance[steps] = np.nan, np.nan
    status = track.status.copy()
    status[list(frames)] = "lost"
    return replace(track, status=status)


def without_rotation(track: ts.Track) -> ts.Track:
    track.increment[:, 2:], track.covariance[:, 2:], track.covariance[:, :, 2:] = np.nan, np.nan, np.nan
    track.orientation[1:] = np.nan
    return replace(track, status=np.full(FRAMES, "weak_texture"))


def moved(track: ts.Track, step_px: float) -> ts.Track:
    """The same step in all frames, without any turn or scatter."""
    track.increment[:] = [step_px, 0.0, 0.0, 0.0, 0.0]
    track.position[:] = 50.0 + np.arange(FRAMES)[:, None] * [step_px, 0.0]
    return replace(track, orientation=np.tile(np.eye(3), (FRAMES, 1, 1)))


def of_pairs(track: ts.Track) -> ts.Track:
    return replace(track, findings=Findings(), sd_steady=np.full(5, 1e-3))


CASES: dict[str, Callable[[], ts.Track]] = {
    "gap in contact": lambda: lost(made(), range(36, 44)),
    "ends lost": lambda: lost(made(), [0, 1, 78, 79]),
    "every other frame": lambda: lost(made(), range(1, FRAMES, 2)),
    "three lone frames": lambda: lost(made(), set(range(FRAMES)) - {10, 40, 60}),
    "all but one lost": lambda: lost(made(), range(1, FRAMES)),
    "all lost": lambda: lost(made(), range(FRAMES)),
    "no rotation": lambda: without_rotation(made()),
    "no rotation, gap": lambda: lost(without_rotation(made()), range(10, 20)),
    "at rest": lambda: moved(made(), 0.0),
    "uniform": lambda: moved(made(), 3.0),
    "pairs, gap": lambda: lost(of_pairs(made()), range(36, 44)),
    "two frames": lambda: part(made(), 0, 2),
    "three frames": lambda: part(made(), 0, 3),
    "in contact": lambda: part(made(), 36, 46),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("case", CASES)
def test_an_odd_recording_has_a_motion_and_an_impact_or_a_reason(case: str, method: str) -> None:
    track = CASES[case]()
    for mass in (0.11, 1e6):
        motion = ts.kinematics(track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=mass, method=method)
        assert "frames" in repr(motion)
        assert motion.force_N is not None
        assert motion.sd_force_N is not None
        # Whatever has a value has an uncertainty, and whatever has none has none.
        np.testing.assert_array_equal(np.isfinite(motion.force_N), np.isfinite(motion.sd_force_N))
        np.testing.assert_array_equal(np.isfinite(motion.velocity_m_s), np.isfinite(motion.sd_velocity_m_s))
        np.testing.assert_array_equal(np.isfinite(motion.spin_rad_s), np.isfinite(motion.sd_spin_rad_s))
        assert np.isfinite(track.increment).any() == any(
            np.isfinite(v).any() for v in mean_motion(track, None).values()
        )
        assert set(mean_motion(track, motion)) > set(mean_motion(track, None))
        for normal_deg in (None, 180.0):
            found, reason = ts.impact(motion, ts.ball(mass, 0.015), normal_deg=normal_deg)
            assert (found is None) == bool(reason)
            assert bool(ts.impacts(motion, ts.ball(mass, 0.015), normal_deg=normal_deg)) == (found is not None)


def test_a_single_frame_is_refused() -> None:
    with pytest.raises(ValueError, match="one frame shows no motion"):
        ts.kinematics(part(made(), 0, 1), frame_rate=RATE, m_per_px=M_PER_PX)
