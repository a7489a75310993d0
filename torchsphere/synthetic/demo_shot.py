"""Synthetic shot with known motion: a speckled ball flies, hits a bar, bounces back and is spun up by friction."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tifffile
import torch
from numpy.typing import NDArray

from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.geometry.orientation import chain
from torchsphere.synthetic import ray_caster
from torchsphere.tracking.result import Track

Array = NDArray[np.float64]

#: Name of the temporary input in the results.
NAME = "synthetic example shot"

#: The paper's frontal impact (section 5): ball of 30 mm and 110 g at 36 000 frames/s.
FRAME_RATE, DIAMETER_MM, MASS_G = 36_000.0, 30.0, 110.0

#: Image (h, w) and radius of the ball, px.
SHAPE, RADIUS_PX = (192, 384), 40.0

#: Noise, and grey levels of background and target, of an 8-bit camera.
NOISE, BACKGROUND, TARGET = 2.0, 60.0, 170.0

#: Frames before, in and after the contact.
BEFORE, CONTACT, AFTER = 26, 12, 32


@dataclass(frozen=True)
class Shot:
    """Images and their true motion."""

    images: NDArray[np.uint8]  # (n, h, w)
    position: Array  # centres (n, 2), px
    increment: Array  # (n - 1, 5) as (dx, dy, wx, wy, wz) per frame, px and rad
    orientation: Array  # rotation matrices (n, 3, 3) since the first frame


def make_shot(seed: int = 1) -> Shot:
    """Make the shot; the same seed gives the same images."""
    increment = _increments()
    n = len(increment) + 1
    start = np.array([[64.3, 92.6]])
    position = np.concatenate((start, start + increment[:, :2].cumsum(0)))
    rotation = np.concatenate((np.zeros((1, 3)), increment[:, 2:]))
    orientation = chain(rotation, np.ones(n, dtype=bool))
    still = torch.full(SHAPE, BACKGROUND)
    # The ball touches the bar in the middle of the contact.
    still[:, round(position[BEFORE + CONTACT // 2, 0] + RADIUS_PX) + 1 :] = TARGET
    pattern = ray_caster.speckle(seed, radius_px=RADIUS_PX)
    poses = torch.from_numpy(position).float(), torch.from_numpy(orientation).float()
    clean = ray_caster.render(pattern, poses[0], RADIUS_PX, poses[1], still)
    noise = NOISE * torch.randn(clean.shape, generator=torch.Generator().manual_seed(seed))
    images = (clean + noise).round().clamp(0, 255).to(torch.uint8).numpy()
    return Shot(images, position, increment, orientation)


def _increments() -> Array:
    """Increments (n - 1, 5): steady flight, half a sine of force while in contact, steady flight."""
    before = np.array([5.3, 0.3, *np.radians([0.0, 0.25, 0.0])])
    after = np.array([-2.4, 0.5, *np.radians([0.1, 0.35, 0.3])])
    share = 0.5 * (1 - np.cos(np.pi * (np.arange(CONTACT) + 0.5) / CONTACT))
    contact = before + share[:, None] * (after - before)
    return np.concatenate((np.tile(before, (BEFORE, 1)), contact, np.tile(after, (AFTER, 1))))


def write_shot(folder: Path, shot: Shot) -> tuple[Path, Path]:
    """Write the images as ``shot.tif`` and the truth as ``truth.csv``, with the column names of ``track.csv``."""
    images, truth = folder / "shot.tif", folder / "truth.csv"
    tifffile.imwrite(images, shot.images, photometric="minisblack")
    with truth.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(("frame", "x_px", "y_px", "dx_px", "dy_px", "wx_rad", "wy_rad", "wz_rad"))
        blank = np.full((1, 5), np.nan)
        rows = np.concatenate((shot.position, np.concatenate((blank, shot.increment))), axis=1)
        for frame, row in enumerate(rows):
            writer.writerow([frame, *(format(v, ".9g") for v in row)])
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


def compare(shot: Shot, motion: Kinematics) -> list[Comparison]:
    """Measured against true values: means over both flights, the peak of the force, and the last position."""
    m_per_px = 1e-3 * DIAMETER_MM / (2 * RADIUS_PX)
    rows = []
    flights = {"before": slice(1, BEFORE), "after": slice(BEFORE + CONTACT + 1, BEFORE + CONTACT + AFTER)}
    for flight, part in flights.items():
        true = shot.increment[part.start]
        for k, axis in enumerate("xy"):
            value, sd = _mean(motion.velocity_m_s[part, k], motion.sd_velocity_m_s[part, k])
            rows.append(Comparison(f"velocity {axis} {flight}", "m/s", true[k] * m_per_px * FRAME_RATE, value, sd))
        for k, axis in enumerate("xyz"):
            value, sd = _mean(motion.spin_rad_s[part, k], motion.sd_spin_rad_s[part, k])
            rows.append(Comparison(f"spin {axis} {flight}", "rad/s", true[2 + k] * FRAME_RATE, value, sd))
    if motion.force_N is not None and motion.sd_force_N is not None:
        acceleration = np.diff(shot.increment[:, 0]) * m_per_px * FRAME_RATE**2
        frame = int(np.abs(acceleration).argmax()) + 1
        force = 1e-6 * MASS_G * acceleration[frame - 1]
        measured, sd = 1e-3 * motion.force_N[frame, 0], 1e-3 * motion.sd_force_N[frame, 0]
        rows.append(Comparison("force x at its peak", "kN", force, float(measured), float(sd)))
    for k, axis in enumerate("xy"):
        measured, sd = 1e3 * motion.position_m[-1, k], 1e3 * motion.sd_position_m[-1, k]
        position = 1e3 * (shot.position[-1, k] * m_per_px)
        rows.append(Comparison(f"position {axis} at the end", "mm", position, float(measured), float(sd)))
    return rows


def _mean(values: Array, sd: Array) -> tuple[float, float]:
    """Mean over a flight, and the standard deviation of one frame, since errors of scale and radius do not cancel."""
    return float(values.mean()), float(sd.mean())


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
