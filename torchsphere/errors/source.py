"""A source of error: how it is detected, what it adds to the uncertainty, and what a reader must know."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from torchsphere.errors.evidence import Evidence
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track


def known_before(track: Track, evidence: Evidence) -> Findings:
    """What was found out while the ball was followed."""
    return track.findings


def no_wider(track: Track, evidence: Evidence) -> Track:
    """The track of a source that adds nothing to the uncertainty."""
    return track


def unsaid(track: Track, evidence: Evidence) -> Sequence[str]:
    """The sentences on a source of which a reader needs to know nothing."""
    return ()


@dataclass(frozen=True)
class ErrorSource:
    """One source of error of a track.

    Attributes
    ----------
    name : str
        In the ledger.
    detect : callable
        The findings of the track, with what this source is known by.
    widen : callable
        The track with the uncertainty that this source adds.
    without : callable
        For a source that the measured steps hold already: the track without it.
    sentences : callable
        What a reader of the numbers must know.
    """

    name: str
    detect: Callable[[Track, Evidence], Findings] = known_before
    widen: Callable[[Track, Evidence], Track] = no_wider
    without: Callable[[Track, Evidence], Track] = no_wider
    sentences: Callable[[Track, Evidence], Sequence[str]] = unsaid
