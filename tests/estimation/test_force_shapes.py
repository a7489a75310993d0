"""Forces that are no half-sines: the smoother's forces and bands against exact truth."""

from collections.abc import Callable

import numpy as np
import pytest
from pulses import FRAMES, LENGTH, M_PER_PX, MASS_KG, NOISES_M, PEAK_N, RATE, Pulse, Push, filmed

from torchsphere.dynamics.kinematics import kinematics_of_many

SHOTS, PARTS = 5, 50

Shape = Callable[[np.ndarray], np.ndarray]


def triangle(share: np.ndarray) -> np.ndarray:
    return 1 - np.abs(2 * share - 1)


def two_peaks(share: np.ndarray) -> np.ndarray:
    return np.sin(np.pi * share) * (1 - 0.5 * np.exp(-(((share - 0.5) / 0.12) ** 2)))


def shaped(shape: Shape, seed: int, noise_m: float) -> Pulse:
    """A pulse of another shape than in `pulses`, integrated in fiftieths of a frame: exact to 1e-3 of the noise."""
    rng = np.random.default_rng(seed)
    start = 33 + rng.random()
    share = ((np.arange((FRAMES - 1) * PARTS) + 0.5) / PARTS - start) / LENGTH
    inside = (share > 0) & (share < 1)
    change = np.where(inside, PEAK_N / MASS_KG * shape(np.clip(share, 0, 1)), 0.0) / (RATE * PARTS)
    slowed = np.concatenate(([0.0], np.cumsum(change)))
    between = 0.5 * (slowed[1:] + slowed[:-1])
    path = np.concatenate(([0.0], np.cumsum(between))) / (RATE * PARTS)
    at_frames = (np.arange(FRAMES) - start) / LENGTH
    force = np.where((at_frames > 0) & (at_frames < 1), PEAK_N * shape(np.clip(at_frames, 0, 1)), 0.0)
    push = Push(
        path_m=path[::PARTS],
        slowed_m_s=slowed[::PARTS],
        force_N=force,
        gained=slowed[::PARTS] / slowed[-1],
        gained_between=between / slowed[-1],
        edges=np.array([start, start + LENGTH]),
    )
    return filmed(push, noise_m, rng)


#: By shape and noise, m: largest error of the force, N, root mean square over the contact (of a peak of 29 kN). It is
#: about 1.4 times what is seen in five shots; `experiments.validation.contact_shapes` has more shots, and
#: eight shapes, a plateau and the force of Hertz among them.
LIMITS = {
    (two_peaks, NOISES_M[1]): 850,
    (triangle, NOISES_M[0]): 62,
}

#: Least share of values in the bands of 95 %: 0.93 to 1 are seen, and five shots give a share to 3 percent.
LEAST_INSIDE = 0.88


@pytest.mark.parametrize(("shape", "noise_m"), LIMITS, ids=lambda value: getattr(value, "__name__", f"{value}"))
def test_forces_of_other_shapes_lie_within_their_bands(shape: Shape, noise_m: float) -> None:
    made = [shaped(shape, seed, noise_m) for seed in range(SHOTS)]
    found = kinematics_of_many([p.track for p in made], frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)
    off = np.concatenate([(k.force_N - p.force_N)[p.touching, 0] for p, k in zip(made, found, strict=True)])
    sd = np.concatenate([k.sd_force_N[p.touching, 0] for p, k in zip(made, found, strict=True)])
    assert np.sqrt((off**2).mean()) < LIMITS[shape, noise_m]
    assert (np.abs(off) < 1.96 * sd).mean() > LEAST_INSIDE
