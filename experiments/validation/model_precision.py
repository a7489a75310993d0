"""Precision of the forward model on fresh patterns: ``python -m experiments.validation.model_precision``.

Claim: on patterns on which no constant was chosen, a step at R = 50 px under noise of 2 grey levels has a standard
deviation of 0.0024 px and 0.006 deg at most, and a bias of 0.0006 px and 0.0008 deg at most. The stated standard
deviation is 0.9 to 1.1 times the true error for each of the five components, with the true circle and with the circle
that the program finds: from R = 20 to 150 px, noise 0.5 to 8, 0 to 20 deg per frame. Over 400 frames that turn by 180
deg in place and back, no orientation is off by more than 0.02 deg and no position by more than 0.007 px; a frame takes
15 ms. A position is a place in the image and is compared with the true one; an orientation counts from the first frame.

The shots are those of `experiments.validation.accuracy` with other patterns: one property is varied at a time, and the
speckle has 4 px at every radius. At another noise or radius the limits of the standard deviation scale as the
Cramer-Rao bound: with noise / 2, and with 50 / R in px and (50 / R)^2 in deg. The limits of the bias do not scale. Both
hold for the steps of all patterns of a case together; ``--pattern`` shows a single pattern.

Stated/true is one over the root mean square of the errors, bias included, in units of the stated standard deviation.
It is known to 0.87 / sqrt(steps) only, as successive errors share an image: 7 % for a case, 5 components of which would
leave the limits by chance in about half of the cases. So a single case may miss the limits by three such errors; the
mean over all cases may not. ``--noises 4`` records each shot four times, with other noise, which halves that error.

Clean frames are kept in ``experiments/cache/frames``, as their rendering takes long; results are not kept. A checkout
can share the folder of another by a symbolic link. ``--render`` only fills the folder. ``--case NAME`` and ``--pattern
NUMBER`` measure less and print a line per shot; ``--quick`` measures four cases. These do not write the table.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

import torchsphere as ts
from experiments.experiment import CACHE, Array, Row, claims, key_of, publish, table
from experiments.validation import seeds
from experiments.validation.accuracy import (
    AXIS,
    MARGIN_PX,
    SUBSAMPLES,
    Case,
    Errors,
    Shot,
    clean_shot,
    errors_of,
    recorded,
)
from torchsphere.sphere_map.decision import NoMap
from torchsphere.synthetic import ray_caster

#: Patterns that the choice of no constant sees, and the ways to know the first circle.
PATTERNS, CIRCLES = seeds.MODEL_PRECISION, ("true", "found")

#: Options of `ts.track` that make a map of the ball, which is the forward model.
OPTIONS: dict[str, Any] = {"sphere_map": True}

#: Largest std and |bias| of (dx, dy, wx, wy, wz) in the base case, px and deg, and the range of stated/true.
MAX_STD = np.array([0.0024, 0.0024, 0.006, 0.006, 0.006])
MAX_BIAS = np.array([0.0006, 0.0006, 0.0008, 0.0008, 0.0008])
RATIO = (0.9, 1.1)

#: Largest errors of a pose over the drifting recording, px and deg, and ms per frame: a tenth of the former 150 ms.
DRIFT_PX, DRIFT_DEG, DRIFT_MS = 0.007, 0.02, 15.0

BASE = Case(frames=60)

#: The drifting recording turns in place to this angle and back.
DRIFT, DRIFT_TURN_DEG = Case(frames=400, step=(0.0, 0.0), turn=0.0), 180.0

#: Frames by radius, px: a large ball costs more time.
FRAMES = {20: 60, 35: 60, 75: 40, 100: 24, 150: 24}

CASES: dict[str, Case] = {
    "base": BASE,
    **{f"radius-{radius}": replace(BASE, radius=float(radius), frames=frames) for radius, frames in FRAMES.items()},
    **{f"noise-{noise:g}": replace(BASE, noise=noise) for noise in (0.5, 8.0)},
    **{f"turn-{turn:g}": replace(BASE, turn=turn) for turn in (0.0, 0.1, 3.0, 10.0, 20.0)},
    "drift": DRIFT,
}
QUICK = ("base", "radius-20", "noise-8", "turn-10")


@dataclass(frozen=True)
class Tracked:
    """One recording as tracked, and its errors."""

    error: Array  # of the increments (n - 1, 5), px and deg; NaN if a step was not measured
    variance: Array  # stated, (n - 1, 5)
    position_px: float  # largest error of a position in the image
    orientation_deg: float  # largest error of an orientation since the first known frame
    radius_px: float  # error of the radius
    sd_radius_px: float
    frame_ms: float
    on_map: bool
    reason: str  # why there is no map, in words


@dataclass(frozen=True)
class Found:
    """All recordings of a case with one kind of circle."""

    name: str
    circle: str
    tracked: list[Tracked]

    @property
    def errors(self) -> Errors:
        """Errors of the steps of all recordings."""
        return Errors(np.stack([t.error for t in self.tracked]), np.stack([t.variance for t in self.tracked]))

    @property
    def label(self) -> str:
        """Case and circle."""
        return f"{self.name}, {self.circle}"


def shot_of(name: str, pattern: int) -> Shot:
    """The clean shot of a case, from the cache if it was rendered before."""
    case = CASES[name]
    drift = {"drift_deg": DRIFT_TURN_DEG} if name == "drift" else {}
    settings = asdict(replace(case, noise=0.0)) | {"pattern": pattern, "subsamples": SUBSAMPLES} | drift
    path = CACHE / "frames" / f"{key_of('clean', settings)}.npz"
    if not path.exists():
        print(f"rendering {name}, pattern {pattern}", file=sys.stderr, flush=True)
        _keep(path, _turning_back(case, pattern) if name == "drift" else clean_shot(case, pattern))
    with np.load(path) as kept:
        return Shot(torch.from_numpy(kept["images"]), kept["position"], kept["increment"], case.radius)


def _keep(path: Path, shot: Shot) -> None:
    """Write a clean shot; a rendering that is broken off leaves no file of that name."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(".part.npz")
    np.savez(unfinished, images=shot.images.numpy(), position=shot.position, increment=shot.increment)
    unfinished.rename(path)


def _turning_back(case: Case, pattern: int) -> Shot:
    """Clean footage of a ball that turns to `DRIFT_TURN_DEG` and back, at nearly the same place."""
    time_share, i = np.linspace(-1, 1, case.frames), np.arange(case.frames)
    turned = np.radians(DRIFT_TURN_DEG) * (1 - abs(time_share))[:, None] * AXIS
    middle = case.radius + MARGIN_PX + np.random.default_rng(pattern).uniform(0, 1, 2)
    position = middle + np.stack((0.3 * np.sin(i / 5), 0.2 * np.cos(i / 7)), 1)
    side = math.ceil(position.max() + case.radius + MARGIN_PX)
    images = ray_caster.render(
        ray_caster.speckle(pattern, radius_px=case.radius, speckle_px=case.speckle),
        torch.from_numpy(position).float(),
        case.radius,
        torch.from_numpy(Rotation.from_rotvec(turned).as_matrix()).float(),
        90.0,
        shape=(side, side),
        subsamples=SUBSAMPLES,
    )
    return Shot(images, position, np.concatenate((np.diff(position, axis=0), np.diff(turned, axis=0)), 1), case.radius)


def tracked(shot: Shot, circle: str) -> Tracked:
    """Track one recording and compare it with the truth."""
    start = time.perf_counter()
    track = ts.track(shot.images, shot.circle if circle == "true" else None, **OPTIONS)
    seconds = time.perf_counter() - start
    error, variance = errors_of(track.increment, track.covariance, shot.increment)
    position_px, orientation_deg = _pose_errors(track, shot)
    return Tracked(
        error=error,
        variance=variance,
        position_px=position_px,
        orientation_deg=orientation_deg,
        radius_px=track.circle.radius - shot.radius,
        sd_radius_px=track.circle.sd_radius,
        frame_ms=1e3 * seconds / len(shot.images),
        on_map=track.findings.is_on_map,
        reason=track.findings.map.reason if isinstance(track.findings.map, NoMap) else "",
    )


def _pose_errors(track: ts.Track, shot: Shot) -> tuple[float, float]:
    """Largest error of a position in the image, px, and of an orientation since the first known frame, deg."""
    position = np.nanmax(np.linalg.norm(track.position - shot.position, axis=1))
    # All turns of a shot have one axis, so that their rotation vectors add.
    turned = Rotation.from_rotvec(np.concatenate((np.zeros((1, 3)), shot.increment[:, 2:].cumsum(0))))
    known = np.isfinite(track.orientation[:, 0, 0])
    true = turned[known] * turned[known][0].inv()
    measured = Rotation.from_matrix(track.orientation[known])
    angles = (measured * measured[0].inv() * true.inv()).magnitude()
    return float(position), float(np.degrees(angles.max()))


def measure(name: str, circle: str, patterns: Sequence[int], noises: int) -> Iterator[Tracked]:
    """The recordings of a case: each pattern under ``noises`` sequences of noise."""
    for pattern in patterns:
        shot = shot_of(name, pattern)
        for repeat in range(noises):
            yield tracked(recorded(shot, CASES[name].noise, pattern + 100 * (repeat + 1)), circle)


def compute(names: Sequence[str], circles: Sequence[str], patterns: Sequence[int], noises: int) -> list[Found]:
    """All cases with every kind of circle."""
    found = []
    for name in names:
        for circle in circles:
            parts = []
            for part in measure(name, circle, patterns, noises):
                parts.append(part)
                print(line(f"{name}, {circle}", part), file=sys.stderr, flush=True)
            found.append(Found(name, circle, parts))
    return found


def limits(name: str) -> Array:
    """Largest standard deviations (5,) of a case, px and deg."""
    case = CASES[name]
    smaller = 50 / case.radius
    return MAX_STD * case.noise / 2 * np.array([smaller, smaller, *3 * [smaller**2]])


def ratios(errors: Errors) -> tuple[Array, float]:
    """Stated over true error (5,), and the relative uncertainty of these by the number of steps."""
    steps = int(np.isfinite(errors.error[..., 0]).sum())
    ratio = [1 / errors.error_ratio(slice(k, k + 1)) if steps else math.nan for k in range(5)]
    return np.array(ratio), 0.5 * math.sqrt(3 / max(steps, 1))


def _numbers(values: Array, form: str) -> str:
    return " ".join(format(value, form) for value in values)


def line(label: str, found: Tracked) -> str:
    """One recording in one line: std, bias, stated/true, worst pose, radius, time and map."""
    errors = Errors(found.error[None], found.variance[None])
    std, bias = errors.std(), np.nanmean(found.error, axis=0)
    return (
        f"{label:>16}: std {_numbers(std, '.4f')}  bias {_numbers(bias, '+.4f')}  "
        f"stated/true {_numbers(ratios(errors)[0], '.2f')}  worst {found.position_px:.4f} px "
        f"{found.orientation_deg:.4f} deg  radius {found.radius_px:+.4f} +- {found.sd_radius_px:.4f}  "
        f"{found.frame_ms:.1f} ms  {'map' if found.on_map else 'NO MAP: ' + found.reason}"
    )


def cells(found: Found) -> list[str]:
    """Cells of the table for one case."""
    errors = found.errors
    (bias, spread), std, (ratio, unsure) = errors.bias(), errors.std(), ratios(errors)
    text = [found.label, f"{sum(t.on_map for t in found.tracked)} of {len(found.tracked)}"]
    for part in (range(2), range(2, 5)):
        text.append(", ".join(f"{std[k]:.4f}" for k in part))
        text.append(", ".join(f"{bias[k]:+.4f} ± {spread[k]:.4f}" for k in part))
    text.append(f"{', '.join(f'{r:.2f}' for r in ratio)} (± {unsure:.2f})")
    text.append(f"{max(t.position_px for t in found.tracked):.4f}, {max(t.orientation_deg for t in found.tracked):.4f}")
    text.append(", ".join(f"{t.radius_px:+.4f} ± {t.sd_radius_px:.4f}" for t in found.tracked))
    text.append(f"{min(t.frame_ms for t in found.tracked):.1f}")
    return text


HEADER = (
    *("case, circle", "on a map", "std dx, dy (px)", "bias dx, dy (px)", "std wx, wy, wz (deg)"),
    *("bias wx, wy, wz (deg)", "stated/true dx, dy, wx, wy, wz", "worst pose (px, deg)", "error of R (px)"),
    "ms per frame",
)


def _worst(shares: dict[str, float]) -> tuple[str, bool]:
    """The largest share of a limit with its case, in words, and whether all are within it."""
    label = max(shares, key=lambda key: math.inf if math.isnan(shares[key]) else shares[key])
    count = sum(not share <= 1 for share in shares.values())
    return f"{shares[label]:.2f} of the limit ({label}); {count} of {len(shares)} cases beyond", count == 0


def rows(found: Sequence[Found]) -> list[Row]:
    """The limits beside what was measured."""
    results = [Row("model_precision", "poses on a map of the ball", "all", *_maps(found))]
    steps = [f for f in found if f.name != "drift"]
    if steps:
        results += _step_rows(steps)
    return results + [row for f in found if f.name == "drift" for row in _drift_rows(f)]


def _maps(found: Sequence[Found]) -> tuple[str, bool]:
    lacking = [f.label for f in found if not all(t.on_map for t in f.tracked)]
    return ("all" if not lacking else f"not all of {'; '.join(lacking)}"), not lacking


def _step_rows(found: Sequence[Found]) -> list[Row]:
    """Standard deviation, bias and honesty of the steps."""
    name, results = "model_precision", []
    for unit, k in (("px", slice(0, 2)), ("deg", slice(2, 5))):
        std = {f.label: float((f.errors.std() / limits(f.name))[k].max()) for f in found}
        bias = {f.label: float((abs(np.nanmean(f.errors.error, (0, 1))) / MAX_BIAS)[k].max()) for f in found}
        results.append(Row(name, f"std of a step, {unit}", f"{MAX_STD[k][0]:g} in the base case", *_worst(std)))
        results.append(Row(name, f"bias of a step, {unit}", f"{MAX_BIAS[k][0]:g}", *_worst(bias)))
    for circle in dict.fromkeys(f.circle for f in found):
        of_circle = [f for f in found if f.circle == circle]
        mean, single = honesty(of_circle), {f.label: beyond(f) for f in of_circle}
        inside = bool(((mean >= RATIO[0]) & (mean <= RATIO[1])).all())
        limit = "{} to {}".format(*RATIO)
        results.append(Row(name, f"stated/true of all cases, {circle} circle", limit, _numbers(mean, ".2f"), inside))
        label = max(single, key=lambda key: single[key])
        outside = sum(int(((r < RATIO[0]) | (r > RATIO[1])).sum()) for r in (ratios(f.errors)[0] for f in of_circle))
        text = f"farthest {label}: {single[label]:.1f} sampling errors beyond"
        text += f"; {outside} of {5 * len(of_circle)} components beyond"
        results.append(
            Row(name, f"stated/true of each case, {circle} circle", f"{limit}, or 3 beyond", text, single[label] <= 3)
        )
    return results


def honesty(found: Sequence[Found]) -> Array:
    """Stated over true error (5,) over the steps of all cases."""
    squared = [f.errors.error**2 / f.errors.variance for f in found]
    return 1 / np.sqrt(np.nanmean(np.concatenate([s.reshape(-1, 5) for s in squared]), axis=0))


def beyond(found: Found) -> float:
    """How far the farthest stated/true of a case is beyond the limits, in its sampling errors; infinite if unknown."""
    ratio, unsure = ratios(found.errors)
    far = np.maximum(RATIO[0] - ratio, ratio - RATIO[1]).max() / unsure
    return float(max(far, 0.0)) if np.isfinite(far) else math.inf


def _drift_rows(found: Found) -> list[Row]:
    """Worst pose and time of the drifting recording."""
    values = (
        ("position", DRIFT_PX, "px", max(t.position_px for t in found.tracked)),
        ("orientation", DRIFT_DEG, "deg", max(t.orientation_deg for t in found.tracked)),
        ("time per frame", DRIFT_MS, "ms", min(t.frame_ms for t in found.tracked)),
    )
    return [
        Row("model_precision", f"{label}, {found.label} circle", f"{limit:g} {unit}", f"{value:.4g}", value <= limit)
        for label, limit, unit, value in values
    ]


def main() -> None:
    """Measure and print; the whole run writes the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help=f"four cases: {', '.join(QUICK)}")
    parser.add_argument("--case", action="append", choices=list(CASES), help="this case alone; can be repeated")
    parser.add_argument("--pattern", action="append", type=int, help=f"seed of a pattern, by default {PATTERNS}")
    parser.add_argument("--circle", choices=CIRCLES, help="with the true or the found circle; by default both")
    parser.add_argument("--noises", type=int, default=1, help="recordings of each shot, with other noise")
    parser.add_argument("--render", action="store_true", help="only render the clean frames")
    options = parser.parse_args()
    names = options.case or (QUICK if options.quick else tuple(CASES))
    patterns, circles = options.pattern or PATTERNS, CIRCLES if options.circle is None else (options.circle,)
    if options.render:
        for name in names:
            for pattern in patterns:
                shot_of(name, pattern)
        return
    found = compute(names, circles, patterns, options.noises)
    if options.pattern:
        return
    parts = (table(HEADER, [cells(f) for f in found]), claims(rows(found)))
    if options.case or options.quick or options.circle:
        print("\n".join(parts))
    else:
        publish("model_precision", "validation.model_precision", *parts)


if __name__ == "__main__":
    main()
