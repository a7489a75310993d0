"""Figures of a result over its images: the path of the ball, and what the measured motion leaves unexplained."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.report.figures import COLOURS, DPI, new_figure
from torchsphere.report.folder import ResultFolder
from torchsphere.report.kept import Sampled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Circles along the path at even times, as many as in the paper's figure 8.
CIRCLES = 12

#: Robust standard deviations of a residual map at which its colours end.
COLOURS_END = 5.0

#: Longest side of a thumbnail, px.
THUMBNAIL_PX = 160


def path_figure(result: ResultFolder) -> Figure:
    """Path over an image with circles at even times: the paper's figures 8 and 15; needs `ResultFolder.sampled`."""
    sampled = _sampled(result)
    known = np.flatnonzero(result.known)
    middle = int(known[len(known) // 2]) if len(known) else 0
    i = int(np.abs(sampled.row - middle).argmin())
    left, top, width, height = sampled.box
    inches = min(7.0, 6.0 * width / height), min(7.0 * height / width, 6.0)
    figure = new_figure(figsize=(max(inches[0], 4.0) + 0.5, inches[1] + 1.1), dpi=DPI)
    axis = figure.subplots()
    axis.imshow(picture(sampled, i), cmap="gray", vmin=0, vmax=255, extent=(left, left + width, top + height, top))
    if len(known):
        _path(axis, result, known)
    axis.set(xlim=(left, left + width), ylim=(top + height, top), xlabel="x (px)", ylabel="y (px)")
    axis.set_title(f"Path of the ball over frame {result.frame[sampled.row[i]]}{_spacing(result, known)}", fontsize=9)
    return figure


def _path(axis: Axes, result: ResultFolder, known: NDArray[np.int64]) -> None:
    where = result.position
    axis.plot(where[:, 0], where[:, 1], "-", color="white", lw=2.2, alpha=0.6)
    axis.plot(where[:, 0], where[:, 1], "--", color=COLOURS[0], lw=1.2)
    angle = np.linspace(0, 2 * np.pi, 181)
    for row in _even(known):
        (x, y), r = where[row], result.radius[row]
        axis.plot(x + r * np.cos(angle), y + r * np.sin(angle), color=COLOURS[1], lw=1.0)
        axis.plot(x, y, "+", color=COLOURS[1], ms=6)


def _even(known: NDArray[np.int64]) -> NDArray[np.int64]:
    """Known rows at even times, about `CIRCLES` of them."""
    stride = max(int(known[-1] - known[0]) // (CIRCLES - 1), 1)
    return np.intersect1d(np.arange(known[0], known[-1] + 1, stride), known)


def _spacing(result: ResultFolder, known: NDArray[np.int64]) -> str:
    if len(known) < 2:
        return "; the place of the ball was not measured" if len(known) == 0 else ""
    stride = max(int(known[-1] - known[0]) // (CIRCLES - 1), 1)
    rate = result.summary.get("frame_rate")
    every = f"{stride} frame{'s' if stride > 1 else ''}" if rate is None else f"{1e3 * stride / rate:.3g} ms"
    return f", a circle every {every}"


def residual_figure(result: ResultFolder) -> Figure:
    """Image minus the image before it carried along: at the start, where it matches worst, and at the end."""
    sampled = _sampled(result)
    there = np.flatnonzero(sampled.has_residual)
    figure = new_figure(figsize=(7.0, 3.0), dpi=DPI, layout=None)
    if len(there) == 0:
        figure.text(0.5, 0.5, "No residual map: the motion was measured in no frame.", ha="center", fontsize=10)
        return figure
    limit = residual_limit(sampled)
    worst = there[np.nan_to_num(result.zncc[sampled.row[there]], nan=np.inf).argmin()]
    axes = figure.subplots(1, 3, sharey=True)
    figure.subplots_adjust(0.08, 0.12, 0.88, 0.9, wspace=0.08)
    shown: Any = None
    for axis, i, name in zip(axes, (there[0], worst, there[-1]), ("start", "worst match", "end"), strict=True):
        half = 0.5 * sampled.residual.shape[-1] * sampled.residual_bin
        extent = (-half, half, half, -half)
        shown = axis.imshow(sampled.residual_levels(i), cmap="RdBu_r", vmin=-limit, vmax=limit, extent=extent)
        row = sampled.row[i]
        axis.set_title(f"{name}: frame {result.frame[row]}\nZNCC {result.zncc[row]:.4f}", fontsize=8)
        axis.set_xlabel("x from the centre (px)", fontsize=8)
        axis.tick_params(labelsize=8)
    axes[0].set_ylabel("y from the centre (px)", fontsize=8)
    bar = figure.colorbar(shown, cax=figure.add_axes((0.905, 0.2, 0.018, 0.62)))
    bar.set_label("residual (grey levels)", fontsize=8)
    bar.ax.tick_params(labelsize=8)
    return figure


def residual_limit(sampled: Sampled) -> float:
    """Grey levels at which the colours of residual maps end: five robust standard deviations of all, at most the range
    that maps have.
    """
    there = np.flatnonzero(sampled.has_residual)
    if len(there) == 0:
        return 127 * sampled.residual_step
    few = there[np.unique(np.linspace(0, len(there) - 1, 20).round().astype(int))]
    sizes = np.abs(np.concatenate([sampled.residual_levels(i).ravel() for i in few]))
    # 1.4826 median absolute values are the standard deviation of Gaussian noise.
    robust = 1.4826 * float(np.nanmedian(sizes))
    return float(np.clip(COLOURS_END * robust, 4 * sampled.residual_step, 127 * sampled.residual_step))


def thumbnail(result: ResultFolder) -> bytes:
    """A small WebP of the first frame in which the ball is known, with its circle; of the first frame otherwise."""
    from PIL import Image, ImageDraw

    sampled = _sampled(result)
    known = result.known[sampled.row]
    i = int(known.argmax())
    image = Image.open(io.BytesIO(sampled.webp[i])).convert("RGB")
    image.thumbnail((THUMBNAIL_PX, THUMBNAIL_PX))
    if known.any():
        scale = image.width / sampled.box[2]
        (x, y), r = result.position[sampled.row[i]], result.radius[sampled.row[i]]
        corners = [scale * v for v in (x - r - sampled.box[0], y - r - sampled.box[1])]
        ImageDraw.Draw(image).ellipse((*corners, *(v + 2 * r * scale for v in corners)), outline=COLOURS[1], width=2)
    stream = io.BytesIO()
    image.save(stream, "WEBP", quality=60)
    return stream.getvalue()


def picture(sampled: Sampled, i: int) -> NDArray[np.uint8]:
    """Image ``i`` (h, w) as it was kept."""
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(sampled.webp[i])).convert("L"))


def _sampled(result: ResultFolder) -> Sampled:
    if result.sampled is None:
        raise ValueError(f"{result.path}: no images were kept with this result; track again without --no-report")
    return result.sampled
