"""Motion of a speckled ball from high-speed footage: translation, rotation, velocity and force, with uncertainty."""

from torchsphere.circle import Circle
from torchsphere.correlate import Correlation, correlate
from torchsphere.impact import Ball, Impact, ball, impact
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
