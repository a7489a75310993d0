"""A raw colour mosaic that nobody stated: `imaging.colour_mosaic` recognises it, and its green pixels are measured."""

from __future__ import annotations

from collections.abc import Sequence

from torchsphere.errors.evidence import Evidence
from torchsphere.motion.track import Track
from torchsphere.recording.facts import Facts
from torchsphere.runtime.warning_levels import severe
from torchsphere.settings.choices import BAYER


def about(patterns: Sequence[str], facts: Facts | None) -> str:
    """A sentence on images with such ``patterns``, of a recording that states other ``facts``."""
    if facts is not None and facts.orientation != 1:
        # The images are turned, and a pattern is that of the stored ones.
        patterns = BAYER
    named = f"{', '.join(patterns[:-1])} or {patterns[-1]}"
    if facts is not None and facts.bayer is not None:
        return severe(
            f"The images still show a mosaic of 2 x 2 pixels after {facts.bayer}, whose green pixels are on the wrong "
            f"diagonal: give `bayer` = {named}. The numbers are not to be trusted."
        )
    return (
        "The images are the raw mosaic of a colour sensor, not grey: pixels differ in blocks of 2 x 2. They are "
        f"measured on the pixels that look green; give `bayer` = {named} to say so, or export them in grey."
    )


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """That the images are a mosaic."""
    patterns = track.findings.mosaic
    return [about(patterns, track.facts)] if patterns else []
