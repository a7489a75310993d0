"""Figure 8, positions of the ball through the impact on the bar: ``python -m experiments.paper.fig08``.

Claim: the positions by the five modes stay on the ball through the impact. Correlation of translations alone
underestimates the displacement, since the ball turns, and may lose the ball.

Paper: twelve evenly spaced frames in 3.1 ms with the circles of both; no numbers.

Here: 114 frames of the exactly known impact of `bar`, by `bar_shot`. Translations alone start from the true circle, and
their region moves along as in torchsphere. Whether they lose the ball depends on its spin: `lost_balls` follows it in
`SPINNING` more shots of 100 frames, without an impact, with 0.1 to 1.5 deg per frame (10 to 150 rev/s).
"""

from __future__ import annotations

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from experiments.experiment import FIGURES, Array, Row, cached, claims, saved_figure
from experiments.paper.bar_shot import MODEL, OURS, TRANSLATION, Impact, compute, shade
from experiments.shots import frames_of
from torchsphere.benchmark.baselines import TRACKERS
from torchsphere.synthetic import ray_caster

#: Number of frames shown, as in the paper.
SHOWN = 12
#: Largest error of a position on the ball, as a share of the radius: 0.5 px, less than the width of a line.
ON_BALL = 0.01
#: Shots with a spin about y, its least and largest value, deg per frame, and their frames.
SPINNING, SPINS_DEG, FRAMES = 15, (0.1, 1.5), 100
#: Distance from the ball at which it is lost, as a share of the radius.
LOST = 0.5


def errors_px(impact: Impact) -> dict[str, Array]:
    """Measured minus true positions (n, 2) by tracker."""
    true = impact.footage.true("x_px", "y_px")
    return {"five modes": impact.track.position - true, "translation only": impact.translation_only.position - true}


def velocity_error_m_s(impact: Impact) -> float:
    """Error of the velocity along x after the impact by translations alone."""
    part = impact.after()
    steps = impact.translation_only.increment[:, 0] - impact.footage.true("dx_px")[1:, 0]
    return float(np.nanmean(steps[part.start :])) * impact.footage.m_per_px * impact.frame_rate_hz


def lost_balls() -> list[float]:
    """Spins, deg per frame, of the shots in which translations alone end more than half a radius off the ball."""
    spins = np.linspace(*SPINS_DEG, SPINNING)

    def make() -> list[float]:
        return [float(spin) for seed, spin in enumerate(spins) if _is_lost(float(spin), seed)]

    found: list[float] = cached("fig08-lost", [SPINNING, SPINS_DEG, FRAMES], make)
    return found


def _is_lost(spin_deg: float, seed: int) -> bool:
    """Whether a ball that flies along x and spins about y is lost by translations alone."""
    radius, step_px = 30.0, 2.4
    angle = np.radians(spin_deg) * np.arange(FRAMES)
    turned = Rotation.from_rotvec(angle[:, None] * [0.0, 1.0, 0.0]).as_matrix()
    centres = np.stack((50.3 + step_px * np.arange(FRAMES), np.full(FRAMES, 40.6)), 1)
    clean = ray_caster.render(
        ray_caster.speckle(seed, radius_px=radius),
        torch.from_numpy(centres).float(),
        radius,
        torch.from_numpy(turned).float(),
        60.0,
        shape=(82, 340),
    )
    noise = 2.0 * torch.randn(clean.shape, generator=torch.Generator().manual_seed(seed))
    images = (clean + noise).round().clamp(0, 255).to(torch.uint8).numpy()
    found = TRACKERS["translation_only"](images, (float(centres[0, 0]), float(centres[0, 1]), radius))
    known = found.position[np.isfinite(found.position[:, 0])]
    off = np.linalg.norm(known[-1] - centres[len(known) - 1]) if len(known) else np.inf
    return len(known) < FRAMES or bool(off > LOST * radius)


def rows(impact: Impact) -> list[Row]:
    """The claims of the figure."""
    spins = lost_balls()
    error = {name: np.linalg.norm(values, axis=1) for name, values in errors_px(impact).items()}
    radius, m_per_px = impact.footage.circle[2], impact.footage.m_per_px
    ours, lost = error["five modes"], impact.translation_only.status != "ok"
    last = errors_px(impact)["translation only"][-1]
    travel = float(np.ptp(impact.footage.true("x_px")))
    speed, off = impact.history.velocity_m_s[-1, 0], velocity_error_m_s(impact)
    return [
        Row(
            "fig08",
            "Five modes keep the ball through the impact.",
            "circles on the ball in 12 frames",
            f"off by {np.nanmax(ours):.2f} px at most in 114 frames, {np.isnan(ours).sum()} frames lost",
            bool(np.isfinite(ours).all() and ours.max() < ON_BALL * radius),
        ),
        Row(
            "fig08",
            "Translations alone underestimate the displacement.",
            "seen in the figure",
            f"{last[0]:+.1f} px ({1e3 * last[0] * m_per_px:+.2f} mm) of {travel:.0f} px at the end, "
            f"{100 * abs(last[0]) / radius:.0f} % of the radius",
            bool(last[0] < -10 * np.nanmax(ours)),
        ),
        Row(
            "fig08",
            "Translations alone give a wrong velocity after the impact.",
            "seen in the figure",
            f"{off:+.2f} m/s of {speed:.2f} m/s ({100 * off / speed:+.0f} %)",
            bool(off < -0.05 * speed),
        ),
        Row(
            "fig08",
            "Translations alone sometimes lose the ball.",
            "sometimes observed",
            f"in {len(spins)} of {SPINNING} shots of {FRAMES} frames with {SPINS_DEG[0]:g} to {SPINS_DEG[1]:g} deg per "
            f"frame{f', from {min(spins):.2f} deg on' if spins else ''}; in this shot {lost.sum()} frames",
            bool(spins),
        ),
    ]


def _draw_frame(axis: Axes, impact: Impact, frame: int) -> None:
    axis.imshow(impact.footage.images[frame], cmap="gray", vmin=0, vmax=200)
    places = (
        (impact.footage.true("x_px", "y_px"), MODEL, "-", 2.2),
        (impact.translation_only.position, TRANSLATION, "-", 1.0),
        (impact.track.position, "white", "--", 1.0),
    )
    for position, color, line, width in places:
        if np.isfinite(position[frame]).all():
            centre = position[frame, 0], position[frame, 1]
            axis.add_patch(Circle(centre, impact.footage.circle[2], fill=False, color=color, ls=line, lw=width))
    path = impact.track.position[: frame + 1]
    axis.plot(path[:, 0], path[:, 1], ".", color="white", ms=1.5)
    axis.set_title(f"{1e3 * impact.time_s[frame]:+.2f} ms", fontsize=8, pad=2)
    axis.set_xticks([])
    axis.set_yticks([])


def plot(impact: Impact) -> None:
    """Twelve frames with the circles, and the errors over time."""
    with saved_figure(FIGURES / "fig08.png", (9, 10), dpi=80) as figure:
        upper, lower = np.asarray(figure.subfigures(2, 1, height_ratios=(2.3, 1)))
        frames = list(frames_of(SHOWN, len(impact.time_s)))
        grid: NDArray[np.object_] = np.asarray(upper.subplots(SHOWN // 2, 2))
        for axis, frame in zip(grid.T.ravel(), frames, strict=True):
            _draw_frame(axis, impact, frame)
        upper.suptitle("white dashed: five modes; orange: translations alone; green: true", fontsize=9)
        axis = lower.subplots()
        shade(axis, impact.history)
        colors = {"five modes": OURS, "translation only": TRANSLATION}
        for name, error in errors_px(impact).items():
            axis.plot(1e3 * impact.time_s, error[:, 0], color=colors[name], label=f"{name}: x")
            axis.plot(1e3 * impact.time_s, error[:, 1], ":", color=colors[name], label=f"{name}: y")
        axis.set_xlabel("time since first touch (ms); in contact where shaded")
        axis.set_ylabel("error of the position (px)")
        axis.legend()


def main() -> None:
    """Measure, draw, and print the claims."""
    found = compute()
    plot(found)
    print(claims(rows(found)))


if __name__ == "__main__":
    main()
