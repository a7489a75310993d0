"""A raw colour mosaic that nobody stated: it is recognised, measured on its green pixels, and said.

Taken for grey, rows of such images seem to be the fields of interlaced video.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from torchsphere.errors.evidence import Evidence
from torchsphere.imaging import colour_mosaic
from torchsphere.motion.track import Track
from torchsphere.recording import mosaic
from torchsphere.recording.facts import Facts
from torchsphere.recording.frame_source import Source
from torchsphere.runtime.warning_levels import severe
from torchsphere.settings.choices import BAYER


def without_mosaic(source: Source) -> tuple[Source, tuple[str, ...]]:
    """The green levels of images that are a mosaic, and the patterns that it may have; other images as they are."""
    patterns = colour_mosaic.recognised(source.images(0, min(2, source.count)))
    if not patterns:
        return source, ()

    def green(images: Tensor) -> Tensor:
        return torch.from_numpy(mosaic.green(images.cpu().numpy(), patterns[0])).to(images)

    return source.changed(green), patterns


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
