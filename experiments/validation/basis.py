"""The modes that the paper prints against those of a rigid rotation: ``python -m experiments.validation.basis``.

Claim: the printed modes recover 0.71 of a real rotation from half of the radius and 0.83 from 0.95 of it, and put 0.25
to 0.045 of the way of the ball's front into x; from 20 px on the size of the ball changes little of it. Images moved
with the printed field itself show nothing. The rigid modes recover 1.00 from 35 px on, and x to 0.001 px from regions
of 0.7 and more.

Modes 3 and 4 as the paper prints them (section 2.2) lack the factor ``sqrt(R^2 - y^2) / R`` of a rotation.
Its figure 2 moves images with the same field that is then fitted, and cannot see it. Both are done here:

- rendered: Mitsuba turns the ball by 0.5 deg per frame about y, orthographic camera, steps of (1.4, 0.2) +- 0.3 px;
- advected: each of these frames, before noise and rounding, is displaced with the printed field itself, as the paper
  did (quintic spline; the field is inverted by iteration), by the same increments.

Both get sensor noise of 2 grey levels and 8 bits. Speckles of 4 px, six patterns of nine frames, true circles; models
``published`` and ``rigid`` (linearised) of `ts.correlate`. Uncertainties are the scatter of the patterns' means over
the root of their number. R w is the way of the ball's front.

The fields alone tell what to expect: the least squares fit of the field that moved the ball by that of the model, all
points of the region counting alike. They differ by a hundredth to 0.08, for foreshortened texture counts more near the
outline. An earlier measurement with another renderer and other patterns stands beside it.
"""

from __future__ import annotations

import functools
import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from scipy.ndimage import map_coordinates

import torchsphere as ts
from experiments.experiment import DOCS, Array, cached, publish, saved_figure, table
from experiments.validation.projection_errors import WAYS
from experiments.validation.projection_footage import BASE, NOISE_GREY, Case, Scene, make_scene
from render.frames import render_radiance
from torchsphere.geometry.motion_models import Geometry, published

PATTERNS, TURN_DEG, MODELS = range(6), 0.5, ("published", "rigid")
CASE = replace(BASE, turn=TURN_DEG, axis=(0.0, 1.0, 0.0), frames=9, samples=64)

#: Regions, of a ball of 50 px, and radii, of a region of 0.9.
REGIONS, RADII, REGION = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95), (10, 20, 35, 50, 75, 100), 0.9

#: An earlier measurement: by region, the leak and the share of the rotation recovered with the printed modes, and the
#: standard deviation of x with the rigid ones, px.
KNOWN = {
    0.5: (-0.264, 0.695, 0.043),
    0.7: (-0.191, 0.727, 0.014),
    0.8: (-0.141, 0.752, 0.010),
    0.9: (-0.079, 0.789, 0.008),
    0.95: (-0.042, 0.814, 0.010),
}

#: The printed field moves points by 0.03 px per px at most within the region: each round gains a digit and a half.
INVERSION_ROUNDS = 12


def advected(image: Array, circle: Array, increment: Array) -> Array:
    """The image (h, w) displaced with the printed field about the circle (3,)."""
    rows, columns = np.indices(image.shape, dtype=float)
    target = np.stack((columns.ravel(), rows.ravel()), -1) - circle[:2]
    geometry, q = Geometry(torch.tensor(float(circle[2]))), torch.from_numpy(increment)
    source = target
    for _ in range(INVERSION_ROUNDS):
        source = target - published(q, torch.from_numpy(source), geometry).numpy()
    at = source + circle[:2]
    return map_coordinates(image, [at[:, 1], at[:, 0]], order=5, mode="nearest").reshape(image.shape)


def pairs(scene: Scene) -> dict[str, tuple[torch.Tensor, torch.Tensor]]:
    """Images before and after the motion, (m, h, w) each, by the method that moves the ball."""
    clean = list(render_radiance(scene.setup, scene.motion, scene.times_s))
    moved = [advected(*one) for one in zip(clean[:-1], scene.centres[:-1], scene.increment, strict=True)]
    record = scene.setup.sensor.record
    seen = torch.from_numpy(np.stack([record(image, i) for i, image in enumerate(clean)])).float()
    # Other frame numbers give independent noise.
    fake = torch.from_numpy(np.stack([record(image, len(clean) + i) for i, image in enumerate(moved)])).float()
    return {"rendered": (seen[:-1], seen[1:]), "advected": (seen[:-1], fake)}


def measure(case: Case, regions: tuple[float, ...]) -> dict[str, Any]:
    """Errors of x and wy, (patterns, pairs, 2), px and rad, by "way model region"."""
    errors: dict[str, list[Any]] = {}
    for seed in PATTERNS:
        scene = make_scene(case, seed)
        circles = scene.centres[:-1]
        for way, (f, g) in pairs(scene).items():
            for model in MODELS:
                # The residual of a wrong field must not count as an occluder.
                options: dict[str, Any] = {"finite_from_deg": 180.0, "robust": False}
                for region in regions:
                    found = ts.correlate(f, g, circles, start=scene.increment, model=model, roi=region, **options)
                    error = found.q.double().numpy() - scene.increment
                    errors.setdefault(f"{way} {model} {region:g}", []).append(error[:, [0, 3]].tolist())
    return errors


@dataclass(frozen=True)
class Cost:
    """Leak (error of x over R w) and share of the rotation recovered, each with its uncertainty; std of x, px."""

    leak: tuple[float, float]
    recovered: tuple[float, float]
    std_px: float


def cost(errors: Array, radius: float) -> Cost:
    """The cost by errors (patterns, pairs, 2) of x, px, and wy, rad."""
    turn = math.radians(TURN_DEG)
    share = errors / (np.array([radius, 1.0]) * turn) + np.array([0.0, 1.0])
    mean, spread = share.mean((0, 1)), share.mean(1).std(0, ddof=1) / math.sqrt(len(share))
    leak, recovered = zip(mean.tolist(), spread.tolist(), strict=True)
    return Cost(leak, recovered, float((errors[..., 0] - errors[..., 0].mean(1, keepdims=True)).std()))


def expected(region: float, way: str, model: str) -> tuple[float, float]:
    """Leak and share recovered in a least squares fit of the model's field to the true field over the region."""
    y, x = np.mgrid[-1:1:401j, -1:1:401j]
    inside = x**2 + y**2 < region**2
    true = np.sqrt(1 - x[inside] ** 2 - y[inside] ** 2)
    fields = {"rigid": true, "published": true / np.sqrt(1 - y[inside] ** 2)}
    moved = fields["rigid" if way == "rendered" else "published"]
    modes = np.column_stack((np.ones_like(true), -fields[model]))
    leak, recovered = np.linalg.lstsq(modes, -moved, rcond=None)[0].tolist()
    return leak, recovered


#: Cost by radius, region, way of moving the ball, and model.
Results = dict[tuple[float, float, str, str], Cost]


def compute() -> Results:
    """All costs, measured or from the cache."""
    results: Results = {}
    for radius in RADII:
        case = replace(CASE, radius=float(radius))
        regions = REGIONS if radius == CASE.radius else (REGION,)
        settings = asdict(case) | {"patterns": list(PATTERNS), "noise": NOISE_GREY, "regions": regions, "robust": False}
        raw = cached("basis", settings, functools.partial(measure, case, regions))
        for name, errors in raw.items():
            way, model, region = name.split()
            results[float(radius), float(region), way, model] = cost(np.array(errors), radius)
    return results


def _draw(axis: Axes, results: Results, by_region: bool, recovered: bool) -> None:
    """One panel: leak or share recovered by region or radius."""
    values = REGIONS if by_region else RADII
    for way, line, fill in (("rendered", "-", "full"), ("advected", ":", "none")):
        for model in MODELS:
            keys = [(CASE.radius, v, way, model) if by_region else (float(v), REGION, way, model) for v in values]
            points = np.array([results[key].recovered if recovered else results[key].leak for key in keys])
            color, marker = WAYS[model]
            style: dict[str, Any] = {"color": color, "marker": marker, "ls": line, "fillstyle": fill}
            axis.errorbar(values, points[:, 0], points[:, 1], ms=6, capsize=2, label=f"{model}, {way}", **style)
    if by_region:
        known = [KNOWN[v][recovered] for v in KNOWN]
        axis.plot(list(KNOWN), known, "k+", ms=12, mew=1.6, label="published, earlier measurement")
    axis.axhline(float(recovered), color="0.6", lw=0.8, zorder=0)
    if not by_region:
        axis.set_xscale("log")
    axis.set_xticks(values, [f"{v:g}" for v in values])
    axis.minorticks_off()
    axis.tick_params(labelsize=11)


def plot(results: Results) -> None:
    """Leak and share recovered against the region and the radius."""
    with saved_figure(DOCS / "basis.png", (10, 7), dpi=90) as figure:
        grid = figure.subplots(2, 2, sharex="col", sharey="row")
        for row, axes in enumerate(grid):
            for axis, by_region in zip(axes, (True, False), strict=True):
                _draw(axis, results, by_region, recovered=bool(row))
        for axis, label in zip(grid[:, 0], ("error of x / (R w) (1)", "rotation measured / true (1)"), strict=True):
            axis.set_ylabel(label, fontsize=12)
        grid[1, 0].set_xlabel("radius of the region / R (1)", fontsize=12)
        grid[1, 1].set_xlabel("R (px)", fontsize=12)
        grid[0, 0].set_title(f"R = {CASE.radius:g} px", fontsize=12)
        grid[0, 1].set_title(f"region {REGION:g} R", fontsize=12)
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=11, frameon=False)


def publish_table(results: Results) -> None:
    """All costs, beside the expectation from the fields alone and an earlier measurement."""
    head = ("R (px)", "region / R", "moved by", "model", "error of x / (R w)", "bias of x (px)")
    head += ("rotation measured / true", "std of x (px)", "expected", "earlier")
    lines = []
    for (radius, region, way, model), found in results.items():
        bias = found.leak[0] * radius * math.radians(TURN_DEG)
        beside, known = ", ".join(f"{v + 0.0:.3f}" for v in np.round(expected(region, way, model), 6)), ""
        if way == "rendered" and radius == CASE.radius and region in KNOWN:
            leak, recovered, std = KNOWN[region]
            known = f"{leak:.3f}, {recovered:.3f}" if model == "published" else f"std {std:.3f}"
        leak, turn = f"{found.leak[0]:+.3f} ± {found.leak[1]:.3f}", "{:.3f} ± {:.3f}".format(*found.recovered)
        case = (f"{radius:g}", f"{region:g}", way, model)
        lines.append((*case, leak, f"{bias:+.4f}", turn, f"{found.std_px:.4f}", beside, known))
    publish("basis", "validation.basis", table(head, lines))


def main() -> None:
    """Measure, draw, and print the table."""
    results = compute()
    plot(results)
    publish_table(results)


if __name__ == "__main__":
    main()
