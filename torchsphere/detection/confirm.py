"""Whether the images show an outline where a circle was given: all that has a length scales with its radius."""

from __future__ import annotations

import math

from torch import Tensor

from torchsphere.detection.detect import Circle, refine_circle

#: What a given circle may differ by from the outline that the images show: standard deviations of that, and share of
#: its radius. A careful hand on a preview is right to 2 %.
CLEAR, CAREFUL = 4.0, 0.03

LOOK = "See figures/path.png: where it is not the ball's, every length and speed is off as its radius is."


def confirm(image: Tensor, given: Circle) -> str:
    """A sentence where the outline in ``image`` (h, w) is not the circle that was ``given``; empty where it is."""
    told = f"The circle that was given, {_told(given)} px,"
    try:
        seen = refine_circle(image, given)
    except ValueError:
        seen = None
    if seen is None or seen.sd_guessed:
        return f"{told} was not confirmed: no limb of a speckled ball was seen along it. {LOOK}"
    apart = max(math.hypot(seen.x - given.x, seen.y - given.y), abs(seen.radius - given.radius))
    if apart <= max(CLEAR * max(seen.sd_x, seen.sd_y, seen.sd_radius), CAREFUL * seen.radius):
        return ""
    return f"{told} is not the outline that the image shows at {_told(seen)} px; --refine takes that. {LOOK}"


def refined(fitted: Circle) -> str:
    """A sentence where a circle that was given and ``fitted`` to the image may not be the ball's outline by now."""
    if not fitted.doubt:
        return ""
    return (
        f"The circle that was given was fitted by --refine, at {_told(fitted)} px, and may not be the ball's outline: "
        f"{fitted.doubt}. See figures/path.png: where the circle as given is better, leave out --refine."
    )


def _told(circle: Circle) -> str:
    return f"{circle.x:.1f},{circle.y:.1f},{circle.radius:.1f}"
