"""Long recordings and several impacts: windows around the forces, joined with the flights between."""

import numpy as np
import pulses
import pytest
from pulses import M_PER_PX, MASS_KG, NOISES_M, PEAK_N, RATE, Pulse, Push, filmed, pulse

import torchsphere as ts
from torchsphere.dynamics.kinematics import Kinematics

BALL = ts.ball(MASS_KG, 150 * M_PER_PX)

#: Steps of the integration of the path per frame: exact to 1e-3 of the noise.
PARTS = 50

#: Start and length, frames, and peak, N, of three half-sines.
HITS = ((40.3, 14.0, PEAK_N), (110.7, 14.0, 10e3), (180.2, 14.0, 0.05 * PEAK_N))


def shot_of(hits: tuple[tuple[float, float, float], ...], frames: int, monkeypatch: pytest.MonkeyPatch) -> Pulse:
    """A ball that is slowed by several half-sines of force."""
    monkeypatch.setattr(pulses, "FRAMES", frames)

    def force(time: np.ndarray) -> np.ndarray:
        shares = [(np.clip((time - start) / length, 0, 1), peak) for start, length, peak in hits]
        return np.sum([0 * time, *(peak * np.sin(np.pi * share) for share, peak in shares)], axis=0)

    change = force((np.arange((frames - 1) * PARTS) + 0.5) / PARTS) / MASS_KG / (RATE * PARTS)
    slowed = np.concatenate(([0.0], np.cumsum(change)))
    between = 0.5 * (slowed[1:] + slowed[:-1])
    path = np.concatenate(([0.0], np.cumsum(between))) / (RATE * PARTS)
    total = slowed[-1] if hits else 1.0
    push = Push(
        path_m=path[::PARTS],
        slowed_m_s=slowed[::PARTS],
        force_N=force(np.arange(float(frames))),
        gained=slowed[::PARTS] / total,
        gained_between=between / total,
        edges=np.array([hits[0][0], hits[-1][0] + hits[-1][1]]) if hits else np.zeros(2),
    )
    return filmed(push, NOISES_M[0], np.random.default_rng(5))


def moved(shot: Pulse) -> Kinematics:
    return ts.kinematics(shot.track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)


def test_three_impacts_are_found_each_within_its_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    motion = moved(shot_of(HITS, 240, monkeypatch))
    found = ts.impacts(motion, BALL, normal_deg=180.0)
    assert len(found) == 3
    for impact, (start, length, peak) in zip(found, HITS, strict=True):
        true = {
            "contact_start": start / RATE,
            "duration": length / RATE,
            "peak_force": peak,
            "impulse_size": 2 / np.pi * peak * length / RATE,
        }
        for name, value in true.items():
            estimate = getattr(impact, name)
            assert abs(estimate.value - value) < 3 * estimate.sd, name
    strongest, _ = ts.impact(motion, BALL, normal_deg=180.0)
    assert strongest is not None
    assert strongest.count == 3
    assert strongest.peak_force == found[0].peak_force


def test_a_contact_in_two_thousand_frames_has_its_force_and_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pulses, "FRAMES", 2000)
    shot = pulse(1, NOISES_M[0])
    motion = moved(shot)
    [found] = ts.impacts(motion, BALL, normal_deg=180.0)
    assert found.peak_force is not None
    assert abs(found.peak_force.value - PEAK_N) < 0.005 * PEAK_N
    assert abs(found.peak_force.value - PEAK_N) < 3 * found.peak_force.sd
    off = (motion.velocity_m_s - shot.velocity_m_s) / motion.sd_velocity_m_s
    assert np.sqrt((off**2).mean()) < 1.3
    # No step of the bands where windows and flights meet.
    flight = motion.sd_velocity_m_s[60:, 0]
    assert np.abs(np.diff(np.log(flight))).max() < 0.2


def test_a_long_flight_has_no_impact(monkeypatch: pytest.MonkeyPatch) -> None:
    motion = moved(shot_of((), 1500, monkeypatch))
    assert ts.impacts(motion, BALL) == []
    assert motion.contact_s is None
    assert np.isfinite(motion.velocity_m_s).all()
