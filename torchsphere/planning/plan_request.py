"""The settings of ``torchsphere plan``: test, camera, look of the ball, or a recording of a free flight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from torchsphere.settings.choices import MAPS
from torchsphere.settings.limits import SettingError, require_positive, within
from torchsphere.settings.setting import (
    NUMBER,
    PATH,
    WHOLE,
    Group,
    Setting,
    check_ranges,
    finite,
    numbers,
    one_of,
    positive,
    settings_of,
    switch,
)

TEST = Group("the test")
CAMERA = Group("the camera")
LOOK = Group("what the ball looks like: images of it, a rendered pattern, or a free flight")

#: Settings that a plan needs where no flight is given, and settings that a flight replaces.
NEEDED = ("speed", "fps", "shutter_us", "px_per_mm", "diameter_mm", "mass_g", "noise")
REPLACED_BY_FLIGHT = (
    "speed",
    "px_per_mm",
    "noise",
    "image",
    "speckle_px",
    "grey",
    "modes",
    "field_mm",
    "blurred",
    "direction_deg",
    "spin_rev_s",
)

Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class PlanRequest:
    """What to plan; each field is a setting that its `Setting` describes.

    Raises
    ------
    SettingError
        Where a setting is out of its range, is missing, or contradicts another.
    """

    speed: Annotated[float | None, positive(TEST, "V", "of the ball, m/s")] = None
    direction_deg: Annotated[float, finite(TEST, "A", "of its flight, deg from right towards down")] = 0.0
    spin_rev_s: Annotated[Vector, Setting(numbers("X,Y,Z"), TEST, "X,Y,Z", "its spin, rev/s (0,0,0)")] = (0.0, 0.0, 0.0)
    diameter_mm: Annotated[float | None, positive(TEST, "D", "diameter of the ball, mm")] = None
    mass_g: Annotated[float | None, positive(TEST, "M", "mass of the ball, g")] = None
    contact_us: Annotated[float | None, positive(TEST, "T", "duration of the contact, us (elastic, Hertz)")] = None
    restitution: Annotated[float, Setting(NUMBER, TEST, "E", "speed after over speed before", within((0.0, 1.0)))] = 0.3
    fps: Annotated[float | None, positive(CAMERA, "F", "frame rate, 1/s")] = None
    shutter_us: Annotated[float | None, positive(CAMERA, "T", "exposure time, us")] = None
    px_per_mm: Annotated[float | None, positive(CAMERA, "P", "scale in the ball's plane (--circle's)")] = None
    noise: Annotated[float | None, positive(CAMERA, "S", "sd of a pixel between images, grey levels")] = None
    width: Annotated[
        int | None,
        Setting(WHOLE, CAMERA, "W", "of the image along the flight, px, for frames in view", require_positive),
    ] = None
    modes: Annotated[Path | None, Setting(PATH, CAMERA, "FILE.csv", "its modes: width_px, height_px, fps_max")] = None
    field_mm: Annotated[float | None, positive(CAMERA, "W", "width that all modes show, mm (they keep px per mm)")] = (
        None
    )
    map: Annotated[
        str,
        one_of(
            tuple(MAPS),
            CAMERA,
            "as in 'track': the impact is measured on a map of the ball, or (off) by steps from pairs",
        ),
    ] = "auto"
    image: Annotated[
        Sequence[Path], Setting(PATH, LOOK, "FILE", "sharp image; again for other sides", repeats=True)
    ] = ()
    circle: Annotated[
        Sequence[Vector],
        Setting(numbers("X,Y,R"), LOOK, "X,Y,R", "outline in it, px (in the flight: found)", repeats=True),
    ] = ()
    blurred: Annotated[bool, switch(LOOK, "the images show the test's motion blur")] = False
    speckle_px: Annotated[float | None, positive(LOOK, "S", "size of the rendered spots, px (4)")] = None
    grey: Annotated[
        tuple[float, float] | None, Setting(numbers("LOW,HIGH"), LOOK, "LOW,HIGH", "their grey levels (30,220)")
    ] = None
    flight: Annotated[
        Path | None, Setting(PATH, LOOK, "INPUT", "recording, or result of 'track', without a target")
    ] = None

    def __post_init__(self) -> None:
        check_ranges(self, PLAN_SETTINGS)
        if self.flight is not None:
            self._require_flight_alone()
            return
        if len(self.image) != len(self.circle):
            raise SettingError(
                f"{len(self.image)} `image` and {len(self.circle)} `circle` were given; each image needs its circle: "
                "find it with 'torchsphere info'"
            )
        if self.image and (self.speckle_px is not None or self.grey is not None):
            raise SettingError("`image` and a rendered pattern (`speckle_px`, `grey`) were both given; leave one out")
        if not self.image and self.blurred:
            raise SettingError("`blurred` speaks of an image, and none was given; add `image`, or leave it out")
        if self.field_mm is not None and self.modes is None:
            raise SettingError(
                "`field_mm` speaks of the camera's modes, and none were given; add `modes`, or leave it out"
            )
        missing = [f"`{name}`" for name in NEEDED if getattr(self, name) is None and not self._is_in_image(name)]
        if missing:
            raise SettingError(f"a plan needs {', '.join(missing)}; or give `flight`, a recording without a target")

    def _is_in_image(self, name: str) -> bool:
        """Whether an image tells the setting: its circle, with the diameter, tells the scale."""
        return name == "px_per_mm" and bool(self.image) and self.diameter_mm is not None

    def _require_flight_alone(self) -> None:
        given = [f"`{name}`" for name in REPLACED_BY_FLIGHT if getattr(self, name) != PLAN_SETTINGS[name].default]
        if given:
            raise SettingError(f"`flight` measures what {', '.join(given)} would say; leave one of both out")


#: All settings of a plan by name.
PLAN_SETTINGS = settings_of(PlanRequest)
