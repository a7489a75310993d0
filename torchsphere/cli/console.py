"""Output of the commands: sentences, and progress bars."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NoReturn

from torchsphere.runtime.shown_text import shown

if TYPE_CHECKING:
    from tqdm import tqdm


def say(quiet: bool, sentence: str) -> None:
    """Print a sentence unless ``quiet``."""
    if not quiet:
        print(shown(sentence))


@contextlib.contextmanager
def progress_bar(
    quiet: bool, description: str, unit: str = "frame", second_pass: str = "", delay_s: float = 0.0
) -> Iterator[Callable[..., None] | None]:
    """A callback ``(done, total, postfix)`` that shows a bar on stderr, or None if ``quiet``.

    The bar appears with the first progress, so that a refusal stands alone, and starts again as ``second_pass``.
    """
    bar: tqdm[NoReturn] | None = None

    def show(done: int, total: int, postfix: str = "") -> None:
        nonlocal bar
        if bar is None:
            from tqdm import tqdm

            # Finished recordings of an archive are not part of the rate.
            bar = tqdm(
                desc=description, total=total, initial=done, unit=unit, delay=delay_s, leave=False, file=sys.stderr
            )
        if done < bar.n and second_pass:
            bar.reset(total)
            bar.set_description(second_pass)
        bar.total = total
        bar.set_postfix_str(postfix, refresh=False)
        bar.update(done - bar.n)

    try:
        yield None if quiet else show
    finally:
        if bar is not None:
            bar.close()
