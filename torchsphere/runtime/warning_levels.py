"""Levels of warnings: what makes numbers wrong, what limits them, and remarks on their origin."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from torchsphere.runtime.steps import LOG

#: SEVERE: numbers are wrong, or belong to something else than the ball. CAUTION: numbers hold as stated, and a reader
#: must know how. NOTE: where numbers come from, and what was given or left out.
SEVERE, CAUTION, NOTE = "severe", "caution", "note"
LEVELS = (SEVERE, CAUTION, NOTE)


class Warned(str):
    """A sentence of a warning with its ``level``; a plain string counts as `CAUTION`."""

    level: str

    def __new__(cls, sentence: str, level: str = CAUTION) -> Warned:
        """The sentence, with one of `LEVELS`."""
        made = super().__new__(cls, sentence)
        made.level = level
        return made


def severe(sentence: str) -> str:
    """A sentence on numbers that are wrong, or may not be those of the ball."""
    return Warned(sentence, SEVERE)


def note(sentence: str) -> str:
    """A remark on where numbers come from."""
    return Warned(sentence, NOTE)


def log(sentences: Iterable[str]) -> None:
    """Hand the sentences to the logger ``torchsphere``, at the level WARNING."""
    for sentence in sentences:
        LOG.warning("%s", sentence)


def level_of(sentence: str) -> str:
    """The level of a sentence."""
    return getattr(sentence, "level", CAUTION)


def levels_of(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Level and sentence of each warning in a ``summary.json``; those of earlier versions have no levels."""
    sentences, levels = summary.get("warnings") or [], summary.get("warning_levels") or []
    if len(levels) != len(sentences):
        levels = [CAUTION] * len(sentences)
    return list(zip(levels, sentences, strict=True))


def by_level(sentences: Iterable[str]) -> tuple[str, ...]:
    """The sentences, the severe ones first; those of one level keep their order."""
    return tuple(sorted(sentences, key=lambda sentence: LEVELS.index(level_of(sentence))))
