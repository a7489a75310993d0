"""The track: the motion of a ball as it was measured, with its uncertainty."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.correlation.frame_status import OUT_OF_FRAME, TRANSLATION_KNOWN
from torchsphere.geometry.circle import Circle
from torchsphere.motion.findings import Findings
from torchsphere.motion.ledger import Entry
from torchsphere.recording.facts import Facts
from torchsphere.runtime.presentation import Tabulated, present
from torchsphere.settings.calibration import Calibration

if TYPE_CHECKING:
    import os

#: Least share of frames with a measured motion in a usable result, of those with the ball in view
#: (docs/constants.toml).
LEAST_MEASURED = 0.1


@dataclass(frozen=True)
class Track(Tabulated):
    """Motion of the ball over n frames, px and rad, image and camera frame.

    Attributes
    ----------
    position : ndarray
        Centre in each image (n, 2) as (x, y), px; NaN where unknown.
    increment : ndarray
        Motion (n - 1, 5) from each frame to the next as (dx, dy, wx, wy, wz), px and rad; NaN where not measured, as
        are all rotations with the model `translation`.
    covariance : ndarray
        Of the increments (n - 1, 5, 5). Successive increments share an image, so that their errors have opposite signs:
        the covariance of increment i with i + 1 is about minus half of this.
    orientation : ndarray
        Rotation matrices (n, 3, 3) since the first tracked frame; NaN from where a rotation is missing.
    zncc : ndarray
        Correlation coefficient (n,) of each frame with the frame it was compared with; NaN for the first.
    iterations : ndarray
        Gauss-Newton steps (n,).
    status : ndarray
        Strings (n,), each one of `torchsphere.correlation.frame_status.STATUSES`; row i speaks of frame i and of the
        increment that leads to it. A frame found again after a gap is "lost" with a position: no increment leads to it.
        With the model `translation`, which measures no rotation, a frame is "weak_texture" at best.
    radius : ndarray
        Radius of the ball in each image (n,), px; constant except with the model `pinhole6`; NaN where unknown.
    sd_growth : ndarray
        Standard deviation (n - 1,) of the radius's relative change from each frame to the next; 0 where the model
        takes it as constant.
    sd_steady : ndarray
        Standard deviation (5,) of the error that all increments of a flight have in common, px and rad. It is not part
        of `covariance`, since it does not average out.
    circle : Circle
        The outline in the first tracked frame; with a camera the projected centre and the radius at its depth.
    settings : dict
        Every setting used.
    findings : Findings
        What was found out beside the motion: the map, the camera's distance, a codec, ...
    ledger : tuple of Entry
        Which source of error added how much to the uncertainty; empty for results of earlier versions.
    warnings : tuple of str
        Sentences that a reader of the numbers must know, those first that make numbers wrong.
    calibration : Calibration
        Frame rate, diameter or size of a pixel, and mass, as far as the recording states them or `track` was given
        them; `torchsphere.kinematics` takes them from here.
    first_frame : int
        Number of the first image in the whole recording.
    facts : Facts or None
        What the recording states.
    times : ndarray or None
        Times of the images (n,) since the first of the recording, in frame intervals; None where they are evenly
        spaced. A step across a gap is the whole way, and its velocity is this over the gap's time.
    """

    position: NDArray[np.float64]
    increment: NDArray[np.float64]
    covariance: NDArray[np.float64]
    orientation: NDArray[np.float64]
    zncc: NDArray[np.float64]
    iterations: NDArray[np.int64]
    status: NDArray[np.str_]
    radius: NDArray[np.float64]
    sd_growth: NDArray[np.float64]
    sd_steady: NDArray[np.float64]
    circle: Circle
    settings: dict[str, Any]
    findings: Findings = field(default_factory=Findings)
    ledger: tuple[Entry, ...] = ()
    warnings: tuple[str, ...] = ()
    calibration: Calibration = field(default_factory=Calibration)
    first_frame: int = 0
    facts: Facts | None = field(default=None, repr=False)
    times: NDArray[np.float64] | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        counts = ", ".join(f"{count} {name}" for name, count in status_counts(self).items())
        known = np.isfinite(self.increment)
        duration = (known * self.durations[:, None]).sum(0)
        steps = np.where(known, self.increment, 0.0).sum(0) / np.where(duration > 0, duration, 1.0)
        turn = np.degrees(np.linalg.norm(steps[2:])) if known[:, 2:].any() else np.nan
        motion = f"mean step {steps[0]:.3f}, {steps[1]:.3f} px and {turn:.3f} deg" if known[:, 0].any() else "no motion"
        count = len(self.warnings)
        warned = f"; {count} warning{'s' if count > 1 else ''}" if count else ""
        return f"<Track of {len(self.status)} frames: {counts}; circle {self.circle.text()} px; {motion}{warned}>"

    @property
    def durations(self) -> NDArray[np.float64]:
        """Times (n - 1,) of the increments, in frame intervals."""
        return np.ones(len(self.increment)) if self.times is None else np.diff(self.times)

    def save(
        self,
        folder: str | os.PathLike[str],
        *,
        recording: Any = None,
        report: bool = True,
        export: Sequence[str] = (),
        overwrite: bool = False,
    ) -> Path:
        """Write a result folder as ``torchsphere track`` does; `torchsphere.load` reads it back.

        Parameters
        ----------
        folder : str or path
        recording : Recording or array_like, optional
            The images, to keep some of them and their residuals in the folder and in the report.
        report : bool
            Draw figures and ``report.html``.
        export : sequence of str
            "hdf5", "mat": further files with all tables.
        overwrite : bool
            Replace an earlier result.

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        ValueError, OSError
            If the folder cannot be written or holds other files; nothing is written then.
        """
        place: Path = present(
            "save", self, folder, recording=recording, report=report, export=export, overwrite=overwrite
        )
        return place


def status_counts(track: Track) -> dict[str, int]:
    """Number of frames per status, the most frequent first."""
    return dict(Counter(track.status.tolist()).most_common())


def why_unusable(status: NDArray[np.str_]) -> str:
    """Why the frames (n,) of this ``status`` are no usable result; empty where they are one.

    Frames that the ball has left do not count, nor does the first frame, to which no motion leads.
    """
    in_view = status[1:][status[1:] != OUT_OF_FRAME]
    measured = int(np.isin(in_view, TRANSLATION_KNOWN).sum())
    if measured and measured >= LEAST_MEASURED * len(in_view):
        return ""
    return f"nothing usable was measured: the motion is known in {measured} of {len(in_view)} frames after the first"
