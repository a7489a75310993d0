"""The status of a pair of images, and of the frame to which it leads: one word for what was found.

No other module decides on a status. Loads no torch, as reports and pages name the statuses, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from torch import Tensor

#: The words, from what is measured whole to what is not known at all; their meaning is in docs/status.md.
STATUSES = ("ok", "weak_texture", "low_correlation", "not_converged", "out_of_frame", "lost")
OK, WEAK_TEXTURE, LOW_CORRELATION, NOT_CONVERGED, OUT_OF_FRAME, LOST = STATUSES

#: Statuses of frames with a measured translation, and of frames with a measured translation and rotation.
TRANSLATION_KNOWN, ALL_KNOWN = (OK, WEAK_TEXTURE), (OK,)

Words = NDArray[np.str_]
Rows = NDArray[np.bool_]


def of_pairs(
    *, is_alike: Tensor, converged: Tensor, has_texture: Tensor, is_in_view: Tensor, is_known: Tensor | None = None
) -> Tensor:
    """Places (n,) in `STATUSES` of n pairs; of several reasons the last one counts, which explains the others.

    All arguments are (n,): whether the images are alike, the solution has settled, the texture determines every mode,
    enough of the ball is in view, and all values near it are finite.
    """
    status = (~is_alike).long() * STATUSES.index(LOW_CORRELATION)
    for good, name in ((converged, NOT_CONVERGED), (has_texture, WEAK_TEXTURE), (is_in_view, OUT_OF_FRAME)):
        status = status.masked_fill(~good, STATUSES.index(name))
    return status if is_known is None else status.masked_fill(~is_known, STATUSES.index(LOST))


def of_flat_images(status: Tensor, is_flat: Tensor) -> Tensor:
    """The ``status`` (n,) of `of_pairs` where ``is_flat`` (n,) tells images in view without any contrast."""
    return status.masked_fill(is_flat, STATUSES.index(WEAK_TEXTURE))


def words(status: Tensor) -> Words:
    """The words (n,) of places in `STATUSES`."""
    return np.array(STATUSES)[status.cpu().numpy()]


def of_both_ways(back: Words, disagree: Rows) -> Words:
    """The status (m,) of pairs that were measured both ways: that of the way ``back``, unless both ways disagree."""
    return np.where(disagree, NOT_CONVERGED, back)


def of_unknown_values(status: Words, finite: Rows) -> Words:
    """The ``status`` (n,) of pairs, of which failed ones without ``finite`` (n,) values alone tell nothing."""
    return np.where(~np.isin(status, (OK, OUT_OF_FRAME)) & ~finite, LOST, status)


def of_unmeasured(count: int) -> Words:
    """The status of ``count`` frames before any is measured."""
    return np.full(count, LOST, dtype=f"<U{max(map(len, STATUSES))}")


def without(status: Words, left_out: Any) -> Words:
    """The ``status`` (n,) of frames of which those ``left_out`` (n,) are not the ball's, or have no step."""
    return np.where(left_out, LOST, status)


def without_rotation(status: Words) -> Words:
    """The ``status`` (n,) of frames by a model without rotation, which was not measured then."""
    return np.where(status == OK, WEAK_TEXTURE, status)


def of_frame(pair: str, *, is_placed: bool, has_step: bool, is_plain: bool, has_left: bool) -> str:
    """The status of a frame that was measured by itself, from that of its ``pair`` with the last frame with the ball.

    ``is_placed``: the ball was found there, by the pair, by outlines or by a search; ``has_step``: that last frame is
    the frame before; ``is_plain``: the ball may lack a texture; ``has_left``: its flight leads out of the image.
    """
    if is_placed:
        # No step leads from the frame before to a ball that was found again.
        return pair if has_step else LOST
    if has_left:
        return OUT_OF_FRAME
    if pair == WEAK_TEXTURE:
        # A patterned ball that seems plain is hidden or absent.
        return LOST if is_plain else LOW_CORRELATION
    return LOST if pair == OUT_OF_FRAME else pair
