"""Poses with independent errors from a track, and combinations of degrees of freedom with independent errors."""

import dataclasses

import numpy as np
import pytest
import torch
from pulses import M_PER_PX, MASS_KG, NOISES_M, RATE, pulse
from tracks import made_track

import torchsphere as ts
from torchsphere.dynamics.kinematics import kinematics_of_many
from torchsphere.estimation import contact_search, rts
from torchsphere.estimation.measurements import MIN_OWN_SHARE, Poses, poses, separation
from torchsphere.estimation.motion_model import MotionModel

#: Frames with steps of the outline alone, and frames with steps of the texture.
PLAIN, TEXTURED = 20, 8


def half_textured() -> ts.Track:
    """A ball whose texture comes into view: from it translation and rotation are known together better than alone."""
    n = PLAIN + TEXTURED
    sd = np.array([0.04, 0.04, 1e-3, 1e-3, 1e-3])
    track = made_track(np.tile([3.0, 0.4, 0.0, 0.0, 0.0], (n, 1)), sd, ts.Circle(50.0, 40.0, 30.0, 0.0, 0.0, 0.0))
    covariance, increment = track.covariance.copy(), track.increment.copy()
    for i, j in ((0, 3), (1, 2)):
        covariance[:, i, j] = covariance[:, j, i] = 0.95 * sd[i] * sd[j]
    covariance[:PLAIN, 2:], covariance[:PLAIN, :, 2:], increment[:PLAIN, 2:] = np.nan, np.nan, np.nan
    covariance[:PLAIN, :2, :2] = np.diag([0.01, 0.01]) ** 2
    return dataclasses.replace(track, covariance=covariance, increment=increment, settings={})


def test_every_covariance_of_a_pose_is_positive() -> None:
    found = poses([half_textured()], [np.arange(PLAIN + TEXTURED + 1.0)])
    smallest = torch.linalg.eigvalsh(found.covariance[0] / found.unit[0] / found.unit[0, :, None])[:, 0]
    assert torch.all(smallest >= 0)
    # Where both come from the same steps, their covariance stays.
    both = found.covariance[0, PLAIN + 1 :]
    torch.testing.assert_close(both[:, 0, 3], 0.95 * (both[:, 0, 0] * both[:, 3, 3]).sqrt())


def test_the_smoother_accepts_a_texture_that_comes_into_view() -> None:
    motion = ts.kinematics(half_textured(), frame_rate=1000.0, m_per_px=5e-4)
    np.testing.assert_allclose(motion.velocity_m_s[:, 0], 1.5, atol=0.01)
    assert np.isfinite(motion.sd_velocity_m_s).all()


SHOTS, FRAMES = 3, 400
TIMES, ALL = torch.arange(float(FRAMES)).expand(SHOTS, FRAMES), torch.ones(SHOTS, FRAMES, 3, dtype=torch.bool)
SWING = 30 * torch.sin(torch.arange(FRAMES) / 10)


def measured(correlation: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Covariances (n, t, 3, 3) and values (n, t, 3): the second swings, with errors like those of the first."""
    covariance = torch.eye(3, dtype=torch.float64)
    covariance[0, 1] = covariance[1, 0] = correlation
    root = torch.linalg.cholesky(covariance)
    errors = torch.randn(SHOTS, FRAMES, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1)) @ root.T
    return covariance.expand(SHOTS, FRAMES, 3, 3), errors + torch.stack((0 * SWING, SWING, 0 * SWING), -1)


def test_a_moving_value_is_freed_of_the_errors_of_a_resting_value() -> None:
    covariance, value = measured(-0.95)
    found = separation(covariance, value, TIMES, ALL)
    torch.testing.assert_close(found[:, 0], torch.tensor([1.0, 0, 0]).expand(SHOTS, 3).double(), atol=0.2, rtol=0)
    torch.testing.assert_close(found[:, 1, 0], torch.full((SHOTS,), 0.95).double())
    left = (found[:, None] @ value[..., None])[:, :, 1, 0] - SWING
    # Variances of 400 values scatter by a hundredth.
    torch.testing.assert_close(left.var(1), torch.full((SHOTS,), 1 - 0.95**2).double(), atol=0.03, rtol=0)


def test_independent_errors_are_not_changed() -> None:
    covariance, value = measured(0.0)
    found = separation(covariance, value, TIMES, ALL)
    torch.testing.assert_close(found, torch.eye(3).expand(SHOTS, 3, 3).double())


def test_a_value_that_was_not_seen_in_all_frames_is_left_out() -> None:
    covariance, value = measured(-0.95)
    seen = ALL.clone()
    seen[1, 7, 0] = False
    found = separation(covariance, value, TIMES, seen)
    torch.testing.assert_close(found[1], torch.eye(3).double())
    assert torch.all(found[[0, 2], 1, 0] > 0.9)


def test_a_straight_line_is_no_motion() -> None:
    covariance, value = measured(-0.95)
    value = value.clone()
    value[:, :, 0] += 7 * TIMES
    found = separation(covariance, value, TIMES, ALL)
    torch.testing.assert_close(found[:, 1, 0], torch.full((SHOTS,), 0.95).double())


def test_the_weights_come_from_the_frames_in_which_both_were_seen() -> None:
    covariance, value = (v.clone() for v in measured(-0.95))
    seen = ALL.clone()
    # Before the second value was seen, the first had other errors.
    seen[:, :350, 1] = False
    covariance[:, :350, 0, 0] = 1 / 16
    found = separation(covariance, value, TIMES, seen)
    torch.testing.assert_close(found[:, 1, 0], torch.full((SHOTS,), 0.95).double())


def test_a_value_without_an_error_has_no_share_in_the_others() -> None:
    covariance, value = (v.clone() for v in measured(-0.95))
    covariance[:, :, 0], covariance[:, :, :, 0] = 0, 0
    torch.testing.assert_close(separation(covariance, value, TIMES, ALL), torch.eye(3).expand(SHOTS, 3, 3).double())


def of_a_pulse(seed: int = 1) -> Poses:
    return poses([pulse(seed, NOISES_M[1]).track], [np.arange(80.0)])


def test_fully_correlated_errors_leave_the_least_own_share() -> None:
    found = of_a_pulse()
    covariance = found.covariance.clone()
    covariance[:, :, 1, 2] = covariance[:, :, 2, 1] = -(covariance[:, :, 1, 1] * covariance[:, :, 2, 2]).sqrt()
    variance = dataclasses.replace(found, covariance=covariance).series().variance
    assert float(variance[0, 2].min()) == pytest.approx(MIN_OWN_SHARE)


@pytest.mark.parametrize("seed", range(24))
def test_the_position_across_the_force_counts_as_quieter_than_the_spin(seed: int) -> None:
    assert float(of_a_pulse(seed).separation[0, 1, 2]) == 0


def test_a_longer_recording_in_the_batch_changes_nothing() -> None:
    short, long = pulse(3, NOISES_M[1]).track, pulse(4, NOISES_M[1]).track
    cut = {name: getattr(short, name)[:30] for name in ("position", "orientation", "status", "zncc", "iterations")}
    short = dataclasses.replace(short, **cut, increment=short.increment[:29], covariance=short.covariance[:29])
    alone = poses([short], [np.arange(30.0)])
    both = poses([short, long], [np.arange(30.0), np.arange(80.0)])
    torch.testing.assert_close(both.separation[0], alone.separation[0])
    torch.testing.assert_close(both.series().value[0, :, :30], alone.series().value[0])


def test_a_noisy_step_does_not_break_a_chain() -> None:
    whole = of_a_pulse()
    covariance = whole.covariance.clone()
    covariance[0, 40] *= 30
    drift = 0.08 * (covariance[:, 1:] + covariance[:, :-1])
    noisy = dataclasses.replace(whole, covariance=covariance, drift=drift)
    assert float(noisy.separation[0, 2, 1]) == pytest.approx(0.95, abs=0.01)


def test_unseen_poses_have_no_influence_on_the_smoother_whatever_the_noise() -> None:
    whole = of_a_pulse(8)
    found = contact_search.find(whole.series())
    found = dataclasses.replace(found, noise=found.noise * torch.tensor([1.0, 1.0, 3.0, 1.0, 1.0]).double())
    odd = torch.arange(80) % 2 == 1
    seen, covariance = whole.seen.clone(), whole.covariance.clone()
    seen[:, odd, 2:] = False
    covariance[:, odd, 2:], covariance[:, odd, :, 2:] = 0, 0
    hidden = dataclasses.replace(whole, seen=seen)
    covariance[:, odd, 2:, 2:] = 1e6 * torch.eye(3).double()
    vague = dataclasses.replace(whole, covariance=covariance)
    for one in (hidden, vague):
        one.__dict__["separation"] = whole.separation
    ends = [rts.forward(one, found, MotionModel(one, found))[1][-1] for one in (hidden, vague)]
    # The variance of y, which is quieter than wx.
    np.testing.assert_allclose(ends[0][..., 1, 1], ends[1][..., 1, 1], rtol=1e-3)


def test_the_spin_is_freed_of_the_errors_of_the_position_across_the_force() -> None:
    found = of_a_pulse()
    # y rests; wx looks like motion in y, with errors correlated by -0.95.
    assert float(found.separation[0, 2, 1]) == pytest.approx(0.95, abs=0.01)
    assert float(found.series().variance[0, 2, 5]) == pytest.approx(1 - 0.95**2, abs=0.001)
    # x moves more than wy and is freed of the errors of wy.
    assert float(found.separation[0, 3, 0]) == 0
    assert float(found.separation[0, 0, 3]) == pytest.approx(-0.95, abs=0.01)


def test_a_broken_chain_has_no_share_in_the_other_values() -> None:
    whole = of_a_pulse()
    drift = whole.drift.clone()
    drift[0, 40, 3, 3] = 1e8
    broken = dataclasses.replace(whole, drift=drift)
    assert float(broken.separation[0, 0, 3]) == 0
    assert float(broken.series().drift[0, 0].max()) == float(whole.drift[0, :, 0, 0].max())
    assert float(broken.separation[0, 2, 1]) == pytest.approx(0.95, abs=0.01)


def test_stated_correlations_make_forces_more_accurate() -> None:
    made = [pulse(seed, NOISES_M[1]) for seed in range(4)]
    alone = []
    for one in made:
        diagonal = np.diagonal(one.track.covariance, axis1=1, axis2=2)
        alone.append(dataclasses.replace(one.track, covariance=diagonal[:, :, None] * np.eye(5)))
    off = []
    for tracks in ([one.track for one in made], alone):
        found = kinematics_of_many(tracks, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)
        errors = [(k.force_N - p.force_N)[p.touching, 0] for p, k in zip(made, found, strict=True)]
        off.append(float(np.sqrt(np.mean(np.concatenate(errors) ** 2))))
    assert off[0] < 0.8 * off[1]
