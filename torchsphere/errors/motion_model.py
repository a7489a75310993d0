"""Motion models that measure no rotation, or measure it with a bias."""

from __future__ import annotations

from torchsphere.errors.evidence import Evidence
from torchsphere.motion.track import Track
from torchsphere.runtime.warning_levels import severe


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """What the model does not measure, or measures with a bias."""
    model = track.settings["model"]
    if model == "published":
        return [severe("The published modes are no rigid rotation: they bias translation and rotation; see Methods.")]
    if model == "translation":
        return [
            "The translation model takes any rotation of the ball for translation and measures none: rotation and spin "
            "are left empty, and frames are weak_texture at best. Give `model` = rigid to have them."
        ]
    return []
