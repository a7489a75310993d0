"""Results per frame, filled row by row while the ball is followed."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np
import torch
from kornia.geometry.liegroup import So3
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation import frame_status
from torchsphere.correlation.result import Correlation
from torchsphere.geometry import orientation
from torchsphere.geometry.circle import Circle
from torchsphere.runtime.arrays import Array


@dataclass(frozen=True)
class Record:
    """Rows of n frames; unknown rows are NaN and "lost". The arrays are filled in place."""

    # position, increment, covariance, zncc, iterations, status: as in `torchsphere.tracking.track.Track`.
    position: Array
    increment: Array
    covariance: Array
    zncc: Array
    iterations: NDArray[np.int64]
    status: NDArray[np.str_]
    size: Array  # radius (n,) of the ball in each frame, px; constant except with the model `pinhole6`
    sd_growth: Array  # standard deviation (n - 1,) of its relative change from each frame to the next
    uneven_light: NDArray[np.bool_]  # (n,), True for a frame into which an object took light from one side of the ball
    rotation: Array  # rotation vector (n, 3) of each frame since the last frame that showed the ball, rad
    repeated: list[int] = field(default_factory=list)  # frames that repeat the image before although the ball moves
    untried: int = 0  # last frames that were not tried, as nothing confirms the first circle

    @classmethod
    def empty(cls, count: int, first: Circle) -> Record:
        """A record of ``count`` frames in which only the ``first`` circle is known."""
        record = cls(
            position=np.full((count, 2), np.nan),
            increment=np.full((count - 1, 5), np.nan),
            covariance=np.full((count - 1, 5, 5), np.nan),
            zncc=np.full(count, np.nan),
            iterations=np.zeros(count, dtype=np.int64),
            status=frame_status.of_unmeasured(count),
            size=np.full(count, np.nan),
            sd_growth=np.full(count - 1, np.nan),
            uneven_light=np.zeros(count, dtype=bool),
            rotation=np.full((count, 3), np.nan),
        )
        record.place(first.frame, np.array([first.x, first.y]), first.radius)
        record.status[first.frame] = frame_status.OK
        return record

    @property
    def uneven_share(self) -> float:
        """Share of the measured steps into a frame with uneven light."""
        return int(self.uneven_light.sum()) / max(int(np.isfinite(self.increment[:, 0]).sum()), 1)

    @property
    def is_ok(self) -> NDArray[np.bool_]:
        """Frames (n,) that were measured whole."""
        return self.status == frame_status.OK

    @property
    def radius(self) -> float:
        """Radius of the ball in the last frame that shows it, px."""
        return float(self.size[np.isfinite(self.size)][-1])

    def is_placed(self, frame: int) -> bool:
        """Whether the position in that frame is known."""
        return bool(np.isfinite(self.position[frame, 0]))

    def place(self, frame: int, centre: Array, radius: float) -> None:
        """Store position and radius of the ball in one frame, px."""
        self.position[frame], self.size[frame] = centre, radius

    def is_confirmed(self, first: int) -> bool:
        """Whether a later frame was measured against the ``first`` frame."""
        later = np.flatnonzero(np.isfinite(self.position[first + 1 :, 0])) + first + 1
        # A ball found again by its outline alone has no rotation since the frame before.
        return len(later) > 0 and (not self.is_ok[first] or bool(np.isfinite(self.rotation[later[0], 0])))

    def turned(self, first: int, last: int) -> Array:
        """Rotation vector (1, 3) from frame ``first`` to ``last``, rad; NaN where a rotation between is missing."""
        part = slice(first, last + 1)
        matrices = orientation.chain(self.rotation[part], np.isfinite(self.position[part, 0]))
        return np.asarray(So3.from_matrix(torch.from_numpy(matrices[-1:])).log().numpy())

    def without(self, frame: int | slice | NDArray[np.bool_]) -> Record:
        """The record without that frame, or several, and without the steps to and from it."""
        left_out = np.zeros(len(self.position), dtype=bool)
        left_out[frame] = True
        between = left_out[:-1] | left_out[1:]
        return dataclasses.replace(
            self,
            position=np.where(left_out[:, None], np.nan, self.position),
            increment=np.where(between[:, None], np.nan, self.increment),
            covariance=np.where(between[:, None, None], np.nan, self.covariance),
            rotation=np.where(left_out[:, None], np.nan, self.rotation),
            status=frame_status.without(self.status, left_out),
        )

    def set_match(self, frame: int, found: Correlation) -> None:
        """Store coefficient and iterations of a frame that was measured alone."""
        self.zncc[frame], self.iterations[frame] = float(found.zncc[0]), int(found.iterations[0])

    def set_pairs(self, last: int, found: Correlation, circles: Tensor, count: int) -> Array:
        """Store the first ``count`` pairs after frame ``last``, with ``circles`` (m + 1, 3): their increments."""
        rows = slice(last, last + count)
        after = slice(last + 1, last + 1 + count)
        self.increment[rows] = found.q[:count].double().cpu().numpy()
        self.sd_growth[rows] = found.sd_growth[:count].double().cpu().numpy()
        self.covariance[rows] = found.covariance[:count].cpu().numpy()
        arrived = circles[1 : count + 1].numpy()
        self.position[after], self.size[after] = arrived[:, :2], arrived[:, 2]
        self.rotation[after] = self.increment[rows, 2:]
        self.zncc[after] = found.zncc[:count].cpu().numpy()
        self.uneven_light[after] = found.uneven_light[:count].cpu().numpy()
        self.iterations[after] = found.iterations[:count].cpu().numpy()
        self.status[after] = frame_status.OK
        return self.increment[rows]

    def without_rotation(self) -> Record:
        """The record of a model without rotation: a rotation held at 0 was not measured."""
        increment = self.increment.copy()
        increment[:, 2:] = np.nan
        status, rotation = frame_status.without_rotation(self.status), np.full_like(self.rotation, np.nan)
        return dataclasses.replace(self, increment=increment, rotation=rotation, status=status)
