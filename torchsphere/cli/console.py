"""Output of the commands: sentences, progress bars, and what is being done."""

from __future__ import annotations

import contextlib
import logging
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NoReturn

from torchsphere.runtime import steps
from torchsphere.runtime.imports import without_collections
from torchsphere.runtime.setting_names import as_options
from torchsphere.runtime.shown_text import shown

if TYPE_CHECKING:
    from tqdm import tqdm


def say(quiet: bool, sentence: str) -> None:
    """Print a sentence unless ``quiet``."""
    if not quiet:
        print(shown(sentence))


def print_lines(text: str) -> None:
    """Print a text of several lines, such as a table."""
    print("\n".join(map(shown, text.splitlines())))


class _Steps(logging.Handler):
    """Prints records of the package on the standard error: warnings and steps that take long, or all with their times.

    Steps that take long are those of `torchsphere.runtime.steps`.
    """

    def __init__(self, verbose: bool) -> None:
        super().__init__(logging.INFO)
        self._verbose, self._began = verbose, time.monotonic()

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        if self._verbose:
            self._print(f"{time.monotonic() - self._began:7.2f} s  {record.getMessage()}")
        elif getattr(record, "takes_long", False):
            self._print(f"torchsphere: {record.getMessage()} ...")
        elif record.levelno >= logging.WARNING:
            self._print(f"torchsphere: {record.getMessage()}")

    def _print(self, line: str) -> None:
        from tqdm import tqdm

        # A progress bar goes on below the line.
        tqdm.write(shown(as_options(line)), file=sys.stderr)


@contextlib.contextmanager
def told_steps(quiet: bool, verbose: bool) -> Iterator[None]:
    """Say on the standard error which steps take long: no step if ``quiet``, every step if ``verbose``."""
    log = logging.getLogger("torchsphere")
    if quiet and not verbose:
        yield
        return
    handler, level, propagates = _Steps(verbose), log.level, log.propagate
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    # Without this, a handler of the root logger would print the lines once more.
    log.propagate = False
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(level)
        log.propagate = propagates


@contextlib.contextmanager
def loading_libraries() -> Iterator[None]:
    """Say that libraries are imported within the block, which takes seconds the first time, and import them fast."""
    if "torch" not in sys.modules:
        steps.tell("loading the libraries")
    with without_collections():
        yield


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
            # The rate counts from 0, not from where the first pass began.
            bar.initial = 0
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
