"""Whether a circle is the outline of a ball: what its own image shows, and what later frames prove.

`Circle.doubt` says what a circle states of itself.
"""

from __future__ import annotations

import math

from torch import Tensor

from torchsphere.detection.detect import refine_circle
from torchsphere.geometry.camera import Camera
from torchsphere.geometry.circle import Circle
from torchsphere.settings.limits import SettingError

#: Standard deviation of a doubtful circle's radius, as a share of it, from which it needs a proof
#: (docs/constants.toml).
MAX_UNPROVEN_SD = 0.1

#: Relative scatter of the outlines' radii in several frames from which they are not those of a ball, where no map could
#: be made (docs/constants.toml).
MAX_OUTLINE_SCATTER = 0.03

#: Largest difference of a given circle from the outline, in standard deviations and as a share of the radius: 2 % is
#: the error of a circle that was drawn by hand with care.
MAX_CIRCLE_SDS, MAX_CIRCLE_ERROR = 4.0, 0.03

#: Advice for a circle in doubt.
CHECK_ADVICE = (
    "Look at the circle in the image: if it is not the ball's outline, lengths and speeds are wrong in proportion to "
    "its radius."
)


def shows_outline(image: Tensor, circle: Circle, camera: Camera | None = None) -> bool:
    """Whether the ``image`` (h, w) shows an outline near the circle."""
    try:
        refine_circle(image, circle, camera=camera)
    except ValueError:
        return False
    return True


def needs_proof(circle: Circle) -> bool:
    """Whether its image leaves a circle that was found in doubt, so that other images must prove it."""
    is_measured = not circle.sd_guessed and circle.sd_radius < MAX_UNPROVEN_SD * circle.radius
    return bool(circle.doubt) and not is_measured


def lacking_proof(circle: Circle, *, is_proven: bool, outline_scatter: float = 0.0, untried_frames: int = 0) -> str:
    """Why nothing shows that a circle that was found is the outline of a ball, in words; empty where something does.

    The circle is in doubt by its own image, by outlines in other frames whose radii have that relative scatter, or as
    the frames right after it hardly show the same, so that the rest of the frames was not tried.
    """
    if is_proven:
        return ""
    if outline_scatter > MAX_OUTLINE_SCATTER:
        return f"outlines in other frames have radii that differ by {100 * outline_scatter:.0f} %"
    if untried_frames:
        return f"{circle.doubt}, the frames right after it hardly show the same"
    return circle.doubt if needs_proof(circle) else ""


def require_ball(circle: Circle) -> None:
    """Raise SettingError for a circle that was found where nothing shows that it is a ball's outline."""
    if circle.unproven:
        raise SettingError(
            f"the circle found, {circle.text(1)} px in frame {circle.frame}, may not be the ball: {circle.unproven}; "
            "if it is, give its outline with `circle` as x, y, radius in px of the first frame to track"
        )


def require_proof(circle: Circle, lack: str) -> None:
    """Raise SettingError for a circle of a track with a ``lack`` of a proof: `lacking_proof`."""
    if lack:
        raise SettingError(
            f"the circle found, {circle.text(1)} px in frame {circle.frame}, may not be the ball: {lack}, and "
            "no map of a ball could be made around it: give its outline with `circle` as x, y, radius in px of the "
            "first frame to track"
        )


def given_circle_warning(image: Tensor, given: Circle) -> str:
    """A warning where the outline in ``image`` (h, w) is not the ``given`` circle, else an empty string."""
    text = f"The circle that was given, {given.text(1)} px,"
    try:
        seen = refine_circle(image, given)
    except ValueError:
        seen = None
    if seen is None or seen.sd_guessed:
        return f"{text} was not confirmed: no limb of a speckled ball was seen along it. {CHECK_ADVICE}"
    difference = max(math.hypot(seen.x - given.x, seen.y - given.y), abs(seen.radius - given.radius))
    if difference <= max(MAX_CIRCLE_SDS * max(seen.sd_x, seen.sd_y, seen.sd_radius), MAX_CIRCLE_ERROR * seen.radius):
        return ""
    return f"{text} is not the outline that the image shows at {seen.text(1)} px; `refine` takes that. {CHECK_ADVICE}"


def refined_circle_warning(fitted: Circle) -> str:
    """A warning where a given circle, ``fitted`` to the image, may not be the ball's outline, else an empty string."""
    if not fitted.doubt:
        return ""
    return (
        f"The circle that was given was fitted by `refine`, at {fitted.text(1)} px, and may not be the ball's outline: "
        f"{fitted.doubt}. Look at both in the image: where the circle as given is better, leave out `refine`."
    )
