"""The pattern painted on the ball: speckle cut from noise in space, without seam, pole or stretch.

White noise in a cube around the ball, smoothed by a Gaussian, is a stationary isotropic Gaussian field `z` of
variance 1. The share of light paint at the body point `p` of the unit sphere is `Phi(s (z(p) - z0))`. Here `s` is the
sharpness, and `z0` makes the mean share of dark the coverage: `E Phi(s (z - z0)) = Phi(-s z0 / sqrt(1 + s^2))`.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, optimize
from scipy.special import ndtr, ndtri

from .check import one_of, vector, within

#: Standard deviation of the smoothing kernel, in cells of the noise; from 1.2 on, the grid of the cubic spline is not
#: visible.
_CELLS_PER_SIGMA = 1.5
#: Edge of the largest noise cube, cells: 4 bytes per cell, and four times as much while the cube is computed.
_LARGEST_CUBE = 400


@dataclass(frozen=True)
class Mark:
    """A round soft dot painted over the pattern: `exp(-d^2 / (2 (diameter / 4)^2))` at the straight distance d from
    the dot's centre.

    Attributes
    ----------
    direction : (3,) tuple
        Direction from the ball's centre to the mark, body-fixed, of any length.
    diameter_mm : float
        Four standard deviations, mm.
    albedo : float
        Albedo at the dot's centre.
    """

    direction: tuple[float, float, float] = (0.0, 0.0, -1.0)
    diameter_mm: float = 2.0
    albedo: float = 0.05

    def __post_init__(self) -> None:
        """Check the values."""
        vector("direction", self.direction, 3, nonzero=True)
        within("diameter_mm", self.diameter_mm, 0.0, above=True)
        within("albedo", self.albedo, 0.0, 1.0)


@dataclass(frozen=True)
class Pattern:
    """The paint on the ball.

    Attributes
    ----------
    kind : str
        `speckle`, or `plain`: the brightest albedo everywhere.
    speckle_mm : float
        Size of the speckles, mm: full width at half maximum of the pattern's autocorrelation.
    sharpness : float
        Sharpness of the speckles' edges: 0.5 is soft clouds, 3 spray paint, 20 hard edges.
    coverage : float
        Share of dark, between 0 and 1.
    darkest, brightest : float
        Albedo of dark and of bright paint at full contrast.
    contrast : float
        1 uses the whole range between both; less moves both towards the middle of the range.
    seed : int
        Seed of the noise.
    marks : tuple of Mark
        Dots painted over the pattern.
    """

    kind: str = "speckle"
    speckle_mm: float = 1.2
    sharpness: float = 3.0
    coverage: float = 0.5
    darkest: float = 0.08
    brightest: float = 0.85
    contrast: float = 1.0
    seed: int = 0
    marks: tuple[Mark, ...] = ()

    def __post_init__(self) -> None:
        """Check the values."""
        one_of("kind", self.kind, ("speckle", "plain"))
        within("speckle_mm", self.speckle_mm, 0.0, above=True)
        within("sharpness", self.sharpness, 0.0, 1e3, above=True)
        within("coverage", self.coverage, 0.001, 0.999)
        within("darkest", self.darkest, 0.0, 1.0)
        within("brightest", self.brightest, 0.0, 1.0)
        if self.darkest > self.brightest:
            raise ValueError(f"darkest = {self.darkest}: expected no more than brightest = {self.brightest}")
        within("contrast", self.contrast, 0.0, 1.0)
        within("seed", self.seed, 0)


def albedo(pattern: Pattern, points: NDArray[np.float64], radius_mm: float) -> NDArray[np.float64]:
    """Albedo at points of the ball.

    Parameters
    ----------
    pattern : Pattern
        The paint.
    points : (n, 3) ndarray
        Unit vectors, body-fixed.
    radius_mm : float
        The ball's radius, mm.

    Returns
    -------
    (n,) ndarray
        Between 0 and 1.
    """
    middle, half = (pattern.brightest + pattern.darkest) / 2, (pattern.brightest - pattern.darkest) / 2
    if pattern.kind == "plain":
        paint = np.full(len(points), pattern.brightest)
    else:
        sigma, cube = _noise(pattern.speckle_mm / radius_mm, pattern.sharpness, pattern.coverage, pattern.seed)
        cells = (points.T * (_CELLS_PER_SIGMA / sigma)) + (len(cube) - 1) / 2
        z = ndimage.map_coordinates(cube, cells, order=3, prefilter=False)
        s = pattern.sharpness
        light = ndtr(s * z - ndtri(pattern.coverage) * math.sqrt(1 + s * s))
        paint = middle + pattern.contrast * half * (2 * light - 1)
    for mark in pattern.marks:
        direction = np.asarray(mark.direction) / np.linalg.norm(mark.direction)
        square = ((points - direction) ** 2).sum(axis=1) * radius_mm**2
        dot = np.exp(-square / (2 * (mark.diameter_mm / 4) ** 2))
        paint = paint + (mark.albedo - paint) * dot
    return paint


@functools.lru_cache(maxsize=2)
def _noise(speckle: float, sharpness: float, coverage: float, seed: int) -> tuple[float, NDArray[np.float32]]:
    """Give the noise's kernel, in ball radii, and its spline coefficients in a cube that holds the ball.

    White noise smoothed by the kernel sigma has the autocorrelation exp(-d^2 / (4 sigma^2)).
    """
    half_width = 2 * math.sqrt(-math.log(half_correlation(sharpness, coverage)))
    sigma = speckle / 2 / half_width
    edge = 2 * math.ceil(_CELLS_PER_SIGMA / sigma) + 7
    if edge > _LARGEST_CUBE:
        raise ValueError(
            f"speckle_mm is {speckle:.2g} of the ball's radius: expected at least "
            f"{speckle * edge / _LARGEST_CUBE:.2g} of it, for finer noise would not fit the memory"
        )
    white = np.random.default_rng([seed, 0x5BEC]).standard_normal((edge, edge, edge), np.float32)
    # The spline itself smooths, with a variance of 1/3 of a cell squared; the filter adds the rest of the kernel.
    cube = ndimage.gaussian_filter(white, math.sqrt(_CELLS_PER_SIGMA**2 - 1 / 3), mode="wrap", truncate=5.0)
    return sigma, cube * np.float32((2 * math.sqrt(math.pi) * _CELLS_PER_SIGMA) ** 1.5)


@functools.lru_cache(maxsize=64)
def half_correlation(sharpness: float, coverage: float) -> float:
    """Correlation of the noise at which that of the thresholded pattern is one half.

    The share of light is the probability that a second, independent noise lies below `s (z - z0)`. This is the sum of
    both noises, scaled to variance 1 and cut at the quantile q of the coverage. Two such sums have the correlation
    `rho s^2 / (1 + s^2)`. Cut at q, two variables of the correlation rho have the covariance
    `int_0^rho exp(-q^2 / (1 + r)) / (2 pi sqrt(1 - r^2)) dr`; at q = 0 it is `arcsin(rho) / (2 pi)`.

    Parameters
    ----------
    sharpness, coverage : float
        Sharpness and coverage of the pattern.

    Returns
    -------
    float
        Between 0 and 1.
    """
    limit = sharpness**2 / (1 + sharpness**2)
    square = float(ndtri(coverage)) ** 2
    nodes, weights = np.polynomial.legendre.leggauss(60)

    def covariance(rho: float) -> float:
        angle = math.asin(rho * limit) * (nodes + 1) / 2  # r = sin(angle) removes the root
        return float(math.asin(rho * limit) / 2 * (weights @ np.exp(-square / (1 + np.sin(angle)))))

    whole = covariance(1.0)
    return float(optimize.brentq(lambda rho: covariance(rho) - whole / 2, 0.0, 1.0))


@dataclass(frozen=True)
class Chart:
    """The pattern over the sphere's polar coordinates, as the renderer samples it.

    Attributes
    ----------
    albedo : (rows, columns) ndarray
        float32; the columns go around the sphere once, the rows from beyond one pole to beyond the other.
    pad : int
        Rows beyond either pole; they repeat the rows of the other side, so sampling has no edge.
    """

    albedo: NDArray[np.float32]
    pad: int


#: Texels per pixel: linear interpolation then leaves 0.05 grey levels rms (of 255) at a speckle of 10 px, fixed to the
#: body.
_TEXELS_PER_PX = 5.0
#: Smallest and largest number of texels from pole to pole.
_ROWS = (64, 2400)


@functools.lru_cache(maxsize=2)
def chart(pattern: Pattern, radius_mm: float, radius_px: float) -> Chart:
    """Sample the pattern finely enough for an image of the ball.

    A texel is a fifth of a pixel, or at most an eighth of a speckle (less for sharper edges), whichever is smaller,
    within the limits of memory. Between texels the renderer interpolates linearly.

    Parameters
    ----------
    pattern : Pattern
        The paint.
    radius_mm, radius_px : float
        The ball's radius, mm, and its radius in the image, px.

    Returns
    -------
    Chart
        Column j is at the azimuth `2 pi (j + 1/2) / columns`, row i at the polar angle `pi (i + 1/2 - pad) / (rows -
        2 pad)`, both about the body's z axis.
    """
    finest = _TEXELS_PER_PX * math.pi * radius_px
    for mark in pattern.marks:
        finest = max(finest, 12 * math.pi * radius_mm / mark.diameter_mm)
    if pattern.kind == "speckle":
        finest = max(finest, (8 + pattern.sharpness) * math.pi * radius_mm / pattern.speckle_mm)
    elif not pattern.marks:
        finest = 0.0
    rows, pad = int(np.clip(math.ceil(finest), *_ROWS)), 2
    polar = np.pi * (np.arange(-pad, rows + pad) + 0.5) / rows
    azimuth = np.pi * (np.arange(2 * rows) + 0.5) / rows
    texels = np.empty((rows + 2 * pad, 2 * rows), np.float32)
    around = np.stack([np.cos(azimuth), np.sin(azimuth), np.ones_like(azimuth)], axis=1)
    for row, angle in enumerate(polar):
        points = around * [math.sin(angle), math.sin(angle), math.cos(angle)]
        texels[row] = albedo(pattern, points, radius_mm)
    texels.flags.writeable = False  # the cache shares the array
    return Chart(texels, pad)
