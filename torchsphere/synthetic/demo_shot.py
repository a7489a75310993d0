"""The demo's shot: a speckled ball flies, hits a bar and bounces back, along the exact course of `demo_motion`."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tifffile
import torch
from kornia.geometry.liegroup import So3
from numpy.typing import NDArray

from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.motion.track import Track
from torchsphere.runtime.arrays import Array
from torchsphere.synthetic import demo_motion, ray_caster
from torchsphere.synthetic.demo_motion import CONTACT_LENGTH, CONTACT_START, FRAMES, RADIUS_PX

#: Name of the temporary input in the results.
NAME = "synthetic example shot"

#: The paper's frontal impact (section 5): ball of 30 mm and 110 g at 36 000 frames/s.
FRAME_RATE, DIAMETER_MM, MASS_G = 36_000.0, 30.0, 110.0

#: Size of a pixel, m.
M_PER_PX = 1e-3 * DIAMETER_MM / (2 * RADIUS_PX)

#: Image (h, w).
SHAPE = (192, 384)

#: Noise, and grey levels of background and target, of an 8-bit camera.
NOISE, BACKGROUND, TARGET = 2.0, 60.0, 170.0


@dataclass(frozen=True)
class Shot:
    """Images and their true motion."""

    images: NDArray[np.uint8]  # (n, h, w)
    position: Array  # centres (n, 2), px
    increment: Array  # (n - 1, 5) as (dx, dy, wx, wy, wz) per frame, px and rad
    orientation: Array  # rotation matrices (n, 3, 3) since the first frame


def make_shot(seed: int = 1) -> Shot:
    """Make the shot; the same seed gives the same images."""
    position, orientation = demo_motion.position(np.arange(FRAMES)), demo_motion.orientation(FRAMES)
    turned = torch.from_numpy(orientation[1:] @ orientation[:-1].swapaxes(1, 2))
    increment = np.concatenate((np.diff(position, axis=0), So3.from_matrix(turned).log().numpy()), 1)
    still = torch.full(SHAPE, BACKGROUND)
    # The bar gives way: the ball touches it as it is drawn in the middle of the contact.
    deepest = float(demo_motion.position([CONTACT_START + 0.5 * CONTACT_LENGTH])[0, 0])
    still[:, round(deepest + RADIUS_PX) + 1 :] = TARGET
    pattern = ray_caster.speckle(seed, radius_px=RADIUS_PX)
    poses = torch.from_numpy(position).float(), torch.from_numpy(orientation).float()
    clean = ray_caster.render(pattern, poses[0], RADIUS_PX, poses[1], still)
    noise = NOISE * torch.randn(clean.shape, generator=torch.Generator().manual_seed(seed))
    images = (clean + noise).round().clamp(0, 255).to(torch.uint8).numpy()
    return Shot(images, position, increment, orientation)


def true_impact() -> dict[str, Array]:
    """Exact values of the impact by their names and in the units of `Impact`."""
    m_s = M_PER_PX * FRAME_RATE
    before, after = (m_s * v[:2] for v in (demo_motion.VELOCITY_BEFORE, demo_motion.VELOCITY_AFTER))
    spins = (spin * FRAME_RATE / (2 * np.pi) for spin in (demo_motion.SPIN_BEFORE, demo_motion.SPIN_AFTER))
    change = after - before
    impulse = 1e-3 * MASS_G * np.linalg.norm(change)
    contact_s = np.array([CONTACT_START, CONTACT_START + CONTACT_LENGTH]) / FRAME_RATE
    duration = contact_s[1] - contact_s[0]
    values = {
        "contact_start": contact_s[0],
        "contact_end": contact_s[1],
        "duration": duration,
        "velocity_before": before,
        "velocity_after": after,
        "speed_before": np.linalg.norm(before),
        "speed_after": np.linalg.norm(after),
        "restitution_normal": -(after @ change) / (before @ change),
        # A half-sine of force has the mean 2 / pi of its largest value.
        "peak_force": 0.5 * np.pi * impulse / duration,
        "peak_time": contact_s.mean(),
        "mean_force": impulse / duration,
        "impulse_size": impulse,
    }
    values |= dict(zip(("spin_before", "spin_after"), spins, strict=True))
    return {name: np.asarray(value) for name, value in values.items()}


def write_shot(folder: Path, shot: Shot) -> tuple[Path, Path]:
    """Write ``shot.tif`` and the true motion ``truth.csv``, with column names of ``track.csv`` and ``kinematics.csv``.

    Increments lead from frame to frame; velocities, forces and spins are those of the moments of the frames.
    """
    images, truth = folder / "shot.tif", folder / "truth.csv"
    tifffile.imwrite(images, shot.images, photometric="minisblack")
    frames = np.arange(len(shot.position))
    blank = np.full((1, 5), np.nan)
    columns = {
        "x_px,y_px": shot.position,
        "dx_px,dy_px,wx_rad,wy_rad,wz_rad": np.concatenate((blank, shot.increment)),
        "time_s": frames[:, None] / FRAME_RATE,
        "vx_m_s,vy_m_s": M_PER_PX * FRAME_RATE * demo_motion.velocity(frames),
        "fx_N,fy_N": 1e-3 * MASS_G * M_PER_PX * FRAME_RATE**2 * demo_motion.acceleration(frames),
        "wx_rad_s,wy_rad_s,wz_rad_s": FRAME_RATE * demo_motion.spin(frames),
    }
    with truth.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["frame", *",".join(columns).split(",")])
        for frame, row in enumerate(np.concatenate(list(columns.values()), 1)):
            writer.writerow([frame, *(format(v, ".12g") for v in row)])
    return images, truth


@dataclass(frozen=True)
class Comparison:
    """A line of the demo's table: quantity, unit, truth, measurement and standard deviation."""

    name: str
    unit: str
    true: float
    measured: float
    sd: float

    @property
    def ratio(self) -> float:
        """Error in standard deviations."""
        return (self.measured - self.true) / self.sd


#: Name in `Impact`, label, unit and its size in the unit of `Impact`, of the lines of the demo's table.
_LINES = (
    ("contact_start", "contact begins", "ms", 1e-3),
    ("duration", "contact lasts", "ms", 1e-3),
    ("velocity_before", "velocity {} before", "m/s", 1.0),
    ("velocity_after", "velocity {} after", "m/s", 1.0),
    ("spin_before", "spin {} before", "rev/s", 1.0),
    ("spin_after", "spin {} after", "rev/s", 1.0),
    ("restitution_normal", "restitution", "", 1.0),
    ("peak_force", "largest force", "kN", 1e3),
    ("impulse_size", "impulse", "N s", 1.0),
)


def compare(shot: Shot, motion: Kinematics, found: Impact) -> list[Comparison]:
    """Measured against true values: those of the impact, and the last position."""
    rows = []
    for name, label, unit, size in _LINES:
        estimate = getattr(found, name)
        values = (np.atleast_1d(v) / size for v in (true_impact()[name], estimate.value, estimate.sd))
        rows += [Comparison(label.format(axis), unit, *row) for axis, *row in zip("xyz", *values, strict=False)]
    sides = zip("xy", shot.position[-1] * M_PER_PX, motion.position_m[-1], motion.sd_position_m[-1], strict=True)
    return rows + [Comparison(f"position {axis} at the end", "mm", *(1e3 * v for v in row)) for axis, *row in sides]


def frame_errors(shot: Shot, track: Track) -> list[tuple[str, str, float, float, float]]:
    """Name, unit, rms error per frame, stated standard deviation, and share of frames within two of them."""
    error = track.increment - shot.increment
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))
    rows = []
    for k, name in enumerate(("dx", "dy", "wx", "wy", "wz")):
        unit, factor = ("px", 1.0) if k < 2 else ("deg", 180 / np.pi)
        within = float((np.abs(error[:, k]) <= 2 * sd[:, k]).mean())
        rms = float(np.sqrt(np.nanmean(error[:, k] ** 2)))
        rows.append((name, unit, factor * rms, factor * float(np.nanmean(sd[:, k])), within))
    return rows
