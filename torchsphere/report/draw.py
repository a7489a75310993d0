"""Draws figures, thumbnail and report of a result from its folder alone."""

from __future__ import annotations

import contextlib
import io
import multiprocessing
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from torchsphere.report import force_figure, image_figures, motion_figures, pages
from torchsphere.report.figure_style import new_figure
from torchsphere.results.atomic_output import full_disk_named
from torchsphere.results.reader import ResultFolder, read
from torchsphere.runtime import imports

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Figures of the tables, and of the images that a result keeps, by the names of their files.
NUMBER_FIGURES: dict[str, Callable[[ResultFolder], Figure]] = {
    "motion": motion_figures.motion_figure,
    "rotation": motion_figures.rotation_figure,
    "quality": motion_figures.quality_figure,
    "force_path": force_figure.force_figure,
}
IMAGE_FIGURES: dict[str, Callable[[ResultFolder], Figure]] = {
    "path": image_figures.path_figure,
    "residuals": image_figures.residual_figure,
}

#: Compression level of PNG and PDF (docs/constants.toml).
COMPRESSION = 1

Result = TypeVar("Result")

#: Matplotlib draws for one thread at a time.
_DRAWING = threading.Lock()


@contextlib.contextmanager
def drawing_process(wanted: bool = True) -> Iterator[Executor | None]:
    """A process that draws figures while this process goes on, for `draw`; None unless ``wanted``."""
    if not wanted:
        yield None
        return
    # Spawned, not forked: torch's threads do not survive a fork.
    spawned = multiprocessing.get_context("spawn")
    modules = __name__, "matplotlib.backends.backend_agg", "matplotlib.backends.backend_pdf"
    pool = ProcessPoolExecutor(1, spawned, initializer=imports.become_worker_with, initargs=modules)
    try:
        begin(pool, load_matplotlib)
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def begin(pool: Executor | None, function: Callable[..., Result], *arguments: Any) -> Future[Result] | None:
    """Call a function in the process of `drawing_process`; None if there is no process, or if the process has died."""
    try:
        return None if pool is None else pool.submit(function, *arguments)
    except BrokenProcessPool:
        return None


def begin_figures(folder: Path, pool: Executor | None) -> Future[None] | None:
    """Begin to draw the figures of numbers of the result in ``folder``, whose tables are written."""
    (folder / "figures").mkdir()
    return begin(pool, draw_figures, folder, folder / "figures", tuple(NUMBER_FIGURES))


def draw(folder: Path, pool: Executor | None = None, begun: Future[None] | None = None) -> None:
    """Draw figures and report of the result in ``folder`` and replace earlier ones; tables stay as they are.

    Every file appears whole or not at all. The process of ``pool`` draws the figures of images while this process
    makes the report; ``begun`` is the call that draws the figures of numbers. This process draws the figures of a call
    that fails. Raises ValueError if ``folder`` is not a result folder, or is damaged.
    """
    with _DRAWING:
        result = read(folder)
        with tempfile.TemporaryDirectory(prefix=".drawing.", dir=folder) as name:
            new = Path(name)
            # The folder is removed on leaving: a full disk is named before.
            with full_disk_named(new, folder, "report"):
                _draw_into(new, folder, result, pool, begun)
            figures = new / "figures"
            (folder / "figures").mkdir(exist_ok=True)
            for path in [*figures.iterdir(), new / "report.html"]:
                path.replace(folder / path.relative_to(new))


def _draw_into(
    new: Path, folder: Path, result: ResultFolder, pool: Executor | None, begun: Future[None] | None
) -> None:
    """Draw figures and report of the result in ``folder`` into the folder ``new``."""
    figures = new / "figures"
    figures.mkdir()
    beside = begin(pool, draw_figures, folder, figures, tuple(IMAGE_FIGURES))
    (new / "report.html").write_text(pages.report_html(result), encoding="utf-8")
    if result.sampled is not None:
        (figures / "thumbnail.webp").write_bytes(image_figures.thumbnail(result))
    calls = ((NUMBER_FIGURES, begun), (IMAGE_FIGURES, beside))
    draw_figures(folder, figures, [name for names, call in calls if failed(call) for name in names])


def failed(call: Future[Any] | None) -> bool:
    """Whether a call of `begin` failed or was never made; waits for its end."""
    return call is None or call.exception() is not None


def draw_figures(result_folder: Path, folder: Path, names: Sequence[str]) -> None:
    """Draw figures of a result into ``folder`` as PNG and PDF.

    A result without images has no figures of images, and without a force path no figure of it.
    """
    from matplotlib import rc_context

    result = read(result_folder)
    available = NUMBER_FIGURES | (IMAGE_FIGURES if result.sampled is not None else {})
    if result.force_path is None:
        available.pop("force_path")
    for name in available.keys() & set(names):
        figure = available[name](result)
        figure.savefig(folder / f"{name}.png", pil_kwargs={"compress_level": COMPRESSION})
        # The layout is known; computing it again takes a tenth of the drawing time.
        figure.set_layout_engine("none")
        # The same result gives the same file, so that the date is left out.
        with rc_context({"pdf.compression": COMPRESSION}):
            figure.savefig(folder / f"{name}.pdf", metadata={"CreationDate": None})
        # The parts of a figure refer to each other: clear() frees their 10 to 20 MB at once.
        figure.clear()


def load_matplotlib() -> None:
    """Load matplotlib and its fonts by drawing an empty figure."""
    figure = new_figure(figsize=(1.0, 1.0), layout=None)
    figure.add_subplot().set_xlabel("time")
    for kind in ("png", "pdf"):
        figure.savefig(io.BytesIO(), format=kind)
