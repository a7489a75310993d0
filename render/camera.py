"""Cameras: the place of a point in the image, and the line of sight of a pixel.

Pixels: x right, y down; the centre of the top-left pixel is (0, 0) and a pixel covers half a pixel to every side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .check import one_of, vector, within


@dataclass(frozen=True)
class Camera:
    """A camera at the origin that looks along +z.

    Attributes
    ----------
    model : str
        `orthographic` or `pinhole`.
    width, height : int
        Size of the image, px.
    scale_px_per_mm : float
        Scale of the orthographic camera.
    focal_px : float
        Focal length of the pinhole, px.
    principal_px : (2,) tuple or None
        Where the optical axis meets the image, px (x, y); None is the middle of the image.
    distortion : (3,) tuple
        k1, k2, k3 of the pinhole's radial distortion, in OpenCV's convention: a point at (x, y) on the plane z = 1,
        with r^2 = x^2 + y^2, is imaged at (x, y) (1 + k1 r^2 + k2 r^4 + k3 r^6).
    """

    model: str = "orthographic"
    width: int = 512
    height: int = 256
    scale_px_per_mm: float = 10.0 / 3.0
    focal_px: float = 2000.0
    principal_px: tuple[float, float] | None = None
    distortion: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Check the values."""
        one_of("model", self.model, ("orthographic", "pinhole"))
        within("width", self.width, 1)
        within("height", self.height, 1)
        within("scale_px_per_mm", self.scale_px_per_mm, 0.0, above=True)
        within("focal_px", self.focal_px, 0.0, above=True)
        if self.principal_px is not None:
            vector("principal_px", self.principal_px, 2)
        vector("distortion", self.distortion, 3)
        if self.model == "orthographic" and any(self.distortion):
            raise ValueError(f"distortion = {self.distortion}: expected zeros, for only the pinhole camera has it")
        if self.model == "pinhole" and np.isnan(self.undistort(np.asarray(self._farthest()))):
            raise ValueError(
                f"distortion = {self.distortion}: the image folds over within the frame, so that a pixel would see no "
                "point or several; expected smaller coefficients or a longer focal_px"
            )

    @property
    def centre_px(self) -> tuple[float, float]:
        """Where the optical axis meets the image, px (x, y)."""
        return self.principal_px or ((self.width - 1) / 2, (self.height - 1) / 2)

    def px_per_m(self, depth_m: float) -> float:
        """Scale of the image at a depth, on the optical axis.

        Parameters
        ----------
        depth_m : float
            z, m; the orthographic camera ignores it.

        Returns
        -------
        float
            px per m.
        """
        return 1000.0 * self.scale_px_per_mm if self.model == "orthographic" else self.focal_px / depth_m

    def project(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Project points into the image.

        Parameters
        ----------
        points_m : (n, 3) ndarray
            Points in the camera frame, m.

        Returns
        -------
        (n, 2) ndarray
            x and y, px; NaN for points beside or behind the pinhole camera, and for points beyond the angle at which
            the distortion folds the image over.
        """
        points_m = np.asarray(points_m, dtype=np.float64)
        centre = np.asarray(self.centre_px)
        if self.model == "orthographic":
            return centre + 1000.0 * self.scale_px_per_mm * points_m[:, :2]
        depth = np.where(points_m[:, 2:] > 0, points_m[:, 2:], np.nan)
        plane = points_m[:, :2] / depth
        radius = np.hypot(plane[:, :1], plane[:, 1:])
        seen = np.where(radius < self._fold(), radius, np.nan)
        return centre + self.focal_px * plane * self._stretch(seen)

    def undistort(self, radius: NDArray[np.float64]) -> NDArray[np.float64]:
        """Undo the distortion.

        Parameters
        ----------
        radius : (...) ndarray
            Distorted distances from the principal point, divided by the focal length.

        Returns
        -------
        (...) ndarray
            Distances without distortion, on the plane z = 1; NaN if no point is imaged there.
        """
        seen = np.asarray(radius, dtype=np.float64)
        if not any(self.distortion):
            return seen
        low, high = np.zeros_like(seen), np.full_like(seen, min(self._fold(), 1e3))
        outside = high * self._stretch(high) < seen
        for _ in range(80):  # bisection, to double precision
            middle = (low + high) / 2
            short = middle * self._stretch(middle) < seen
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        return np.where(outside, np.nan, (low + high) / 2)

    def _stretch(self, radius: NDArray[np.float64]) -> NDArray[np.float64]:
        k1, k2, k3 = self.distortion
        square = radius * radius
        return 1 + square * (k1 + square * (k2 + square * k3))

    def _fold(self) -> float:
        """Radius on the plane z = 1 beyond which the distorted radius decreases; infinite if there is none."""
        k1, k2, k3 = self.distortion
        roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])  # of d/dr (r + k1 r^3 + k2 r^5 + k3 r^7), in r^2
        real = roots.real[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)]
        return float(np.sqrt(real.min())) if real.size else float("inf")

    def _farthest(self) -> float:
        """Distance of the frame's farthest corner from the principal point over the focal length."""
        x, y = self.centre_px
        across = max(abs(x + 0.5), abs(self.width - 0.5 - x))
        down = max(abs(y + 0.5), abs(self.height - 0.5 - y))
        return float(np.hypot(across, down)) / self.focal_px
