"""A ball in perspective, seen along the line to its centre: there it differs little from a ball seen from afar.

Along that line the outline is a circle again. A camera at a finite distance then differs from one infinitely far away
in two ways: the ball is turned against the axes of the camera by the direction in which it is seen, and it shows less
than half of its surface. A ray that passes the centre at b radii meets the surface at the angle
``asin(b) - asin(b k)`` from its foremost point, with the nearness k, the radius over the distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere.geometry.camera import Camera, distorted, outline_distance, undistorted


@dataclass(frozen=True)
class Optics:
    """The camera, as far as the images of the ball depend on it. Image points are px, float64, lens distortion removed.

    A camera infinitely far away has ``per_focal`` 0.
    """

    principal: Tensor  # intersection of the optical axis with the image (2,), px
    per_focal: Tensor  # one over the focal length (), 1/px
    # Radial coefficients (3,), 1/px^2, 1/px^4 and 1/px^6: those of `torchsphere.geometry.camera.Camera` over powers of
    # the focal length, so that a camera infinitely far away has them, too.
    distortion: Tensor
    stretch: Tensor  # logarithm () of the pixels' width over their height, as the images show it

    @classmethod
    def of(cls, camera: Camera, device: torch.device) -> Optics:
        """The optics of a camera whose focal length and principal point are known."""
        assert camera.focal_px is not None
        assert camera.principal_px is not None
        coefficients = [k / camera.focal_px ** (2 * power) for power, k in enumerate(camera.distortion, 1)]
        given = camera.principal_px, 1 / camera.focal_px, coefficients, 0.0
        return cls(*(torch.tensor(v, dtype=torch.float64, device=device) for v in given))

    @property
    def is_distorted(self) -> bool:
        """Whether straight lines are bent in the images, or squares are not square."""
        return bool((self.distortion != 0).any() or self.stretch != 0)

    @property
    def _sides(self) -> Tensor:
        """Factors (2,) that make the pixels square, of the same area."""
        return (0.5 * self.stretch * torch.tensor([1.0, -1.0]).to(self.principal)).exp()

    def straightened(self, points: Tensor) -> Tensor:
        """Image points (..., 2) without the distortion of the lens, on square pixels."""
        if not self.is_distorted:
            return points
        return self.principal + undistorted(self._sides * (points - self.principal), self.distortion)

    def bent(self, points: Tensor) -> Tensor:
        """Image points (..., 2) with the distortion of the lens: the inverse of `straightened`."""
        if not self.is_distorted:
            return points
        return self.principal + distorted(points - self.principal, self.distortion) / self._sides

    def enlargement(self, centres: Tensor, radius: float) -> float:
        """Largest distance of an outline from the ``centres`` (n, 2) at which balls are seen, over their ``radius``."""
        return float(self._outline(centres, radius).norm(dim=-1).max()) / radius

    def outline_radius(self, centre: Tensor, radius: float) -> float:
        """Radius, px, of the circle that fits the outline of a ball of that ``radius`` seen at the ``centre`` (2,)."""
        outline = self._outline(centre.unsqueeze(0), radius)[0]
        return float((outline - outline.mean(0)).norm(dim=-1).mean())

    def _outline(self, centres: Tensor, radius: float) -> Tensor:
        """Points (n, 8, 2) of the image on the outlines of balls seen at ``centres`` (n, 2), from where these are."""
        angles = torch.arange(8, dtype=centres.dtype, device=centres.device) * (math.pi / 4)
        far = torch.full((len(centres), len(angles)), radius, dtype=centres.dtype, device=centres.device)
        if bool(self.per_focal > 0):
            camera = Camera(float(1 / self.per_focal), tuple(self.principal.tolist()))
            far = outline_distance(torch.cat((centres, far[:, :1]), 1), angles, camera)
        around = far.unsqueeze(-1) * torch.stack((angles.cos(), angles.sin()), -1)
        return self.bent(centres.unsqueeze(1) + around) - self.bent(centres).unsqueeze(1)

    def view(self, centre: Tensor) -> View:
        """The view of balls whose centres are seen at ``centre`` (n, 2)."""
        towards = (centre - self.principal) * self.per_focal
        secant = (1 + towards.square().sum(-1)).sqrt()
        ex, ey, ez = (torch.nn.functional.pad(towards, (0, 1), value=1.0) / secant.unsqueeze(-1)).unbind(-1)
        # The least turn from the optical axis to the direction of the ball.
        share = 1 / (1 + ez)
        columns = (
            torch.stack((1 - share * ex * ex, -share * ex * ey, -ex), -1),
            torch.stack((-share * ex * ey, 1 - share * ey * ey, -ey), -1),
            torch.stack((ex, ey, ez), -1),
        )
        return View(torch.stack(columns, -1), towards, secant, self.per_focal)


@dataclass(frozen=True)
class View:
    """The axes along the line to the ball's centre, in n images; float64."""

    turn: Tensor  # rotations (n, 3, 3) from these axes to those of the camera
    towards: Tensor  # tangents (n, 2) of the angles at which the centre is seen
    secant: Tensor  # distance (n,) of the centre over its depth
    per_focal: Tensor  # one over the focal length (), 1/px

    def nearness(self, radius: Tensor) -> Tensor:
        """Radius over distance (n,) of a ball of that ``radius`` (n,) at its depth, px."""
        return radius * self.per_focal / self.secant

    def offsets(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """Offsets (n, s, s) from the centre, px, at which an orthographic view would have the outline's same part.

        ``x`` and ``y`` are those in the image, which broadcast to (n, s, s).
        """
        a, b, c, d, u, v, square = (
            part.to(x).reshape(-1, 1, 1)
            for part in (*self.turn[:, :2, :2].flatten(1).unbind(1), *self.towards.unbind(1), self.secant.square())
        )
        scale = self.per_focal.to(x)
        # Length of the ray over that of the ray to the centre: no difference of large numbers for a far ball.
        longer = (1 + (2 * scale * (u * x + v * y) + scale.square() * (x.square() + y.square())) / square).sqrt()
        return (a * x + c * y) / longer, (b * x + d * y) / longer

    def along(self, orientation: Tensor) -> Tensor:
        """Orientations (n, 3, 3) from body axes to those of the view, from those to the axes of the camera."""
        return self.turn.mT @ orientation

    def motion(self, radius: Tensor) -> Tensor:
        """Motion (n, 5, 5) in the view by one (dx, dy, wx, wy, wz) in the image, px, rotations times ``radius`` (n,).

        A ball that moves sideways is seen from another side.
        """
        found = torch.zeros(len(self.turn), 5, 5, dtype=self.turn.dtype, device=self.turn.device)
        found[:, :2, :2] = self.turn[:, :2, :2].mT
        found[:, 2:, 2:] = self.turn.mT
        axis = self.turn[:, :, 2]
        for k in range(2):
            step = torch.zeros_like(axis)
            step[:, k] = radius * self.per_focal / self.secant
            found[:, 2:, k] = -(self.turn.mT @ torch.linalg.cross(axis, step).unsqueeze(-1))[..., 0]
        return found

    def shrinking(self, radius: Tensor) -> Tensor:
        """Change (n, 2) of the outline's ``radius`` (n,) with the centre, px: a ball off the axis is farther away."""
        return -(radius * self.per_focal / self.secant.square()).unsqueeze(-1) * self.towards


def orthographic(shape: tuple[int, ...], device: torch.device) -> Optics:
    """A camera infinitely far away, for images (h, w), whose axis meets their middle."""
    height, width = shape[-2:]
    zero = torch.zeros((), dtype=torch.float64, device=device)
    principal = torch.tensor(((width - 1) / 2, (height - 1) / 2), dtype=torch.float64, device=device)
    return Optics(principal, zero, torch.zeros(3, dtype=torch.float64, device=device), zero)
