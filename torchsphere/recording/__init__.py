"""Open footage of any supported kind as a lazy :class:`Recording`."""

from torchsphere.recording.opener import open_recording
from torchsphere.recording.recording import Recording

__all__ = ["Recording", "open_recording"]
