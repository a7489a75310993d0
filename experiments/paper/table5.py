"""Table 5, Johnson and Cook's constants of the plate in finite elements: ``python -m experiments.paper.table5``.

Claim: the ball slides on the plate with almost no deceleration along it; simulation and measurement agree (section 6).

Paper (Radioss, the ball a rigid wall, shells of 0.5 to 10 mm): in contact at 0.65 ms of the recording (figure 15);
velocities and forces are in figure 14 only, without numbers in the text.

Here: `experiments.fe.explicit`, half of the plate under a rigid ball, with the actual strain rate and heat. Two layers
of bricks stand for the shells; they bend as a plate does (`experiments.fe.validation`). Not in the paper: density,
capacity of heat, friction, place of the impact and direction of the long side (`explicit.impacts`). The force is that
seen at 20 000 frames per second. `experiments.fe.plate` is the same in CalculiX with tables, up to the loss of contact.
"""

from __future__ import annotations

import math

import numpy as np

from experiments.experiment import Array, Row, claims, table
from experiments.fe.explicit.impacts import RATE, STRAIN, WARMTH, Done, PlateImpact, impact
from experiments.fe.plate import ALMOST_NONE, FRAME_RATE_HZ, TOUCHING

#: Meshes from coarse to fine.
MESHES = (PlateImpact(size_mm=4.0, long_mm=20.0), PlateImpact(size_mm=2.5, long_mm=15.0))
#: Largest change of the highest force over the meshes that counts as converged.
CONVERGED = 0.03


def along_kept(done: Done) -> float:
    """Speed along the plate at the end over that before."""
    along = done.motion.velocity_m_s[:, 0]
    return float(along[-1] / along[0])


def turned_deg(done: Done) -> float:
    """Angle by which the ball's path turned."""
    (x, y), (u, v) = done.motion.velocity_m_s[0, :2], done.motion.velocity_m_s[-1, :2]
    return math.degrees(math.atan2(v, u) - math.atan2(y, x))


def deepest_mm(done: Done) -> float:
    """Largest depth of the ball's lowest point under the plate's first level."""
    return float(done.case.radius_mm - done.place_mm[:, 1].min())


def contact_end_s(done: Done) -> float:
    """Time of the last push of the plate since first touch."""
    time, force = done.motion.force()
    return float(time[np.flatnonzero(force[:, 1] > TOUCHING * force[:, 1].max())[-1]])


def seen_N(done: Done) -> tuple[Array, Array]:  # noqa: N802  (N is newton)
    """Times (m,) in s and size (m,) of the force in N as a camera sees it."""
    time, force = done.motion.seen(1 / FRAME_RATE_HZ)
    return time, np.linalg.norm(force, axis=1)


def compute() -> tuple[Done, ...]:
    """The impact on each mesh."""
    return tuple(map(impact, MESHES))


def rows(impacts: tuple[Done, ...]) -> list[Row]:
    """The claims of section 6, and whether the mesh is fine enough."""
    name, done = "table5", impacts[-1]
    out, last = done.motion.velocity_m_s[-1, :2], contact_end_s(done)
    tops = [float(seen_N(one)[1].max()) for one in impacts]
    return [
        Row(
            name,
            "The ball slides along the plate with almost no deceleration.",
            "almost no deceleration",
            f"{100 * along_kept(done):.1f} % of the speed along the plate kept with a friction of "
            f"{done.case.friction:g}; {deepest_mm(done):.1f} mm deep, warmed by {done.metal[WARMTH].max():.0f} K",
            along_kept(done) > 1 - ALMOST_NONE,
        ),
        Row(
            name,
            "The ball turns and leaves the plate.",
            "seen in figure 15",
            f"turned by {turned_deg(done):.1f} deg, leaves with {out[1]:+.2f} m/s off the plate after "
            f"{1e3 * last:.2f} ms",
            bool(out[1] > 0),
        ),
        Row(
            name,
            "The mesh is fine enough for the highest force (edges of 0.5 to 10 mm).",
            "not stated",
            f"{', '.join(f'{1e-3 * top:.2f}' for top in tops)} kN with bricks of "
            f"{', '.join(f'{one.case.size_mm:g}' for one in impacts)} mm",
            max(tops) / min(tops) - 1 < CONVERGED,
        ),
    ]


def main() -> None:
    """Compute, and print the tables."""
    impacts = compute()
    head = (
        *("mesh", "bricks", "steps", "peak as seen (kN)", "at (ms)", "contact until (ms)", "deepest (mm)"),
        *("along kept (%)", "turned (deg)", "spin (rev/s)", "strain", "rate (1/s)", "warming (K)", "energy off"),
    )
    lines = []
    for done in impacts:
        time, force = seen_N(done)
        top = (f"{1e-3 * force.max():.2f}", f"{1e3 * time[force.argmax()]:.3f}", f"{1e3 * contact_end_s(done):.2f}")
        moved = (f"{deepest_mm(done):.2f}", f"{100 * along_kept(done):.1f}", f"{turned_deg(done):.1f}")
        spun = f"{done.spin_rad_s[-1, 2] / 2 / math.pi:.1f}"
        metal = (f"{done.metal[STRAIN].max():.3f}", f"{done.metal[RATE].max():.0f}", f"{done.metal[WARMTH].max():.1f}")
        lines.append((done.name, done.bricks, done.steps, *top, *moved, spun, *metal, f"{100 * done.imbalance:.2f} %"))
    print(table(head, lines))
    print(claims(rows(impacts)))


if __name__ == "__main__":
    main()
