"""Motion of a speckled ball from high-speed footage: translation, rotation, velocity and force, with uncertainty."""

import importlib
from typing import TYPE_CHECKING, Any

from torchsphere.runtime import presentation

if TYPE_CHECKING:
    from torchsphere.correlation.correlate import correlate
    from torchsphere.correlation.result import Correlation
    from torchsphere.dynamics.ball import Ball, ball
    from torchsphere.dynamics.channel_filter import channel_filter, channel_filter_sd
    from torchsphere.dynamics.contact_law import ContactForce, contact_force
    from torchsphere.dynamics.impact import impact, impacts
    from torchsphere.dynamics.impact_estimate import Impact
    from torchsphere.dynamics.kinematics import Kinematics, kinematics, kinematics_of_many
    from torchsphere.geometry.camera import Camera
    from torchsphere.geometry.circle import Circle
    from torchsphere.notebook.loaded import Result, load
    from torchsphere.recording import Recording, open_recording
    from torchsphere.tracking.track import Track, track, track_many

__version__ = "0.1.0"

__all__ = [
    "Ball",
    "Camera",
    "Circle",
    "ContactForce",
    "Correlation",
    "Impact",
    "Kinematics",
    "Recording",
    "Result",
    "Track",
    "ball",
    "channel_filter",
    "channel_filter_sd",
    "contact_force",
    "correlate",
    "impact",
    "impacts",
    "kinematics",
    "kinematics_of_many",
    "load",
    "open_recording",
    "track",
    "track_many",
]

#: Module of each public name, imported when the name is first used: torch and kornia take two seconds, which
#: ``torchsphere --help`` and a program that only opens a recording need not wait for.
_HOMES = {
    "Ball": "dynamics.ball",
    "Camera": "geometry.camera",
    "Circle": "geometry.circle",
    "ContactForce": "dynamics.contact_law",
    "Correlation": "correlation.result",
    "Impact": "dynamics.impact_estimate",
    "Kinematics": "dynamics.kinematics",
    "Recording": "recording",
    "Result": "notebook.loaded",
    "Track": "tracking.track",
    "ball": "dynamics.ball",
    "channel_filter": "dynamics.channel_filter",
    "channel_filter_sd": "dynamics.channel_filter",
    "contact_force": "dynamics.contact_law",
    "correlate": "correlation.correlate",
    "impact": "dynamics.impact",
    "impacts": "dynamics.impact",
    "kinematics": "dynamics.kinematics",
    "kinematics_of_many": "dynamics.kinematics",
    "load": "notebook.loaded",
    "open_recording": "recording",
    "track": "tracking.track",
    "track_many": "tracking.track",
}

#: Functions of the methods of results that need packages above those of the results, by the modules that have them.
presentation.register(
    {
        "html": "torchsphere.notebook.html",
        "plot": "torchsphere.notebook.figures",
        "save": "torchsphere.notebook.folders",
        "to_pandas": "torchsphere.notebook.tables",
        "to_xarray": "torchsphere.notebook.tables",
    },
    lambda module, name: getattr(importlib.import_module(module), name),
)


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
