"""Whether anything shows that a circle which was found is the outline of a ball."""

from __future__ import annotations

from torchsphere.geometry.circle import Circle
from torchsphere.settings.limits import SettingError
from torchsphere.tracking.result import Track

#: Standard deviation of a doubtful circle's radius, as a share of it, from which it needs a proof (docs/constants.md).
MAX_UNPROVEN_SD = 0.1

#: Relative scatter of the outlines' radii in several frames from which they are not those of a ball, where no map could
#: be made (docs/constants.md).
MAX_OUTLINE_SCATTER = 0.03


def needs_proof(circle: Circle) -> bool:
    """Whether its image leaves a circle that was found in doubt, so that other images must prove it."""
    is_measured = not circle.sd_guessed and circle.sd_radius < MAX_UNPROVEN_SD * circle.radius
    return bool(circle.doubt) and not is_measured


def require_proof(found: Track) -> None:
    """Raise ValueError for a circle of a track that its image leaves in doubt, and that no other image proves.

    A map of the ball proves it, or the outlines of a ball that stays in its place. Outlines of other frames that
    contradict each other leave it in doubt, too.
    """
    circle, place = found.circle, found.settings["place"]
    is_proven = found.settings["sphere_map"]["used"] or (place is not None and place["limbs_stay"])
    scatter = found.settings["sphere_map"].get("outline_scatter", 0.0)
    if scatter > MAX_OUTLINE_SCATTER and not (is_proven or found.settings["circle_given"]):
        raise SettingError(
            f"the circle found, {circle.text(1)} px in frame {circle.frame}, may not be the ball: outlines in other "
            f"frames have radii that differ by {100 * scatter:.0f} %, and no map of a ball could be made around it: "
            "give its outline with `circle` as x, y, radius in px of the first frame to track"
        )
    if needs_proof(circle) and not is_proven:
        raise SettingError(
            f"the circle found, {circle.text(1)} px in frame {circle.frame}, may not be the ball: {circle.doubt}, and "
            "no map of a ball could be made around it: give its outline with `circle` as x, y, radius in px of the "
            "first frame to track"
        )
