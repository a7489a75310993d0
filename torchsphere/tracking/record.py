"""What is known of each frame so far: the rows that following the ball fills one after the other."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation.result import STATUSES, Correlation
from torchsphere.geometry.circle import Circle

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Record:
    """Rows of n frames; what is not known, or not yet, is NaN and "lost". The arrays are filled in place.

    Attributes
    ----------
    position, increment, covariance, zncc, iterations, status
        As in `torchsphere.tracking.track.Track`.
    size : ndarray
        Radius (n,) of the ball in each frame, px; the same throughout but with the model `pinhole6`.
    sd_growth : ndarray
        Standard deviation (n - 1,) of its relative change from each frame to the next.
    uneven_light : ndarray
        (n,), True for a frame into which an object took light from one side of the ball.
    rotation : ndarray
        Rotation vector (n, 3) of each frame since the frame in which the ball was seen before, rad.
    repeated : list of int
        Frames that repeat the image before them although the ball moves.
    """

    position: Array
    increment: Array
    covariance: Array
    zncc: Array
    iterations: NDArray[np.int64]
    status: NDArray[np.str_]
    size: Array
    sd_growth: Array
    uneven_light: NDArray[np.bool_]
    rotation: Array
    repeated: list[int] = field(default_factory=list)

    @classmethod
    def empty(cls, count: int, first: Circle) -> Record:
        """For ``count`` frames, in one of which the ball is known."""
        record = cls(
            position=np.full((count, 2), np.nan),
            increment=np.full((count - 1, 5), np.nan),
            covariance=np.full((count - 1, 5, 5), np.nan),
            zncc=np.full(count, np.nan),
            iterations=np.zeros(count, dtype=np.int64),
            status=np.full(count, "lost", dtype=f"<U{max(map(len, STATUSES))}"),
            size=np.full(count, np.nan),
            sd_growth=np.full(count - 1, np.nan),
            uneven_light=np.zeros(count, dtype=bool),
            rotation=np.full((count, 3), np.nan),
        )
        record.place(first.frame, np.array([first.x, first.y]), first.radius)
        record.status[first.frame] = "ok"
        return record

    @property
    def radius(self) -> float:
        """Radius of the ball in the last frame in which it was seen, px."""
        return float(self.size[np.isfinite(self.size)][-1])

    def is_placed(self, frame: int) -> bool:
        """Whether it is known where the ball is in that frame."""
        return bool(np.isfinite(self.position[frame, 0]))

    def place(self, frame: int, centre: Array, radius: float) -> None:
        """Note where the ball is in one frame, px."""
        self.position[frame], self.size[frame] = centre, radius

    def is_confirmed(self, first: int) -> bool:
        """Whether a later frame was measured against the ``first`` one in which the ball is known."""
        later = np.flatnonzero(np.isfinite(self.position[first + 1 :, 0])) + first + 1
        # A ball that was found anew, by its outline alone, has no rotation since the frame before.
        return len(later) > 0 and (self.status[first] != "ok" or bool(np.isfinite(self.rotation[later[0], 0])))

    def without(self, frame: int) -> Record:
        """The same with nothing known of that frame."""
        position, status = self.position.copy(), self.status.copy()
        position[frame], status[frame] = np.nan, "lost"
        return dataclasses.replace(self, position=position, status=status)

    def note(self, frame: int, found: Correlation) -> str:
        """Note status, coefficient and steps of a frame that was measured by itself, and return its status."""
        self.status[frame], self.zncc[frame] = found.status[0], float(found.zncc[0])
        self.iterations[frame] = int(found.iterations[0])
        return str(found.status[0])

    def keep(self, last: int, found: Correlation, balls: Tensor, count: int) -> Array:
        """Write ``count`` confirmed pairs down, the ball at ``balls`` (m + 1, 3); return their increments."""
        rows = slice(last, last + count)
        after = slice(last + 1, last + 1 + count)
        self.increment[rows] = found.q[:count].double().cpu().numpy()
        self.sd_growth[rows] = found.sd_growth[:count].double().cpu().numpy()
        self.covariance[rows] = found.covariance[:count].cpu().numpy()
        arrived = balls[1 : count + 1].numpy()
        self.position[after], self.size[after] = arrived[:, :2], arrived[:, 2]
        self.rotation[after] = self.increment[rows, 2:]
        self.zncc[after] = found.zncc[:count].cpu().numpy()
        self.uneven_light[after] = found.uneven_light[:count].cpu().numpy()
        self.iterations[after] = found.iterations[:count].cpu().numpy()
        self.status[after] = "ok"
        return self.increment[rows]

    def without_rotation(self) -> Record:
        """The same for a model that knows no rotation: where it holds it at 0, none was measured."""
        increment = self.increment.copy()
        increment[:, 2:] = np.nan
        status = np.where(self.status == "ok", "weak_texture", self.status)
        return dataclasses.replace(
            self, increment=increment, rotation=np.full_like(self.rotation, np.nan), status=status
        )
