"""Accuracy by radius, noise, speckle, rotation and blur: ``python -m experiments.validation.accuracy``.

Claim: up to 0.6 deg per frame the noise in the images makes the error of a step, and the stated uncertainty is true to
20 % (single components at R = 10 px to a third). The bias is 0.0002 px, independent of the noise; 0.0005 to 0.002 px
with finer and coarser speckle; 0.005 px at R = 10 px. From 2 deg per frame on the changing view of the texture adds
errors: the stated uncertainty is true to 25 % at 5 deg; at 10 deg it is a third too wide, but for wz a quarter too
narrow; at 20 deg up to a half too wide, and for wz 1.6 times too narrow. All this is by pairs (``sphere_map=False``).
The default, on a map of the ball, is twice as precise; its bias is 0.0003 px at most without motion blur and 0.0006 px
at 2 px and more, and 20 deg per frame are as good as 0.57. The stated uncertainty is true to a quarter, mostly to a
tenth (wz with speckle of 8 px: 0.8 of the error; dx and wy at 5 px of motion blur: 1.4 times it).

Base case: R = 50 px, noise 2 grey levels, 8 bit, speckle 4 px from 30 to 220 grey levels over a uniform background of
90, steps of (1.4, 0.2) +- 0.3 px, rotation 0.57 deg per frame; one property is varied at a time; three patterns of 30
frames each, with the true circle. Motion blur needs a fast ball: that series moves by (8, 1.1) px per frame. Pixels are
means of 64 rays, since nine rays leave 3 grey levels of error at the outline; with blur, means of 8 moments with 16
rays.

Reference numbers for a pair of the base case over the region 0.95 R: Cramer-Rao bound 0.0041 px; a hand-written solver
0.0049 and 0.0042 px, 0.007 to 0.008 deg. Bound from the whole image with a known texture: 0.0017 px.

The bias is the mean error. If the error of a step is the difference of two errors of position, the mean over n steps
contains only the first and the last position: its uncertainty is then ``std / n`` for a pattern (0.0001 px for three
patterns of the base case), not ``std / sqrt(n)``. The table states the scatter of the patterns' means over the root of
three, which makes no assumption, but is itself known to half of its size only. Actual/stated is the rms error, bias
included, in units of the stated standard deviation.

Results are kept in ``experiments/cache``; delete them after a change to the package that leaves its version as it is.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

import torchsphere as ts
from experiments.experiment import BLUE, DOCS, PX_DEG, VERMILION, Array, cached, publish, saved_figure, table
from torchsphere.sphere_map.decision import NoMap
from torchsphere.synthetic import ray_caster

TRANSLATION, ROTATION = slice(0, 2), slice(2, 5)
HEADER = (
    *("bias dx, dy (px)", "std dx, dy (px)", "bias wx, wy, wz (deg)", "std wx, wy, wz (deg)"),
    "actual/stated dx, dy, wx, wy, wz",
)

PATTERNS, MARGIN_PX, SUBSAMPLES, SUB_FRAMES = (0, 1, 2), 20, 8, 8
AXIS = np.array([0.2, 0.5, 0.2]) / math.sqrt(0.33)


@dataclass(frozen=True)
class Case:
    """Settings of a shot: px, grey levels, degrees per frame."""

    radius: float = 50.0
    noise: float = 2.0
    speckle: float = 4.0
    turn: float = math.sqrt(0.33)
    blur: float = 0.0
    step: tuple[float, float] = (1.4, 0.2)
    frames: int = 30


BASE, FAST = Case(), Case(step=(8.0, 1.1))

#: Property, its name on the axis, whether the axis is logarithmic, and its values.
SERIES: tuple[tuple[str, str, bool, tuple[float, ...]], ...] = (
    ("radius", "radius (px)", True, (10, 20, 35, 50, 75, 100)),
    ("noise", "noise (grey levels)", True, (0.5, 1, 2, 4, 8)),
    ("speckle", "speckle (px)", False, (2.5, 3, 4, 6, 8)),
    ("turn", "rotation (deg per frame)", False, (0, BASE.turn, 2, 5, 10, 20)),
    ("blur", "motion blur (px)", False, (0, 1, 2, 5)),
)

#: Ways to measure, and the argument ``sphere_map`` of `ts.track`.
WAYS = {"pairs": False, "default": None}


@dataclass(frozen=True)
class Shot:
    """Images (n, h, w), true positions (n, 2), px, and increments (n - 1, 5), px and rad."""

    images: torch.Tensor
    position: Array
    increment: Array
    radius: float

    @property
    def circle(self) -> tuple[float, float, float]:
        """The true outline in the first image."""
        x, y = self.position[0].tolist()
        return x, y, self.radius


@dataclass(frozen=True)
class Errors:
    """Errors (patterns, steps, 5), px and deg, NaN if a step was not measured, and stated variances."""

    error: Array
    variance: Array
    maps: int = 0  # patterns whose poses were measured on a map of the ball

    @property
    def measured(self) -> float:
        """Share of the steps that were measured."""
        return float(np.isfinite(self.error[..., 0]).mean())

    def bias(self) -> tuple[Array, Array]:
        """Mean error (5,), and its uncertainty (5,) by the scatter between patterns."""
        of_pattern = np.nanmean(self.error, axis=1)
        return np.nanmean(self.error, axis=(0, 1)), of_pattern.std(axis=0, ddof=1) / math.sqrt(len(of_pattern))

    def std(self) -> Array:
        """Standard deviation (5,)."""
        return np.nanstd(self.error, axis=(0, 1))

    def error_ratio(self, k: slice) -> float:
        """Actual error, bias included, over the stated one, of the components ``k``."""
        return float(np.sqrt(np.nanmean(self.error[..., k] ** 2 / self.variance[..., k])))


#: Errors by property and value.
Results = dict[tuple[str, float], Errors]


def make_shot(case: Case, seed: int, behind: Callable[[tuple[int, int]], torch.Tensor] | None = None) -> Shot:
    """Footage of one pattern; ``behind`` makes the still background (h, w), by default 90 throughout."""
    return recorded(clean_shot(case, seed, behind), case.noise, seed + 100)


def recorded(shot: Shot, noise: float, seed: int) -> Shot:
    """A clean shot as a camera of 8 bit records it, with white noise, grey levels."""
    levels = shot.images + noise * torch.randn(shot.images.shape, generator=torch.Generator().manual_seed(seed))
    return replace(shot, images=levels.round().clamp(0, 255))


def clean_shot(case: Case, seed: int, behind: Callable[[tuple[int, int]], torch.Tensor] | None = None) -> Shot:
    """Footage of one pattern without noise, not rounded; `Case.noise` is not used."""
    rng = np.random.default_rng(seed)
    steps = np.array(case.step) + rng.uniform(-0.3, 0.3, (case.frames - 1, 2))
    turn = np.radians(case.turn) * AXIS
    moved = np.concatenate((np.zeros((1, 2)), steps.cumsum(0)))
    position = case.radius + MARGIN_PX + rng.uniform(0, 1, 2) + moved
    width, height = (int(v) for v in np.ceil(position.max(0) + case.radius + MARGIN_PX))
    still = torch.full((height, width), 90.0) if behind is None else behind((height, width))
    # Moments of the exposure, in frames.
    share = (np.arange(SUB_FRAMES) + 0.5) / SUB_FRAMES - 0.5 if case.blur else np.zeros(1)
    share = share * case.blur / np.hypot(*case.step)
    times = np.arange(case.frames)[:, None] + share
    centres = position[:, None] + share[:, None] * np.array(case.step)
    orientations = Rotation.from_rotvec(times.reshape(-1, 1) * turn).as_matrix()
    pattern = ray_caster.speckle(seed, radius_px=case.radius, speckle_px=case.speckle)
    images = ray_caster.render(
        pattern,
        torch.from_numpy(centres.reshape(-1, 2)).float(),
        case.radius,
        torch.from_numpy(orientations).float(),
        still,
        subsamples=SUBSAMPLES // 2 if case.blur else SUBSAMPLES,
    )
    images = images.unflatten(0, (case.frames, len(share))).mean(1)
    increment = np.concatenate((steps, np.tile(turn, (case.frames - 1, 1))), 1)
    return Shot(images, position, increment, case.radius)


def errors_of(increment: Array, covariance: Array, truth: Array) -> tuple[Array, Array]:
    """Errors and stated variances (n - 1, 5), px and deg."""
    unit = PX_DEG
    return (increment - truth) * unit, np.diagonal(covariance, axis1=1, axis2=2) * unit**2


def measure(case: Case, sphere_map: bool | None) -> list[list[Any]]:
    """Errors, variances, and whether there is a map, of the three patterns, as nested lists."""
    found = []
    for seed in PATTERNS:
        shot = make_shot(case, seed)
        track = ts.track(shot.images, shot.circle, sphere_map=sphere_map)
        if sphere_map is None and isinstance(track.findings.map, NoMap):
            print(f"no map: {track.findings.map.reason}", file=sys.stderr)
        error, variance = errors_of(track.increment, track.covariance, shot.increment)
        found.append([error.tolist(), variance.tolist(), track.findings.is_on_map])
    return found


def compute() -> dict[str, Results]:
    """Errors by way, see `WAYS`."""
    return {way: errors_by(way) for way in WAYS}


def errors_by(way: str) -> Results:
    """Errors by property and value."""
    results = {}
    for name, _, _, values in SERIES:
        for value in values:
            case = replace(FAST if name == "blur" else BASE, **{name: float(value)})
            settings = asdict(case) | {"way": way, "patterns": PATTERNS, "subsamples": SUBSAMPLES}
            raw = cached("accuracy", settings, lambda case=case: measure(case, WAYS[way]))
            errors, variances, maps = zip(*raw, strict=True)
            results[name, value] = Errors(np.array(errors), np.array(variances), sum(maps))
    return results


def root_mean_square(values: Array) -> float:
    """Root mean square of all values."""
    return float(np.sqrt(np.mean(np.square(values))))


def _draw(axes: Array, values: tuple[float, ...], results: list[Errors], color: str, way: str) -> None:
    """Translation, rotation, and actual over stated error of one series by one way, from top to bottom."""
    line = "-" if way == "pairs" else ":"
    for axis, k in zip(axes, (TRANSLATION, ROTATION), strict=False):
        std = [root_mean_square(r.std()[k]) for r in results]
        bias, error = ([root_mean_square(r.bias()[part][k]) for r in results] for part in (0, 1))
        axis.plot(values, std, "o" + line, color=color, label=f"{way}: std")
        axis.errorbar(values, bias, error, fmt="s", color=color, mfc="white", capsize=2, label=f"{way}: |bias|")
    for k, marker, name in ((TRANSLATION, "o", "dx, dy"), (slice(2, 4), "^", "wx, wy"), (slice(4, 5), "x", "wz")):
        axes[2].plot(values, [r.error_ratio(k) for r in results], marker + line, color=color, label=f"{way}: {name}")


def plot(results: dict[str, Results]) -> None:
    """One column per series; translation, rotation, and actual over stated error."""
    with saved_figure(DOCS / "accuracy.png", (16, 8.5)) as figure:
        grid = figure.subplots(3, len(SERIES), sharex="col", sharey="row")
        for axes, (name, label, logarithmic, values) in zip(grid.T, SERIES, strict=True):
            for way, color in zip(WAYS, (BLUE, VERMILION), strict=True):
                _draw(axes, values, [results[way][name, v] for v in values], color, way)
            axes[2].axhspan(0.85, 1.15, color="0.9", zorder=0)
            axes[2].set_xlabel(label)
            for axis in axes:
                if logarithmic:
                    axis.set_xscale("log")
                    axis.set_xticks(values, [f"{v:g}" for v in values])
                    axis.minorticks_off()
        for axis, label in zip(
            grid[:, 0], ("translation (px)", "rotation (deg)", "actual / stated error"), strict=True
        ):
            axis.set_ylabel(label)
            axis.set_yscale("log")
        ratios = (0.3, 0.5, 0.7, 1, 1.5, 2, 3)
        grid[2, 0].set_yticks(ratios, [f"{v:g}" for v in ratios])
        grid[2, 0].minorticks_off()
        for axis in grid[:2, 0]:
            axis.set_ylim(2e-5, 0.4)
        for axis in (grid[0, 2], grid[2, 2]):
            axis.legend(ncols=2)
        figure.suptitle("Error of the step from frame to frame, rms of the components; 3 patterns of 30 frames each")


def cells(found: Errors) -> list[str]:
    """Cells of a table: bias, standard deviation, actual over stated error."""
    (bias, error), std = found.bias(), found.std()
    text = []
    for part in (range(2), range(2, 5)):
        text.append(", ".join(f"{bias[k]:+.4f} ± {error[k]:.4f}" for k in part))
        text.append(", ".join(f"{std[k]:.4f}" for k in part))
    text.append(", ".join(f"{found.error_ratio(slice(k, k + 1)):.2f}" for k in range(5)))
    return text


def main() -> None:
    """Measure, draw, and print the table."""
    results = compute()
    plot(results)
    lines = []
    for name, label, _, values in SERIES:
        for value in values:
            for way, found in results.items():
                errors = found[name, value]
                counts = f"{100 * errors.measured:.0f}", f"{errors.maps} of {len(PATTERNS)}"
                lines.append((f"{label} {value:.3g}", way, *counts, *cells(errors)))
    publish("accuracy", "validation.accuracy", table(("case", "way", "measured (%)", "maps", *HEADER), lines))


if __name__ == "__main__":
    main()
