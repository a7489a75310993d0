"""A step of many small Kalman filters, each row of them with a matrix of its own."""

from __future__ import annotations

from torchsphere.kernels.jit import Doubles, compiled


@compiled
def move(old: Doubles, matrix: Doubles, added: Doubles, new: Doubles) -> None:
    """Move the rows of filters of one value, in the order of `estimation.filter_bank`, to the next frame.

    ``old`` (rows + q, b, s) ends with the q factors of the covariances ``added`` (q, b, s', s') that the step adds;
    ``matrix`` (b, s', s) moves the states; ``new`` has the rows after the step first.
    """
    after, before = matrix.shape[1:]
    rows = before * (before + 1) // 2 + before
    for i in range(matrix.shape[0]):
        out = 0
        for a in range(after):
            for b in range(a, after):
                new[out, i, :] = 0.0
                _add_covariance(old, matrix[i], a, b, i, new[out, i])
                for q in range(added.shape[0]):
                    _add(added[q, i, a, b], old[rows + q, i], new[out, i])
                out += 1
            new[out, i, :] = 0.0
            at = -1
            for c in range(before):
                at += before - c + 1
                _add(matrix[i, a, c], old[at, i], new[out, i])
            out += 1


@compiled
def _add_covariance(old: Doubles, matrix: Doubles, a: int, b: int, i: int, found: Doubles) -> None:
    """Add the covariance of the states ``a`` and ``b`` after the step, from all covariances before it."""
    before = matrix.shape[1]
    at = 0
    for c in range(before):
        _add(matrix[a, c] * matrix[b, c], old[at, i], found)
        for d in range(c + 1, before):
            _add(matrix[a, c] * matrix[b, d] + matrix[a, d] * matrix[b, c], old[at + d - c, i], found)
        at += before - c + 1


@compiled
def _add(factor: float, values: Doubles, found: Doubles) -> None:
    if factor != 0.0:
        for j in range(len(found)):
            found[j] += factor * values[j]
