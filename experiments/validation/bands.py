"""Coverage of the stated bands of velocity, force and spin: ``python -m experiments.validation.bands``.

Claim: on rendered shots (free flight, frontal and oblique impact) the true velocity, force and spin lie within the
stated 95 % bands as often as stated. Over all quantities and shots the share is 98 % of the frames in flight and in
contact with the found outline, 99.7 and 99.8 % with the true outline. By quantity it is 82 to 100 %. The steps allow
for light from the target on one side of the ball; a map does not, and frames that contradict it are left to the steps
(`torchsphere.sphere_map.decision.shaded_frames`).

No constant was chosen on these patterns: the common error of all steps was measured on others (`steady_error`).

The presets `free-flight`, `frontal-impact` and `oblique-impact` are rendered with eight patterns each and independent
noise, and measured with the ball's diameter and mass. The outline is either found or the true one, which separates the
circle's errors from the smoother's. Errors of neighbouring frames are alike, and the common errors of a shot (scale,
steady error of the steps) are one draw per shot: eight shots determine a share of 95 % in flight to some 8 %.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

import torchsphere as ts
from experiments.experiment import BLUE, DOCS, GREEN, ORANGE, VERMILION, YELLOW, Array, publish, saved_figure, table
from experiments.shots import Footage, rendered, tracked
from render import preset

SHOTS, SEEDS = ("free-flight", "frontal-impact", "oblique-impact"), tuple(range(61, 69))
CIRCLES = ("given", "found")
NAMES = ("v_x", "v_y", "F_x", "F_y", "w_x", "w_y", "w_z")
COLUMNS = ("vx_m_s", "vy_m_s", "fx_N", "fy_N", "wx_rad_s", "wy_rad_s", "wz_rad_s")
LABELS = ("velocity (m/s)", "force (kN)", "spin (rad/s)")
#: Half width of a band of 95 %, standard deviations.
BAND = 1.96
COLOURS = (BLUE, VERMILION, GREEN)


@dataclass(frozen=True)
class Shot:
    """Stated and true motion (n, 7) of a shot in the order of `NAMES`, and the frames in contact."""

    time_s: Array
    value: Array
    sd: Array
    true: Array
    contact: NDArray[np.bool_]

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Whether the truth lies within the band, (n, 7)."""
        return np.abs(self.value - self.true) <= BAND * self.sd


def measured(footage: Footage, circle: str) -> Shot:
    """The shot's motion in SI units by the smoother, beside the truth."""
    track = tracked(footage, footage.circle if circle == "given" else None)
    shot = footage.shot
    motion = ts.kinematics(
        track,
        frame_rate=shot.frame_rate_hz,
        diameter_m=2 * shot.setup.ball.radius_m,
        mass_kg=1e-3 * shot.trajectory.mass_g,
    )
    assert motion.force_N is not None
    assert motion.sd_force_N is not None
    value = np.concatenate((motion.velocity_m_s, motion.force_N, motion.spin_rad_s), 1)
    sd = np.concatenate((motion.sd_velocity_m_s, motion.sd_force_N, motion.sd_spin_rad_s), 1)
    begin, end = (1e-6 * v for v in touch(footage))
    contact = (motion.time_s > begin) & (motion.time_s < end)
    return Shot(motion.time_s, value, sd, footage.true(*COLUMNS), contact)


def touch(footage: Footage) -> tuple[float, float]:
    """Start and end of the true contact, us; infinite in a free flight."""
    trajectory = footage.shot.trajectory
    start = getattr(trajectory, "touch_us", np.inf)
    return start, start + getattr(trajectory, "contact_us", 0.0)


def compute() -> dict[tuple[str, str], list[Shot]]:
    """Shots by preset and kind of circle."""
    results = {}
    for name in SHOTS:
        footages = [rendered(preset.load(name, seed=seed)) for seed in SEEDS]
        for circle in CIRCLES:
            results[name, circle] = [measured(footage, circle) for footage in footages]
    return results


def shares(shots: list[Shot], contact: bool) -> Array:
    """Share (7,) of the frames, in contact or in flight, whose truth lies within the band."""
    inside = np.concatenate([shot.inside[shot.contact == contact] for shot in shots])
    return inside.mean(0) if len(inside) else np.full(len(NAMES), np.nan)


def plot(results: dict[tuple[str, str], list[Shot]]) -> None:
    """A shot of each kind with its bands; below, the shares of all shots."""
    with saved_figure(DOCS / "bands.png", (11, 9.5)) as figure:
        axes = figure.subplots(4, 3, gridspec_kw={"height_ratios": (1, 1, 1, 0.8)})
        groups = ((0, 2, 1.0), (2, 4, 1e-3), (4, 7, 1.0))
        for column, name in enumerate(SHOTS):
            shot = results[name, "given"][0]
            for axis, (first, last, factor), label in zip(axes[:3, column], groups, LABELS, strict=True):
                for k, colour in zip(range(first, last), COLOURS, strict=False):
                    value, sd, true = (factor * v[:, k] for v in (shot.value, shot.sd, shot.true))
                    middle = np.zeros(len(true)) if label.startswith("force") else true
                    # Velocity and spin less the truth: the bands are a thousandth of the values.
                    axis.fill_between(
                        1e3 * shot.time_s,
                        value - middle - BAND * sd,
                        value - middle + BAND * sd,
                        color=colour,
                        alpha=0.3,
                    )
                    axis.plot(1e3 * shot.time_s, value - middle, color=colour, lw=1.0, label=f"${NAMES[k]}$")
                    axis.plot(1e3 * shot.time_s, true - middle, color="k", lw=0.8, ls=":")
                if shot.contact.any():
                    axis.axvspan(*(1e3 * shot.time_s[shot.contact][[0, -1]]), color=YELLOW, alpha=0.3, lw=0)
                axis.legend(fontsize=7, ncols=3, loc="upper left", framealpha=0.7)
                if column == 0:
                    axis.set_ylabel(
                        label
                        if label.startswith("force")
                        else f"{label.split(' (')[0]} less truth ({label.split('(')[1]}"
                    )
            axes[0, column].set_title(name.replace("-", " "), fontsize=10)
            axes[2, column].set_xlabel("time (ms)")
            _share_bars(axes[3, column], results, name)
        axes[3, 0].set_ylabel("truth within\n95 % band (%)")


def _share_bars(axis: Axes, results: dict[tuple[str, str], list[Shot]], name: str) -> None:
    """Shares of one preset in flight and in contact, with the true outline and, paler, with the found outline."""
    place = np.arange(len(NAMES))
    bars = [(circle, contact) for contact in (False, True) for circle in CIRCLES]
    for number, (circle, contact) in enumerate(bars):
        share = 100 * shares(results[name, circle], contact)
        if np.isfinite(share).any():
            colour, label = (ORANGE, "contact") if contact else (BLUE, "flight")
            pale, label = (0.45, f"{label}, found") if circle == "found" else (1.0, f"{label}, given")
            axis.bar(place + 0.2 * (number - 1.5), share, 0.19, color=colour, alpha=pale, label=label)
    axis.axhspan(90, 98, color="0.8", lw=0, zorder=0)
    axis.set(ylim=(0, 150), xticks=place, xticklabels=[f"${n}$" for n in NAMES], yticks=(0, 25, 50, 75, 100))
    axis.legend(fontsize=7, ncols=2, loc="upper right")


def main() -> None:
    """Measure, draw, and print the shares by quantity and their ranges."""
    results = compute()
    plot(results)
    lines, ranges = [], []
    for (name, circle), shots in results.items():
        parts = {part: 100 * shares(shots, part == "contact") for part in ("flight", "contact")}
        known = {part: share for part, share in parts.items() if np.isfinite(share).any()}
        lines += [(name, circle, part, *(f"{v:.0f}" for v in share)) for part, share in known.items()]
        spread = [f"{share.min():.0f} to {share.max():.0f} %" for share in known.values()]
        ranges.append((name.replace("-", " "), circle, *spread, *[""] * (2 - len(spread))))
    print(table(("shot", "outline", "frames", *NAMES), lines))
    head = ("shot", "outline", "before and after the impact", "in contact")
    publish("bands", "validation.bands", table(head, ranges))


if __name__ == "__main__":
    main()
