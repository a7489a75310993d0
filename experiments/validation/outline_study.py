"""The use of the ball's outline: ``python -m experiments.validation.outline_study``.

Claim: the outline holds most of the information that separates a translation from a rotation, and only a model of the
whole image uses it. A region of interest across the outline reduces the scatter by a tenth, but has a bias of 0.003 px,
and of 0.05 px over a textured background. An edge fit beside the correlation gains nothing, since its errors are larger
than its residuals. The map of the ball, whose forward model contains the outline, halves the scatter without a bias
above 0.0001 px over any background.

The shot is that of `accuracy` with 60 frames, over a uniform background of 90 grey levels and over still blotches (blur
3 px, standard deviation 20 grey levels), three patterns each, with the true circle. Ways:

pairs
    `track(..., sphere_map=False)`: region 0.95 R.
region 1.08 R
    The same correlation over a region across the outline; also with a constant instead of the still background, which
    is estimated from the recording, weighted by the share of each pixel that the ball covers.
fused edge
    The pairs' increments and the centres of circles of the given radius, fitted to the edges, combined by their
    covariances; also without the still background.
map
    `track` by default: all poses on a map of the ball, the outline in the forward model.

Reference numbers: bound 0.0017 px for a pair (Cramer-Rao, whole image, known texture); target 0.0026 px with a bias
under 0.001 px; a region of 1.08 R in a hand-written solver, 0.0042 and 0.0036 px.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor

import torchsphere as ts
from experiments.experiment import BLUE, DOCS, VERMILION, cached, publish, saved_figure, table
from experiments.validation.accuracy import (
    BASE,
    HEADER,
    PATTERNS,
    ROTATION,
    SUBSAMPLES,
    TRANSLATION,
    Array,
    Errors,
    Shot,
    cells,
    errors_of,
    make_shot,
    root_mean_square,
)
from torchsphere.correlation.correlate import correlate_pairs
from torchsphere.correlation.options import Options
from torchsphere.detection import outline_fit
from torchsphere.detection.outline_fit import OutlineFit
from torchsphere.imaging import background as still
from torchsphere.imaging.interpolation import blur
from torchsphere.recording.frame_source import Source
from torchsphere.sphere_map import forward_model, rays
from torchsphere.sphere_map.decision import NoMap

FRAMES, BEYOND = 60, 1.08
BOUND_PX, TARGET_PX = 0.0017, 0.0026

#: Ways in the table on the pages, with their names there.
PUBLISHED = {
    "pairs": "pairs (`--map off`), region 0.95 R",
    "region 1.08 R": "region extended to 1.08 R",
    "region 1.08 R, background out": "the same, background taken out",
    "fused edge": "pairs fused with an edge fit",
    "map": "map (default)",
}

#: Increments (n - 1, 5) and their covariances (n - 1, 5, 5), px and rad.
Steps = tuple[Array, Array]


def blotches(shape: tuple[int, int]) -> Tensor:
    """A still background (h, w): 3 px, 20 grey levels."""
    field = blur(torch.randn(1, *shape, generator=torch.Generator().manual_seed(7)), 3.0)[0]
    return (120 + 20 * field / field.std()).clamp(0, 255)


BACKGROUNDS: dict[str, Callable[[tuple[int, int]], Tensor] | None] = {"uniform": None, "blotches": blotches}


def without_background(shot: Shot, position: Array) -> Tensor:
    """The images with a constant instead of the still background around the ball at ``position`` (n, 2)."""
    behind = still.background(Source.open(shot.images, None, torch.float32), position, shot.radius)
    level = float(behind.median())
    centres, images = torch.from_numpy(position), shot.images.clone()
    for image, centre in zip(images, centres, strict=True):
        y, x = torch.meshgrid(*(torch.arange(n) for n in image.shape), indexing="ij")
        size = torch.tensor([shot.radius, forward_model.MIN_BLUR_PX], dtype=torch.float64)
        share, _, _ = rays.coverage(x - centre[0], y - centre[1], *size)
        image -= ((1 - share) * (behind - level)).float()
    return images


class Unchecked(Options):
    """Options that accept a region beyond the outline, which the package refuses."""

    def __post_init__(self) -> None:
        """Check nothing; copies of the options would be checked again."""


def beyond_the_outline(images: Tensor, track: ts.Track) -> Steps:
    """Pairs over a region that crosses the outline."""
    options = Unchecked(roi=BEYOND, robust=False)
    radii = np.full(len(track.position) - 1, track.circle.radius)
    circles = torch.from_numpy(np.column_stack((track.position[:-1], radii)))
    start = torch.from_numpy(track.increment).float()
    found = correlate_pairs(images[:-1], images[1:], circles, start, None, options)
    return found.q.double().numpy(), found.covariance.numpy()


def fused_with_edge(images: Tensor, track: ts.Track) -> Steps:
    """The pairs' increments, updated by the steps of circles that are fitted to the edges, as in a Kalman filter.

    Region and edge share no pixels, so their errors count as independent.
    """
    radius = torch.full((len(images), 1), track.circle.radius, dtype=torch.float64)
    circles = torch.cat((torch.from_numpy(track.position), radius), 1)
    fit = outline_fit.refine(images, circles, window=outline_fit.STEP_BLUR_PX, fixed_radius=True)
    names = ("circle", "covariance", "support", "contrast", "residual", "weights")
    increment, covariance = track.increment.copy(), track.covariance.copy()
    for i in range(len(increment)):
        step, spread = outline_fit.centre_step(OutlineFit(*(getattr(fit, name)[i : i + 2] for name in names)))
        gain = covariance[i, :, :2] @ np.linalg.inv(covariance[i, :2, :2] + spread.numpy())
        increment[i] += gain @ (step.numpy() - increment[i, :2])
        covariance[i] -= gain @ covariance[i, :2]
    return increment, covariance


def by_correlation(shot: Shot) -> dict[str, Steps]:
    """Steps by all ways except the map."""
    track = ts.track(shot.images, shot.circle, sphere_map=False)
    bare = without_background(shot, track.position)
    return {
        "pairs": (track.increment, track.covariance),
        "region 1.08 R": beyond_the_outline(shot.images, track),
        "region 1.08 R, background out": beyond_the_outline(bare, track),
        "fused edge": fused_with_edge(shot.images, track),
        "fused edge, background out": fused_with_edge(bare, track),
    }


def by_map(shot: Shot) -> dict[str, Steps]:
    """Steps by the map."""
    track = ts.track(shot.images, shot.circle)
    if isinstance(track.findings.map, NoMap):
        raise RuntimeError(f"no map was made: {track.findings.map.reason}")
    return {"map": (track.increment, track.covariance)}


def measure(way: Callable[[Shot], dict[str, Steps]], background: str, seed: int) -> dict[str, Any]:
    """Errors and stated variances of one pattern by the names of the ways."""
    shot = make_shot(replace(BASE, frames=FRAMES), seed, BACKGROUNDS[background])
    found = {name: errors_of(*steps, shot.increment) for name, steps in way(shot).items()}
    return {name: [part.tolist() for part in parts] for name, parts in found.items()}


def compute() -> dict[tuple[str, str], Errors]:
    """Errors by background and way."""
    results = {}
    for background in BACKGROUNDS:
        for way in (by_correlation, by_map):
            settings = asdict(replace(BASE, frames=FRAMES)) | {"way": way.__name__, "background": background}
            settings |= {"subsamples": SUBSAMPLES, "beyond": BEYOND}
            raw = [
                cached("outline", settings | {"pattern": seed}, partial(measure, way, background, seed))
                for seed in PATTERNS
            ]
            for name in raw[0]:
                error, variance = (np.array([pattern[name][part] for pattern in raw]) for part in (0, 1))
                results[background, name] = Errors(error, variance)
    return results


def plot(results: dict[tuple[str, str], Errors]) -> None:
    """Translation and rotation (filled: standard deviation, open: bias), and actual over stated error."""
    with saved_figure(DOCS / "outline.png", (13, 4.6), dpi=110) as figure:
        axes = figure.subplots(1, 3, sharey=True)
        names = list(dict.fromkeys(name for _, name in results))
        place = np.arange(len(names))
        for j, (background, color) in enumerate(zip(BACKGROUNDS, (BLUE, VERMILION), strict=True)):
            at, rows = place + 0.24 * (j - 0.5), [results[background, name] for name in names]
            for axis, k in zip(axes, (TRANSLATION, ROTATION), strict=False):
                std = [root_mean_square(r.std()[k]) for r in rows]
                bias = [root_mean_square(r.bias()[0][k]) for r in rows]
                axis.plot(std, at, "o", color=color, label=f"{background}: std")
                axis.plot(bias, at, "D", color=color, mfc="white", ms=5, label=f"{background}: |bias|")
            for k, marker, name in ((TRANSLATION, "o", "dx, dy"), (ROTATION, "^", "wx, wy, wz")):
                axes[2].plot([r.error_ratio(k) for r in rows], at, marker, color=color, label=f"{background}: {name}")
        axes[0].axvline(BOUND_PX, ls=":", color="black", lw=1, label="bound, known texture")
        axes[0].axvline(TARGET_PX, ls="--", color="black", lw=1, label="target of the std")
        axes[2].axvspan(0.85, 1.15, color="0.9", zorder=0)
        axes[0].set_yticks(place, names)
        axes[0].invert_yaxis()
        for axis, label in zip(axes, ("dx, dy (px)", "wx, wy, wz (deg)", "actual / stated error"), strict=True):
            axis.set_xscale("log")
            axis.set_xlabel(label)
        axes[2].set_xticks((0.7, 1, 1.5, 2, 3, 4, 5), ("0.7", "1", "1.5", "2", "3", "4", "5"))
        axes[2].minorticks_off()
        axes[0].legend(loc=(0.02, 0.5))
        axes[2].legend()
        figure.suptitle("Error of the step from frame to frame, rms of the components; 3 patterns of 60 frames each")


def brief(found: Errors) -> list[str]:
    """Standard deviation and bias of x and y, and actual over stated error."""
    (bias, _), std, ratio = found.bias(), found.std(), [found.error_ratio(slice(k, k + 1)) for k in (0, 1)]
    return ["{:.4f}, {:.4f}".format(*std), "{:+.4f}, {:+.4f}".format(*bias), "{:.2f}, {:.2f}".format(*ratio)]


def main() -> None:
    """Measure, draw, and print the table."""
    results = compute()
    plot(results)
    print(table(("background", "way", *HEADER), [(*key, *cells(found)) for key, found in results.items()]))
    head = ["way"]
    for background in BACKGROUNDS:
        head += [f"std x, y (px), {background}", "bias x, y (px)", "actual/stated"]
    lines = [
        [name, *(cell for background in BACKGROUNDS for cell in brief(results[background, way]))]
        for way, name in PUBLISHED.items()
    ]
    publish("outline", "validation.outline_study", table(head, lines))


if __name__ == "__main__":
    main()
