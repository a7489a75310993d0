"""Grey levels that are not proportional to the light, as the outline on a map of the ball shows them."""

from __future__ import annotations

from torchsphere.errors.evidence import Evidence
from torchsphere.motion.track import Track
from torchsphere.runtime.warning_levels import note
from torchsphere.sphere_map.decision import MadeMap


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """How a pixel at the outline shows the tone curve."""
    made = track.findings.map
    if not isinstance(made, MadeMap) or not made.edge_bend:
        return []
    half = 0.5 + made.edge_bend / 4
    return [
        note(
            "The grey levels are not proportional to the light (a tone curve or gamma, or parts that are too bright "
            f"for the camera): a pixel that the ball covers by half shows {100 * half:.0f} % of the way from the "
            "background to the ball. The radius is without what this moves the outline; sizes are surest with a "
            "linear recording."
        )
    ]
