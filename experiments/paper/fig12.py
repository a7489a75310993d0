"""Figure 12 and section 5.3.2, the bar's modes in the force's peaks: ``python -m experiments.paper.fig12``.

Claim: the time from the first peak of the force to the third is half a period of the bar's first bending mode, and the
time to the second peak half a period of its third mode (the second symmetric one). The force of the frontal impact
therefore tells the bar's eigenfrequencies.

Paper: 0.594 ms and 841 Hz against 827 Hz by theory; 0.124 ms and 4032 Hz against 4468 Hz by theory (alpha = 22.37 and
120.9; 61.67 between them belongs to an antisymmetric mode, which an impact at mid-span does not excite). The two
theoretical numbers agree with each other, but not with the paper's length, diameter and modulus: with a density of
2800 kg/m^3 these give 903 and 4879 Hz, and 894 and 4643 Hz with the shear and the rotary inertia of so thick a bar
(Timoshenko), which is the theory here. 827 Hz would need 3340 kg/m^3.

Here: the impact of `bar`, whose bar yields and has the frequencies of its own numbers. The peaks are those of the true
force, those of the force that a camera at 36 000 frames per second sees without noise, and those measured in the
rendered shot of `fig11` by differences, as in the paper. The times agree with the paper's, and so lie below theory:
half a period is a rough rule, since the first peak comes only after the contact has built up.

The result is kept in ``experiments/cache``; delete it after a change to `bar`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from experiments.experiment import (
    BLUE,
    FIGURES,
    VERMILION,
    Array,
    Row,
    cached,
    claims,
    decided,
    saved_figure,
    table,
)
from experiments.paper import bar_shot
from experiments.paper.bar.beam import free_roots, symmetric_shape, timoshenko_hz
from experiments.paper.bar.history import peaks
from experiments.paper.bar.impact import simulate
from experiments.paper.bar.setup import Setup

#: Frames per second, section 5.1.
FRAME_RATE_HZ = 36_000
#: Section 5.3.2, by mode: frequency by theory, time between peaks (peaks 1 and 3, peaks 1 and 2), frequency from it.
PAPER = {1: (827.0, 0.594e-3, 841.0), 3: (4468.0, 0.124e-3, 4032.0)}
#: The peak that follows the first by half a period of each mode, counted from 0.
PARTNER = {1: 2, 3: 1}
#: Ratio of the model's steps to those in the cache.
THINNING = 5

COLORS = {1: BLUE, 3: VERMILION}


#: Largest deviation that counts as confirmed: the paper's estimate of mode 3 is off by 10 %.
ROUGHLY = 0.1
#: Relative distance from it within which a verdict is left open.
MARGIN = 0.1

HALF_A_PERIOD = "the bar yields and the contact lasts, so that half a period is a rough rule"


@dataclass(frozen=True)
class Force:
    """A force (n,) in N over time (n,) in s, and times and heights of its peaks, (m,) each."""

    time_s: Array
    force_N: Array  # noqa: N815  (N is newton)
    peak_s: Array
    peak_N: Array  # noqa: N815

    def lapse_s(self, mode: int) -> float:
        """Time from the first peak to the mode's partner; NaN if there are too few peaks."""
        partner = PARTNER[mode]
        return float(self.peak_s[partner] - self.peak_s[0]) if len(self.peak_s) > partner else float("nan")

    def frequency_hz(self, mode: int) -> float:
        """The paper's estimate, by which the lapse is half a period."""
        return 1 / (2 * self.lapse_s(mode))


@dataclass(frozen=True)
class Result:
    """Theoretical frequencies by mode in Hz, and the true force, that which the camera sees, and the measured one."""

    theory_hz: dict[int, float]
    true: Force
    seen: Force
    measured: Force


def measure(setup: Setup) -> dict[str, Any]:
    """The impact, as lists."""
    history = simulate(setup)
    forces = {"true": (history.time_s, history.normal_N), "seen": history.seen(1 / FRAME_RATE_HZ)}
    found = {}
    for name, (time, force) in forces.items():
        tops = peaks(time, force)
        columns = (time[::THINNING], force[::THINNING])
        found[name] = [*(c.tolist() for c in columns), [t.time_s for t in tops], [t.force_N for t in tops]]
    return found


def compute() -> Result:
    """Frequencies by theory, and the impact's force."""
    setup = Setup()
    theory = timoshenko_hz(3, setup).tolist()
    raw = cached("fig12", asdict(setup) | {"rate": FRAME_RATE_HZ, "thinning": THINNING}, lambda: measure(setup))
    forces = {name: Force(*(np.array(part) for part in parts)) for name, parts in raw.items()}
    return Result({mode: theory[mode - 1] for mode in PAPER}, **forces, measured=_measured())


def _measured() -> Force:
    """The force against the path by differences of the tracked positions, with its peaks."""
    impact = bar_shot.compute()
    motion = impact.kinematics(impact.track, "differences")
    assert motion.force_N is not None
    force = -np.nan_to_num(motion.force_N[:, 0])
    tops = peaks(impact.time_s, force)
    return Force(impact.time_s, force, np.array([t.time_s for t in tops]), np.array([t.force_N for t in tops]))


def _draw_shapes(axis: Axes, theory_hz: dict[int, float], length_m: float) -> None:
    place = np.linspace(-0.5, 0.5, 401)
    shapes = symmetric_shape(free_roots(3)[::2], place)
    for (mode, frequency), shape in zip(theory_hz.items(), shapes.T, strict=True):
        label = f"mode {mode}: {frequency:.0f} Hz (paper: {PAPER[mode][0]:.0f} Hz)"
        axis.plot(1e3 * length_m * place, shape / np.abs(shape).max(), color=COLORS[mode], label=label)
    axis.axhline(0, color="0.6", lw=0.8)
    axis.set_xlabel("place along the bar (mm)")
    axis.set_ylabel("deflection (largest = 1)")
    axis.set_ylim(-1.15, 1.75)
    axis.legend(loc="upper center", title="symmetric modes, by theory")


def _draw_force(axis: Axes, result: Result) -> None:
    axis.plot(1e3 * result.true.time_s, 1e-3 * result.true.force_N, color="0.75", lw=1, label="true")
    axis.plot(
        1e3 * result.seen.time_s,
        1e-3 * result.seen.force_N,
        color="black",
        label=f"as seen at {FRAME_RATE_HZ} frames per second",
    )
    force, top = result.seen, 1e-3 * result.true.force_N.max()
    for i, (time, height) in enumerate(zip(1e3 * force.peak_s, 1e-3 * force.peak_N, strict=True)):
        axis.annotate(str(i + 1), (time, height), (5, 4), textcoords="offset points", fontweight="bold")
    for mode, level in ((3, 1.12), (1, 1.3)):
        start, stop = 1e3 * force.peak_s[0], 1e3 * (force.peak_s[0] + force.lapse_s(mode))
        axis.plot((start, start, stop, stop), top * (level + np.array((-0.04, 0, 0, -0.04))), color=COLORS[mode])
        text = f"{1e3 * force.lapse_s(mode):.3f} ms: {force.frequency_hz(mode):.0f} Hz"
        paper = f"paper: {1e3 * PAPER[mode][1]:.3f} ms, {PAPER[mode][2]:.0f} Hz"
        axis.text(start, top * (level + 0.02), f"{text} ({paper})", color=COLORS[mode])
    axis.set_xlim(-0.05, 0.9)
    axis.set_ylim(0, 1.45 * top)
    axis.set_xlabel("time since first touch (ms)")
    axis.set_ylabel("force on the ball (kN)")
    axis.legend(loc="upper right", bbox_to_anchor=(1.0, 0.75))


def plot(result: Result) -> None:
    """The mode shapes, and the force with the lapses between its peaks."""
    with saved_figure(FIGURES / "fig12.png", (12, 4.4), dpi=110) as figure:
        shapes, force = figure.subplots(1, 2)
        _draw_shapes(shapes, result.theory_hz, Setup().bar_length_m)
        _draw_force(force, result)


def rows(result: Result) -> list[Row]:
    """The paper's estimates of the eigenfrequencies, from its peaks and from the model's as a camera sees them."""
    found = []
    for mode, (theory, lapse, frequency) in PAPER.items():
        own, paper_off = result.theory_hz[mode], frequency / theory - 1
        for name, force in (("measured", result.measured), ("of the model", result.seen)):
            off = force.frequency_hz(mode) / own - 1
            found.append(
                Row(
                    "fig12",
                    f"half a period of bending mode {mode} lies between peaks 1 and {PARTNER[mode] + 1} of the force, "
                    f"{name}",
                    f"{1e3 * lapse:.3f} ms: {frequency:.0f} Hz against {theory:.0f} Hz ({100 * paper_off:+.1f} %)",
                    f"{1e3 * force.lapse_s(mode):.3f} ms: {force.frequency_hz(mode):.0f} Hz against {own:.0f} Hz "
                    f"({100 * off:+.1f} %)",
                    decided(ROUGHLY, abs(off), MARGIN),
                    reason=HALF_A_PERIOD if abs(off) > ROUGHLY else "",
                )
            )
    return found


def main() -> None:
    """Measure, draw, and print the table."""
    result = compute()
    plot(result)
    head = ("mode", "by theory (Hz)", "paper's theory (Hz)", "from the peaks", "peaks 1 to", "lapse (ms)", "Hz", "off")
    lines = []
    for mode, (theory, lapse, frequency) in PAPER.items():
        own = result.theory_hz[mode]
        estimates = [("paper", lapse, frequency, frequency / theory - 1)]
        for name, force in (("true force", result.true), ("as seen", result.seen), ("measured", result.measured)):
            found = force.frequency_hz(mode)
            estimates.append((name, force.lapse_s(mode), found, found / own - 1))
        for name, time, found, off in estimates:
            known = (mode, f"{own:.0f}", f"{theory:.0f}", name, PARTNER[mode] + 1)
            lines.append((*known, f"{1e3 * time:.3f}", f"{found:.0f}", f"{100 * off:+.1f} %"))
    print(table(head, lines))
    for name, force in (("true force", result.true), ("as seen", result.seen)):
        tops = zip(force.peak_s, force.peak_N, strict=True)
        print(f"peaks, {name}: " + ", ".join(f"{1e-3 * top:.1f} kN at {1e3 * time:.3f} ms" for time, top in tops))
    print(claims(rows(result)))


if __name__ == "__main__":
    main()
