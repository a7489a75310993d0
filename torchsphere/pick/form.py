"""The form of the page: its fields, the settings in what it sends, and the TOML file of these settings.

A page sends texts, as they would stand on the command line; the descriptions in `torchsphere.request` read them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torchsphere.recording.ignore_mask import read_ignore
from torchsphere.request import PER_RECORDING, SETTINGS, check_settings
from torchsphere.results.atomic_output import atomic_file
from torchsphere.runtime.shown_text import shown
from torchsphere.settings.configuration import as_toml, number_text
from torchsphere.settings.limits import SettingError
from torchsphere.settings.setting import SWITCH

#: Settings that have a place of their own on the page; all others that were given stay as they are.
DRAWN = ("circle", "refine", "frames", "ignore")


@dataclass(frozen=True)
class Field:
    """A setting in a form: its name, a label for people, its unit and a hint."""

    name: str
    label: str
    unit: str = ""
    hint: str = ""

    @property
    def is_switch(self) -> bool:
        """Whether the setting is on or off."""
        return SETTINGS[self.name].kind is SWITCH


#: Fields of the form, by the headings above them.
FORM: dict[str, tuple[Field, ...]] = {
    "Time, size and mass": (
        Field("fps", "Frame rate", "1/s", "of the camera, not of a player"),
        Field("diameter_mm", "Diameter of the ball", "mm", "gives the scale"),
        Field("mm_per_px", "Size of a pixel", "mm", "instead of the diameter"),
        Field("mass_g", "Mass of the ball", "g", "gives the force"),
    ),
    "Camera": (
        Field("distance_mm", "Distance of the ball", "mm", "from the camera; needs the diameter"),
        Field("focal_px", "Focal length", "px", "over the size of a pixel; instead of the distance"),
        Field("principal_px", "Optical axis", "px", "x, y where it meets the image; its middle if left empty"),
        Field("distortion", "Distortion", "", "k1, k2, k3 in OpenCV's convention"),
        Field("telecentric", "Telecentric lens"),
        Field("shutter_us", "Exposure", "µs", "the file's if left empty"),
    ),
    "More": (
        Field("scale_sd_percent", "Uncertainty of the size", "%", "standard deviation of the diameter or pixel"),
        Field("fps_sd_percent", "Uncertainty of the frame rate", "%", "standard deviation"),
        Field("mass_sd_percent", "Uncertainty of the mass", "%", "standard deviation"),
        Field("shell_mm", "Thickness of a hollow ball", "mm", "solid if left empty"),
        Field("normal_deg", "Normal of the target", "deg", "from target to ball, x towards y; found if left empty"),
        Field("in_place", "The ball turns without leaving its place"),
        Field("lab_frame", "Results with y up and z to the camera"),
    ),
}

FIELDS = {field.name: field for fields in FORM.values() for field in fields}


@dataclass(frozen=True)
class Choice:
    """What was chosen on a page, as sent."""

    fields: Mapping[str, Any]  # texts of the form, True or False for a switch
    circle: tuple[float, float, float] | None  # px; None to have it found
    circle_frame: int  # frame in which the circle was drawn
    first: int
    last: int  # first and last frame to measure
    ignore: tuple[str, ...]  # polygons 'x,y x,y x,y', and masks by their paths

    @classmethod
    def of(cls, sent: Mapping[str, Any], count: int) -> Choice:
        """The choice in what a page has ``sent`` for ``count`` frames; raises ValueError for anything else."""
        try:
            drawn = sent.get("circle")
            circle = None if drawn is None else (float(drawn["x"]), float(drawn["y"]), float(drawn["radius"]))
            frames = sent.get("frames") or (0, count - 1)
            first, last = (int(frame) for frame in frames)
            fields, ignore = dict(sent.get("fields") or {}), tuple(str(text) for text in sent.get("ignore") or ())
            return cls(fields, circle, first if drawn is None else int(drawn["frame"]), first, last, ignore)
        except (TypeError, KeyError, ValueError, AttributeError, OverflowError) as error:
            raise ValueError("the page sent settings that cannot be read; load it again") from error


def settings_of(choice: Choice, base: Mapping[str, Any], shape: Sequence[int]) -> dict[str, Any]:
    """Settings of `torchsphere.request.Request` for images of ``shape`` (n, h, w).

    ``base`` are settings that the command was started with; those without a place on the page stay.

    Raises
    ------
    SettingError, ValueError, OSError
        For texts that cannot be read, values out of range or in contradiction, and regions that cannot be used.
    """
    settings = {name: value for name, value in base.items() if name not in FIELDS and name not in DRAWN}
    for name, given in choice.fields.items():
        value = _value(name, given)
        if value is not None:
            settings[name] = value
    settings |= _frames(choice, shape[0])
    if choice.circle is not None:
        if choice.circle_frame != choice.first:
            raise SettingError(
                f"`circle` lies in frame {choice.circle_frame}, and frame {choice.first} is the first to be measured; "
                "draw it there, or begin with its frame"
            )
        settings["circle"] = tuple(round(value, 3) for value in choice.circle)
    if choice.ignore:
        read_ignore(choice.ignore, tuple(shape[1:]))
        settings["ignore"] = list(choice.ignore)
    check_settings(settings)
    return settings


def _value(name: str, given: Any) -> Any:
    """The value of a field; None where it is empty, or off as by default."""
    if name not in FIELDS:
        raise ValueError(f"{name!r} is no field of the page; load it again")
    setting = SETTINGS[name]
    if setting.kind is SWITCH:
        return bool(given) if bool(given) != setting.default else None
    text = str(given).strip()
    value = setting.from_text(text) if text else None
    return None if value == setting.default else value


def _frames(choice: Choice, count: int) -> dict[str, Any]:
    """The range of frames, unless it is the whole recording."""
    if not 0 <= choice.first < choice.last < count:
        raise SettingError(
            f"`frames` from {choice.first} to {choice.last}: expected a first frame of 0 or more, and a later last "
            f"frame of {count - 1} at most"
        )
    whole = (choice.first, choice.last) == (0, count - 1)
    return {} if whole else {"frames": (choice.first, choice.last + 1)}


def text_of(name: str, value: Any) -> str:
    """A value as its text in a form."""
    if value is None:
        return ""
    return ", ".join(map(number_text, value)) if isinstance(value, (tuple, list)) else number_text(value)


def toml_text(settings: Mapping[str, Any], recording: str) -> str:
    """The settings as a TOML file, which `track --config` reads; ``recording`` is named in its first line.

    Raises ValueError as `as_toml`.
    """
    kept = {name: value for name, value in settings.items() if name in PER_RECORDING}
    return f"# torchsphere track, {shown(recording)}\n{as_toml(kept, PER_RECORDING)}"


def write_toml(path: Path, text: str, replace: bool) -> None:
    """Write the file whole or not at all; raises FileExistsError unless an earlier one may be replaced."""
    if path.exists() and not replace:
        raise FileExistsError(f"{path} exists; tick 'Replace earlier files' to replace it")
    with atomic_file(path) as stream:
        stream.write(text)
