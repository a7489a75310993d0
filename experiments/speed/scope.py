"""How much of the experiment is run."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from experiments.speed.clock import SECONDS


@dataclass(frozen=True)
class Scope:
    """Limits of a run."""

    quick: bool = False
    most_frames: int | None = None

    @property
    def seconds(self) -> float:
        """Time for one comparison, s."""
        return 1.0 if self.quick else SECONDS

    def allows(self, frames: int) -> bool:
        """Whether recordings of so many frames are measured."""
        return self.most_frames is None or frames <= self.most_frames

    def say(self, text: str) -> None:
        """Show the progress."""
        print(text, file=sys.stderr, flush=True)
