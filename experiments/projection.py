"""What each motion model gets wrong: ``python -m experiments.projection``.

Claim: under an orthographic camera the linearised model is right to 0.005 px and 0.005 deg up to 1 deg per frame, the
exact one up to 2, the modes that the paper prints nowhere. Under perspective every orthographic model takes a sideways
step for a rotation of step / distance, 0.64 deg at 10 radii and 0.03 at 200 for 6 px of 50; ``pinhole`` has a bias of
0.002 px and 0.002 deg at most, from 4 radii on and all over the image.

Truth is rendered by Mitsuba (`render/`), which shares no code with the models: a ball of 30 mm with speckles of 4 px
over a uniform backdrop, 8 bits, sensor noise of 2 grey levels; three patterns. The ball turns about the axis
(0.2, 0.5, 0.2). One property is varied at a time:

- rotation: orthographic camera, radius 50 px, steps of (1.4, 0.2) +- 0.3 px, 30 frames per pattern;
- radius: the same, 0.57 deg per frame;
- distance: pinhole camera, radius 50 px, 0.5 deg and (6, 1) +- 0.3 px per frame, over 30 frames from 174 px left of the
  optical axis to the axis, so that nothing cancels by symmetry;
- place: the same camera at a distance of 10 radii (focal length 500 px), 15 frames around a place that many degrees
  off the optical axis, towards the corner of an image of 512 x 256 (24 deg).

Ways to measure: the five models with `ts.correlate`, each pair from the true increment wrong by 3 % and 0.1 px.
``rigid`` is there the linearised model (``finite_from_deg=180``); ``finite`` takes the gradient of the deformed image
(``jacobian="autograd"``), as ``pinhole`` does for large turns by itself: with that of the reference it errs by 0.020 px
and 0.033 deg at 20 deg. ``default`` is `ts.track` as it is shipped, but without its map of the ball: model ``rigid``,
which turns it exactly, and measures both ways from 1 deg on; only there the error of a step moves the region of the
next. The orthographic models are given the circle that fits the true outline best, as a user would; the pinhole model
the true projected centre, radius and camera, under the orthographic camera one at 10000 radii. Truth is the step of the
ball's projected centre.

Near the camera the search for occluders (``robust``) takes parts of the ball for something else, because orthographic
models do not explain them: at 6 radii it turns the bias of x from 0.17 to -0.08 px and triples its scatter.

The bias is the mean error over steps and patterns. Its uncertainty is the scatter of the patterns' means divided by the
root of three, known to half of its size only. Errors of successive steps telescope: at 50 px noise leaves less than
0.0003 px and 0.0005 deg in the mean, the rest of the scatter is the patterns' own. So 64 light paths per pixel do: at
20 deg per frame 256 change no bias and no standard deviation of ``pinhole`` by more than 0.0001 px or deg. Both base
cases have 256. The translation model measures no rotation.

Results are kept in ``experiments/cache``; delete them after a change to the package that leaves its version as it is.
"""

from __future__ import annotations

import functools
import math
import textwrap
import warnings
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import torchsphere as ts
from experiments.accuracy import cached
from render.ball import Ball
from render.camera import Camera
from render.frames import render_frames
from render.pattern import Pattern
from render.pose import Motion, Poses
from render.scene import Quality, Setup
from render.sensor import Sensor

Array = NDArray[np.float64]

OUT = Path(__file__).parent.parent / "docs" / "projection.png"
PATTERNS, NOISE_GREY, SPECKLE_PX, JITTER_PX = (0, 1, 2), 2.0, 4.0, 0.3
BALL_RADIUS_M = 0.015

#: Direction of the rotation, and from the middle of an image of 512 x 256 to where a ball of 50 px fits its corner.
AXIS, TO_CORNER = (0.2, 0.5, 0.2), np.array([200.0, 72.0]) / math.hypot(200.0, 72.0)

#: Distance in radii that stands for an orthographic camera where the pinhole model asks for one.
FAR = 1e4

#: Share and px that first guesses are wrong by.
WRONG_SHARE, WRONG_PX = 0.03, 0.1

#: Bias that the summary asks for, px and deg.
LIMIT = 0.005

TRANSLATION, ROTATION = slice(0, 2), slice(2, 5)

#: Colour (blind-safe) and marker of each way to measure.
WAYS = {
    "translation": ("#999999", "v"),
    "published": ("#CC79A7", "D"),
    "rigid": ("#E69F00", "s"),
    "finite": ("#56B4E9", "o"),
    "default": ("#0072B2", "x"),
    "pinhole": ("#D55E00", "^"),
}

#: What the models are asked for with, see above.
OPTIONS: dict[str, dict[str, Any]] = {"rigid": {"finite_from_deg": 180.0}, "finite": {"jacobian": "autograd"}}


@dataclass(frozen=True)
class Case:
    """Footage of a ball: px, degrees per frame, radii.

    Attributes
    ----------
    distance : float
        From the camera along its axis, radii; infinite for the orthographic camera.
    offset : tuple of float
        Projected centre in the first frame, px from the optical axis.
    """

    radius: float = 50.0
    turn: float = math.sqrt(0.33)
    axis: tuple[float, float, float] = AXIS
    distance: float = math.inf
    offset: tuple[float, float] = (0.0, 0.0)
    step: tuple[float, float] = (1.4, 0.2)
    frames: int = 30
    samples: int = 256


#: Light paths per pixel of all but the base cases.
SAMPLES = 64

BASE = Case()
CROSSING = Case(turn=0.5, distance=10.0, offset=(-174.0, -20.0), step=(6.0, 1.0))
PLACE = replace(CROSSING, frames=15)

#: Name, label and scale of each property that is varied, and its values.
SERIES: tuple[tuple[str, str, str, tuple[float, ...]], ...] = (
    ("rotation", "rotation (deg per frame)", "log", (0.1, 0.3, BASE.turn, 1, 2, 5, 10, 20)),
    ("radius", "radius (px)", "log", (10, 20, 35, 50, 75, 100)),
    ("distance", "distance (radii)", "log", (4, 6, 10, 20, 50, 100, 200)),
    ("place", "place (deg off the axis)", "linear", (0, 6, 12, 18, 24)),
)


def case_of(name: str, value: float) -> Case:
    """The footage of a series at one of its values; all but the base cases at fewer samples."""
    if name == "place":
        middle = CROSSING.distance * CROSSING.radius * math.tan(math.radians(value)) * TO_CORNER
        first = middle - (PLACE.frames - 1) / 2 * np.array(PLACE.step)
        return replace(PLACE, offset=(float(first[0]), float(first[1])), samples=SAMPLES)
    base = CROSSING if name == "distance" else BASE
    changed: dict[str, Any] = {"turn" if name == "rotation" else name: float(value)}
    case = replace(base, **changed)
    return case if case == base else replace(case, samples=SAMPLES)


@dataclass(frozen=True)
class Footage:
    """Rendered frames and their truth.

    Attributes
    ----------
    images : Tensor
        (n, h, w), float32.
    centres, outlines : ndarray
        (n, 3) each, px: the projected centre and the radius at its depth; the circle that fits the outline best.
    increment : ndarray
        (n - 1, 5) as (dx, dy, wx, wy, wz), px and rad.
    camera : Camera
        The renderer's.
    """

    images: torch.Tensor
    centres: Array
    outlines: Array
    increment: Array
    camera: Camera


@dataclass(frozen=True)
class Scene:
    """What `render.frames` asks for, the ball's places (n, 3), m, and the true increment (n - 1, 5), px and rad."""

    setup: Setup
    motion: Motion
    places_m: Array
    increment: Array

    @property
    def times_s(self) -> Array:
        """One frame per second."""
        return np.arange(len(self.places_m), dtype=float)

    @property
    def centres(self) -> Array:
        """Projected centre and radius (n, 3) at its depth, px."""
        camera, radius_m = self.setup.camera, self.setup.ball.radius_m
        radii = [radius_m * camera.px_per_m(float(depth)) for depth in self.places_m[:, 2]]
        return np.column_stack((camera.project(self.places_m), radii))


def make_scene(case: Case, seed: int) -> Scene:
    """The scene of one pattern."""
    rng = np.random.default_rng([seed, 7])
    steps = np.array(case.step) + rng.uniform(-JITTER_PX, JITTER_PX, (case.frames - 1, 2))
    seen = np.array(case.offset) + rng.uniform(0, 1, 2) + np.concatenate((np.zeros((1, 2)), steps.cumsum(0)))
    turn = np.radians(case.turn) * np.array(case.axis) / np.linalg.norm(case.axis)
    start = Rotation.random(random_state=int(rng.integers(1 << 31)))
    orientations = (Rotation.from_rotvec(np.arange(case.frames)[:, None] * turn) * start).as_matrix()
    camera, places_m = _camera(case, seen)

    def motion(times_s: Array) -> Poses:
        frames = np.round(times_s).astype(int)
        return Poses(places_m[frames], orientations[frames])

    setup = Setup(
        ball=Ball(diameter_mm=2000 * BALL_RADIUS_M),
        pattern=Pattern(seed=seed, speckle_mm=SPECKLE_PX * 1000 * BALL_RADIUS_M / case.radius),
        camera=camera,
        sensor=Sensor(read_noise_grey=NOISE_GREY, seed=seed),
        quality=Quality(samples=case.samples, seed=seed),
    )
    return Scene(setup, motion, places_m, np.concatenate((steps, np.tile(turn, (case.frames - 1, 1))), 1))


def render_footage(case: Case, seed: int) -> Footage:
    """Footage of one pattern."""
    scene = make_scene(case, seed)
    images = np.stack(list(render_frames(scene.setup, scene.motion, scene.times_s)))
    outlines = np.stack([outline_circle(scene.setup.camera, place) for place in scene.places_m])
    return Footage(torch.from_numpy(images).float(), scene.centres, outlines, scene.increment, scene.setup.camera)


def _camera(case: Case, seen: Array) -> tuple[Camera, Array]:
    """The camera, its image cut to the ball's path, and the ball's places (n, 3), m."""
    perspective = math.isfinite(case.distance)
    # Under perspective the outline is longer than the radius: by half of it at the widest angle of the series.
    margin = 12 + case.radius * (1.6 if perspective else 1.0)
    low, high = np.floor(seen.min(0) - margin), np.ceil(seen.max(0) + margin)
    width, height = (int(v) for v in high - low + 1)
    principal = (-float(low[0]), -float(low[1]))
    if not perspective:
        scale = case.radius / (1000 * BALL_RADIUS_M)
        camera = Camera(width=width, height=height, scale_px_per_mm=scale, principal_px=principal)
        return camera, np.column_stack((seen / (1000 * scale), np.zeros(len(seen))))
    focal = case.distance * case.radius
    camera = Camera("pinhole", width, height, focal_px=focal, principal_px=principal)
    rays = np.column_stack((seen / focal, np.ones(len(seen))))
    return camera, case.distance * BALL_RADIUS_M * rays


def outline_circle(camera: Camera, centre_m: Array) -> Array:
    """Circle (3,) that fits the outline best, px: of the cone that touches the ball."""
    angle = np.linspace(0, 2 * np.pi, 180, endpoint=False)[:, None]
    line, share = np.array([0.0, 0.0, 1.0]), 1.0
    if camera.model == "pinhole":
        distance = float(np.linalg.norm(centre_m))
        line, share = centre_m / distance, 1 - (BALL_RADIUS_M / distance) ** 2
    across = np.cross(line, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    ring = math.sqrt(share) * (np.cos(angle) * across + np.sin(angle) * np.cross(line, across))
    points = camera.project(share * centre_m + BALL_RADIUS_M * ring)
    # |p|^2 = 2 c.p + (R^2 - |c|^2) is linear in the centre c.
    design = np.column_stack((2 * points, np.ones(len(points))))
    x, y, rest = np.linalg.lstsq(design, (points**2).sum(1), rcond=None)[0]
    return np.array([x, y, math.sqrt(rest + x**2 + y**2)])


def measure_pairs(footage: Footage, model: str, seed: int, **options: Any) -> Array:
    """Increments (n - 1, 5) of successive frames, by `ts.correlate` with the true circles."""
    circles = footage.outlines
    if model == "pinhole":
        focal = footage.camera.focal_px
        if footage.camera.model == "orthographic":
            focal = FAR * float(footage.centres[0, 2])
        options["camera"] = ts.Camera(focal_px=focal, principal_px=footage.camera.centre_px)
        circles = footage.centres
    rng = np.random.default_rng([seed, 11])
    start = footage.increment * (1 + WRONG_SHARE * rng.standard_normal(footage.increment.shape))
    start[:, :2] += WRONG_PX * rng.standard_normal((len(start), 2))
    # Pairs need one radius; that of an outline changes little on its way.
    circles = np.column_stack((circles[:-1, :2], np.full(len(start), circles[:, 2].mean())))
    found = ts.correlate(footage.images[:-1], footage.images[1:], circles, start=start, model=model, **options)
    return found.q.double().numpy()


def measure(case: Case) -> dict[str, list[Any]]:
    """Errors (patterns, steps, 5), px and deg, by way, as nested lists."""
    errors: dict[str, list[Any]] = {way: [] for way in WAYS}
    unit = np.array([1, 1, *3 * [180 / math.pi]])
    for seed in PATTERNS:
        footage = render_footage(case, seed)
        for way in WAYS:
            if way == "default":
                x, y, radius = footage.outlines[0].tolist()
                found = ts.track(footage.images, (x, y, radius), sphere_map=False).increment
            else:
                found = measure_pairs(footage, way, seed, **OPTIONS.get(way, {}))
            error = (found - footage.increment) * unit
            if way == "translation":
                error[:, ROTATION] = np.nan
            errors[way].append(error.tolist())
    return errors


@dataclass(frozen=True)
class Errors:
    """Errors (patterns, steps, 5), px and deg, NaN where nothing was measured."""

    error: Array

    @property
    def measured(self) -> float:
        """Share of the steps that were measured."""
        return float(np.isfinite(self.error[..., 0]).mean())

    def bias(self) -> tuple[Array, Array]:
        """Mean error (5,) and its uncertainty (5,), NaN where no more than half of the steps were measured."""
        if self.measured <= 0.5:
            return np.full(5, np.nan), np.full(5, np.nan)
        with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # the translation model's rotation
            of_pattern = np.nanmean(self.error, axis=1)
            spread = np.nanstd(of_pattern, axis=0, ddof=1) / math.sqrt(len(of_pattern))
            return np.nanmean(self.error, axis=(0, 1)), spread

    def std(self) -> Array:
        """Standard deviation (5,), NaN as for the bias."""
        if self.measured <= 0.5:
            return np.full(5, np.nan)
        with warnings.catch_warnings(action="ignore", category=RuntimeWarning):
            return np.asarray(np.nanstd(self.error, axis=(0, 1)))

    def worst(self, k: slice) -> tuple[float, float, float]:
        """The largest |bias| of the components ``k``, its uncertainty, and the largest standard deviation."""
        bias, error = self.bias()
        if not np.isfinite(bias[k]).all():
            return math.nan, math.nan, math.nan
        largest = int(np.abs(bias[k]).argmax())
        return float(abs(bias[k][largest])), float(error[k][largest]), float(self.std()[k].max())


#: Errors by property, value and way.
Results = dict[tuple[str, float, str], Errors]


def compute() -> Results:
    """Errors of everything, from the cache where they have been measured."""
    results: Results = {}
    for name, _, _, values in SERIES:
        for value in values:
            case = case_of(name, value)
            settings = asdict(case) | {"patterns": PATTERNS, "noise": NOISE_GREY}
            raw = cached("projection", settings, functools.partial(measure, case))
            results |= {(name, float(value), way): Errors(np.array(raw[way])) for way in WAYS}
    return results


def plot(results: Results) -> None:
    """One column per property; bias and standard deviation of translation and of rotation."""
    figure = Figure(figsize=(13, 12), layout="constrained")
    grid = figure.subplots(4, len(SERIES), sharex="col", sharey="row")
    rows = (
        ("bias of translation (px)", TRANSLATION, False),
        ("std of translation (px)", TRANSLATION, True),
        ("bias of rotation (deg)", ROTATION, False),
        ("std of rotation (deg)", ROTATION, True),
    )
    for axes, (name, label, scale, values) in zip(grid.T, SERIES, strict=True):
        for axis, (_, k, spread) in zip(axes, rows, strict=True):
            for way, (color, marker) in WAYS.items():
                found = np.array([results[name, float(v), way].worst(k) for v in values])
                y, error = (found[:, 2], None) if spread else (found[:, 0], found[:, 1])
                style: dict[str, Any] = {"color": color, "marker": marker, "ms": 6, "lw": 1.3, "mfc": "none"}
                axis.errorbar(values, y, error, capsize=2, elinewidth=0.8, label=way, **style)
            axis.grid(alpha=0.3)
            axis.set_yscale("log")
            axis.set_xscale(scale)
            axis.tick_params(labelsize=11)
            # The base case stands in the titles.
            axis.set_xticks(values, ["" if v == BASE.turn else f"{v:g}" for v in values])
            axis.minorticks_off()
        axes[-1].set_xlabel(label, fontsize=12)
    for axis, (label, _, spread) in zip(grid[:, 0], rows, strict=True):
        axis.set_ylabel(label, fontsize=12)
        axis.set_ylim((1e-3, 1) if spread else (1e-4, 10))
    for axis, title in zip(
        grid[0],
        ("orthographic, 50 px", "orthographic, 0.57 deg", "pinhole, 0.5 deg, 6 px", "pinhole, 10 radii, 0.5 deg"),
        strict=True,
    ):
        axis.set_title(title, fontsize=12)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(WAYS), fontsize=12, frameon=False)
    figure.savefig(OUT, dpi=90)


def _cells(found: Errors) -> str:
    (bias, error), std = found.bias(), found.std()
    cells = []
    for part in (TRANSLATION, ROTATION):
        if np.isfinite(bias[part]).all():
            cells.append(f"{', '.join(f'{v:+.4f}' for v in bias[part])} ± {error[part].max():.4f}")
            cells.append(", ".join(f"{v:.4f}" for v in std[part]))
        else:
            cells += ["-", "-"]
    return " | ".join(cells)


def print_table(results: Results) -> None:
    """All errors, bias and standard deviation apart; the uncertainty is that of the least certain component."""
    print("| case | model | measured (%) | bias dx, dy (px) | std (px) | bias wx, wy, wz (deg) | std (deg) |")
    print("|" + 7 * "---|")
    for name, label, _, values in SERIES:
        for value in values:
            for way in WAYS:
                found = results[name, float(value), way]
                print(f"| {label} {value:.3g} | {way} | {100 * found.measured:.0f} | {_cells(found)} |")


def holds(results: Results, name: str, way: str, limits: tuple[float, float]) -> list[float]:
    """Values of a series at which a model's bias stays within the limits, px and deg, in every component."""
    values = next(values for title, _, _, values in SERIES if title == name)
    parts = [(k, limit) for k, limit in zip((TRANSLATION, ROTATION), limits, strict=True) if math.isfinite(limit)]
    return [v for v in values if all(results[name, float(v), way].worst(k)[0] < limit for k, limit in parts)]


def verdict(results: Results) -> str:
    """When which model suffices, in figures."""
    strict, of_place, of_turn = (LIMIT, LIMIT), (LIMIT, math.inf), (math.inf, 4 * LIMIT)

    def worst(name: str, way: str, k: slice) -> float:
        return max(results[key].worst(k)[0] for key in results if key[0] == name and key[2] == way)

    def at(name: str, value: float, way: str, k: slice) -> float:
        return results[name, value, way].worst(k)[0]

    turns = {way: max(holds(results, "rotation", way, strict), default=0) for way in WAYS}
    near = max(min(holds(results, "distance", way, of_place)) for way in ("rigid", "finite", "default"))
    pinhole = [worst(name, "pinhole", k) for name in ("distance", "place") for k in (TRANSLATION, ROTATION)]
    published = [at("rotation", turn, "published", ROTATION) for turn in (0.1, BASE.turn)]
    smallest = min(holds(results, "radius", "finite", strict))
    stays = f"up to {turns['published']:g} deg" if turns["published"] else "nowhere"
    text = f"""Limit: a bias of {LIMIT} px and {LIMIT} deg in every component, ball of 50 px.
Under an orthographic camera `rigid` stays within it up to {turns["rigid"]:g} deg per frame, `finite` up to
{turns["finite"]:g}, the default up to {turns["default"]:g}; `finite` keeps {4 * LIMIT:g} deg up to
{max(holds(results, "rotation", "finite", of_turn)):g}. From a radius of {smallest} px on `finite`
stays within it at 0.57 deg. `published` stays within it {stays}: it is off by
{published[0]:.3f} deg at 0.1 deg per frame and by {published[1]:.3f} at 0.57. `translation` takes 0.1 deg per frame for
{at("rotation", 0.1, "translation", TRANSLATION):.3f} px. Under perspective `rigid`, `finite` and the default keep
{LIMIT} px from {near:g} radii on, but take every sideways step for a rotation of step / distance: with 6 px per frame
{at("distance", 10, "rigid", ROTATION):.2f} deg at 10 radii and still {at("distance", 200, "rigid", ROTATION):.3f} at
200. `pinhole` keeps {pinhole[0]:.4f} px and {pinhole[1]:.4f} deg from 4 radii on, and {pinhole[2]:.4f} px and
{pinhole[3]:.4f} deg from the axis to the corner of the image."""
    return "\n" + textwrap.fill(" ".join(text.split()), 120)


def acceptance(results: Results) -> str:
    """The two lines that the project set itself, and what was measured."""
    lines = ["\nTargets (largest component; standard deviation, too, where one is set):"]
    for name, value, way, limits in (
        ("distance", CROSSING.distance, "pinhole", "0.003 px, 0.003 deg"),
        ("distance", CROSSING.distance, "rigid", "none, for comparison"),
        ("distance", CROSSING.distance, "default", "none, for comparison"),
        ("rotation", BASE.turn, "default", "0.002 px, 0.002 deg; std 0.0055 px, 0.009 deg"),
    ):
        (px, _, std_px), (deg, _, std_deg) = (results[name, value, way].worst(k) for k in (TRANSLATION, ROTATION))
        lines.append(
            f"- {way}, {name} {value:.3g}: bias {px:.4f} px, {deg:.4f} deg; std {std_px:.4f} px, {std_deg:.4f} deg "
            f"(target: {limits})"
        )
    return "\n".join(lines)


def main() -> None:
    """Measure, draw, and print the table and when which model suffices."""
    results = compute()
    plot(results)
    print_table(results)
    print(verdict(results))
    print(acceptance(results))


if __name__ == "__main__":
    main()
