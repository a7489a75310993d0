"""What `track` found out about a recording, beside the motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from torchsphere.sphere_map.decision import NOT_NEEDED, MadeMap, NoMap, Why

#: No map, and nobody has said why, as in results of earlier versions.
UNKNOWN_MAP = NoMap(Why.UNKNOWN, "no reason is known", is_needed=False)


@dataclass(frozen=True)
class CameraShake:
    """Displacement of the background, px, and the tracked frame that shows it."""

    px: float
    frame: int


@dataclass(frozen=True)
class Place:
    """The place of a ball that turns in it."""

    recognised: bool  # whether nobody said so
    steps_sum_px: tuple[float, float]  # sum of the steps against which the ball was held
    first_radius_px: float  # of the circle at the start
    limbs: int | None  # frames whose outline was fitted; None without
    limbs_stay: bool  # whether the outlines stay in one place
    limbs_radius_px: float = math.nan
    limbs_sd_px: tuple[float, ...] = ()  # of x, y and radius of the outline in one frame
    limbs_radius_used: bool = False  # in place of the first one

    def items(self) -> dict[str, Any]:
        """The fields for ``summary.json``."""
        return asdict(self) | {"limbs_sd_px": self.limbs_sd_px or None}

    @classmethod
    def read(cls, items: Mapping[str, Any]) -> Place:
        """From ``summary.json``."""
        known: dict[str, Any] = {name: value for name, value in items.items() if value is not None}
        known["steps_sum_px"] = tuple(known["steps_sum_px"])
        return cls(**{"limbs": None} | known | {"limbs_sd_px": tuple(known.get("limbs_sd_px", ()))})


@dataclass(frozen=True)
class Findings:
    """What was found out, by the images alone.

    Attributes
    ----------
    map : MadeMap or NoMap
        The map of the ball, or why there is none.
    sd_radius_over_distance : float
        Standard deviation of the ball's radius over the camera's distance.
    place : Place or None
        Of a ball that turns without leaving it.
    grows : bool
        Whether the ball comes nearer or goes away, which nobody said.
    camera_assumed : bool
        Whether the camera of the settings was not given: a ball that grows is followed with one that is far away.
    interlaced : bool
        Whether only the even rows are used, as the others show another instant.
    mosaic : tuple of str
        Colour mosaics that the images may be, of which only the green pixels are used.
    noise_memory : float
        Share of an image that is the image beside it.
    coded : bool
        Whether a codec draws the ball from parts of the images before.
    hidden : bool
        Whether something stands in front of the ball in many frames.
    repeated_frames : tuple of int
        Images that repeat the image before them although the ball moves.
    untried_frames : int
        Last images that were not tried, as nothing confirms the first circle.
    leaked : float
        Share of a rotation by which the background that leaks into the region of interest makes it too large.
    axis_ratio : float or None
        Width over height of an outline that is an ellipse of fixed axes, as pixels that are not square give.
    outline_scatter : float
        Relative scatter of the outlines' radii where no map could be made.
    texture_fineness : float
        Mean square of the texture's slopes over its variance, 1/px^2.
    uneven_light : float
        Share of the steps in light that an object near the ball changes unevenly.
    stretch : float
        Ratio of the sides of the pixels that the images were drawn from.
    missing_frames : tuple of (int, int)
        Frames before which images seem to be missing, and how many; -1 for one that shows the last once more, and less
        for one of an earlier time than that.
    pace_changes : tuple of (int, float)
        Frames from which every step is that many times as far as those before.
    shake : CameraShake or None
        Of the camera, by the still background.
    """

    map: MadeMap | NoMap = UNKNOWN_MAP
    sd_radius_over_distance: float = 0.0
    place: Place | None = None
    grows: bool = False
    camera_assumed: bool = False
    interlaced: bool = False
    mosaic: tuple[str, ...] = ()
    noise_memory: float = 0.0
    coded: bool = False
    hidden: bool = False
    repeated_frames: tuple[int, ...] = ()
    untried_frames: int = 0
    leaked: float = 0.0
    axis_ratio: float | None = None
    outline_scatter: float = 0.0
    texture_fineness: float = 0.0
    uneven_light: float = 0.0
    stretch: float = 1.0
    missing_frames: tuple[tuple[int, int], ...] = ()
    pace_changes: tuple[tuple[int, float], ...] = ()
    shake: CameraShake | None = None

    @property
    def is_on_map(self) -> bool:
        """Whether the poses are those on a map of the ball."""
        return isinstance(self.map, MadeMap)

    @property
    def proves_ball(self) -> bool:
        """Whether a map of the ball, or outlines that stay in their place, prove that the circle is that of a ball."""
        return self.is_on_map or (self.place is not None and self.place.limbs_stay)

    @property
    def radius_over_distance(self) -> float:
        """Of the camera as the map found it; 0 for one infinitely far away, or not found."""
        return self.map.radius_over_distance if isinstance(self.map, MadeMap) else 0.0

    def items(self) -> dict[str, Any]:
        """The findings for ``summary.json``."""
        found = {one.name: getattr(self, one.name) for one in fields(self) if one.name not in _IN_THE_MAP}
        if isinstance(self.map, MadeMap):
            about: dict[str, Any] = {"used": True, **asdict(self.map)}
        else:
            about = {"used": False, "reason": self.map.reason, "why": self.map.why.name.lower()}
        if self.outline_scatter:
            about["outline_scatter"] = self.outline_scatter
        place, shake = self.place, self.shake
        return found | {
            "place": None if place is None else place.items(),
            "shake": None if shake is None else asdict(shake),
            "sphere_map": about,
        }

    @classmethod
    def read(cls, items: Mapping[str, Any]) -> Findings:
        """From ``summary.json``; results of earlier versions lack some."""
        names = {one.name for one in fields(cls)} - set(_IN_THE_MAP)
        known: dict[str, Any] = {name: value for name, value in items.items() if name in names}
        about, place, shake = items.get("sphere_map") or {}, items.get("place"), items.get("shake")
        known["place"] = None if place is None else Place.read(place)
        known["shake"] = None if shake is None else CameraShake(**shake)
        for name in ("missing_frames", "pace_changes"):
            known[name] = tuple((frame, times) for frame, times in known.get(name) or ())
        for name in ("mosaic", "repeated_frames"):
            known[name] = tuple(known.get(name) or ())
        return cls(map=_read_map(about), outline_scatter=about.get("outline_scatter", 0.0), **known)


#: Fields that ``summary.json`` has under "sphere_map".
_IN_THE_MAP = ("map", "outline_scatter")


def _read_map(about: Mapping[str, Any]) -> MadeMap | NoMap:
    if not about.get("used"):
        reason = str(about.get("reason", UNKNOWN_MAP.reason))
        why = str(about.get("why", UNKNOWN_MAP.why.name)).upper()
        sentence = reason.removeprefix(NOT_NEEDED)
        return NoMap(Why[why], sentence, is_needed=sentence == reason)
    known = {one.name: about[one.name] for one in fields(MadeMap) if one.name in about}
    return MadeMap(**known | {"lens_middle_px": tuple(about.get("lens_middle_px", (0.0, 0.0)))})
