"""Output of the commands: sentences, progress bars, and what is being done."""

from __future__ import annotations

import contextlib
import logging
import sys
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NoReturn

from torchsphere.runtime.shown_text import shown

if TYPE_CHECKING:
    from tqdm import tqdm


#: Said when the first loop is compiled.
COMPILING = "compiling the loops over pixels, once for this machine and version (about a minute)"


def say(quiet: bool, sentence: str) -> None:
    """Print a sentence unless ``quiet``."""
    if not quiet:
        print(shown(sentence))


def print_lines(text: str) -> None:
    """Print a text of several lines, such as a table."""
    print("\n".join(map(shown, text.splitlines())))


class _Steps(logging.Handler):
    """Prints records of the package on the standard error: steps that take long, or all, each with its time."""

    def __init__(self, verbose: bool) -> None:
        super().__init__(logging.INFO)
        self._verbose, self._began = verbose, time.monotonic()

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        if self._verbose:
            self._print(f"{time.monotonic() - self._began:7.2f} s  {record.getMessage()}")
        elif getattr(record, "takes_long", False):
            self._print(f"torchsphere: {record.getMessage()} ...")

    def _print(self, line: str) -> None:
        from tqdm import tqdm

        # A progress bar goes on below the line.
        tqdm.write(shown(line), file=sys.stderr)


@contextlib.contextmanager
def told_steps(quiet: bool, verbose: bool) -> Iterator[None]:
    """Say on the standard error which steps take long: nothing if ``quiet``, every step if ``verbose``."""
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
        with _compilation_told():
            yield
    finally:
        log.removeHandler(handler)
        log.setLevel(level)
        log.propagate = propagates


@contextlib.contextmanager
def _compilation_told() -> Iterator[None]:
    from torchsphere.runtime.compilation import on_compilation

    def tell() -> None:
        logging.getLogger("torchsphere").info(COMPILING, extra={"takes_long": True})

    with on_compilation(tell):
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
