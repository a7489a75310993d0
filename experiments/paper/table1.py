"""Table 1, velocity by a light gate and by images at two pressures: ``python -m experiments.paper.table1``.

Claim: the mean velocity by the images agrees with that of the light gate within the uncertainty.

Paper: 63.63 and 99.12 m/s by the light gate at 2.8 and 4.5 bar; 63.99 +- 0.79 (0.57 % off) and 99.70 +- 1.05 m/s
(0.61 % off) by the images, where +- is the standard deviation from frame to frame.

Here: a ball of 30 mm flies at the velocities of the light gate. It is rendered by the preset ``paper-flight`` (36 000
frames per second, 512 x 128 px, shutter 1/81 000 s) for as long as it is in the picture, and tracked frame to frame
with the found circle and the known scale. The gate's signals come from the same motion: two barriers 40 mm apart, each
a beam of 2 mm; receivers with a time constant of 5 us, gains and offsets of their own, noise of 2 % of the signal, and
sampling at 1 MHz. `torchsphere.instruments.signals` recovers the delay. The distance of the barriers counts as known to
0.1 mm, which is most of the gate's uncertainty; here it is exactly 40 mm.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

import torchsphere as ts
from experiments.experiment import Array, Row, claims, table
from experiments.shots import rendered, spread, tracked
from render import preset
from torchsphere.instruments.signals import GateVelocity, light_gate

#: Section 4.1 and table 1, by pressure in bar: velocity by the gate, mean and standard deviation by the images, m/s.
PAPER = {2.8: (63.63, 63.99, 0.79), 4.5: (99.12, 99.70, 1.05)}
SPACING_M = 0.040

#: Properties of the gate, not in the paper; see above.
SD_SPACING_M, BEAM_M, RISE_S, NOISE, SAMPLING_HZ = 0.1e-3, 2e-3, 5e-6, 0.02, 1e6
#: Voltage of each receiver in the dark, and gain in light.
RECEIVERS_V = ((0.20, 4.6), (0.35, 4.1))

#: Number of frames with the whole ball in the picture, and the first centre.
FRAMES, START_M = {2.8: 50, 4.5: 40}, (-0.0535, -0.0005, 0.0)

#: Largest relative difference of images and gate.
ALLOWED = 0.006


@dataclass(frozen=True)
class Shot:
    """The shot at one pressure."""

    true_m_s: float  # the ball's velocity
    time_s: Array  # of the gate's signals (n,)
    volts: Array  # the gate's signals (2, n)
    gate: GateVelocity  # from the signals
    velocity_m_s: Array  # from the images (m, 2), from frame to frame
    track: ts.Track

    @property
    def images_m_s(self) -> tuple[float, float]:
        """Mean and standard deviation of the velocity along x from the images."""
        return spread(self.velocity_m_s[:, 0])

    @property
    def discrepancy(self) -> float:
        """Relative difference of the images' velocity from the gate's."""
        return self.images_m_s[0] / self.gate.velocity_m_s - 1


def barrier_light(time_s: Array, velocity_m_s: float, place_m: float, radius_m: float) -> Array:
    """Share (n,) of a barrier's light on its receiver, beside a ball whose centre is at 0 at time 0.

    The beam has the width `BEAM_M` along the ball's path and none across; the time constant of the receiver is
    `RISE_S`.
    """
    ahead = (velocity_m_s * time_s - place_m + radius_m + BEAM_M / 2) / BEAM_M
    behind = (velocity_m_s * time_s - place_m - radius_m + BEAM_M / 2) / BEAM_M
    light = 1 - (np.clip(ahead, 0, 1) - np.clip(behind, 0, 1))
    keep = float(np.exp(-(time_s[1] - time_s[0]) / RISE_S))
    # First-order lag from full light.
    return np.asarray(lfilter([1 - keep], [1, -keep], light - 1) + 1)


def gate_signals(velocity_m_s: float, radius_m: float, seed: int) -> tuple[Array, Array]:
    """Times (n,) in s and voltages (2, n) of both receivers, with noise."""
    length = (2 * SPACING_M + 4 * radius_m) / velocity_m_s
    time = np.arange(round(length * SAMPLING_HZ)) / SAMPLING_HZ - (SPACING_M / 2 + 2 * radius_m) / velocity_m_s
    rng = np.random.default_rng(seed)
    volts = []
    for place, (dark, swing) in zip((0.0, SPACING_M), RECEIVERS_V, strict=True):
        light = barrier_light(time, velocity_m_s, place, radius_m)
        volts.append(dark + swing * (light + NOISE * rng.standard_normal(len(time))))
    return time, np.stack(volts)


def measure(pressure_bar: float) -> Shot:
    """The shot at one pressure by gate and images."""
    velocity, seed = PAPER[pressure_bar][0], round(10 * pressure_bar)
    shot = preset.load("paper-flight", [f"trajectory.velocity_m_s=[{velocity}, 0.72, 0.0]"], seed=seed)
    motion = dataclasses.replace(shot.trajectory, start_m=START_M)  # type: ignore[type-var]  # a free flight
    footage = rendered(dataclasses.replace(shot, trajectory=motion, frames=FRAMES[pressure_bar]))
    track = tracked(footage, sphere_map=False)
    time, volts = gate_signals(velocity, shot.setup.ball.radius_m, seed)
    gate = light_gate(time, *volts, spacing_m=SPACING_M, sd_spacing_m=SD_SPACING_M)
    images = track.increment[:, :2] * footage.m_per_px * shot.frame_rate_hz
    return Shot(velocity, time, volts, gate, images, track)


def compute() -> dict[float, Shot]:
    """The shots at both pressures."""
    return {pressure: measure(pressure) for pressure in PAPER}


def rows(shots: dict[float, Shot]) -> list[Row]:
    """The claims of the table."""
    found = []
    for pressure, shot in shots.items():
        gate, images, std = PAPER[pressure]
        mean, own = shot.images_m_s
        found.append(
            Row(
                "table1",
                f"At {pressure} bar the images give the velocity of the light gate.",
                f"{gate:.2f} by the gate, {images:.2f} ± {std:.2f} m/s by images: {100 * (images / gate - 1):.2f} %",
                f"{shot.gate.velocity_m_s:.2f} ± {shot.gate.sd_velocity_m_s:.2f} by the gate, {mean:.3f} ± {own:.3f} "
                f"m/s by images: {100 * shot.discrepancy:+.2f} %; true {shot.true_m_s:.2f} "
                f"({100 * (mean / shot.true_m_s - 1):+.3f} %)",
                abs(shot.discrepancy) < ALLOWED and own < std,
            )
        )
    return found


def main() -> None:
    """Measure, and print the table."""
    shots, lines = compute(), []
    for pressure, shot in shots.items():
        (mean, std), gate = shot.images_m_s, shot.gate
        lines.append(
            (
                pressure,
                f"{gate.velocity_m_s:.3f} ± {gate.sd_velocity_m_s:.3f}",
                f"{1e6 * gate.delay_s:.3f} ± {1e6 * gate.sd_delay_s:.3f}",
                f"{mean:.4f} ± {std:.4f}",
                f"{100 * shot.discrepancy:+.3f} %",
                f"{100 * (mean / shot.true_m_s - 1):+.4f} %",
            )
        )
    print(table(("pressure (bar)", "gate (m/s)", "delay (us)", "images (m/s)", "off gate", "off truth"), lines))
    print(claims(rows(shots)))


if __name__ == "__main__":
    main()
