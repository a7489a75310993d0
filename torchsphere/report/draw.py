"""Draw all that people look at from a result folder alone: figures, a small picture, the report."""

from __future__ import annotations

import contextlib
import io
import multiprocessing
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from torchsphere.report import image_figures, motion_figures, path_figure, report_page
from torchsphere.report.figure_style import new_figure
from torchsphere.results.reader import ResultFolder, read
from torchsphere.runtime import signals

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Figures by the names of their files; those of the second group need the images that were kept.
OF_NUMBERS: dict[str, Callable[[ResultFolder], Figure]] = {
    "motion": motion_figures.motion_figure,
    "rotation": motion_figures.rotation_figure,
    "quality": motion_figures.quality_figure,
}
OF_IMAGES: dict[str, Callable[[ResultFolder], Figure]] = {
    "path": path_figure.path_figure,
    "residuals": image_figures.residual_figure,
}

#: Compression of PNG and PDF: against zlib's usual 6 a tenth of the time to draw less, for a tenth more bytes.
LEVEL = 1

Result = TypeVar("Result")

#: Matplotlib draws for one thread at a time.
_DRAWING = threading.Lock()


@contextlib.contextmanager
def drawing_process(wanted: bool = True) -> Iterator[Executor | None]:
    """A process that draws figures while this one goes on, for `draw`; None where it is not ``wanted``."""
    if not wanted:
        yield None
        return
    # Spawned, not forked: torch's threads do not survive a fork.
    spawned = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(1, spawned, initializer=signals.serve_parent)
    try:
        begin(pool, load_matplotlib)
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def begin(pool: Executor | None, function: Callable[..., Result], *arguments: Any) -> Future[Result] | None:
    """Have the process of a `drawing_process` call a function; None where there is no such process, or it has died."""
    try:
        return None if pool is None else pool.submit(function, *arguments)
    except BrokenProcessPool:
        return None


def begin_figures(folder: Path, pool: Executor | None) -> Future[None] | None:
    """Begin to draw the figures of numbers of the result in ``folder``, which holds its tables by now."""
    (folder / "figures").mkdir()
    return begin(pool, draw_figures, folder, folder / "figures", tuple(OF_NUMBERS))


def draw(folder: Path, pool: Executor | None = None, begun: Future[None] | None = None) -> None:
    """Draw figures and report of the result in ``folder``, and replace earlier ones; no number is touched.

    Every file appears whole or not at all. A ``pool`` draws the figures beside the report; those of numbers may have
    ``begun`` before. Where it fails, they are drawn here.

    Raises
    ------
    ValueError
        If ``folder`` is no result folder, or one that is damaged.
    """
    with _DRAWING:
        _draw(folder, pool, begun)


def _draw(folder: Path, pool: Executor | None, begun: Future[None] | None) -> None:
    result = read(folder)
    new = Path(tempfile.mkdtemp(prefix=".drawing.", dir=folder))
    try:
        figures = new / "figures"
        figures.mkdir()
        beside = begin(pool, draw_figures, folder, figures, tuple(OF_IMAGES))
        (new / "report.html").write_text(report_page.report_html(result), encoding="utf-8")
        if result.sampled is not None:
            (figures / "thumbnail.webp").write_bytes(image_figures.thumbnail(result))
        calls = ((OF_NUMBERS, begun), (OF_IMAGES, beside))
        draw_figures(folder, figures, [name for names, call in calls if failed(call) for name in names])
        (folder / "figures").mkdir(exist_ok=True)
        for path in [*figures.iterdir(), new / "report.html"]:
            path.replace(folder / path.relative_to(new))
    finally:
        shutil.rmtree(new)


def failed(call: Future[Any] | None) -> bool:
    """Whether a call that was to be begun in another process came to nothing; waits for its end."""
    return call is None or call.exception() is not None


def draw_figures(result_folder: Path, folder: Path, names: Sequence[str]) -> None:
    """Draw figures of a result, by their ``names``, into ``folder`` as PNG and PDF.

    Those of images are left out where no images were kept.
    """
    from matplotlib import rc_context

    result = read(result_folder)
    drawn = OF_NUMBERS | (OF_IMAGES if result.sampled is not None else {})
    for name in drawn.keys() & set(names):
        figure = drawn[name](result)
        figure.savefig(folder / f"{name}.png", pil_kwargs={"compress_level": LEVEL})
        # The layout is found: to find it again took a tenth of the time of drawing.
        figure.set_layout_engine("none")
        # Without its date, so that the same result gives the same file.
        with rc_context({"pdf.compression": LEVEL}):
            figure.savefig(folder / f"{name}.pdf", metadata={"CreationDate": None})
        # Its parts know each other and outlive it; taken apart, they leave their memory, 10 to 20 MB, to the next.
        figure.clear()


def load_matplotlib() -> None:
    """Load what drawing loads when it is needed, fonts included, by drawing next to nothing."""
    figure = new_figure(figsize=(1.0, 1.0), layout=None)
    figure.add_subplot().set_xlabel("time")
    for kind in ("png", "pdf"):
        figure.savefig(io.BytesIO(), format=kind)
