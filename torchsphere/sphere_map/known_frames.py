"""The frames of a recording whose poses are known nearly, and their registration on a map, batch by batch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from kornia.geometry.liegroup import So3
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.recording.frame_source import Source
from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import registration
from torchsphere.sphere_map.ball import Poses
from torchsphere.sphere_map.decision import is_on_map
from torchsphere.sphere_map.nearness import seen_alike
from torchsphere.sphere_map.perspective import Optics
from torchsphere.sphere_map.registration import Registration
from torchsphere.sphere_map.state import State
from torchsphere.sphere_map.window import Windows, cut_windows

#: Frames that are registered at once (docs/constants.toml).
BATCH = 32

#: Numbers of frames, and their poses before and after the registration.
Anchors = tuple[list[int], Poses, Poses]


@dataclass(frozen=True)
class KnownFrames:
    """The images with their initial poses, their background (h, w), and a mask (h, w) of the usable pixels.

    Tensors are on the device of the source.
    """

    source: Source
    known: NDArray[np.int64]  # numbers (k,) of the frames with an initial pose
    # Initial poses of all frames, float64: (n, 2), (n, 3, 3) and (n,), NaN where unknown.
    position: Tensor
    orientation: Tensor
    added_radius: Tensor
    background: Tensor
    usable: Tensor | None
    optics: Optics | None
    moments: Tensor | None = None  # `Windows.moments` of all frames

    def poses(self, numbers: NDArray[np.int64] | slice = slice(None)) -> Poses:
        """Initial poses of the given frames, or of all."""
        return Poses.at(self.position[numbers], self.orientation[numbers], self.added_radius[numbers])

    def seen_by(self, optics: Optics | None) -> KnownFrames:
        """The same frames seen by another camera, which shows the same sides of the ball in the same places."""
        if optics is None:
            return self
        afar = seen_alike(self.poses(), self.optics, None)
        seen = self.position if self.optics is None else self.optics.bent(self.position)
        orientation = seen_alike(replace(afar, centre=optics.straightened(seen)), None, optics).orientation
        return replace(self, optics=optics, position=optics.straightened(seen), orientation=orientation)

    def windows(self, numbers: list[int], poses: Poses, radius: Tensor | float) -> Windows:
        """Windows of the given frames around a ball of that ``radius`` at its ``poses`` (k,)."""
        first, last = numbers[0], numbers[-1] + 1
        if last - first == len(numbers):
            images = self.source.images(first, last)
        else:
            images = torch.cat([self.source.images(i, i + 1) for i in numbers])
        # Single precision is nearly twice as fast and moves a pose by 1e-6 px.
        images = images.float() if images.dtype == torch.float64 else images
        moments = None if self.moments is None else self.moments[numbers]
        radii = poses.radii(radius)
        return cut_windows(images, self.background, poses.centre, radii, self.usable, self.optics, moments)


def register_frames(
    frames: KnownFrames,
    wanted: NDArray[np.int64],
    anchors: Anchors,
    state: State,
    shared: RowRunner,
    report: Callable[[int], None],
) -> tuple[NDArray[np.int64], Registration]:
    """Numbers (k,) and registrations of the ``wanted`` frames that fit the map.

    A batch starts where the frame before it was found: the sum of the increments drifts from turn to turn.
    """
    ball, profile = state.ball, state.profile
    numbers, found = [], []
    for first in range(0, len(wanted), BATCH):
        batch = wanted[first : first + BATCH]
        start = _undrifted(frames, batch, *anchors)
        windows = frames.windows(batch.tolist(), start, ball.radius)

        def part(a: int, b: int, windows: Windows = windows, start: Poses = start) -> Registration:
            return registration.register(windows.take(slice(a, b)), start.take(slice(a, b)), ball, profile)

        registered = Registration.joined(shared(part, len(batch)))
        move = (registered.poses.centre - start.centre).norm(dim=1)
        accepted = is_on_map(registered.converged, move / ball.radius, registered.misfit)
        rows = torch.nonzero(accepted)[:, 0]
        numbers.append(batch[rows.cpu().numpy()])
        found.append(registered.take(rows))
        report(first + len(batch))
        if len(rows):
            anchors = _with_last(anchors, frames, int(numbers[-1][-1]), found[-1].poses.take(slice(-1, None)))
    return np.concatenate(numbers), Registration.joined(found)


def _with_last(anchors: Anchors, frames: KnownFrames, number: int, pose: Poses) -> Anchors:
    """The ``anchors`` after frame ``number``, with the pose that was found for it; those before it are not needed."""
    numbers, before, after = anchors
    later = [i for i, key in enumerate(numbers) if key > number]
    own = frames.poses(slice(number, number + 1))
    kept = [number, *(numbers[i] for i in later)]
    return kept, Poses.joined([own, before.take(later)]), Poses.joined([pose, after.take(later)])


def _undrifted(frames: KnownFrames, batch: NDArray[np.int64], numbers: list[int], before: Poses, after: Poses) -> Poses:
    """Initial poses of a ``batch`` of frames without their drift, interpolated between the anchors in time.

    Anchors are frames with these ``numbers`` whose poses are known ``before`` and ``after`` the registration.
    """
    shift = after.centre - before.centre
    turn = So3.from_matrix(after.orientation @ before.orientation.mT).log()
    others = torch.stack((after.gain, after.offset, after.added_radius - before.added_radius), 1)
    known = torch.cat((shift, turn, others), 1).cpu().numpy()
    at = np.stack([np.interp(batch, numbers, column) for column in known.T], 1)
    change = torch.from_numpy(at).to(frames.position.device)
    rotation = So3.exp(change[:, 2:5]).matrix()
    own = frames.poses(batch)
    gain, offset, added = change[:, 5:].unbind(1)
    return Poses(own.centre + change[:, :2], rotation @ own.orientation, gain, offset, own.added_radius + added)
