"""Combinations of degrees of freedom with independent errors, of covariances that are known."""

import dataclasses

import numpy as np
import pytest
import torch
from pulses import M_PER_PX, MASS_KG, NOISES_M, RATE, pulse

from torchsphere.dynamics.kinematics import kinematics_of_many
from torchsphere.estimation import contact_search, rts
from torchsphere.estimation.measurements import MIN_OWN_SHARE, Poses, poses, separation

SHOTS, FRAMES = 3, 400
TIMES, ALL = torch.arange(float(FRAMES)).expand(SHOTS, FRAMES), torch.ones(SHOTS, FRAMES, 3, dtype=torch.bool)


SWING = 30 * torch.sin(torch.arange(FRAMES) / 10)


def measured(correlation: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Covariances (n, t, 3, 3) and values (n, t, 3): the second swings, and its errors go with those of the first."""
    covariance = torch.eye(3, dtype=torch.float64)
    covariance[0, 1] = covariance[1, 0] = correlation
    root = torch.linalg.cholesky(covariance)
    errors = torch.randn(SHOTS, FRAMES, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1)) @ root.T
    return covariance.expand(SHOTS, FRAMES, 3, 3), errors + torch.stack((0 * SWING, SWING, 0 * SWING), -1)


def test_the_value_that_moves_is_freed_of_the_errors_of_the_one_that_rests() -> None:
    covariance, value = measured(-0.95)
    found = separation(covariance, value, TIMES, ALL)
    torch.testing.assert_close(found[:, 0], torch.tensor([1.0, 0, 0]).expand(SHOTS, 3).double(), atol=0.2, rtol=0)
    torch.testing.assert_close(found[:, 1, 0], torch.full((SHOTS,), 0.95).double())
    left = (found[:, None] @ value[..., None])[:, :, 1, 0] - SWING
    # A hundredth is the scatter of a variance of 400 values.
    torch.testing.assert_close(left.var(1), torch.full((SHOTS,), 1 - 0.95**2).double(), atol=0.03, rtol=0)


def test_errors_that_are_independent_already_stay_as_they_are() -> None:
    covariance, value = measured(0.0)
    found = separation(covariance, value, TIMES, ALL)
    torch.testing.assert_close(found, torch.eye(3).expand(SHOTS, 3, 3).double())


def test_what_was_not_seen_throughout_is_left_out() -> None:
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


def test_the_weights_are_those_of_the_frames_that_both_were_seen_in() -> None:
    covariance, value = (v.clone() for v in measured(-0.95))
    seen = ALL.clone()
    # Before the second was seen the first was measured otherwise.
    seen[:, :350, 1] = False
    covariance[:, :350, 0, 0] = 1 / 16
    found = separation(covariance, value, TIMES, seen)
    torch.testing.assert_close(found[:, 1, 0], torch.full((SHOTS,), 0.95).double())


def test_a_value_without_an_error_is_no_part_of_the_others() -> None:
    covariance, value = (v.clone() for v in measured(-0.95))
    covariance[:, :, 0], covariance[:, :, :, 0] = 0, 0
    torch.testing.assert_close(separation(covariance, value, TIMES, ALL), torch.eye(3).expand(SHOTS, 3, 3).double())


def of_a_pulse(seed: int = 1) -> Poses:
    return poses([pulse(seed, NOISES_M[1]).track], [np.arange(80.0)])


def test_errors_that_are_one_leave_something_of_their_own() -> None:
    found = of_a_pulse()
    covariance = found.covariance.clone()
    covariance[:, :, 1, 2] = covariance[:, :, 2, 1] = -(covariance[:, :, 1, 1] * covariance[:, :, 2, 2]).sqrt()
    variance = dataclasses.replace(found, covariance=covariance).series().variance
    assert float(variance[0, 2].min()) == pytest.approx(MIN_OWN_SHARE)


@pytest.mark.parametrize("seed", range(24))
def test_the_position_across_the_force_counts_as_quieter_than_the_spin(seed: int) -> None:
    assert float(of_a_pulse(seed).separation[0, 1, 2]) == 0


def test_a_longer_recording_beside_it_changes_nothing() -> None:
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
    drift = 0.08 * (covariance[:, 1:] + covariance[:, :-1]).diagonal(dim1=-2, dim2=-1)
    noisy = dataclasses.replace(whole, covariance=covariance, drift=drift)
    assert float(noisy.separation[0, 2, 1]) == pytest.approx(0.95, abs=0.01)


def test_what_was_not_seen_says_nothing_to_the_smoother_whatever_the_noise() -> None:
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
    ends = [rts.forward(one, found, rts.MotionModel(one, found))[1][-1] for one in (hidden, vague)]
    # Of y, the quieter one of y and wx.
    np.testing.assert_allclose(ends[0][..., 1, 1], ends[1][..., 1, 1], rtol=1e-3)


def test_the_spin_is_freed_of_the_errors_of_the_position_across_the_force() -> None:
    found = of_a_pulse()
    # y rests but for its errors; wx looks like its motion, with a correlation of -0.95.
    assert float(found.separation[0, 2, 1]) == pytest.approx(0.95, abs=0.01)
    assert float(found.series().variance[0, 2, 5]) == pytest.approx(1 - 0.95**2, abs=0.001)
    # x moves more than wy, and is freed of its errors.
    assert float(found.separation[0, 3, 0]) == 0
    assert float(found.separation[0, 0, 3]) == pytest.approx(-0.95, abs=0.01)


def test_a_chain_that_was_broken_is_not_carried_into_the_others() -> None:
    whole = of_a_pulse()
    drift = whole.drift.clone()
    drift[0, 40, 3] = 1e8
    broken = dataclasses.replace(whole, drift=drift)
    assert float(broken.separation[0, 0, 3]) == 0
    assert float(broken.series().drift[0, 0].max()) == float(whole.drift[0, :, 0].max())
    assert float(broken.separation[0, 2, 1]) == pytest.approx(0.95, abs=0.01)


def test_stated_correlations_make_forces_more_accurate() -> None:
    made = [pulse(seed, NOISES_M[1]) for seed in range(8)]
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
