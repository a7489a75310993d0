"""Figure 11, velocity and force of the impact on the bar: ``python -m experiments.paper.fig11``.

Claim: velocity and force along the path follow the simulation; the force has four peaks, the highest of about 60 kN.

Paper: about 60 kN, four peaks at the simulation's times, velocities of similar shape; the force by central differences.

Here: the impact of `bar`, by `bar_shot`, the force by differences as in the paper, and by torchsphere's smoother. The
frame rate limits the visible force: second differences of exact positions are means over two intervals, 55 us, longer
than the first peak. They are therefore compared with those of exact positions. The smoother states the force at a
moment, and is compared with the true one at that moment. The table also names the true peak, which no frame shows.
"Within the stated uncertainty" means two standard deviations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import torchsphere as ts
from experiments.experiment import FIGURES, Array, Row, claims, saved_figure
from experiments.paper import bar_shot
from experiments.paper.bar.history import Peak, peaks
from experiments.paper.bar_shot import MODEL, OURS, SMOOTH, Impact, dense, shade

#: Largest error of the peak force allowed, and standard deviations that count as within the stated uncertainty.
ALLOWED, WITHIN = 0.03, 2.0


@dataclass(frozen=True)
class Result:
    """Motions by method of differentiation, from measured and from exact positions."""

    impact: Impact
    measured: dict[str, ts.Kinematics]
    exact: dict[str, ts.Kinematics]

    def push_N(self, motion: ts.Kinematics) -> Array:  # noqa: N802  (N is newton)
        """Force against the ball's path (n,), 0 if unknown."""
        assert motion.force_N is not None
        return -np.nan_to_num(motion.force_N[:, 0])


def compute() -> Result:
    """The impact with its kinematics."""
    impact, ways = bar_shot.compute(), ("differences", "smoother")
    measured, exact = ({way: impact.kinematics(track, way) for way in ways} for track in (impact.track, impact.exact))
    return Result(impact, measured, exact)


def matched(found: tuple[Peak, ...], wanted: tuple[Peak, ...]) -> list[tuple[Peak, Peak]]:
    """Pairs of the nearest found peak in time and each wanted peak."""
    return [(min(found, key=lambda p: abs(p.time_s - peak.time_s)), peak) for peak in wanted] if found else []


def _as_from_exact_positions(value: float, wanted: float, sd: float) -> bool | None:
    """Whether two forces agree; None where they differ by more than `ALLOWED`, but not for certain."""
    if abs(value - wanted) > WITHIN * sd:
        return False
    return True if abs(value / wanted - 1) < ALLOWED else None


def _peak_row(result: Result, way: str) -> Row:
    motion, exact = result.measured[way], result.exact[way]
    force, best = result.push_N(motion), result.push_N(exact)
    at = int(force.argmax())
    assert motion.sd_force_N is not None
    value, wanted, sd = force[at], best.max(), motion.sd_force_N[at, 0]
    true = result.impact.history.normal_N.max()
    here = float(np.interp(result.impact.time_s[at], result.impact.history.time_s, result.impact.history.normal_N))
    return Row(
        "fig11",
        f"The highest force, by {way}.",
        "about 60 kN",
        f"{1e-3 * value:.1f} ± {1e-3 * sd:.1f} kN; from exact positions {1e-3 * wanted:.1f} "
        f"({100 * (value / wanted - 1):+.1f} %, {abs(value - wanted) / sd:.1f} sd); true {1e-3 * here:.1f} at the "
        f"frame's time and {1e-3 * true:.1f} between the frames",
        _as_from_exact_positions(value, wanted, sd) if way == "differences" else bool(abs(value - here) < WITHIN * sd),
    )


def rows(result: Result) -> list[Row]:
    """The claims of the figure."""
    impact, motion = result.impact, result.measured["differences"]
    history, frame = impact.history, 1 / impact.frame_rate_hz
    found = peaks(impact.time_s, result.push_N(motion))
    best = peaks(impact.time_s, result.push_N(result.exact["differences"]))
    pairs = matched(found, peaks(*history.seen(frame)))
    late = [p.time_s - q.time_s for p, q in pairs]
    part = impact.after()
    after, true_after = float(np.nanmean(motion.velocity_m_s[part, 0])), float(history.velocity_m_s[-1, 0])
    heights = ", ".join(f"{1e-3 * p.force_N:.1f}" for p in found)
    return [
        Row(
            "fig11",
            "The force has four peaks.",
            "4",
            f"{len(found)} ({heights} kN); {len(best)} from exact positions; the true force has "
            f"{len(peaks(history.time_s, history.normal_N))}, the last two as one at this frame rate",
            len(found) == 4 and len(best) == 4,
        ),
        Row(
            "fig11",
            "The peaks are at the simulation's times.",
            "seen in the figure",
            f"off by {', '.join(f'{1e6 * v:+.0f}' for v in late)} us; a frame is {1e6 * frame:.0f} us",
            bool(late) and max(abs(v) for v in late) < frame,
        ),
        _peak_row(result, "differences"),
        _peak_row(result, "smoother"),
        Row(
            "fig11",
            "The velocity follows the simulation through the impact.",
            "similar, but for that after the impact",
            f"{after:.3f} m/s after the impact, true {true_after:.3f} ({100 * (after / true_after - 1):+.2f} %)",
            abs(after / true_after - 1) < 0.01,
        ),
    ]


def plot(result: Result) -> None:
    """Velocity on the left, force on the right."""
    impact = result.impact
    with saved_figure(FIGURES / "fig11.png", (11, 4.2), dpi=80) as figure:
        left, right = figure.subplots(1, 2)
        time, velocity, _ = dense(impact.history, impact.time_s[0], impact.time_s[-1])
        frames = 1e3 * impact.time_s
        left.plot(1e3 * time, velocity[:, 0], color=MODEL, label="true")
        left.plot(frames, result.measured["differences"].velocity_m_s[:, 0], ".", color=OURS, ms=4, label="differences")
        left.plot(frames, result.measured["smoother"].velocity_m_s[:, 0], color=SMOOTH, lw=0.8, label="smoother")
        left.set_ylabel("velocity along x (m/s)")
        right.plot(1e3 * impact.history.time_s, 1e-3 * impact.history.normal_N, color="0.75", lw=1, label="true")
        seen_time, seen = impact.history.seen(1 / impact.frame_rate_hz)
        right.plot(1e3 * seen_time, 1e-3 * seen, color=MODEL, label="true, as seen at this frame rate")
        for way, color, mark in (("smoother", SMOOTH, "x"), ("differences", OURS, ".")):
            motion = result.measured[way]
            assert motion.sd_force_N is not None
            right.errorbar(
                frames,
                1e-3 * result.push_N(motion),
                1e-3 * motion.sd_force_N[:, 0],
                fmt=mark,
                ms=4,
                lw=0.8,
                color=color,
                label=way,
            )
        right.set_ylabel("force against the path (kN)")
        right.set_xlim(-0.15, 1.0)
        for axis in (left, right):
            shade(axis, impact.history)
            axis.set_xlabel("time since first touch (ms); in contact where shaded")
            axis.legend()


def main() -> None:
    """Measure, draw, and print the claims."""
    found = compute()
    plot(found)
    print(claims(rows(found)))


if __name__ == "__main__":
    main()
