"""The outline of the ball in one image."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from torchsphere.runtime.presentation import Presented

#: Radius below which a circle may be a screw or a lamp, px: speckle of 3 px determines no rotation there.
SMALL_PX = 10.0


@dataclass(frozen=True)
class Circle(Presented):
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
        True where the standard deviations are a bound, because the image shows no limb near the circle; later frames
        may have measured that of the radius.
    others : tuple
        Circles (x, y, radius), px, of other round objects of about that size in the image of a circle that was found:
        one of them may be the ball instead.
    unproven : str
        Why nothing shows that a circle that was found is a ball's outline; empty where something does.
    """

    x: float
    y: float
    radius: float
    sd_x: float = math.nan
    sd_y: float = math.nan
    sd_radius: float = math.nan
    frame: int = 0
    sd_guessed: bool = False
    others: tuple[tuple[float, float, float], ...] = ()
    unproven: str = ""

    def __repr__(self) -> str:
        sd = "" if math.isnan(self.sd_radius) else f", {self.sd_text}"
        others = f"; {len(self.others)} others of this size" if self.others else ""
        return f"<Circle {self.text()} px in frame {self.frame}{sd}{others}>"

    @classmethod
    def of(cls, given: Any) -> Circle:
        """The circle of three numbers, or a circle, with plain numbers; ValueError for anything else."""
        values = (given.x, given.y, given.radius) if isinstance(given, Circle) else given
        try:
            x, y, radius = (float(value) for value in values)
        except (TypeError, ValueError) as error:
            raise ValueError(f"circle: expected three numbers (x, y, radius) in px, got {values!r}") from error
        return replace(given, x=x, y=y, radius=radius) if isinstance(given, Circle) else cls(x, y, radius)

    def with_errors(self, factor: float) -> Circle:
        """The circle with that multiple of its standard deviations."""
        return replace(self, sd_x=factor * self.sd_x, sd_y=factor * self.sd_y, sd_radius=factor * self.sd_radius)

    def text(self, decimals: int = 2) -> str:
        """Centre and radius in the form of ``--circle``."""
        return ",".join(f"{value:.{decimals}f}" for value in (self.x, self.y, self.radius))

    @property
    def sd_text(self) -> str:
        """The standard deviations in words."""
        if self.sd_guessed:
            return f"to about {max(self.sd_x, self.sd_y, self.sd_radius):.0f} px, not measured"
        return f"sd {self.sd_x:.2f}, {self.sd_y:.2f}, {self.sd_radius:.2f} px"

    @property
    def doubt(self) -> str:
        """Reason why the circle may not be the ball's outline; empty without one."""
        if self.unproven:
            return self.unproven
        if self.sd_guessed:
            return "no limb of a speckled ball was seen along it"
        return "it is so small that it may be anything bright or dark" if self.radius < SMALL_PX else ""

    def choice(self, where: str) -> str:
        """A sentence with all round objects of about this size, and ``where`` to look at them; empty without others."""
        if not self.others:
            return ""
        rest = " and ".join(",".join(f"{value:.1f}" for value in other) for other in self.others)
        return (
            f"Frame {self.frame} shows {1 + len(self.others)} round objects of about one size: the one at "
            f"{self.text(1)} px is taken for the ball, not that at {rest} px; look at them {where}, and give "
            "`circle` X,Y,R of the ball."
        )

    def warning(self, where: str) -> str:
        """A sentence with the `doubt` about a circle that was found, and ``where`` to look at it."""
        return (
            f"The circle found, of {self.radius:.1f} px radius, may not be the ball: {self.doubt}; look at it {where}, "
            "and give `circle` X,Y,R if it is wrong."
        )
