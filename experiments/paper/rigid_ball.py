"""The remark of section 5.3.2, whether the ball is rigid: ``python -m experiments.paper.rigid_ball``.

Claim: the first eigenmode of the steel ball lies above 80 kHz, so that the ball may be taken for rigid.

Here: the lowest mode of a free elastic sphere is the torsional one of degree 2, two halves that twist against each
other. With the speed of shear waves ``c`` its frequency is ``x c / (2 pi R)``, where ``x`` is the first root of
``j2(x) = x j3(x)`` with spherical Bessel functions (Lamb, Proc. London Math. Soc. 13, 1881, 189,
DOI 10.1112/plms/s1-13.1.189). Modulus and Poisson's ratio are those of `bar`, the density that of the ball's mass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from scipy.optimize import brentq
from scipy.special import spherical_jn

from experiments.experiment import Row, claims
from experiments.paper.bar.setup import Setup

#: Frequency of the paper, Hz, and the frame rate of its impact.
PAPER_HZ, FRAME_RATE_HZ = 80e3, 36e3


@dataclass(frozen=True)
class Result:
    """Frequency of the ball's lowest mode, Hz."""

    lowest_hz: float


def compute() -> Result:
    """The lowest mode of the ball of `bar`."""
    setup = Setup()
    volume = 4 / 3 * math.pi * setup.ball_radius_m**3
    shear = setup.ball_modulus_pa / (2 + 2 * setup.ball_poisson)
    speed = math.sqrt(shear * volume / setup.ball_mass_kg)
    root = brentq(lambda x: spherical_jn(2, x) - x * spherical_jn(3, x), 1.0, 4.0)
    return Result(root * speed / (2 * math.pi * setup.ball_radius_m))


def rows(result: Result) -> list[Row]:
    """The remark."""
    ours = (
        f"{1e-3 * result.lowest_hz:.1f} kHz, a period of {1e6 / result.lowest_hz:.0f} us; a frame is "
        f"{1e6 / FRAME_RATE_HZ:.0f} us"
    )
    claim = "the first eigenmode of the steel ball is higher than 80 kHz"
    return [Row("rigid_ball", claim, "> 80 kHz", ours, result.lowest_hz > PAPER_HZ)]


def main() -> None:
    """Print the claim."""
    print(claims(rows(compute())))


if __name__ == "__main__":
    main()
