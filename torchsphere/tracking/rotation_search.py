"""Position and rotation of the ball without a first guess: rotated templates over small, blurred images.

Each rotation of a grid turns the ball of one image, and this template is matched over the whole other image. The best
matches are first guesses for a correlation, right to half a step of the grid.
"""

from __future__ import annotations

import functools
import math

import scipy  # scipy.fft is loaded on its first use, in 0.13 s: only a track that searches needs it
import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from kornia.geometry.liegroup import So3
from torch import Tensor

from torchsphere.imaging.interpolation import blur

#: Radius of the ball in the small images, and their blur, px (docs/constants.toml).
SMALL_RADIUS_PX, BLUR_PX = 12.5, 1.0

#: Step and largest angle of the grid of rotation vectors, degrees (docs/constants.toml).
STEP_DEG, REACH_DEG = 6.0, 36.0

#: Share of the radius that is matched: further out, the texture is too foreshortened to be turned
#: (docs/constants.toml).
TEMPLATE = 0.9

#: Correlation coefficient below which a template has no match (docs/constants.toml).
MIN_SCORE = 0.6

#: Pixels of the scores in memory at once: those of all rotations over 1024 x 1024 px would take 4 GB.
AT_ONCE = 2_000_000

#: Smallest energy of the texture at a place, as a share of the ball's own (docs/constants.toml).
MIN_ENERGY = 0.1

#: Largest number of guesses.
MAX_GUESSES = 16


@functools.cache
def _rotation_vectors() -> Tensor:
    """Grid of rotation vectors (m, 3) within a ball, rad, float64; the smallest first."""
    count = math.floor(REACH_DEG / STEP_DEG)
    steps = torch.arange(-count, count + 1, dtype=torch.float64) * STEP_DEG
    grid = torch.cartesian_prod(steps, steps, steps)
    kept = grid[grid.norm(dim=-1) <= REACH_DEG + 1e-9]
    return torch.deg2rad(kept[kept.norm(dim=-1).argsort(stable=True)])


def find_guesses(f: Tensor, g: Tensor, centre: Tensor, radius: float, ignore: Tensor | None = None) -> Tensor:
    """First guesses (m, 5) of the increment from ``f`` to ``g`` (h, w), px and rad, float64, CPU; the best first.

    ``centre`` (2,) and ``radius`` of the ball in ``f``, px; ``ignore`` (h, w). No rows where nothing matches the ball.
    """
    factor = max(1, round(radius / SMALL_RADIUS_PX))
    if ignore is not None:
        f, g = (torch.where(ignore, image[~ignore].mean(), image) for image in (f, g))
    small_f, small_g = (blur(F.avg_pool2d(image[None, None], factor)[0], BLUR_PX)[0] for image in (f, g))
    # Pixel i of the small image is the mean of the pixels from i factor on.
    place = (centre.to("cpu", torch.float64) + 0.5) / factor - 0.5
    vectors = _rotation_vectors()
    templates, disc = _templates(small_f, place, radius / factor, vectors)
    best, at = (values.cpu() for values in _match(small_g, templates, disc))
    best, chosen = best.topk(min(MAX_GUESSES, len(best)))
    chosen = chosen[best > MIN_SCORE]
    at = at[chosen]
    matched = torch.stack((at % small_g.shape[-1], at // small_g.shape[-1]), -1).double()
    return torch.cat(((matched - place) * factor, vectors[chosen]), -1)


def _templates(image: Tensor, place: Tensor, radius: float, vectors: Tensor) -> tuple[Tensor, Tensor]:
    """The ball at ``place`` of ``image``, turned by each of the ``vectors``: (m, s, s), of mean 0; its disc (s, s)."""
    reach = math.ceil(TEMPLATE * radius)
    steps = torch.arange(-reach, reach + 1, dtype=torch.float64)
    y, x = torch.meshgrid(steps, steps, indexing="ij")
    disc = (x**2 + y**2) <= (TEMPLATE * radius) ** 2
    points = torch.stack((x, y, -(radius**2 - x**2 - y**2).clamp_min(0).sqrt()), -1)
    # The surface point at P after the turn was at R^T P before; a row vector times R is R^T times the column.
    before = torch.einsum("hwi,mij->mhwj", points, So3.exp(vectors).matrix())
    size = torch.tensor([image.shape[1], image.shape[0]], dtype=torch.float64)
    at = ((before[..., :2] + place) * 2 + 1) / size - 1
    looked_up = F.grid_sample(image.expand(len(at), 1, -1, -1), at.to(image), align_corners=False)[:, 0]
    seen = (disc & (before[..., 2] < 0) & (at.abs() <= 1).all(-1)).to(image)
    mean = (seen * looked_up).sum((1, 2), keepdim=True) / seen.sum((1, 2), keepdim=True).clamp_min(1)
    return (looked_up - mean) * seen, disc.to(image)


def _match(image: Tensor, templates: Tensor, disc: Tensor) -> tuple[Tensor, Tensor]:
    """Highest correlation coefficient (m,) of each template (m, s, s) over ``image``, and number (m,) of its pixel."""
    height, width = image.shape
    reach = disc.shape[-1] // 2
    # Lengths without large prime factors are twice as fast.
    size = tuple(scipy.fft.next_fast_len(length + 2 * reach, real=True) for length in (height, width))

    def spectrum(values: Tensor) -> Tensor:
        return torch.fft.rfft2(values, s=size)

    def summed(values: Tensor, kernels: Tensor) -> Tensor:
        sums = torch.fft.irfft2(values * spectrum(kernels).conj(), s=size)
        # A kernel's first element is at minus `reach` from its middle.
        return sums.roll((reach, reach), (-2, -1))[..., :height, :width]

    level = image - image.mean()
    levels = spectrum(level)
    count = summed(spectrum(torch.ones_like(image)), disc).clamp_min(1)
    mean = summed(levels, disc) / count
    energy = templates.square().sum((1, 2)).clamp_min(1e-6)
    least = MIN_ENERGY * float(energy.max())
    power = (summed(spectrum(level.square()), disc) - count * mean.square()).clamp_min(least).rsqrt()
    some = max(1, AT_ONCE // (size[0] * size[1]))
    scores = ((summed(levels, part) * power).flatten(1).max(-1) for part in templates.split(some))
    best, at = (torch.cat(values) for values in zip(*scores, strict=True))
    return best / energy.sqrt(), at
