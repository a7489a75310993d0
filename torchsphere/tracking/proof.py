"""Whether anything shows that a circle which was found is the outline of a ball."""

from __future__ import annotations

from torchsphere.geometry.circle import Circle
from torchsphere.motion.track import Track
from torchsphere.settings.limits import SettingError

#: Standard deviation of a doubtful circle's radius, as a share of it, from which it needs a proof
#: (docs/constants.toml).
MAX_UNPROVEN_SD = 0.1

#: Relative scatter of the outlines' radii in several frames from which they are not those of a ball, where no map could
#: be made (docs/constants.toml).
MAX_OUTLINE_SCATTER = 0.03


def needs_proof(circle: Circle) -> bool:
    """Whether its image leaves a circle that was found in doubt, so that other images must prove it."""
    is_measured = not circle.sd_guessed and circle.sd_radius < MAX_UNPROVEN_SD * circle.radius
    return bool(circle.doubt) and not is_measured


def lacking_proof(found: Track) -> str:
    """Why nothing shows that the circle of a track is the outline of a ball, in words; empty where something does.

    A map of the ball proves it, or the outlines of a ball that stays in its place. A circle that was found is in doubt
    by its own image, or where the outlines in other frames contradict each other.
    """
    circle, known, was_found = found.circle, found.findings, not found.settings["circle_given"]
    if known.is_on_map or (known.place is not None and known.place.limbs_stay):
        return ""
    scatter = known.outline_scatter
    if scatter > MAX_OUTLINE_SCATTER and was_found:
        return f"outlines in other frames have radii that differ by {100 * scatter:.0f} %"
    if known.untried_frames and was_found:
        return f"{circle.doubt}, the frames right after it hardly show the same"
    return circle.doubt if needs_proof(circle) else ""


def require_ball(circle: Circle) -> None:
    """Raise ValueError for a circle that was found where nothing shows that it is a ball's outline."""
    if circle.unproven:
        raise SettingError(
            f"the circle found, {circle.text(1)} px in frame {circle.frame}, may not be the ball: {circle.unproven}; "
            "if it is, give its outline with `circle` as x, y, radius in px of the first frame to track"
        )


def require_proof(found: Track) -> None:
    """Raise ValueError for a circle of a track that lacks a proof: `lacking_proof`."""
    circle, reason = found.circle, lacking_proof(found)
    if reason:
        raise SettingError(
            f"the circle found, {circle.text(1)} px in frame {circle.frame}, may not be the ball: {reason}, and "
            "no map of a ball could be made around it: give its outline with `circle` as x, y, radius in px of the "
            "first frame to track"
        )
