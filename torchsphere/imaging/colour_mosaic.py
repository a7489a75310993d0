"""Raw images of a colour sensor, taken for grey: the pixels of 2 x 2 differ by their colours, whatever they show.

The colours make three patterns, which alternate along the rows, along the columns, and like a chessboard. Two of the
four pixels are green. So the first two patterns have the same size, block by block, and the same sign where the other
two colours lie on the diagonal from the top left, else the opposite sign. Neither texture nor noise does that, nor rows
of two instants, which alternate along the columns alone. Without the mosaic, rows would be taken for those of
interlaced video.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

from torchsphere.recording import mosaic
from torchsphere.recording.frame_source import Source

#: Side of the blocks that are compared, px, and fewest blocks.
BLOCK, MIN_BLOCKS = 16, 20

#: Least correlation, over the blocks, of the patterns along rows and columns, and their ratio (docs/constants.toml).
MIN_CORRELATION, MAX_RATIO = 0.8, 1.25

#: Least share of a chessboard's blocks of one sign, where red is as bright as blue (docs/constants.toml).
MIN_COHERENCE = 0.9

#: Least size of the patterns, in standard deviations of the grey levels: what is weaker does no harm
#: (docs/constants.toml).
MIN_SIZE = 0.02

#: Patterns by the diagonal of the green pixels: the first from the top right, the second from the top left.
BY_DIAGONAL = (("RGGB", "BGGR"), ("GRBG", "GBRG"))


def without_mosaic(source: Source) -> tuple[Source, tuple[str, ...]]:
    """The green levels of images that are a mosaic, and the patterns that it may have; other images as they are."""
    patterns = recognised(source.images(0, min(2, source.count)))
    if not patterns:
        return source, ()

    def green(images: Tensor) -> Tensor:
        return torch.from_numpy(mosaic.green(images.cpu().numpy(), patterns[0])).to(images)

    return source.changed(green), patterns


def recognised(images: Tensor) -> tuple[str, ...]:
    """The two `torchsphere.settings.choices.BAYER` patterns that ``images`` (n, h, w) may have; none for grey images.

    Red and blue look alike in grey levels, so that the green pixels are known, but not which of both is which.
    """
    if min(images.shape[1:]) < 2 * BLOCK:
        return ()
    rows, columns, chess = (pattern.flatten().double() for pattern in _patterns(images.float()))
    size = torch.stack((rows, columns, chess)).square().mean(1).sqrt()
    contrast = images.double().std()
    if len(rows) < MIN_BLOCKS or float(size.max()) <= MIN_SIZE * float(contrast):
        return ()
    correlation = float((rows * columns).mean() / (size[0] * size[1]).clamp_min(1e-30))
    ratio = float(size[0] / size[1].clamp_min(1e-30))
    if abs(correlation) >= MIN_CORRELATION and 1 / MAX_RATIO <= ratio <= MAX_RATIO:
        return BY_DIAGONAL[0 if correlation > 0 else 1]
    coherence = float(chess.mean() / size[2].clamp_min(1e-30))
    if abs(coherence) >= MIN_COHERENCE and float(size[2]) > MAX_RATIO * float(size[:2].max()):
        # Sensors are made to be the most sensitive to green.
        return BY_DIAGONAL[0 if coherence < 0 else 1]
    return ()


def _patterns(images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Sizes (n, b, c), block by block, of what alternates along rows, along columns, and like a chessboard."""
    fine_x, smooth_x = _second_difference(images), _mean_of_three(images)
    along_rows = _mean_of_three(fine_x.mT).mT
    along_columns = _second_difference(smooth_x.mT).mT
    chess = _second_difference(fine_x.mT).mT
    height, width = chess.shape[1:]
    # The first row and column were left out.
    of_x, of_y = (1 - 2 * ((torch.arange(n, device=images.device) + 1) % 2).to(images) for n in (width, height))
    signs = of_x.expand(height, width), of_y[:, None].expand(height, width), of_y[:, None] * of_x
    patterns = (along_rows, along_columns, chess)
    along_rows, along_columns, chess = (
        F.avg_pool2d(sign * values, BLOCK) for sign, values in zip(signs, patterns, strict=True)
    )
    return along_rows, along_columns, chess


def _second_difference(values: Tensor) -> Tensor:
    """What alternates along the last axis; 0 for a slope."""
    return (2 * values[..., 1:-1] - values[..., :-2] - values[..., 2:]) / 4


def _mean_of_three(values: Tensor) -> Tensor:
    """What does not alternate along the last axis."""
    return (2 * values[..., 1:-1] + values[..., :-2] + values[..., 2:]) / 4
