"""Errors of the radius on a map of the ball that the residuals do not show."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchsphere.geometry.circle import Circle

#: Systematic error of the radius by the model of the edge, px, further error where the ball does not turn, as the map
#: takes a texture at the limb for a part of the outline, and turn of the limb that halves it, px (docs/constants.toml).
RADIUS_ERROR_PX, STILL_RADIUS_ERROR_PX, HALVING_TURN_PX = 0.003, 0.055, 4.0

#: Error of the radius in light from one side, px per amplitude of the light across the line of sight: where the ball is
#: dark the outline hardly shows (docs/constants.toml).
RADIUS_ERROR_PER_LIGHT = 0.07

#: Blur that optics alone make, px, and error per px of further blur of a radius whose start has no known error
#: (docs/constants.toml).
OPTICS_BLUR_PX, RADIUS_ERROR_PER_BLUR = 0.3, 0.8

#: Blur of the map's outline over that of the images from which both are that of the optics, and error of the radius
#: per px of it, px (docs/constants.toml).
LEAST_OF_OPTICS, RADIUS_ERROR_PER_OPTICS = 0.7, 0.05

#: Error of the radius of a ball whose outline is not known, px, for a turn of 1 rad out of the image plane
#: (docs/constants.toml).
RADIUS_ERROR_PER_TURN = 0.05

#: Distance of the map's radius from that of the outline, in standard deviations of the latter, from which one of the
#: two is wrong and the distance counts as the radius' error (docs/constants.toml).
MAX_OFF_OUTLINE_SD = 3.0

#: A turn, rad, that tells nothing of the radius.
MIN_TURN = 1e-6


def of_model(orientation: Tensor, radius: float) -> float:
    """Systematic error of the ``radius``, px, more where texture may pass for outline.

    Turns ``orientation`` (k, 3, 3) bring new texture over the limb between the images; a turn in the image brings none.
    """
    sight = orientation[:, 2]
    way_px = radius * float((sight[1:] - sight[:-1]).norm(dim=1).sum())
    return math.hypot(RADIUS_ERROR_PX, STILL_RADIUS_ERROR_PX / (1 + way_px / HALVING_TURN_PX))


def by_light(light: Tensor) -> float:
    """Systematic error of the radius, px, by what the ``light`` (4,) lacks of attached shadows and reflections."""
    return RADIUS_ERROR_PER_LIGHT * float(light[1:3].norm())


def by_blur(edge_blur: float, outline_px: float, start: Circle) -> float:
    """Systematic error of the radius by a blurred outline, px.

    Where the outline of the map has the blur ``outline_px`` that outlines in the images have, 0 if it is not known, the
    model holds it. Elsewhere something else blurs the outline, or a codec the images, and the radius hardly leaves that
    of the ``start``.
    """
    beyond = max(edge_blur - OPTICS_BLUR_PX, 0.0)
    if outline_px and edge_blur > LEAST_OF_OPTICS * outline_px:
        return RADIUS_ERROR_PER_OPTICS * beyond
    return min(RADIUS_ERROR_PER_BLUR * beyond, start.sd_radius if is_measured(start) else math.inf)


def by_outline(radius: float, orientation: Tensor, start: Circle) -> float:
    """What the map's ``radius`` may be off, px, by what the outline of the ``start`` tells.

    A map may hold a rim of background: all images of a ball that hardly turns agree with it, and only the outline does
    not. Where the outline was measured, it contradicts the map or it does not. Elsewhere the map corrects a guess, or
    what was given, as well as the turn in ``orientation`` (k, 3, 3) allows.
    """
    off = abs(radius - start.radius)
    if is_measured(start):
        return off if off > MAX_OFF_OUTLINE_SD * start.sd_radius else 0.0
    by_turn = RADIUS_ERROR_PER_TURN / max(turn_out_of_plane(orientation), MIN_TURN)
    return min(by_turn, start.sd_radius if start.sd_guessed else off)


def turn_out_of_plane(orientation: Tensor) -> float:
    """Largest angle, rad, between the sides of the ball that face the camera in the first and in another frame.

    The line of sight in the ball's frame is the last row of its ``orientation`` (k, 3, 3).
    """
    facing = orientation[:, 2]
    apart = torch.linalg.norm(torch.linalg.cross(facing, facing[:1].expand_as(facing)), dim=1)
    return float(torch.atan2(apart, facing @ facing[0]).max())


def is_measured(outline: Circle) -> bool:
    """Whether the image told the outline's radius: not so if it was given, or only guessed."""
    return math.isfinite(outline.sd_radius) and outline.sd_radius > 0 and not outline.sd_guessed
