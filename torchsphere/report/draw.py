"""Draw all that people look at from a result folder alone: figures, a small picture, the report."""

from __future__ import annotations

import shutil
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from torchsphere.report import image_figures, motion_figures, page, path_figure
from torchsphere.report.folder import ResultFolder, read

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

#: Compression of a PNG: up to twice as fast as zlib's usual 6, for a few percent more bytes.
PNG_LEVEL = 4

#: Matplotlib draws for one thread at a time.
_DRAWING = threading.Lock()


def draw(folder: Path) -> None:
    """Draw figures and report of the result in ``folder``, and replace earlier ones; no number is touched.

    Every file appears whole or not at all.

    Raises
    ------
    ValueError
        If ``folder`` is no result folder, or one that is damaged.
    """
    with _DRAWING:
        _draw(folder)


def _draw(folder: Path) -> None:
    result = read(folder)
    new = Path(tempfile.mkdtemp(prefix=".drawing.", dir=folder))
    try:
        (new / "figures").mkdir()
        _figures(result, new / "figures")
        (new / "report.html").write_text(page.page(result), encoding="utf-8")
        (folder / "figures").mkdir(exist_ok=True)
        for path in [*(new / "figures").iterdir(), new / "report.html"]:
            path.replace(folder / path.relative_to(new))
    finally:
        shutil.rmtree(new)


def _figures(result: ResultFolder, folder: Path) -> None:
    drawn = OF_NUMBERS | (OF_IMAGES if result.sampled is not None else {})
    for name, make in drawn.items():
        figure = make(result)
        figure.savefig(folder / f"{name}.png", pil_kwargs={"compress_level": PNG_LEVEL})
        # The layout is found: to find it again took a tenth of the time of drawing.
        figure.set_layout_engine("none")
        # Without its date, so that the same result gives the same file.
        figure.savefig(folder / f"{name}.pdf", metadata={"CreationDate": None})
    if result.sampled is not None:
        (folder / "thumbnail.webp").write_bytes(image_figures.thumbnail(result))
