"""Figure 4, signals of the light gate, and velocities by gate and images: ``python -m experiments.paper.fig04``.

Claim: a one-dimensional correlation of the barriers' signals gives their delay, and the velocity from the delay lies
within the standard deviation of the velocities by the images.

Paper: one pair of signals, and two pairs of velocities with error bars: the numbers of table 1.

Here: the signals and velocities of `table1`, whose delay is exactly known.
"""

from __future__ import annotations

from matplotlib.axes import Axes

from experiments.experiment import BLUE, FIGURES, VERMILION, Row, claims, saved_figure
from experiments.paper.table1 import PAPER, SPACING_M, Shot, compute

SHOWN_BAR = 2.8
FIRST, SECOND = BLUE, VERMILION
#: Standard deviations that count as within the stated uncertainty, and the largest error of the delay allowed.
WITHIN, ALLOWED_DELAY = 3.0, 0.001


def rows(shots: dict[float, Shot]) -> list[Row]:
    """The claims of the figure."""
    found = []
    for pressure, shot in shots.items():
        delay, true = shot.gate.delay_s, SPACING_M / shot.true_m_s
        off, sd = delay - true, shot.gate.sd_delay_s
        found.append(
            Row(
                "fig04",
                f"Correlation of the barriers' signals gives their delay, at {pressure} bar.",
                "used, without an uncertainty",
                f"{1e6 * delay:.2f} ± {1e6 * sd:.2f} us, true {1e6 * true:.2f} ({1e6 * off:+.2f} us, "
                f"{abs(off) / sd:.1f} sd)",
                abs(off) < ALLOWED_DELAY * true and abs(off) < WITHIN * sd,
            )
        )
    return found


def _draw_signals(axis: Axes, shot: Shot) -> None:
    time = 1e6 * shot.time_s
    for volts, color, name in zip(shot.volts, (FIRST, SECOND), ("first", "second"), strict=True):
        axis.plot(time, volts, color=color, lw=0.7, label=f"{name} barrier")
    moved = time - 1e6 * shot.gate.delay_s
    axis.plot(moved, shot.volts[1], color=SECOND, lw=0.7, alpha=0.35, label="second, moved by the delay")
    axis.set_xlabel("time (us)")
    axis.set_ylabel("voltage of the receiver (V)")
    axis.set_title(f"{SHOWN_BAR} bar: delay {1e6 * shot.gate.delay_s:.2f} ± {1e6 * shot.gate.sd_delay_s:.2f} us")
    axis.legend()


def _draw_velocities(axis: Axes, shots: dict[float, Shot]) -> None:
    for place, (pressure, shot) in enumerate(shots.items()):
        gate, images, std = PAPER[pressure]
        mean, own = shot.images_m_s
        bars = (
            (-0.27, gate, 0.0, "0.6", "s", "paper: gate"),
            (-0.09, images, std, "0.6", "o", "paper: images"),
            (0.09, shot.gate.velocity_m_s, shot.gate.sd_velocity_m_s, FIRST, "s", "here: gate"),
            (0.27, mean, own, "black", "o", "here: images"),
        )
        for aside, value, error, color, mark, name in bars:
            label = name if place == 0 else None
            off = 100 * (value / gate - 1)
            axis.errorbar(place + aside, off, 100 * error / gate, fmt=mark, color=color, capsize=3, label=label)
    axis.axhline(0, color="0.8", lw=0.8, zorder=0)
    axis.set_xticks(range(len(shots)), [f"{pressure} bar, {PAPER[pressure][0]} m/s" for pressure in shots])
    axis.set_xlim(-0.6, len(shots) - 0.4)
    axis.set_ylabel("velocity against the paper's gate (%)")
    axis.legend()


def plot(shots: dict[float, Shot]) -> None:
    """Signals on the left, velocities on the right."""
    with saved_figure(FIGURES / "fig04.png", (11, 4.2), dpi=80) as figure:
        left, right = figure.subplots(1, 2)
        _draw_signals(left, shots[SHOWN_BAR])
        _draw_velocities(right, shots)


def main() -> None:
    """Measure, draw, and print the claims."""
    found = compute()
    plot(found)
    print(claims(rows(found)))


if __name__ == "__main__":
    main()
