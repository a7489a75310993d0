"""Figure 3, motion blur against noise and interpolation: ``python -m experiments.paper.fig03``.

Claim: with wider motion blur the measurement is more sensitive to noise; the error of the interpolation between grey
levels first falls with the blur, and then grows.

Paper: blur of 2 to 20 px along the motion; noise of 1 to 8 grey levels on an image that does not move, the error of x
averaged over the noises; the image moved by 0 to 1 px, the error averaged over the shifts. The curves have no numbers.

Here: the light of a rendered ball of 50 px in steps of 1/20 px, whose means over a path are its exact motion blur; two
patterns, the five modes of torchsphere, the true circle. The noise is the sensor's, added to both blurred images; or as
printed, added to the sharp image before the blur, which then removes most of the noise. The interpolation error comes
from images without noise: with torchsphere's pre-blur of 1 px and without; of true motion, or moved by a cubic spline
as in the paper; with and without rounding to whole grey levels. The rounding causes the growth with the blur: without
rounding the error only falls. Without pre-blur, images of 18 and 20 px blur are refused because of their weak texture;
the rows say which share of the pairs. Errors are taken over the pairs that were measured.

The result is kept in ``experiments/cache``; delete it after a change to the package or the renderer that leaves the
version as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage
from tqdm import tqdm

import torchsphere as ts
from experiments.experiment import (
    BLUE,
    FIGURES,
    GREEN,
    ORANGE,
    SKY,
    VERMILION,
    Array,
    Row,
    cached,
    claims,
    decided,
    saved_figure,
    table,
)
from experiments.paper.still_ball import RADIUS_PX, SAMPLES, SHIFTS_PX, Circle, ball, rendered

PATTERNS = (0, 1)
BLURS_PX = tuple(range(0, 22, 2))
NOISES_GREY = tuple(range(1, 9))
#: Pairs per pattern, blur and noise.
REPEATS = 6
STEPS_PER_PX = len(SHIFTS_PX)
#: Room for the blur beside the ball, px.
EXTRA_WIDTH_PX = 24

#: Least ratio of a curve's end to its start (it grows), or of its ends to its minimum (it falls, then grows).
TURN = 1.5
#: Relative distance from it within which a verdict is left open: another machine may differ in the last digits.
MARGIN = 0.15

#: Where the noise enters, and how the interpolation is tried: pre-blur, px, whole grey levels, moved by the spline.
PRINTED_NOISE = "noise in one image before the blur, as printed"
NOISE_KINDS = ("noise of the sensor, in both images", PRINTED_NOISE)
INTERPOLATIONS = {
    "pre-blur 1 px": (1.0, False, False),
    "pre-blur 1 px, 8 bit": (1.0, True, False),
    "no pre-blur": (0.0, False, False),
    "no pre-blur, 8 bit": (0.0, True, False),
    "no pre-blur, 8 bit, moved by a spline": (0.0, True, True),
}
#: What of these is not the paper's condition: 8 bits, moved by a spline, without a pre-blur.
OTHER_CONDITIONS = {
    "pre-blur 1 px": "pre-blur, and no rounding to grey levels",
    "pre-blur 1 px, 8 bit": "the paper has no pre-blur",
    "no pre-blur": "no rounding to grey levels",
    "no pre-blur, 8 bit": "the true motion in place of a spline's",
}
COLORS = (BLUE, SKY, VERMILION, ORANGE, GREEN)


@dataclass(frozen=True)
class Result:
    """Errors of x (patterns, blurs, values, repeats) by where the noise enters, and (patterns, blurs, shifts), px."""

    noise: dict[str, Array]
    interpolation: dict[str, Array]

    def sensitivity(self, kind: str) -> Array:
        """Rms error of x by noise over the pairs that were measured, averaged over the noises, (blurs,), px."""
        return np.asarray(np.sqrt(np.nanmean(self.noise[kind] ** 2, axis=(0, 3))).mean(axis=1))

    def refused(self, kind: str) -> float:
        """Share of the pairs with noise that were refused."""
        return float(1 - np.isfinite(self.noise[kind]).mean())

    def bias(self, kind: str) -> Array:
        """Mean absolute error of x over the shifts that were measured, (blurs,), px; NaN if none was."""
        error = self.interpolation[kind]
        known = np.isfinite(error).sum(axis=(0, 2))
        return np.asarray(np.nansum(np.abs(error), axis=(0, 2)) / np.where(known > 0, known, np.nan))

    def measured(self, kind: str) -> Array:
        """Share of the pairs that were measured, (blurs,)."""
        return np.asarray(np.isfinite(self.interpolation[kind]).mean(axis=(0, 2)))


def light_of(seed: int) -> tuple[Array, Circle]:
    """Light (20, h, w) of the ball in steps of 1/20 px, and its circle in the first image."""
    setup, circle = ball(RADIUS_PX, seed, EXTRA_WIDTH_PX)
    return rendered(setup, SHIFTS_PX, np.zeros(STEPS_PER_PX), f"pattern {seed}"), circle


def blurred(light: Array, blur_px: int, step: int) -> Array:
    """Mean light (h, w) while the ball moves by ``blur_px`` around the shift of ``step`` twentieths of a px."""
    half = blur_px * STEPS_PER_PX // 2
    total = np.zeros(light.shape[1:])
    for at in range(step - half, step + half + 1):
        whole, part = divmod(at, STEPS_PER_PX)
        # The ends of the path count half: the trapezoidal rule. The background is uniform, so that it may wrap around.
        total += (0.5 if half and abs(at - step) == half else 1.0) * np.roll(light[part], whole, axis=1)
    return total / max(2 * half, 1)


def box_blurred(image: Array, blur_px: int) -> Array:
    """The image (..., h, w) with a motion blur of an even number of px along x, by convolution."""
    kernel = np.ones(blur_px + 1)
    kernel[[0, -1]] = 0.5 if blur_px else 1.0
    return np.asarray(ndimage.convolve1d(image, kernel / kernel.sum(), axis=-1, mode="nearest"))


def _measured_x(f: Array, g: Array, circle: Circle, pre_blur: float = 1.0) -> Array:
    """Measured motion along x (n,) of n pairs, NaN if not measured."""
    pairs = ts.correlate(
        np.broadcast_to(f, g.shape).astype(np.float32), g.astype(np.float32), circle, pre_blur=pre_blur
    )
    return pairs.q[:, 0].double().numpy()


def _grey(light: Array) -> Array:
    return np.clip(np.rint(light), 0, 255)


def _noise_errors(light: Array, circle: Circle, kind: str, rng: np.random.Generator) -> list[Any]:
    """Errors of x (blurs, noises, repeats)."""
    found = []
    for blur_px in BLURS_PX:
        still = blurred(light, blur_px, 0)
        per_noise = []
        for noise in NOISES_GREY:
            drawn = rng.normal(0.0, noise, (2, REPEATS, *still.shape))
            if kind == NOISE_KINDS[0]:
                f, g = _grey(still + drawn[0]), _grey(still + drawn[1])
            else:
                f, g = _grey(still)[None], _grey(still + box_blurred(drawn[1], blur_px))
            per_noise.append(_measured_x(f, g, circle).tolist())
        found.append(per_noise)
    return found


def _interpolation_errors(light: Array, circle: Circle, kind: str) -> list[Any]:
    """Errors of x (blurs, shifts)."""
    pre_blur, whole_grey, by_spline = INTERPOLATIONS[kind]
    found = []
    for blur_px in BLURS_PX:
        if by_spline:
            moved = [ndimage.shift(light[0], (0.0, shift), order=3, mode="nearest") for shift in SHIFTS_PX]
            g = box_blurred(np.stack(moved), blur_px)
        else:
            g = np.stack([blurred(light, blur_px, step) for step in range(STEPS_PER_PX)])
        g = _grey(g) if whole_grey else g
        found.append((_measured_x(g[0], g, circle, pre_blur) - SHIFTS_PX).tolist())
    return found


def _measure() -> dict[str, dict[str, list[Any]]]:
    found: dict[str, dict[str, list[Any]]] = {"noise": {}, "interpolation": {}}
    for seed in tqdm(PATTERNS, "patterns"):
        light, circle = light_of(seed)
        for kind in NOISE_KINDS:
            errors = _noise_errors(light, circle, kind, np.random.default_rng(seed))
            found["noise"].setdefault(kind, []).append(errors)
        for kind in INTERPOLATIONS:
            errors = _interpolation_errors(light, circle, kind)
            found["interpolation"].setdefault(kind, []).append(errors)
    return found


def compute() -> Result:
    """Errors of x by kind, over the width of the blur."""
    settings = [PATTERNS, BLURS_PX, NOISES_GREY, REPEATS, STEPS_PER_PX, RADIUS_PX, SAMPLES, NOISE_KINDS, INTERPOLATIONS]
    raw = cached("fig03", settings, _measure)
    return Result(*({kind: np.array(e) for kind, e in raw[part].items()} for part in ("noise", "interpolation")))


def plot(result: Result) -> None:
    """Both errors over the width of the blur."""
    with saved_figure(FIGURES / "fig03.png", (12, 4.4), dpi=110) as figure:
        left, right = figure.subplots(1, 2)
        for kind, color in zip(NOISE_KINDS, COLORS[::2], strict=False):
            left.plot(BLURS_PX, result.sensitivity(kind), "o-", color=color, label=kind)
        left.set_title("noise of 1 to 8 grey levels")
        left.set_ylabel("rms error of x (px)")
        left.set_ylim(bottom=0)
        for kind, color in zip(INTERPOLATIONS, COLORS, strict=True):
            right.plot(BLURS_PX, result.bias(kind), "o-", color=color, label=kind)
        right.set_title("shift of 0 to 1 px, no noise")
        right.set_ylabel("mean absolute error of x (px)")
        right.set_yscale("log")
        for axis in (left, right):
            axis.set_xlabel("motion blur (px)")
            axis.legend()


def rows(result: Result) -> list[Row]:
    """The claims of the figure."""
    found = []
    for kind in NOISE_KINDS:
        error = result.sensitivity(kind)[1:]
        grows = decided(float(error[-1] / error[0]), TURN, MARGIN)
        ours = f"{error[0]:.4f} px at a blur of 2 px, {error[-1]:.4f} at 20{_refused(result.refused(kind))}"
        other = "" if kind == PRINTED_NOISE else "the paper adds the noise before the blur"
        found.append(Row("fig03", f"the error by noise grows with the blur ({kind})", "grows", ours, grows, other))
    for kind in INTERPOLATIONS:
        error = result.bias(kind)
        least = int(np.nanargmin(error))
        last = int(np.flatnonzero(np.isfinite(error))[-1])
        turns = decided(float(min(error[0], error[last]) / error[least]), TURN, MARGIN)
        places = (f"{error[i]:.5f} px at {BLURS_PX[i]} px" for i in (0, least, last))
        ours = "{}, least {}, {}".format(*places)
        ours += _refused(1 - float(result.measured(kind).mean()))
        claim = f"the error of interpolation falls with the blur, then grows ({kind})"
        found.append(Row("fig03", claim, "falls, then grows", ours, turns, OTHER_CONDITIONS.get(kind, "")))
    return found


def _refused(share: float) -> str:
    return f"; {100 * share:.0f} % of the pairs refused as of weak texture" if share else ""


def main() -> None:
    """Measure, draw, and print the table."""
    result = compute()
    plot(result)
    lines = [[kind, *(f"{v:.4f}" for v in result.sensitivity(kind))] for kind in NOISE_KINDS]
    for kind in INTERPOLATIONS:
        pairs = zip(result.bias(kind), result.measured(kind), strict=True)
        cells = (f"{error:.5f}" + ("" if share == 1 else f" ({100 * share:.0f} % measured)") for error, share in pairs)
        lines.append([f"interpolation: {kind}", *cells])
    print(table(("error of x (px) at a blur of (px)", *map(str, BLURS_PX)), lines))
    print(claims(rows(result)))


if __name__ == "__main__":
    main()
