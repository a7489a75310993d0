"""Figure 14, velocity and force of an oblique impact: ``python -m experiments.paper.fig14``.

Claim: on a curved path, too, velocities are smooth and follow the simulation. The force by differentiation is noisier,
by about 10 % of its size. Hardly any energy is dissipated, because the ball slides.

Paper: ball of 19 mm and 28 g at 80 m/s on a steel plate at 15 deg, 20 000 frames per second, 512 x 512 px, shutter
1/81 000 s; uncertainty of the acceleration around 10 % of the impact's.

Here: the motion of finite elements (`table5`) in the preset ``paper-plate`` of that geometry, whose plate hides the
part of the ball that is pressed in (`plate_shot`). The ball is tracked frame to frame from the circle that is found
under a motion blur of 4 px. The force is by differences as in the paper, and by torchsphere's smoother. The noise is
the standard deviation of the difference from the same differences of exact positions, in contact and out of contact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import torchsphere as ts
from experiments.experiment import BLUE, FIGURES, VERMILION, Array, Row, claims, saved_figure
from experiments.fe.explicit.impacts import Done
from experiments.fe.plate import ALMOST_NONE
from experiments.paper import table5
from experiments.paper.plate_shot import contact_s, shot_of, touching
from experiments.shots import Footage, rendered, tracked
from render.trajectory import ObliqueImpact

#: Colours of the axes x, y.
COLORS = (BLUE, VERMILION)
#: Uncertainty of the force as a share of the force, section 6.
PAPER_NOISE = 0.10
#: Largest error of a velocity that follows the model, as a share of the speed.
FOLLOWS = 0.02


@dataclass(frozen=True)
class Oblique:
    """The impact, rendered and tracked."""

    footage: Footage
    track: ts.Track
    done: Done  # the finite elements behind it
    setting: ObliqueImpact  # where ball and plate meet, and when

    @property
    def contact_s(self) -> tuple[float, float]:
        """Begin and end of the contact."""
        begin = 1e-6 * self.setting.touch_us
        return begin, begin + contact_s(self.done)[1]

    @property
    def touching(self) -> NDArray[np.bool_]:
        """Frames (n,) in the contact."""
        return touching(self.footage.shot.times_s, self.contact_s)

    def velocity_m_s(self) -> tuple[Array, Array]:
        """Measured and exact mean velocities (n - 1, 2) from frame to frame."""
        unit = self.footage.m_per_px * self.footage.shot.frame_rate_hz
        return self.track.increment[:, :2] * unit, self.footage.true("dx_px", "dy_px")[1:] * unit

    def force_N(self) -> tuple[Array, Array]:  # noqa: N802  (N is newton)
        """Force by second differences (n - 2, 2) of measured and of exact positions, at the inner frames."""
        unit = 1e-3 * self.setting.mass_g * self.footage.shot.frame_rate_hz
        measured, exact = self.velocity_m_s()
        return unit * np.diff(measured, axis=0), unit * np.diff(exact, axis=0)

    def kinematics(self) -> ts.Kinematics:
        """Motion in SI units by the smoother."""
        return ts.kinematics(
            self.track,
            frame_rate=self.footage.shot.frame_rate_hz,
            m_per_px=self.footage.m_per_px,
            mass_kg=1e-3 * self.setting.mass_g,
        )


def compute() -> Oblique:
    """The impact, rendered and tracked."""
    done = table5.compute()[-1]
    shot, setting = shot_of(done)
    footage = rendered(shot)
    return Oblique(footage, tracked(footage, sphere_map=False), done, setting)


def rows(found: Oblique) -> list[Row]:
    """The claims of the figure."""
    (velocity, exact_velocity), (force, exact) = found.velocity_m_s(), found.force_N()
    state = found.footage.shot.trajectory.state(np.array([0.0, found.footage.shot.times_s[-1]]))
    along = np.cross(np.array(found.setting.normal), (0.0, 0.0, -1.0))
    kept = (state.velocity_m_s @ along).tolist()
    before = float(np.linalg.norm(state.velocity_m_s[0]))
    peak = float(np.linalg.norm(exact, axis=1).max())
    off, touching = force - exact, found.touching[1:-1]
    noise = {name: np.nanstd(off[part], axis=0) for name, part in (("in", touching), ("out of", ~touching))}
    largest = float(max(part.max() for part in noise.values()))
    error = float(np.nanmax(np.abs(velocity - exact_velocity)))
    smooth = found.kinematics().velocity_m_s
    speeds = [float(smooth[i] @ along[: smooth.shape[1]]) for i in (0, -1)]
    texts = [f"{x:.0f} and {y:.0f} N {name} contact" for name, (x, y) in noise.items()]
    return [
        Row(
            "fig14",
            "Velocities follow the model on a curved path.",
            "good agreement",
            f"off by {error:.2f} m/s at most ({100 * error / before:.2f} % of the speed), in both components and all "
            f"{len(velocity)} steps",
            error < FOLLOWS * before,
        ),
        Row(
            "fig14",
            "The force by differences is uncertain by about 10 % of the impact's.",
            "about 10 %",
            f"in x and y {' and '.join(texts)}: {100 * largest / peak:.1f} % of {1e-3 * peak:.2f} kN at most",
            largest < PAPER_NOISE * peak,
        ),
        Row(
            "fig14",
            "Hardly any speed is lost along the plate.",
            "almost no deceleration",
            f"{speeds[0]:.2f} to {speeds[1]:.2f} m/s along the plate, true {kept[0]:.2f} to {kept[1]:.2f}",
            speeds[1] > (1 - ALMOST_NONE) * speeds[0]
            and all(abs(v - w) < 0.01 * w for v, w in zip(speeds, kept, strict=True)),
        ),
    ]


def plot(found: Oblique) -> None:
    """Velocities on the left, forces on the right."""
    with saved_figure(FIGURES / "fig14.png", (11, 4.2), dpi=80) as figure:
        left, right = figure.subplots(1, 2)
        shot, smooth = found.footage.shot, found.kinematics()
        time = np.linspace(0, shot.times_s[-1], 600)
        state = shot.trajectory.state(time)
        middles, frames = 1e3 * (shot.times_s[1:] + shot.times_s[:-1]) / 2, 1e3 * shot.times_s
        velocity, (force, exact) = found.velocity_m_s()[0], found.force_N()
        assert smooth.force_N is not None
        assert smooth.sd_force_N is not None
        for k, color in enumerate(COLORS):
            name = "xy"[k]
            left.plot(1e3 * time, state.velocity_m_s[:, k], color=color, lw=1, alpha=0.6, label=f"{name}: true")
            left.plot(middles, velocity[:, k], ".", color=color, ms=5, label=f"{name}: from frame to frame")
            right.plot(1e3 * time, 1e-3 * state.force_N[:, k], color=color, lw=1, alpha=0.6, label=f"{name}: true")
            right.plot(frames[1:-1], 1e-3 * exact[:, k], "_", color=color, ms=7, label=f"{name}: exact positions")
            right.plot(frames[1:-1], 1e-3 * force[:, k], ".", color=color, ms=5, label=f"{name}: differences")
            value, sd = 1e-3 * smooth.force_N[:, k], 1e-3 * smooth.sd_force_N[:, k]
            right.fill_between(
                frames, value - sd, value + sd, color=color, alpha=0.2, lw=0, label=f"{name}: smoother ± sd"
            )
        left.set_ylabel("velocity (m/s), y down")
        right.set_ylabel("force (kN), y down")
        for axis in (left, right):
            axis.axvspan(*(1e3 * edge for edge in found.contact_s), color="0.93", lw=0, zorder=0)
            axis.set_xlabel("time (ms); in contact where shaded")
            axis.legend(fontsize=7)


def main() -> None:
    """Measure, draw, and print the claims."""
    found = compute()
    plot(found)
    print(claims(rows(found)))


if __name__ == "__main__":
    main()
