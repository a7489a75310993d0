"""The outline of the ball in one image."""

from __future__ import annotations

import math
from dataclasses import dataclass

#: Radius, px, up to which a circle found may as well be a screw or a lamp: speckle of 3 px tells no rotation there.
SMALL_PX = 10.0


@dataclass(frozen=True)
class Circle:
    """Outline of the ball in one image.

    Attributes
    ----------
    x, y, radius : float
        Centre and radius, px.
    sd_x, sd_y, sd_radius : float
        Standard deviations, px; NaN for a circle that was given without them.
    frame : int
        Frame of the recording in which the circle lies.
    sd_guessed : bool
        True where the standard deviations are a bound instead of a measurement, because the image shows no limb near
        the circle. Later frames may since have measured that of the radius.
    """

    x: float
    y: float
    radius: float
    sd_x: float = math.nan
    sd_y: float = math.nan
    sd_radius: float = math.nan
    frame: int = 0
    sd_guessed: bool = False

    def text(self, decimals: int = 2) -> str:
        """The three numbers as ``--circle`` takes them."""
        return ",".join(f"{value:.{decimals}f}" for value in (self.x, self.y, self.radius))

    @property
    def sd_text(self) -> str:
        """The standard deviations in words."""
        if self.sd_guessed:
            return f"to about {max(self.sd_x, self.sd_y, self.sd_radius):.0f} px, not measured"
        return f"sd {self.sd_x:.2f}, {self.sd_y:.2f}, {self.sd_radius:.2f} px"

    @property
    def doubt(self) -> str:
        """Why the circle may not be the ball's outline, in words; empty where nothing says so."""
        if self.sd_guessed:
            return "no limb of a speckled ball was seen along it"
        return "it is so small that it may be anything bright or dark" if self.radius < SMALL_PX else ""

    def warning(self, where: str) -> str:
        """The `doubt` about a circle that was found as a sentence: ``where`` to look at it, and what to do."""
        return (
            f"The circle found, of {self.radius:.1f} px radius, may not be the ball: {self.doubt}; look at it {where}, "
            "and give --circle X,Y,R where it is not."
        )
