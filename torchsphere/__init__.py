"""Motion of a speckled ball from high-speed footage: translation, rotation, velocity and force, with uncertainty."""

from torchsphere.circle import Circle
from torchsphere.correlate import Correlation, correlate
from torchsphere.kinematics import Kinematics, kinematics
from torchsphere.perspective import Camera
from torchsphere.recording import Recording, open_recording
from torchsphere.track import Track, track

__version__ = "0.1.0"

__all__ = [
    "Camera",
    "Circle",
    "Correlation",
    "Kinematics",
    "Recording",
    "Track",
    "correlate",
    "kinematics",
    "open_recording",
    "track",
]
