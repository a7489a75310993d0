"""The backdrop, and still objects before, beside or behind the ball."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .check import one_of, vector, within


@dataclass(frozen=True)
class StillObject:
    """A matt object fixed in space: a target plate, an anvil, a bar, or an occluder before the ball.

    Attributes
    ----------
    kind : str
        `box`, or `bar`: a round bar, along z before the rotation.
    centre_m : (3,) tuple
        Centre, m, in the camera frame.
    size_m : (3,) tuple
        Edges along x, y, z before the rotation, m; for a bar its diameter twice, then its length.
    turn_deg : (3,) tuple
        Rotation vector, degrees.
    albedo : float
        Share of the light that the surface reflects.
    """

    kind: str = "box"
    centre_m: tuple[float, float, float] = (0.03, 0.0, 0.0)
    size_m: tuple[float, float, float] = (0.01, 0.06, 0.06)
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    albedo: float = 0.4

    def __post_init__(self) -> None:
        """Check the values."""
        one_of("kind", self.kind, ("box", "bar"))
        vector("centre_m", self.centre_m, 3)
        vector("size_m", self.size_m, 3)
        for edge in self.size_m:
            within("size_m", edge, 0.0, above=True)
        if self.kind == "bar" and self.size_m[0] != self.size_m[1]:
            raise ValueError(f"size_m = {self.size_m}: expected a bar's diameter twice, then its length")
        vector("turn_deg", self.turn_deg, 3)
        within("albedo", self.albedo, 0.0, 1.0)

    @property
    def reach_m(self) -> float:
        """Radius of the sphere around the centre that holds the object, m."""
        return float(np.linalg.norm(self.size_m)) / 2


@dataclass(frozen=True)
class Background:
    """The backdrop, far behind everything and lit separately, and the still objects.

    Attributes
    ----------
    kind : str
        `uniform`, `texture` (smooth random grain that stays where it is) or `dark` (level 0).
    level : float
        Mean level; 1 is full scale on a sensor with gain 1.
    contrast : float
        Standard deviation of the texture over its mean level.
    grain_px : float
        Size of the texture's grains, px: full width at half maximum of its autocorrelation.
    seed : int
        Seed of the texture.
    objects : tuple of StillObject
        Target, occluder and the like; lit by the lights of the scene.
    """

    kind: str = "uniform"
    level: float = 0.3
    contrast: float = 0.3
    grain_px: float = 6.0
    seed: int = 0
    objects: tuple[StillObject, ...] = ()

    def __post_init__(self) -> None:
        """Check the values."""
        one_of("kind", self.kind, ("uniform", "texture", "dark"))
        within("level", self.level, 0.0)
        within("contrast", self.contrast, 0.0)
        within("grain_px", self.grain_px, 2.0)
        within("seed", self.seed, 0)

    def image(self, height: int, width: int) -> NDArray[np.float64]:
        """Levels of the backdrop.

        Parameters
        ----------
        height, width : int
            Size of the image, px.

        Returns
        -------
        (height, width) ndarray
            Levels, never below 0.
        """
        level = 0.0 if self.kind == "dark" else self.level
        flat = np.full((height, width), level)
        if self.kind != "texture":
            return flat
        # Full width of the autocorrelation of white noise filtered by a Gaussian: 2 sqrt(2 ln 2) sqrt(2) sigma.
        sigma = self.grain_px / (4 * np.sqrt(np.log(2)))
        margin = int(np.ceil(4 * sigma)) + 1
        white = np.random.default_rng([self.seed, 0xBAC]).standard_normal((height + 2 * margin, width + 2 * margin))
        grain = ndimage.gaussian_filter(white, sigma)[margin:-margin, margin:-margin] * (2 * np.sqrt(np.pi) * sigma)
        return np.maximum(flat * (1 + self.contrast * grain), 0.0)


def still_shapes(thing: StillObject, unit_m: float) -> list[dict[str, Any]]:
    """Give the shapes that make up a still object.

    Parameters
    ----------
    thing : StillObject
        The object.
    unit_m : float
        Length of the scene's unit, m.

    Returns
    -------
    list of dict
        For `mitsuba.load_dict`.
    """
    import mitsuba as mi

    transform = mi.ScalarTransform4f()
    place = transform.translate([c / unit_m for c in thing.centre_m])
    angle = float(np.linalg.norm(thing.turn_deg))
    if angle > 0:
        place = place @ transform.rotate([part / angle for part in thing.turn_deg], angle)
    half = [edge / 2 / unit_m for edge in thing.size_m]
    place = place @ transform.scale(half)
    matt = {"type": "diffuse", "reflectance": {"type": "rgb", "value": thing.albedo}}
    if thing.kind == "box":
        return [{"type": "cube", "to_world": place, "bsdf": matt}]
    ends = [
        place @ transform.translate([0, 0, 1]),
        place @ transform.translate([0, 0, -1]) @ transform.scale([1, 1, -1]),
    ]
    side = {"type": "cylinder", "to_world": place, "p0": [0, 0, -1], "p1": [0, 0, 1], "bsdf": matt}
    return [side, *({"type": "disk", "to_world": end, "bsdf": matt} for end in ends)]
