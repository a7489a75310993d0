"""The sensor: from light to grey levels, with point spread, shot noise, read noise, saturation and rounding."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .check import within


@dataclass(frozen=True)
class Sensor:
    """A monochrome sensor.

    Attributes
    ----------
    bit_depth : int
        Bits of the grey levels, 8 to 16.
    gain : float
        Grey level of the light level 1, divided by full scale (2^bit_depth - 1). With 1, flat light maps albedos of 0
        to 1 to the whole range; with more, the bright parts saturate.
    offset_grey : float
        Grey level of darkness.
    blur_px : float
        Standard deviation of the optics' Gaussian point spread, px, on top of the pixel's own area.
    full_well_e : float
        Electrons in a pixel at full scale; their Poisson noise is the shot noise. 0 leaves the shot noise out.
    read_noise_grey : float
        Standard deviation of the read noise, grey levels.
    saturation_grey : float or None
        Highest grey level that is recorded; None is full scale.
    seed : int
        Seed of the noise.
    """

    bit_depth: int = 8
    gain: float = 1.0
    offset_grey: float = 0.0
    blur_px: float = 0.0
    full_well_e: float = 0.0
    read_noise_grey: float = 0.0
    saturation_grey: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the values."""
        within("bit_depth", self.bit_depth, 8, 16)
        within("gain", self.gain, 0.0, above=True)
        within("offset_grey", self.offset_grey, 0.0)
        within("blur_px", self.blur_px, 0.0)
        within("full_well_e", self.full_well_e, 0.0)
        within("read_noise_grey", self.read_noise_grey, 0.0)
        if self.saturation_grey is not None:
            within("saturation_grey", self.saturation_grey, 0.0, self.full_scale, above=True)
        within("seed", self.seed, 0)

    @property
    def full_scale(self) -> int:
        """The highest grey level."""
        return 2**self.bit_depth - 1

    def grey(self, level: NDArray[np.float64]) -> NDArray[np.float64]:
        """Grey levels without noise, saturation and rounding.

        Parameters
        ----------
        level : (h, w) ndarray
            Light; 1 is a white matt surface under flat light of level 1.

        Returns
        -------
        (h, w) ndarray
            `offset_grey + gain * full_scale * level`, after the point spread.
        """
        if self.blur_px > 0:
            level = ndimage.gaussian_filter(level, self.blur_px, mode="nearest", truncate=5.0)
        return self.offset_grey + self.gain * self.full_scale * level

    def record(self, grey: NDArray[np.float64], frame: int) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """Record a frame: noise, saturation, rounding.

        Parameters
        ----------
        grey : (h, w) ndarray
            Grey levels without noise.
        frame : int
            Number of the frame; number and seed fix the noise, so a frame rendered alone is the same.

        Returns
        -------
        (h, w) ndarray
            uint8 up to 8 bits, else uint16.
        """
        rng = np.random.default_rng([self.seed, 0x5E25, frame])
        if self.full_well_e > 0:
            electrons_per_grey = self.full_well_e / self.full_scale
            light = np.maximum(grey - self.offset_grey, 0.0)
            grey = self.offset_grey + rng.poisson(light * electrons_per_grey) / electrons_per_grey
        if self.read_noise_grey > 0:
            grey = grey + rng.normal(0.0, self.read_noise_grey, grey.shape)
        top = self.full_scale if self.saturation_grey is None else math.floor(self.saturation_grey)
        whole = np.clip(np.rint(grey), 0, top)
        return whole.astype(np.uint8) if self.bit_depth <= 8 else whole.astype(np.uint16)
