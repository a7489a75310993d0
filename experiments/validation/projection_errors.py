"""Errors of `projection`: each way to measure on all footage, against the truth."""

from __future__ import annotations

import functools
import math
import warnings
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import torchsphere as ts
from experiments.experiment import BLUE, ORANGE, PINK, PX_DEG, SKY, VERMILION, Array, cached
from experiments.validation.projection_footage import NOISE_GREY, SERIES, Case, Footage, case_of, render_footage

PATTERNS = (0, 1, 2)

#: Distance in radii that stands for an orthographic camera in the pinhole model.
FAR = 1e4

#: Relative and absolute error of first guesses, the latter in px.
WRONG_SHARE, WRONG_PX = 0.03, 0.1

TRANSLATION, ROTATION = slice(0, 2), slice(2, 5)

#: Colour (blind-safe) and marker of each way to measure.
WAYS = {
    "translation": ("#999999", "v"),
    "published": (PINK, "D"),
    "rigid": (ORANGE, "s"),
    "finite": (SKY, "o"),
    "default": (BLUE, "x"),
    "pinhole": (VERMILION, "^"),
}

#: Options of the models, see `projection`.
OPTIONS: dict[str, dict[str, Any]] = {"rigid": {"finite_from_deg": 180.0}, "finite": {"jacobian": "autograd"}}


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
    # Pairs need a common radius; the radius of an outline changes little on its way.
    circles = np.column_stack((circles[:-1, :2], np.full(len(start), circles[:, 2].mean())))
    found = ts.correlate(footage.images[:-1], footage.images[1:], circles, start=start, model=model, **options)
    return found.q.double().numpy()


def measure(case: Case) -> dict[str, list[Any]]:
    """Errors (patterns, steps, 5), px and deg, by way, as nested lists."""
    errors: dict[str, list[Any]] = {way: [] for way in WAYS}
    unit = PX_DEG
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
    """Errors (patterns, steps, 5), px and deg, NaN if not measured."""

    error: Array

    @property
    def measured(self) -> float:
        """Share of the steps that were measured."""
        return float(np.isfinite(self.error[..., 0]).mean())

    def bias(self) -> tuple[Array, Array]:
        """Mean error (5,) and its uncertainty (5,), NaN if at most half of the steps were measured."""
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
    """Errors of all footage by all ways, measured or from the cache."""
    results: Results = {}
    for name, _, _, values in SERIES:
        for value in values:
            case = case_of(name, value)
            settings = asdict(case) | {"patterns": PATTERNS, "noise": NOISE_GREY}
            raw = cached("projection", settings, functools.partial(measure, case))
            results |= {(name, float(value), way): Errors(np.array(raw[way])) for way in WAYS}
    return results
