"""Motion of a speckled ball from high-speed footage: translation, rotation, velocity and force, with uncertainty."""

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from torchsphere.circle import Circle
    from torchsphere.correlate import correlate
    from torchsphere.correlation import Correlation
    from torchsphere.estimates import Impact
    from torchsphere.impact import impact
    from torchsphere.inertia import Ball, ball
    from torchsphere.kinematics import Kinematics, kinematics, kinematics_of_many
    from torchsphere.perspective import Camera
    from torchsphere.recording import Recording, open_recording
    from torchsphere.track import Track, track, track_many

__version__ = "0.1.0"

__all__ = [
    "Ball",
    "Camera",
    "Circle",
    "Correlation",
    "Impact",
    "Kinematics",
    "Recording",
    "Track",
    "ball",
    "correlate",
    "impact",
    "kinematics",
    "kinematics_of_many",
    "open_recording",
    "track",
    "track_many",
]

#: Module of each public name, imported when the name is first used: torch and kornia take two seconds, which
#: ``torchsphere --help`` and a program that only opens a recording need not wait for.
_HOMES = {
    "Ball": "inertia",
    "Camera": "perspective",
    "Circle": "circle",
    "Correlation": "correlation",
    "Impact": "estimates",
    "Kinematics": "kinematics",
    "Recording": "recording",
    "Track": "track",
    "ball": "inertia",
    "correlate": "correlate",
    "impact": "impact",
    "kinematics": "kinematics",
    "kinematics_of_many": "kinematics",
    "open_recording": "recording",
    "track": "track",
    "track_many": "track",
}


def __getattr__(name: str) -> Any:
    """A public name on its first use (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """All names, those that no one has used yet, too."""
    return sorted({*globals(), *__all__})


class _Package(ModuleType):
    """The package, in which `track`, `correlate`, `kinematics` and `impact` stay the functions of these names.

    They are the names of modules, too, and importing one of those, by whomever, would set the module in its place.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if isinstance(value, ModuleType) and name in _HOMES:
            value = getattr(value, name)
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
