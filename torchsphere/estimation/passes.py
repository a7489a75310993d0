"""The two passes of the Rauch-Tung-Striebel smoother (see `torchsphere.estimation.rts`), forward and backward.

Forward each frame waits for the one before. Backward, what a frame says of the one before follows from the filter's
covariances alone: it is computed for some frames at once, and two products of matrices per frame are left.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import torch

from torchsphere.estimation.contact_search import Contact
from torchsphere.estimation.entries import UNKNOWN, Array
from torchsphere.estimation.measurements import FREEDOMS, Poses
from torchsphere.estimation.transitions import FLIGHT, Moves

#: Least variance of a combination of states that is not taken for rounding, of the largest, all being of one size.
SINGULAR = 1e-10

#: Covariances that are worked on at once: as many as stay near the processor.
AT_ONCE = 512


class State(NamedTuple):
    """A frame's states under c intervals in n recordings, in units of the errors; in contact they are larger.

    Attributes
    ----------
    mean, spread : ndarray
        (n, c, s) and (n, c, s, s), given all data.
    gain, rest : ndarray
        What the next frame's state, of the size s', says of this one (n, c, s, s'), and the covariance (n, c, s, s)
        that it leaves; of the last frame none, and its covariance.
    """

    mean: Array
    spread: Array
    gain: Array
    rest: Array


def forward(poses: Poses, contact: Contact, moves: Moves) -> tuple[list[Array], list[Array]]:
    """Kalman filter: means (n, c, s) and covariances (n, c, s, s) of every frame given all frames up to it."""
    n, c, _ = contact.noise.shape
    seen = poses.seen.swapaxes(0, 1).numpy()[:, :, None]
    both = seen[..., :, None] & seen[..., None, :]
    unit = poses.unit.numpy()[:, None]
    stated = poses.covariance.swapaxes(0, 1).numpy()[:, :, None] / unit[..., :, None] / unit[..., None, :]
    stated = np.where(both, stated, 0.0)
    missing = np.where(both, 0.0, np.eye(FREEDOMS))
    # Each of the separate errors has a factor of its own.
    separate = poses.separation.numpy()[:, None]
    factor = np.linalg.solve(separate, contact.noise.numpy()[..., None] * separate)

    def noise(i: int) -> Array:
        return np.asarray(np.where(both[i], factor @ stated[i] @ factor.swapaxes(-1, -2), 0.0) + missing[i])

    mean, spread = np.zeros((n, c, FLIGHT)), np.tile(UNKNOWN * np.eye(FLIGHT), (n, c, 1, 1))
    first = _updated(mean, spread, noise(0), seen[0], both[0])
    means, spreads = [first[0]], [first[1]]
    for part in moves.alike(max(1, AT_ONCE // (n * c))):
        for i, (matrix, offset, added) in enumerate(zip(*moves.at(part), strict=True), part.start + 1):
            mean = (matrix @ means[-1][..., None])[..., 0] + offset
            spread = matrix @ spreads[-1] @ matrix.swapaxes(-1, -2)
            spread += added
            mean, spread = _updated(mean, spread, noise(i), seen[i], both[i])
            means.append(mean)
            spreads.append(spread)
    return means, spreads


def _updated(mean: Array, spread: Array, noise: Array, seen: Array, both: Array) -> tuple[Array, Array]:
    """Means and covariances with what was ``seen`` (n, 1, 5) of the poses, with errors of covariance ``noise``."""
    total = torch.from_numpy(spread[..., :FREEDOMS, :FREEDOMS] * both + noise)
    observed = spread[..., :FREEDOMS, :] * seen[..., None]
    gain = torch.linalg.solve(total, torch.from_numpy(observed)).mT.numpy()
    # The reference goes through the measured pose: what was observed of the difference is 0.
    mean = mean - (gain @ (mean[..., :FREEDOMS] * seen)[..., None])[..., 0]
    keep = np.tile(np.eye(spread.shape[-1]), (*spread.shape[:-2], 1, 1))
    keep[..., :FREEDOMS] -= gain * seen[..., None, :]
    return mean, keep @ spread @ keep.swapaxes(-1, -2) + gain @ noise @ gain.swapaxes(-1, -2)


def backward(means: list[Array], spreads: list[Array], moves: Moves) -> Iterator[tuple[int, State]]:
    """States given all data with their frames' numbers, from the last frame to the first; the lists become empty."""
    mean, spread = means.pop(), spreads.pop()
    yield len(means), State(mean, spread, np.empty(0), spread)
    at_once = max(1, AT_ONCE // mean[..., 0].size)
    for part in reversed(moves.alike(at_once)):
        matrix, offset, added = moves.at(part)
        own, known = np.stack(means[part]), np.stack(spreads[part])
        del means[part], spreads[part]
        expected = (matrix @ own[..., None])[..., 0] + offset
        along = matrix @ known
        gain = np.ascontiguousarray(_solve(along @ matrix.swapaxes(-1, -2) + added, along).swapaxes(-1, -2))
        keep = np.eye(known.shape[-1]) - gain @ matrix
        # A sum of squares: a difference of covariances would lose what the unknown start makes large.
        rest = keep @ known @ keep.swapaxes(-1, -2) + gain @ added @ gain.swapaxes(-1, -2)
        for i in reversed(range(len(own))):
            mean = own[i] + (gain[i] @ (mean - expected[i])[..., None])[..., 0]
            spread = gain[i] @ spread @ gain[i].swapaxes(-1, -2)
            spread += rest[i]
            yield part.start + i, State(mean, spread, gain[i], rest[i])


def _solve(matrix: Array, right: Array) -> Array:
    """Solution for a symmetric positive matrix whose rows differ by many orders of magnitude."""
    size = np.sqrt(np.diagonal(matrix, axis1=-2, axis2=-1))
    even = torch.from_numpy(matrix / size[..., :, None] / size[..., None, :])
    known = torch.from_numpy(right / size[..., None])
    factor, failed = torch.linalg.cholesky_ex(even)
    solution = torch.cholesky_solve(known, factor)
    if failed.any():
        # Behind a contact of a frame or less pose, rate and acceleration may be one number, but for rounding.
        values, vectors = torch.linalg.eigh(even[failed > 0])
        values = torch.maximum(values, SINGULAR * values[..., -1:])
        solution[failed > 0] = vectors @ ((vectors.mT @ known[failed > 0]) / values[..., None])
    return solution.numpy() / size[..., None]
