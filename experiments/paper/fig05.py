"""Figure 5, acceleration of a drop weight by images and by an accelerometer: ``python -m experiments.paper.fig05``.

Claim: at 5000 frames per second both show the same lobe, of the same amplitude and duration; the accelerometer is
noisier.

Paper: one figure, no numbers.

Here: the preset ``paper-drop-weight``. The ball stands for the weight's hemispherical head, with its upper half in
sight: a plain shaft over that half more than doubled the error of the steps, and the peak was 18 % too high. The ball
is tracked frame to frame from the circle that is found; the acceleration is that of torchsphere's smoother. The
accelerometer's signal comes from the true motion: no weight (0 in free fall), sampled at 50 kHz by its own clock, gain
1 % high, an offset, noise of 5 % of the peak, and ringing of the mount at 7 kHz. `torchsphere.instruments.signals`
aligns signal and track. Amplitude is the peak of the lobe, duration its width at half of the peak.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

import torchsphere as ts
from experiments.experiment import FIGURES, GREEN, Array, Row, claims, saved_figure
from experiments.shots import Footage, rendered, tracked
from render import preset
from render.trajectory import DropWeight
from torchsphere.instruments.signals import Alignment, align

#: Properties of the accelerometer. The paper gives none, and calls the sensor "quite noisy".
SAMPLING_HZ, GAIN, OFFSET_M_S2, NOISE, RINGING, RING_HZ, DECAY_S = 50e3, 1.01, 15.0, 0.05, 0.1, 7e3, 1.5e-3
#: Time of the sensor's clock at the first frame, s.
CLOCK_S = 0.01234

#: Largest difference in amplitude and duration of equal lobes; standard deviations that count as agreement.
SAME, WITHIN = 0.05, 3.0


@dataclass(frozen=True)
class Drop:
    """The drop by both instruments."""

    footage: Footage  # the weight's head
    motion: ts.Kinematics  # from the images
    sensor_time_s: Array  # (m,) by the accelerometer's own clock
    sensor_m_s2: Array  # the accelerometer's signal (m,), upwards
    alignment: Alignment  # of images and accelerometer


def accelerometer(motion: DropWeight, length_s: float, seed: int) -> tuple[Array, Array]:
    """Times (m,) by the sensor's clock and signal (m,), m/s^2 upwards, of an accelerometer on the weight."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(length_s * SAMPLING_HZ)) / SAMPLING_HZ
    free = motion.gravity_m_s2 - motion.state(time).acceleration_m_s2[:, 1]
    peak, since = float(free.max()), time - 1e-6 * motion.touch_us
    ring = np.where(since > 0, np.exp(-np.maximum(since, 0) / DECAY_S) * np.sin(2 * np.pi * RING_HZ * since), 0.0)
    signal = GAIN * (free + RINGING * peak * ring) + OFFSET_M_S2 + NOISE * peak * rng.standard_normal(len(time))
    return CLOCK_S + time, signal


def compute() -> Drop:
    """The drop, by both instruments and aligned."""
    shot = preset.load("paper-drop-weight")
    assert isinstance(shot.trajectory, DropWeight)
    footage, seed = rendered(shot), shot.setup.sensor.seed
    track = tracked(footage, sphere_map=False)
    motion = ts.kinematics(
        track,
        frame_rate=shot.frame_rate_hz,
        m_per_px=footage.m_per_px,
        mass_kg=1e-3 * shot.trajectory.mass_g,
        lab_frame=True,
    )
    time, signal = accelerometer(shot.trajectory, float(shot.times_s[-1]), seed)
    return Drop(footage, motion, time, signal, align(motion, time, signal, direction=np.array([0.0, 1.0])))


def lobe(time_s: Array, values: Array) -> tuple[float, float]:
    """Peak of a lobe (n,) and its width in s at half of the peak, on a spline; NaN if the lobe has no end."""
    fine = np.linspace(time_s[0], time_s[-1], 50 * len(time_s))
    curve = CubicSpline(time_s, values)(fine)
    at = int(curve.argmax())
    low = curve < curve[at] / 2
    if not (low[:at].any() and low[at:].any()):
        return float(curve[at]), float("nan")
    first, last = at - int(low[at::-1].argmax()), at + int(low[at:].argmax())
    return float(curve[at]), float(fine[last] - fine[first])


def rows(drop: Drop) -> list[Row]:
    """The claims of the figure."""
    both, shot = drop.alignment, drop.footage.shot
    gravity = float(getattr(shot.trajectory, "gravity_m_s2", 9.81))
    true = lobe(both.time_s, -shot.trajectory.state(both.time_s).acceleration_m_s2[:, 1] + gravity)
    images = lobe(both.time_s, both.track_m_s2 + gravity)
    sensor = lobe(both.time_s, both.sensor_m_s2 - float(np.median(both.sensor_m_s2)))
    late, sd = both.delay_s - CLOCK_S, both.sd_delay_s
    off = [float(v / w - 1) for v, w in zip(images, sensor, strict=True)]
    return [
        Row(
            "fig05",
            "Images and accelerometer show a lobe of the same amplitude.",
            "well measured",
            f"{images[0]:.0f} and {sensor[0]:.0f} m/s² ({100 * off[0]:+.1f} %; the sensor's gain is 1 % high), true "
            f"{true[0]:.0f}",
            abs(off[0]) < SAME,
        ),
        Row(
            "fig05",
            "Images and accelerometer show a lobe of the same duration.",
            "well measured",
            f"{1e3 * images[1]:.2f} and {1e3 * sensor[1]:.2f} ms ({100 * off[1]:+.1f} %), true {1e3 * true[1]:.2f}",
            abs(off[1]) < SAME,
        ),
        Row(
            "fig05",
            "Both can be put over each other.",
            "drawn on one axis of time",
            f"clocks apart by {1e3 * both.delay_s:.3f} ± {1e3 * sd:.3f} ms, true {1e3 * CLOCK_S:.3f}; correlation "
            f"{both.correlation:.4f}, rms difference {both.rms_difference_m_s2:.0f} m/s²",
            abs(late) < max(WITHIN * sd, 0.1 / shot.frame_rate_hz),
        ),
    ]


def plot(drop: Drop) -> None:
    """A picture of the weight, and both accelerations."""
    with saved_figure(FIGURES / "fig05.png", (10, 4.4), dpi=80) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(1, 3.4))
        shot, both = drop.footage.shot, drop.alignment
        left.imshow(drop.footage.images[0], cmap="gray", vmin=0, vmax=255)
        left.set_xticks([])
        left.set_yticks([])
        time = np.linspace(0, shot.times_s[-1], 1000)
        signal = drop.sensor_m_s2 - np.median(drop.sensor_m_s2)
        frames, sd = 1e3 * drop.motion.time_s, drop.motion.sd_acceleration_m_s2[:, 1]
        upwards = drop.motion.acceleration_m_s2[:, 1] + 9.81
        right.plot(1e3 * (drop.sensor_time_s - both.delay_s), signal, color="0.75", lw=0.5, label="accelerometer")
        right.plot(1e3 * time, 9.81 - shot.trajectory.state(time).acceleration_m_s2[:, 1], color=GREEN, label="true")
        right.errorbar(frames, upwards, sd, fmt=".", color="black", ms=4, lw=0.8, label="images")
        right.set_xlabel("time (ms)")
        right.set_ylabel("acceleration without weight (m/s²)")
        right.legend()


def main() -> None:
    """Measure, draw, and print the claims."""
    found = compute()
    plot(found)
    print(claims(rows(found)))


if __name__ == "__main__":
    main()
