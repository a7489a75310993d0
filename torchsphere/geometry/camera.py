"""A camera near the ball: rays, the ball's outline under perspective, and the lens's distortion.

Under perspective the outline is an ellipse, and its centre is not the projected centre of the ball. In this package the
ball's position is the projected centre, and its radius is ``focal_px / distance``, the distance in radii.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
from torch import Tensor

from torchsphere.settings.limits import SettingError, as_float, as_positive

#: Steps that invert the distortion; each gains about two digits at the corners of usual lenses.
INVERSION_STEPS = 12

#: Least distance of the camera from the ball's centre, radii (docs/constants.toml).
MIN_DISTANCE_RADII = 1.5

#: Rays on which a circle is compared with the outline of a sphere, and rounds of the fit.
RAYS, ROUNDS = 90, 8


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with radial distortion, as calibration programs give it (OpenCV's convention).

    Attributes
    ----------
    focal_px : float, optional
        Focal length over the size of a pixel, px. Give either ``focal_px`` or ``distance_radii``.
    principal_px : tuple of float, optional
        Intersection of the optical axis with the image (x, y), px; by default the middle of the image.
    distortion : tuple of float
        Radial coefficients (k1, k2, k3): a ray at the radius r over the focal length appears at
        ``r (1 + k1 r^2 + k2 r^4 + k3 r^6)``.
    distance_radii : float, optional
        Distance of the ball's centre along the optical axis in the first frame, in radii of the ball; the focal length
        follows from the size of the outline.
    """

    focal_px: float | None = None
    principal_px: tuple[float, float] | None = None
    distortion: tuple[float, float, float] = (0.0, 0.0, 0.0)
    distance_radii: float | None = None

    def __post_init__(self) -> None:
        if (self.focal_px is None) == (self.distance_radii is None):
            raise ValueError("camera: give either the focal length in px or the ball's distance in radii, not both")
        if self.focal_px is not None:
            as_positive("camera: focal_px", self.focal_px, "a finite, positive number of px")
        if self.distance_radii is not None and not 1 < as_float(self.distance_radii) < math.inf:
            raise ValueError(f"camera: distance_radii = {self.distance_radii!r}: expected a number above 1")
        for name, count in (("principal_px", 2), ("distortion", 3)):
            values: Any = getattr(self, name)
            if values is None:
                continue
            found = tuple(map(as_float, values)) if isinstance(values, Iterable) else ()
            if not (len(found) == count and all(map(math.isfinite, found))):
                raise ValueError(f"camera: {name} = {values!r}: expected {count} finite numbers")
            # A tuple, since calibration programs give arrays, which cannot be compared.
            object.__setattr__(self, name, found)

    @classmethod
    def of_numbers(cls, given: Mapping[str, Any], diameter_mm: float | None) -> Camera:
        """The camera of those numbers of the command line that were ``given``, of a ball of that diameter, mm."""
        known = dict(given)
        if "distance_mm" in known:
            distance_mm = as_positive("distance_mm", known.pop("distance_mm"))
            if diameter_mm is None:
                raise ValueError("distance_mm was given without diameter_m; the distance in radii needs both")
            known["distance_radii"] = 2 * distance_mm / diameter_mm
        return cls(**known)

    @classmethod
    def of_settings(cls, settings: Mapping[str, Any]) -> Camera | None:
        """The camera in the settings of a track, where it is a table of its numbers; None without one."""
        camera = settings.get("camera")
        return cls(**camera) if isinstance(camera, Mapping) else camera

    def settled(self, shape: tuple[int, ...], outline_radius: float = math.nan) -> Camera:
        """The camera with focal length and principal point, for images (h, w) of a ball of that radius, px."""
        height, width = shape[-2:]
        focal = self.focal_px
        if self.distance_radii is not None:
            # The cone that touches a ball on the axis: tan of its half angle is 1 / sqrt(D^2 - 1).
            focal = outline_radius * math.sqrt(self.distance_radii**2 - 1)
        principal = self.principal_px or ((width - 1) / 2, (height - 1) / 2)
        return Camera(focal, principal, self.distortion)

    def reduced(self, factor: int) -> Camera:
        """The camera of images whose pixels are the means of ``factor`` x ``factor`` pixels."""
        assert self.focal_px is not None
        assert self.principal_px is not None
        x, y = ((v + 0.5) / factor - 0.5 for v in self.principal_px)
        return dataclasses.replace(self, focal_px=self.focal_px / factor, principal_px=(x, y))


def require_distance(camera: Camera, outline_radius: float) -> None:
    """Raise SettingError if the camera is too near to a ball whose outline has that radius, px."""
    assert camera.focal_px is not None
    distance = math.hypot(1.0, camera.focal_px / outline_radius)
    if distance < MIN_DISTANCE_RADII:
        raise SettingError(
            f"`focal_px` = {camera.focal_px:g}: an outline with a radius of {outline_radius:.1f} px is then seen from "
            f"{distance:.2f} radii, expected {MIN_DISTANCE_RADII:g} or more; give the focal length over the size of a "
            "pixel"
        )


class View(NamedTuple):
    """View of one ball by a camera; a batch has one more axis in front."""

    centre: Tensor  # projected centre of the ball (2,), px from the principal point
    focal: Tensor  # focal length, a scalar, px
    distortion: Tensor | None  # radial coefficients (3,); None where they are all 0


def view_of(camera: Camera, centres: Tensor, like: Tensor) -> View:
    """Views of balls seen at ``centres`` (n, 2), px; in the precision and on the device of ``like``."""
    assert camera.focal_px is not None
    assert camera.principal_px is not None
    n = len(centres)
    offset = centres - torch.tensor(camera.principal_px, dtype=centres.dtype, device=centres.device)
    focal, distortion = (
        torch.tensor(v, dtype=like.dtype, device=like.device) for v in (camera.focal_px, camera.distortion)
    )
    return View(offset.to(like), focal.expand(n), distortion.expand(n, 3) if any(camera.distortion) else None)


def distorted(rays: Tensor, distortion: Tensor | None) -> Tensor:
    """Image points over the focal length (..., 2) of ``rays`` (..., 2), tangents of their angles."""
    if distortion is None:
        return rays
    r2 = rays.square().sum(-1, keepdim=True)
    k1, k2, k3 = (k[..., None] for k in distortion.unbind(-1))
    return rays * (1 + r2 * (k1 + r2 * (k2 + r2 * k3)))


def undistorted(seen: Tensor, distortion: Tensor | None) -> Tensor:
    """The inverse of `distorted`, by fixed-point steps of the rays' scale."""
    if distortion is None:
        return seen
    square = seen.square().sum(-1, keepdim=True)
    scale = torch.ones_like(square)
    k1, k2, k3 = (k[..., None] for k in distortion.unbind(-1))
    for _ in range(INVERSION_STEPS):
        r2 = scale.square() * square
        scale = 1 / (1 + r2 * (k1 + r2 * (k2 + r2 * k3)))
    return scale * seen


def distortion_slope(rays: Tensor, distortion: Tensor) -> Tensor:
    """Derivative (..., 2, 2) of `distorted` at ``rays`` (..., 2)."""
    k1, k2, k3 = (k[..., None] for k in distortion.unbind(-1))
    r2 = rays.square().sum(-1, keepdim=True)
    gain, change = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), k1 + r2 * (2 * k2 + 3 * r2 * k3)
    outer = rays[..., :, None] * (2 * change * rays)[..., None, :]
    return outer + gain[..., None] * torch.eye(2, dtype=rays.dtype, device=rays.device)


def outline_distance(circles: Tensor, angles: Tensor, camera: Camera) -> Tensor:
    """Distance (n, a), px, of the outline from the projected centre at ``angles`` (a,), rad, in the image.

    ``circles`` (n, 3): projected centre and radius, px, float64. On the outline a ray's angle with the direction of the
    centre has the sine 1 / |C|, with the distance |C| in radii; Newton steps find it under distortion.
    """
    view = view_of(camera, circles[:, :2], circles)
    focal = view.focal[:, None]
    centre = undistorted(view.centre / focal, view.distortion)
    axis = torch.cat((centre, torch.ones_like(centre[:, :1])), -1)
    distance = focal[:, 0] / circles[:, 2] * axis.norm(dim=-1)
    sine2 = (1 / distance.clamp_min(1 + 1e-9)).square()
    direction = torch.stack((angles.cos(), angles.sin()), -1)
    reach = circles[:, 2:].expand(-1, len(angles)).clone()
    for _ in range(ROUNDS):
        value, slope = _cone_distance(reach, view, direction, axis, sine2)
        reach = reach - value / slope
    return reach


def _cone_distance(reach: Tensor, view: View, direction: Tensor, axis: Tensor, sine2: Tensor) -> tuple[Tensor, Tensor]:
    """Distance of rays at ``reach`` (n, a), px, from the tangent cone, as a sine, and its derivative."""
    focal, distortion = view.focal[:, None, None], None if view.distortion is None else view.distortion[:, None]
    rays = undistorted((view.centre[:, None] + reach[..., None] * direction) / focal, distortion)
    change = direction / focal
    if distortion is not None:
        change = torch.linalg.solve(distortion_slope(rays, distortion), change)
    # Sine of the angle between ray and axis by the cross product: it stays exact for a far camera.
    offset = rays - axis[:, None, :2]
    along_z = axis[:, None, 0] * offset[..., 1] - axis[:, None, 1] * offset[..., 0]
    turned = axis[:, None, 0] * change[..., 1] - axis[:, None, 1] * change[..., 0]
    axis2 = axis.square().sum(-1, keepdim=True)
    lengths = (rays.square().sum(-1) + 1) * axis2
    sine = ((offset.square().sum(-1) + along_z.square()) / lengths).sqrt()
    slope = (offset * change).sum(-1) + along_z * turned - sine.square() * (rays * change).sum(-1) * axis2
    return sine - sine2.sqrt()[:, None], slope / (sine * lengths)


def sphere_of_outline(circle: Tensor, camera: Camera) -> Tensor:
    """Projected centre and radius (3,), px, float64, of the sphere whose outline is nearest to a circle (3,)."""
    angles = torch.arange(RAYS, dtype=torch.float64) * (2 * math.pi / RAYS)
    direction = torch.stack((angles.cos(), angles.sin()), -1)
    sphere = circle.to(torch.float64).clone()
    for _ in range(ROUNDS):
        points = sphere[:2] + outline_distance(sphere[None], angles, camera)[0][:, None] * direction
        sphere = sphere + circle - _circle_through(points)
    return sphere


def _circle_through(points: Tensor) -> Tensor:
    """Least-squares circle (3,) through points (a, 2), by geometric distance."""
    circle = torch.cat((points.mean(0), (points - points.mean(0)).norm(dim=-1).mean()[None]))
    for _ in range(ROUNDS):
        offset = points - circle[:2]
        distance = offset.norm(dim=-1)
        design = torch.cat((offset / distance[:, None], torch.ones_like(distance)[:, None]), -1)
        circle = circle + torch.linalg.lstsq(design, (distance - circle[2])[:, None]).solution[:, 0]
    return circle
