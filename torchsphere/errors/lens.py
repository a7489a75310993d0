"""A lens that distorts, or pixels that are not square, as the map of the ball shows them though nobody gave them."""

from __future__ import annotations

from torchsphere.errors.evidence import Evidence
from torchsphere.motion.track import Track
from torchsphere.runtime.warning_levels import note
from torchsphere.sphere_map.decision import MadeMap


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """What was found of the lens, and what it does to the results."""
    made = track.findings.map
    if not isinstance(made, MadeMap) or not made.has_lens:
        return []
    found = []
    if made.lens_distortion:
        percent, sd = 100 * made.lens_distortion, 100 * made.sd_lens_distortion
        found.append(f"the lens moves the image's corner by {percent:+.2f} +- {sd:.2f} % of its way from the middle")
    if made.pixel_ratio != 1:
        found.append(f"the pixels are {made.pixel_ratio:.4f} +- {made.sd_pixel_ratio:.4f} times as wide as high")
    return [
        note(
            f"As the images show the ball, {' and '.join(found)}: places in px are as seen, lengths and velocities "
            "are without it. A calibration of the camera (`focal_px`, `distortion`), or `pixel_aspect`, says it better."
        )
    ]
