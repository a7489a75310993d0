"""Figure 10, the model of the frontal impact by finite elements: ``python -m experiments.paper.fig10``.

Claim: the mesh is finer where the ball hits, and the plastic strain is there; force and measurement match.

Paper: edges of 0.5 to 15 mm; a colour map of the largest principal plastic strain, without numbers; a very good match.

Here: the finest impact of `table4`, its cut along the bar coloured by the equivalent plastic strain. Its force stands
beside that of the beam model, and beside the force that was tracked in the shot of `fig11`. The true motion of that
shot is the beam model's: there is no recording of the test itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.experiment import BLUE, FIGURES, GREEN, ORANGE, Row, claims, saved_figure
from experiments.fe.bar import FRAME_RATE_HZ, PAPER_PEAK_N
from experiments.fe.explicit.pictures import cut, draw_cut, edges_mm
from experiments.paper import fig11, table4

#: Plastic strain from which a place counts as strained: the yield of a tensile test.
STRAINED = 0.002
#: Share of the largest strain that counts as dented, and largest distance of such places from the ball's, in radii.
DENTED, NEAR = 0.1, 1.0


@dataclass(frozen=True)
class Result:
    """Finite elements and beam model, and the tracked shot."""

    model: table4.Result
    tracked: fig11.Result


def compute() -> Result:
    """All three."""
    return Result(table4.compute(), fig11.compute())


def rows(result: Result) -> list[Row]:
    """The claims of the figure."""
    done = result.model.finest
    short, long = edges_mm(done)
    faces, strain = cut(done)
    middles = faces.mean(axis=1)
    away = np.abs(middles[strain > DENTED * strain.max(), 1]).max()
    bent = np.abs(middles[strain > STRAINED, 1]).max()
    force = table4.force_of(done)
    shown = float(result.tracked.push_N(result.tracked.measured["differences"]).max())
    beam = result.model.beam
    return [
        Row(
            "fig10",
            "The mesh is finer where the ball hits.",
            "edges of 0.5 to 15 mm",
            f"edges of {short:.2f} to {long:.1f} mm, {done.bricks} bricks in a quarter",
            short < 1,
        ),
        Row(
            "fig10",
            "The plastic strain is where the ball hits.",
            "seen in the figure",
            f"largest {strain.max():.2f}; a tenth of it up to {away:.0f} mm along the bar, {STRAINED:g} up to "
            f"{bent:.0f} mm by bending",
            away < NEAR * done.case.radius_mm,
        ),
        Row(
            "fig10",
            "The highest forces of simulation and measurement match.",
            "very good",
            f"finite elements {1e-3 * force.lowest_N:.1f} to {1e-3 * force.force_N.max():.1f} kN as the frames fall, "
            f"beam model {1e-3 * beam.lowest_N:.1f} to {1e-3 * beam.force_N.max():.1f}, tracked {1e-3 * shown:.1f}",
            force.lowest_N <= shown <= force.force_N.max(),
        ),
    ]


def plot(result: Result) -> None:
    """The cut on the left, the forces on the right."""
    done = result.model.finest
    with saved_figure(FIGURES / "fig10.png", (11, 4.2), dpi=80) as figure:
        left, right = figure.subplots(1, 2)
        drawn = draw_cut(left, done, mirrored=True)
        figure.colorbar(drawn, ax=left, label="equivalent plastic strain")
        middle = float(cut(done)[0][:, :, 0].min())
        left.set_xlim(middle - 12, middle + 32)
        left.set_ylim(-35, 35)
        left.set_xlabel("along the barrel (mm)")
        left.set_ylabel("along the bar (mm)")
        left.grid(visible=False)
        for force, color in (
            (table4.force_of(result.model.runs[0]), ORANGE),
            (table4.force_of(done), BLUE),
            (result.model.beam, GREEN),
        ):
            right.plot(1e3 * force.time_s, 1e-3 * force.force_N, color=color, label=force.name)
        frames = 1e3 * result.tracked.impact.time_s
        push = result.tracked.push_N(result.tracked.measured["differences"])
        right.plot(frames, 1e-3 * push, ".", color="black", ms=4, label="tracked")
        right.axhline(1e-3 * PAPER_PEAK_N, color="0.6", lw=0.8, ls="--", label="paper: about 60 kN")
        right.set_xlim(-0.1, 0.9)
        right.set_xlabel("time since first touch (ms)")
        right.set_ylabel(f"force as seen at {FRAME_RATE_HZ} frames per second (kN)")
        right.legend()


def main() -> None:
    """Compute, draw, and print the claims."""
    found = compute()
    plot(found)
    print(claims(rows(found)))


if __name__ == "__main__":
    main()
