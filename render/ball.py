"""The ball's size and its paint."""

from __future__ import annotations

from dataclasses import dataclass

from .check import within


@dataclass(frozen=True)
class Ball:
    """The ball, without its pattern.

    Attributes
    ----------
    diameter_mm : float
        Diameter, mm.
    gloss : float
        Strength of the paint's reflection: 0 is matt, 1 a lacquer of refractive index 1.5. Light that the lacquer
        reflects does not reach the pigment, so the pattern appears darker than its albedo.
    roughness : float
        Alpha of the GGX distribution of the gloss: 0.05 gives a small sharp highlight, 0.4 a wide dim one.
    """

    diameter_mm: float = 30.0
    gloss: float = 0.0
    roughness: float = 0.15

    def __post_init__(self) -> None:
        """Check the values."""
        within("diameter_mm", self.diameter_mm, 0.0, above=True)
        within("gloss", self.gloss, 0.0, 1.0)
        within("roughness", self.roughness, 0.0, 1.0, above=True)

    @property
    def radius_m(self) -> float:
        """Radius, m."""
        return self.diameter_mm / 2000.0
