"""Whether the ball stays round in the contact, and what its flattening does to the five modes (section 2.2).

``python -m experiments.paper.flattening``

Claim: the ball may be taken for rigid.

Here: the ball of `bar` as an elastic sphere under the largest force of the impact, spread over the contact that yields
at the pressure of `Setup`, and, as the most that could be, over that of two elastic bodies (Hertz). Its inertia
balances the force (`bar.elastic_sphere`). The camera looks across the impact: the ball's outline is compared with the
circle that fits it best, and an image of the ball as it is deformed is correlated with one of the round ball, whose
centre of mass is in the same place: what the five modes measure then is their error. An error that follows the force
adds its second derivative to the acceleration, for a half-sine of duration T by (pi / T)^2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

import torchsphere as ts
from experiments.experiment import PX_DEG, Array, Row, claims
from experiments.paper.bar.elastic_sphere import PushedSphere
from experiments.paper.bar.impact import simulate
from experiments.paper.bar.setup import Setup
from torchsphere.synthetic.ray_caster import CUBE_HALF_WIDTH, speckle

#: Size of the ball in the rendered shots, px per mm, and duration of the first pulse of the force, s.
PX_PER_MM, PULSE_S = 3.6, 2.3e-4
#: Rays per pixel along each side, patterns of speckle, and steps that find the point of a ray.
RAYS, PATTERNS, STEPS = 4, 6, 6
#: Largest error of the five modes, px, and of the force, as a share of it, with which the ball counts as rigid: the
#: noise of a step, and what the paper states for the force.
MOST_PX, OF_FORCE = 0.005, 0.01


@dataclass(frozen=True)
class Deformation:
    """Displacement of the surface at angles (k,), rad, from the pole: outwards and away from the pole (k,), radii."""

    angle: Array
    outwards: Array
    along: Array

    @classmethod
    def of(cls, ball: PushedSphere) -> Deformation:
        """The displacement of a pushed sphere."""
        angle = np.linspace(0, math.pi, 4001)
        return cls(angle, *(values / ball.radius_m for values in ball.displacement(angle)))


@dataclass(frozen=True)
class Flattened:
    """The ball under the largest force, on a contact of that radius."""

    cap_m: float
    outline_px: float  # largest deviation from the best circle, outside the contact
    increment: Array  # (patterns, 5), px and rad: what the five modes measure
    of_force: float  # effect of the error of x on the force, as a share of it


@dataclass(frozen=True)
class Result:
    """The largest force, N, and the ball on both contacts."""

    force_N: float  # noqa: N815  (N is newton)
    yielding: Flattened
    elastic: Flattened


def compute() -> Result:
    """The ball of `bar` at the largest force of its impact."""
    setup = Setup()
    force = float(np.abs(simulate(setup).force_N).max())
    caps = math.sqrt(force / (math.pi * setup.contact_pressure_pa)), hertz_radius(setup, force)
    return Result(force, *(flattened(setup, force, cap) for cap in caps))


def hertz_radius(setup: Setup, force: float) -> float:
    """Radius of the contact of two elastic bodies, m, the bar taken for flat."""
    ball, bar = ((1 - nu**2) / e for nu, e in _materials(setup))
    return float((0.75 * force * setup.ball_radius_m * (ball + bar)) ** (1 / 3))


def _materials(setup: Setup) -> tuple[tuple[float, float], tuple[float, float]]:
    return (setup.ball_poisson, setup.ball_modulus_pa), (setup.bar_poisson, setup.bar_modulus_pa)


def flattened(setup: Setup, force: float, cap_m: float) -> Flattened:
    """Outline and five modes of the ball under a force on a contact."""
    ball = PushedSphere(setup.ball_radius_m, setup.ball_modulus_pa, setup.ball_poisson, force, cap_m)
    deformation, radius = Deformation.of(ball), 1e3 * PX_PER_MM * setup.ball_radius_m
    shown = [measured(deformation, radius, seed) for seed in range(PATTERNS)]
    # The error of the position follows the force, and so do mass and acceleration.
    error_m = 1e-3 * float(np.mean(shown, 0)[0]) / PX_PER_MM
    of_force = setup.ball_mass_kg * error_m * (math.pi / PULSE_S) ** 2 / force
    beside = deformation.angle > math.asin(cap_m / setup.ball_radius_m)
    return Flattened(cap_m, radius * off_round(deformation, beside), np.array(shown), abs(of_force))


def off_round(deformation: Deformation, beside: NDArray[np.bool_]) -> float:
    """Largest distance of the outline ``beside`` (k,) the contact from the circle that fits it best, radii."""
    angle, outwards = deformation.angle[beside], deformation.outwards[beside]
    # A circle whose centre lies on the axis, by symmetry.
    circle = np.stack((np.ones_like(angle), np.cos(angle)), 1)
    return float(np.abs(outwards - circle @ np.linalg.lstsq(circle, outwards, rcond=None)[0]).max())


def measured(deformation: Deformation, radius: float, seed: int) -> Array:
    """What the five modes measure from the round ball to the deformed one, (5,), px and rad; ``radius`` in px."""
    middle = math.ceil(radius) + 6
    volume = speckle(seed, radius_px=radius).volume.double()
    images = [image(volume, middle, radius, pushed) for pushed in (None, deformation)]
    return np.asarray(ts.correlate(images[0], images[1], (middle, middle, radius)).q[0].numpy())


def image(volume: Tensor, middle: int, radius: float, deformation: Deformation | None) -> Tensor:
    """Image of a textured ball, round or deformed, pushed from the right, grey levels; the background is black."""
    side = torch.arange((2 * middle + 1) * RAYS, dtype=torch.float64)
    y, x = torch.meshgrid(*2 * ((side + 0.5) / RAYS - 0.5 - middle,), indexing="ij")
    ray = torch.stack((x, y), -1) / radius
    origin = ray.clone()
    if deformation is not None:
        for _ in range(STEPS):
            # The point of the round ball that the deformation moves onto the ray.
            origin = ray - moved(origin, deformation)
    squared = origin.square().sum(-1)
    front = torch.cat((origin, -(1 - squared).clamp_min(0).sqrt()[..., None]), -1)
    grey = functional.grid_sample(volume[None, None], (front / CUBE_HALF_WIDTH)[None, None], align_corners=True)
    seen = torch.where(squared < 1, grey[0, 0, 0], 0.0)
    return functional.avg_pool2d(seen[None, None], RAYS)[0, 0]


def moved(origin: Tensor, deformation: Deformation) -> Tensor:
    """Displacement (..., 2) in the image of the front's points at ``origin`` (..., 2), radii; 0 beyond the outline."""
    inside = origin.square().sum(-1) < 1
    x, y = origin[inside].T.numpy()
    angle = np.arccos(np.clip(x, -1, 1))
    outwards, along = (np.interp(angle, deformation.angle, v) for v in (deformation.outwards, deformation.along))
    sine = np.maximum(np.sin(angle), 1e-9)
    found = torch.zeros_like(origin)
    found[inside] = torch.from_numpy(np.stack((outwards * x - along * sine, (outwards + along * x / sine) * y), -1))
    return found


def rows(result: Result) -> list[Row]:
    """The remark, for the contact that yields and the elastic one."""
    found = []
    for name, one in (
        ("of a bar that yields", result.yielding),
        ("of a bar that does not, as the most", result.elastic),
    ):
        mean = np.abs(one.increment.mean(0) * PX_DEG)
        ours = (
            f"{1e-3 * result.force_N:.0f} kN on a contact of {1e3 * one.cap_m:.1f} mm: outline off round by "
            f"{one.outline_px:.3f} px at most beside it; five modes off by {mean[:2].max():.4f} px and "
            f"{mean[2:].max():.4f} deg, {100 * one.of_force:.2f} % of the force"
        )
        holds = bool(mean[:2].max() < MOST_PX) and one.of_force < OF_FORCE
        other = "the contact yields" if one is result.elastic else ""
        found.append(
            Row("flattening", f"the ball can be considered rigid on the contact {name}", "assumed", ours, holds, other)
        )
    return found


def main() -> None:
    """Print the rows."""
    print(claims(rows(compute())))


if __name__ == "__main__":
    main()
