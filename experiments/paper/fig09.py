"""Figure 9, rotation angles and spin through the impact on the bar: ``python -m experiments.paper.fig09``.

Claim: before the contact the ball spins about y alone; the contact changes the spin abruptly, to about 20 revolutions
per second.

Paper: about 20 rev/s afterwards; only y is not zero before.

Here: the impact of `bar`, by `bar_shot`. Angles are sums of the rotations from frame to frame in the camera's axes; the
spin is that of torchsphere's smoother. The model's contacts are shaded. Lines mark the contact of the smoother with its
stated uncertainty.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

import torchsphere as ts
from experiments.experiment import BLUE, FIGURES, GREEN, VERMILION, Array, Row, claims, saved_figure
from experiments.paper.bar_shot import BEFORE_S, SMOOTH, Impact, compute, dense, shade

#: Colours of the axes x, y, z.
COLORS = (BLUE, VERMILION, GREEN)
#: Frames next to the contact that the mean spins leave out: their rotations reach into the contact.
NEXT_TO = 1
#: Largest error of the spin after the impact, as a share of it.
ALLOWED = 0.02


def angles_deg(increment: Array) -> Array:
    """Sums (n, 3) of the rotations of increments (n - 1, 5), from 0 in the first frame."""
    turns = np.degrees(increment[:, 2:])
    return np.concatenate((np.zeros((1, 3)), turns.cumsum(0)))


def mean_spin_rev_s(increment: Array, frame_rate_hz: float) -> Array:
    """Mean spin (3,) over steps (m, 5)."""
    return np.asarray(np.nanmean(increment[:, 2:], axis=0) * frame_rate_hz / (2 * np.pi))


def spins(impact: Impact) -> dict[str, tuple[Array, Array]]:
    """Measured and true spin (3,) in rev/s, "before" and "after" the contact."""
    first = int(np.searchsorted(impact.time_s, 0.0)) - 1
    parts = {"before": slice(0, first - NEXT_TO), "after": slice(impact.after().start + NEXT_TO, None)}
    exact = {"before": impact.history.spin_rad_s[0], "after": impact.history.spin_rad_s[-1]}
    return {
        name: (mean_spin_rev_s(impact.track.increment[part], impact.frame_rate_hz), exact[name] / (2 * np.pi))
        for name, part in parts.items()
    }


def rows(impact: Impact) -> list[Row]:
    """The claims of the figure."""
    found = spins(impact)
    (before, true_before), (after, true_after) = found["before"], found["after"]
    rate, true_rate = (float(np.linalg.norm(v)) for v in (after, true_after))
    vector = ", ".join(f"{v:+.2f}" for v in after)
    truth = ", ".join(f"{v:+.2f}" for v in true_after)
    off = float(np.linalg.norm(after - true_after)) / true_rate
    return [
        Row(
            "fig09",
            "Before the contact the ball spins about y alone.",
            "x and z: 0",
            f"({', '.join(f'{v:+.2f}' for v in before)}) rev/s; true y: {true_before[1]:.2f}",
            bool(np.abs(before[[0, 2]]).max() < 0.3 * abs(before[1])),
        ),
        Row(
            "fig09",
            "The spin after the impact.",
            "about 20 rev/s",
            f"{rate:.2f} rev/s, true {true_rate:.2f} ({100 * (rate / true_rate - 1):+.1f} %); ({vector}), "
            f"true ({truth}): the vectors differ by {100 * off:.1f} %",
            abs(rate / true_rate - 1) < ALLOWED,
        ),
    ]


def _draw_spin(axis: Axes, impact: Impact, motion: ts.Kinematics) -> None:
    time, _, spin = dense(impact.history, impact.time_s[0], impact.time_s[-1])
    for k, color in enumerate(COLORS):
        axis.plot(1e3 * time, spin[:, k] / (2 * np.pi), color=color, lw=1, alpha=0.6)
        value, sd = (part[:, k] / (2 * np.pi) for part in (motion.spin_rad_s, motion.sd_spin_rad_s))
        axis.plot(1e3 * impact.time_s, value, ".", color=color, ms=4, label=f"about {'xyz'[k]}")
        axis.fill_between(1e3 * impact.time_s, value - sd, value + sd, color=color, alpha=0.2, lw=0)
    axis.set_ylabel("spin (rev/s)")


def plot(impact: Impact) -> None:
    """Angles on the left, spins on the right."""
    motion = impact.kinematics(impact.track, "smoother")
    with saved_figure(FIGURES / "fig09.png", (11, 4.2), dpi=80) as figure:
        left, right = figure.subplots(1, 2)
        measured, exact = angles_deg(impact.track.increment), angles_deg(impact.exact.increment)
        for k, color in enumerate(COLORS):
            left.plot(1e3 * impact.time_s, exact[:, k], color=color, lw=1, alpha=0.6)
            left.plot(1e3 * impact.time_s, measured[:, k], ".", color=color, ms=4, label=f"about {'xyz'[k]}")
        left.set_ylabel("angle (deg)")
        _draw_spin(right, impact, motion)
        for axis in (left, right):
            shade(axis, impact.history)
            axis.set_xlabel("time since first touch (ms)")
            if motion.contact_s is not None and motion.sd_contact_s is not None:
                for edge, sd in zip(motion.contact_s - BEFORE_S, motion.sd_contact_s, strict=True):
                    axis.axvline(1e3 * edge, color=SMOOTH, lw=0.8, ls="--")
                    axis.axvspan(1e3 * (edge - sd), 1e3 * (edge + sd), color=SMOOTH, alpha=0.2, lw=0)
            axis.legend(loc="upper left")
        figure.suptitle("dots: torchsphere; lines: true; grey: true contacts; dashed: contact found", fontsize=9)


def main() -> None:
    """Measure, draw, and print the claims."""
    found = compute()
    plot(found)
    print(claims(rows(found)))


if __name__ == "__main__":
    main()
