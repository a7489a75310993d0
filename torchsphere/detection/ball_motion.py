"""Whether a circle is a ball by its motion: it moves against what is still, or its texture turns as a ball's does.

A poster of a ball and a clock on the wall have an outline, too. They move as what surrounds them moves: not at all, or
with the camera. A ball that neither moves nor turns looks alike, so that nothing tells it from these.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere.correlation.correlate import correlate_pairs
from torchsphere.correlation.options import Options, adapt_pre_blur
from torchsphere.detection import limb_fit, outline_fit
from torchsphere.detection.candidates import MIN_PART
from torchsphere.detection.scene import Scene
from torchsphere.imaging import template_matching
from torchsphere.imaging.interpolation import blur

#: Least motion that proves a ball, px at its front, and the same in standard deviations (docs/constants.toml).
MIN_MOTION_PX, MIN_MOTION_SD = 0.5, 6.0

#: Distances of the frames that are compared with that of the circle, frames: a slow ball needs time.
DISTANCES = (1, 2, 4, 8, 16, 32)

#: Reach of the search for the disc in the next frame, radii beyond its outline.
REACH = 8.0

#: Largest relative difference of the radius of one ball in two frames (docs/constants.toml).
MAX_RADIUS_CHANGE = 0.05

#: Side of the blocks that show the motion of what surrounds a ball, px, the most of them, and the fewest that tell.
BLOCK_PX, MAX_BLOCKS, MIN_BLOCKS = 24, 48, 4

#: Distance of a block from the outline, px, and blur of the blocks against noise, px.
CLEARANCE_PX, BLOCK_BLUR_PX = 6.0, 1.0

#: Correlation coefficient of a block that is seen again (docs/constants.toml).
MIN_ALIKE = 0.5


@dataclass(frozen=True)
class Disc:
    """A disc in a frame that may be the ball."""

    circle: Tensor  # (3,), px
    frame: int
    plain: bool  # whether it has no texture
    variance: float = 0.0  # of its centre: the sum of those of x and y, px^2

    @property
    def radius(self) -> float:
        """The radius, px."""
        return float(self.circle[2])


@dataclass(frozen=True)
class Motion:
    """Motion of a disc from one frame to another."""

    step: Tensor  # of the centre (2,), px
    radius: float  # in the other frame, px
    rotation: Tensor  # (3,), rad; 0 where only the outline shows the motion
    sd_px: float  # standard deviation of the motion of the ball's front
    variance: float  # of the centre in the other frame, px^2

    @property
    def is_of_texture(self) -> bool:
        """Whether the texture shows it, and not the outline alone."""
        return bool(self.rotation.any())


def step_of_ball(scene: Scene, disc: Disc, *, hidden: bool = False) -> Tensor | None:
    """Step (2,) per frame, px, of a ``disc`` that moves as a ball, twice in succession; None where it does not.

    It is compared with frames after it, or before it at the end. A ball of which a part is ``hidden`` must turn.
    """
    step = torch.zeros(2, dtype=torch.float64)
    for distance in DISTANCES:
        signed = distance if disc.frame + distance < scene.count else -distance
        if disc.frame + signed < 0:
            break
        motion, is_of_ball = _compared(scene, disc, signed, step, hidden=hidden)
        if motion is None:
            continue
        step = motion.step / signed
        if is_of_ball and _is_confirmed(scene, disc, signed, motion, hidden=hidden):
            return step
    return None


def _is_confirmed(scene: Scene, disc: Disc, distance: int, motion: Motion, *, hidden: bool) -> bool:
    """Whether the disc moves on as a ball after a ``motion``, or moved so before; True where there is no such frame."""
    after = Disc(_moved(disc, motion), disc.frame + distance, disc.plain, motion.variance)
    step = motion.step / distance
    if 0 <= after.frame + distance < scene.count:
        again, is_of_ball = _compared(scene, after, distance, step, hidden=hidden)
    elif 0 <= disc.frame - distance < scene.count:
        again, is_of_ball = _compared(scene, disc, -distance, step, hidden=hidden)
    else:
        return True
    # Texture and outline are one ball's: where they show different motions, one of them was mistaken.
    return is_of_ball and again is not None and again.is_of_texture == motion.is_of_texture


def _compared(scene: Scene, disc: Disc, distance: int, step: Tensor, *, hidden: bool) -> tuple[Motion | None, bool]:
    """Motion of the disc to the frame at a ``distance``, and whether it is a ball's; None where it is not there.

    ``step`` (2,) is the expected one per frame.
    """
    f, g = scene.image(disc.frame), scene.image(disc.frame + distance)
    place = _best_match(f, g, disc, scene.ignore) if abs(distance) == 1 else disc.circle[:2] + distance * step
    by_texture = None if disc.plain else _motion_of_texture(f, g, disc, place, scene.ignore)
    if by_texture is not None and _is_of_ball(scene, disc, distance, by_texture, hidden=hidden):
        return by_texture, True
    # An outline does not show a turn.
    by_outline = None if hidden else _motion_of_outline(scene, disc, distance, place)
    if by_outline is not None and _is_of_ball(scene, disc, distance, by_outline, hidden=hidden):
        return by_outline, True
    return by_texture or by_outline, False


def _is_of_ball(scene: Scene, disc: Disc, distance: int, motion: Motion, *, hidden: bool) -> bool:
    """Whether the outline moves along, and a picture on something that surrounds the disc would not move so."""
    least = max(MIN_MOTION_PX, MIN_MOTION_SD * motion.sd_px)
    # A picture cannot turn out of its plane.
    turns = disc.radius * float(motion.rotation[:2].norm()) > least
    in_plane = max(float(motion.step.norm()), disc.radius * abs(float(motion.rotation[2])))
    if not (turns or (in_plane > least and not hidden)):
        return False
    arcs = scene.arcs(disc.frame + distance, _moved(disc, motion))
    if not (arcs.are_all_round or (hidden and arcs.share >= MIN_PART)):
        return False
    f, g = scene.image(disc.frame), scene.image(disc.frame + distance)
    return turns or not surroundings_follow(f, g, disc.circle, motion, scene.ignore)


def _moved(disc: Disc, motion: Motion) -> Tensor:
    """The circle (3,) after the motion, px."""
    return torch.cat((disc.circle[:2] + motion.step, disc.circle.new_tensor([motion.radius])))


def _best_match(f: Tensor, g: Tensor, disc: Disc, ignore: Tensor | None) -> Tensor:
    """Place (2,), px, in ``g`` (h, w) that looks most like the disc in ``f``, within `REACH`."""
    reach = (1 + REACH) * disc.radius
    corner = (disc.circle[:2] - reach).floor().clamp_min(0).long()
    part = tuple(slice(int(c), int(c + 2 * reach) + 1) for c in corner.flip(0))
    within = None if ignore is None else ignore[part]
    return template_matching.best_match(f[part], g[part], disc.circle[:2] - corner, disc.radius, within) + corner


def _motion_of_texture(f: Tensor, g: Tensor, disc: Disc, place: Tensor, ignore: Tensor | None) -> Motion | None:
    """Motion of the texture from image ``f`` to ``g`` (h, w), to about ``place`` (2,); None where it differs."""
    circle, starts = disc.circle, torch.zeros(2, 5, dtype=torch.float64)
    starts[0, :2] = place - circle[:2]
    options = adapt_pre_blur(Options(), disc.radius)
    both_f, both_g = (image.expand(2, -1, -1) for image in (f, g))
    found = correlate_pairs(both_f, both_g, circle.expand(2, 3), starts.to(f), ignore, options)
    is_ok = torch.from_numpy(found.status == "ok")
    if not bool(is_ok.any()):
        return None
    best = int(torch.where(is_ok, found.zncc.cpu(), -1.0).argmax())
    q, variance = found.q[best].double().cpu(), found.covariance[best].diagonal().double().cpu()
    sd_px = float((variance[:2].sum() + circle[2].square() * variance[2:].sum()).clamp_min(0).sqrt())
    return Motion(q[:2], disc.radius, q[2:], sd_px, disc.variance + float(variance[:2].sum()))


def _motion_of_outline(scene: Scene, disc: Disc, distance: int, place: Tensor) -> Motion | None:
    """Motion of the outline to about ``place`` (2,) in the frame at a ``distance``; None where it is not there."""
    views, radius = scene.views(disc.frame + distance), disc.radius
    guess = torch.cat((place, disc.circle[2:])).expand(len(views), 3)
    fit = outline_fit.refine(
        views, guess, ignore=scene.ignore, window=max(2.0, 0.06 * radius), plain=disc.plain, patterned=not disc.plain
    )
    # Fits that failed are NaN.
    found, covariance = fit.circle[fit.support > 0], fit.covariance[fit.support > 0]
    if not disc.plain and len(found):
        found, covariance = limb_fit.fit(views[fit.support > 0], found, ignore=scene.ignore)
    is_same = (found[:, 2] / radius - 1).abs() < MAX_RADIUS_CHANGE
    if not bool(is_same.any()):
        return None
    variance = covariance[:, :2, :2].diagonal(dim1=1, dim2=2).sum(-1).clamp_min(0)
    best = int(torch.where(is_same & variance.isfinite(), variance, torch.inf).argmin())
    step, of_centre = found[best, :2] - disc.circle[:2], float(variance[best])
    # The centre in the first frame has an error of this size at least.
    sd_px = math.sqrt(of_centre + max(of_centre, disc.variance))
    return Motion(step, float(found[best, 2]), torch.zeros(3, dtype=torch.float64), sd_px, of_centre)


def surroundings_follow(f: Tensor, g: Tensor, circle: Tensor, motion: Motion, ignore: Tensor | None) -> bool:
    """Whether what surrounds the disc moves in the image as the disc does; False where nothing tells."""
    corners = _corners(f, circle, motion, ignore)
    if len(corners) < MIN_BLOCKS:
        return False
    middles = corners + (BLOCK_PX - 1) / 2
    across = torch.stack((circle[1] - middles[:, 1], middles[:, 0] - circle[0]), -1)
    expected = motion.step + float(motion.rotation[2]) * across
    whole = expected.round()
    first, still, moved = (_blocks(image, at) for image, at in ((f, corners), (g, corners), (g, corners + whole)))
    alike_still, alike_moved = _alike(first, still), _alike(first, moved)
    follows = alike_moved > alike_still
    near = (whole == 0).all(-1)
    if bool(near.any()):
        shift = _shifts(first[near], still[near])
        follows[near] = (shift - expected[near]).norm(dim=-1) < shift.norm(dim=-1)
    tells = torch.maximum(alike_still, alike_moved) > MIN_ALIKE
    return int(tells.sum()) >= MIN_BLOCKS and float(follows[tells].double().mean()) > 0.5


def _corners(image: Tensor, circle: Tensor, motion: Motion, ignore: Tensor | None) -> Tensor:
    """First column and row (k, 2) of blocks that are clear of the disc in both frames."""
    height, width = image.shape
    columns, rows = (torch.arange(0, size - BLOCK_PX + 1, BLOCK_PX).double() for size in (width, height))
    corners = torch.cartesian_prod(columns, rows)
    if ignore is not None:
        used = ~ignore.cpu().unfold(0, BLOCK_PX, BLOCK_PX).unfold(1, BLOCK_PX, BLOCK_PX).flatten(2).any(-1)
        corners = corners[used.T.flatten()]
    clear = torch.ones(len(corners), dtype=torch.bool)
    for centre in (circle[:2], circle[:2] + motion.step):
        beside = centre.clamp(corners, corners + BLOCK_PX - 1) - centre
        clear &= beside.norm(dim=-1) > float(circle[2]) + CLEARANCE_PX
    corners = corners[clear]
    chosen = torch.linspace(0, len(corners) - 1, min(MAX_BLOCKS, len(corners))).round().long()
    return corners[chosen]


def _blocks(image: Tensor, corners: Tensor) -> Tensor:
    """Blocks (k, s, s), float64, blurred, without mean and slope; beyond the image its border is repeated."""
    height, width = image.shape
    steps = torch.arange(BLOCK_PX)
    x, y = ((corners[:, k, None].long() + steps).clamp(0, size - 1) for k, size in enumerate((width, height)))
    blocks = blur(image.cpu().double()[y[:, :, None], x[:, None, :]], BLOCK_BLUR_PX)
    slope = steps.double() - steps.double().mean()
    level = blocks.mean((1, 2), keepdim=True)
    down = (blocks * slope[:, None]).sum((1, 2), keepdim=True) / (BLOCK_PX * slope.square().sum())
    right = (blocks * slope).sum((1, 2), keepdim=True) / (BLOCK_PX * slope.square().sum())
    return blocks - level - down * slope[:, None] - right * slope


def _alike(first: Tensor, second: Tensor) -> Tensor:
    """Correlation coefficients (k,) of blocks (k, s, s)."""
    products = ((a * b).sum((1, 2)) for a, b in ((first, second), (first, first), (second, second)))
    both, one, other = products
    return (both / (one * other).sqrt()).nan_to_num(0.0)


def _shifts(first: Tensor, second: Tensor) -> Tensor:
    """Shifts (k, 2) as (x, y), px, from the ``first`` to the ``second`` blocks (k, s, s), of less than about a px."""
    down, right = torch.gradient(first, dim=(1, 2))
    jacobian = torch.stack((right, down, first), -1).flatten(1, 2)
    normal = jacobian.mT @ jacobian + 1e-9 * torch.eye(3, dtype=first.dtype) * first.square().sum((1, 2))[:, None, None]
    change = (second - first).flatten(1)[..., None]
    return -torch.linalg.solve(normal, jacobian.mT @ change)[:, :2, 0]
