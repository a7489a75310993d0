"""Figure 13, the set-up of the oblique impact and its model by finite elements: ``python -m experiments.paper.fig13``.

Claim: the mesh is finer where the ball hits. The paper shows a photograph and a mesh of shells, without numbers but the
edges of 0.5 to 10 mm.

Here: the finest impact of `table5`, its cut along the ball's path at the end, coloured by the equivalent plastic
strain, with the path of the ball; and its velocities on both meshes. A photograph of the set-up has no counterpart; a
rendered frame is in figure 15.
"""

from __future__ import annotations

from experiments.experiment import BLUE, FIGURES, ORANGE, VERMILION, Row, claims, saved_figure
from experiments.fe.explicit.impacts import Done
from experiments.fe.explicit.pictures import draw_cut, edges_mm
from experiments.paper import table5


def compute() -> tuple[Done, ...]:
    """The impact on each mesh."""
    return table5.compute()


def rows(impacts: tuple[Done, ...]) -> list[Row]:
    """The claim of the figure."""
    done = impacts[-1]
    thick, long = edges_mm(done)
    return [
        Row(
            "fig13",
            "The mesh is finer where the ball hits.",
            "edges of 0.5 to 10 mm",
            f"edges of {done.case.size_mm:g} to {long:.1f} mm in the plane, {thick:.2g} mm through the thickness, "
            f"{done.bricks} bricks in a half; the photograph has no counterpart",
            done.case.size_mm < long / 2,
        )
    ]


def plot(impacts: tuple[Done, ...]) -> None:
    """The cut on the left, the velocities on the right."""
    done = impacts[-1]
    with saved_figure(FIGURES / "fig13.png", (11, 4.2), dpi=80) as figure:
        left, right = figure.subplots(1, 2)
        drawn = draw_cut(left, done, mirrored=False)
        figure.colorbar(drawn, ax=left, label="equivalent plastic strain", shrink=0.6)
        left.plot(done.place_mm[:, 0], done.place_mm[:, 1], color=VERMILION, lw=1, label="path of the ball")
        left.set_xlim(-40, 120)
        left.set_ylim(-25, 25)
        left.set_xlabel("along the plate (mm)")
        left.set_ylabel("off the plate (mm)")
        left.grid(visible=False)
        left.legend()
        for one, color in zip(impacts, (ORANGE, BLUE), strict=True):
            velocity = one.motion.velocity_m_s
            for axis, style, name in ((0, "-", "along the plate"), (1, "--", "off the plate")):
                time, change = 1e3 * one.motion.time_s, velocity[:, axis] - velocity[0, axis]
                right.plot(time, change, style, color=color, label=f"{name}, {one.name}")
        right.set_xlabel("time since first touch (ms)")
        right.set_ylabel("change of the ball's velocity (m/s)")
        right.legend()


def main() -> None:
    """Compute, draw, and print the claims."""
    found = compute()
    plot(found)
    print(claims(rows(found)))


if __name__ == "__main__":
    main()
