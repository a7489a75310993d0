"""Draw all that people look at from a result folder alone: figures, a small picture, the report."""

from __future__ import annotations

import shutil
import tempfile
import threading
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TYPE_CHECKING

from torchsphere.report import image_figures, motion_figures, page, path_figure
from torchsphere.results.reader import ResultFolder, read

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from torchsphere.report.assistant import Assistant

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

#: Matplotlib draws for one thread at a time.
_DRAWING = threading.Lock()


def draw(folder: Path, assistant: Assistant | None = None) -> None:
    """Draw figures and report of the result in ``folder``, and replace earlier ones; no number is touched.

    Every file appears whole or not at all. An ``assistant`` draws the figures beside what is drawn here; those of
    `OF_NUMBERS` it has been asked for.

    Raises
    ------
    ValueError
        If ``folder`` is no result folder, or one that is damaged.
    """
    with _DRAWING:
        _draw(folder, assistant)


def _draw(folder: Path, assistant: Assistant | None) -> None:
    result = read(folder)
    new = Path(tempfile.mkdtemp(prefix=".drawing.", dir=folder))
    try:
        figures = new / "figures"
        figures.mkdir()
        if assistant is not None:
            assistant.begin(folder, OF_IMAGES, figures)
        (new / "report.html").write_text(page.page(result), encoding="utf-8")
        if result.sampled is not None:
            (figures / "thumbnail.webp").write_bytes(image_figures.thumbnail(result))
        if assistant is None or not assistant.finish():
            draw_figures(result, OF_NUMBERS | OF_IMAGES, figures)
        (folder / "figures").mkdir(exist_ok=True)
        for path in [*figures.iterdir(), new / "report.html"]:
            path.replace(folder / path.relative_to(new))
    finally:
        shutil.rmtree(new)


def draw_figures(result: ResultFolder, names: Collection[str], folder: Path) -> None:
    """Draw figures of `OF_NUMBERS` and `OF_IMAGES`, by their ``names``, into ``folder`` as PNG and PDF.

    Those that need images are left out where none were kept.
    """
    from matplotlib import rc_context

    drawn = OF_NUMBERS | (OF_IMAGES if result.sampled is not None else {})
    for name in names:
        if name not in drawn:
            continue
        figure = drawn[name](result)
        figure.savefig(folder / f"{name}.png", pil_kwargs={"compress_level": LEVEL})
        # The layout is found: to find it again took a tenth of the time of drawing.
        figure.set_layout_engine("none")
        # Without its date, so that the same result gives the same file.
        with rc_context({"pdf.compression": LEVEL}):
            figure.savefig(folder / f"{name}.pdf", metadata={"CreationDate": None})
        if len(names) > 1:
            # Its parts know each other and outlive it; taken apart, they leave their memory, 10 to 20 MB, to the next.
            figure.clear()
