"""The map of the ball, and the light on it, that fit the images best where the poses are what they are.

Both enter the grey levels linearly; the map's thousands of coefficients touch their neighbours only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy  # which imports scipy.sparse on its first use: 0.1 s, and a track without a map has none
import torch
from numpy.typing import NDArray

from torchsphere.kernels.map_equations import Products
from torchsphere.runtime import threads
from torchsphere.sphere_map import cube_map, forward_model, pixel_weights, projection, schur
from torchsphere.sphere_map.pixel_weights import Profile
from torchsphere.sphere_map.projection import Ball, Pose, Sight
from torchsphere.sphere_map.window import Window

Array = NDArray[np.float64]

#: Steps of the conjugate gradients for a map.
MAP_STEPS = 60

#: Share of the squared residuals that a change of the shading must explain to be believed, how often it is sought, and
#: the standard deviation of its terms beforehand: slow light and a slow ball cannot be told apart.
EXPLAINED, SHADING_ROUNDS, SHADING_SD = 0.01, 4, 0.3


def first_map(
    windows: list[Window], poses: list[Pose], ball: Ball, profile: Profile, gain_rounds: int = 0
) -> tuple[Ball, list[Pose]]:
    """The map that fits the images best where the poses are what they are, and the poses.

    With ``gain_rounds`` map and gains are fitted in turns. The equations stay those of the first gains then: they only
    lead the way to where the exact residuals pull no more.
    """
    sights = projection.sights(windows, poses, ball)
    ball = replace(ball, coefficients=torch.zeros(cube_map.size(ball.cells), dtype=torch.float64))
    normal = _map_equations(windows, sights, poses, ball.cells, profile)
    seen = np.flatnonzero(normal.diagonal() > 0)
    matrix = schur.with_prior(normal, seen, ball.cells)
    ball = _nearer(windows, sights, poses, ball, profile, matrix, seen)
    for _ in range(gain_rounds):
        poses = _levelled(windows, sights, poses, ball, profile)
        ball = _nearer(windows, sights, poses, ball, profile, matrix, seen)
    # What no image has shown is as grey as the rest.
    coefficients = ball.coefficients.clone()
    coefficients[normal.diagonal() == 0] = coefficients[seen].median()
    return replace(ball, coefficients=coefficients), poses


def _nearer(
    windows: list[Window],
    sights: list[Sight],
    poses: list[Pose],
    ball: Ball,
    profile: Profile,
    matrix: scipy.sparse.csr_matrix,
    seen: NDArray[np.int64],
) -> Ball:
    """The ball with its map a step nearer to what fits best, by the normal ``matrix`` of its ``seen`` coefficients."""
    coefficients = ball.coefficients.numpy().copy()
    pull = _pull(windows, sights, poses, ball, profile) - schur.RIDGE * coefficients
    step, _ = scipy.sparse.linalg.cg(matrix, pull[seen], maxiter=MAP_STEPS)
    coefficients[seen] += step
    return replace(ball, coefficients=torch.from_numpy(coefficients))


def _map_equations(
    windows: list[Window], sights: list[Sight], poses: list[Pose], cells: int, profile: Profile
) -> scipy.sparse.csr_matrix:
    """Normal equations (m, m) of the map alone."""
    products = Products(cells)

    def of_one(window: Window, seen: Sight, pose: Pose) -> tuple[scipy.sparse.csr_matrix, Array]:
        design = schur.design_matrix(window, seen.look, seen.onto_pixels(window, pose))
        return design, pixel_weights.weights(window, pose, profile).double().numpy()

    for design, weights in threads.each(of_one, windows, sights, poses):
        products.add(design, weights)
    return products.matrix()


def _levelled(
    windows: list[Window], sights: list[Sight], poses: list[Pose], ball: Ball, profile: Profile
) -> list[Pose]:
    """The poses with the gains and offsets that fit best."""

    def of_one(window: Window, seen: Sight, pose: Pose) -> Pose:
        return pixel_weights.levelled(
            window, pose, profile, forward_model.levels(window, seen, pose, ball.coefficients)
        )

    return list(threads.each(of_one, windows, sights, poses))


def brought_up_to_date(
    windows: list[Window],
    sights: list[Sight],
    poses: list[Pose],
    ball: Ball,
    profile: Profile,
    elimination: schur.Elimination,
) -> Ball:
    """The ball with its map brought up to date with poses that have moved; near the limb that is no linear change."""
    pull = _pull(windows, sights, poses, ball, profile)
    coefficients = ball.coefficients.numpy().copy()
    coefficients[elimination.seen] += elimination.map.solve(pull[elimination.seen])
    return replace(ball, coefficients=torch.from_numpy(coefficients))


def _pull(windows: list[Window], sights: list[Sight], poses: list[Pose], ball: Ball, profile: Profile) -> Array:
    """Where the residuals and the map's smoothness pull its coefficients (m,)."""

    def of_one(window: Window, seen: Sight, pose: Pose) -> Array:
        rest = window.levels - forward_model.levels(window, seen, pose, ball.coefficients)
        weighted = pixel_weights.weights(window, pose, profile) * rest
        return seen.look.add(window.spread(pose.gain * seen.share * weighted, seen.light)).double().numpy()

    pull = -schur.SMOOTHNESS * (schur.roughness_matrix(ball.cells) @ ball.coefficients.numpy())
    for own in threads.each(of_one, windows, sights, poses):
        pull += own
    return pull


def shaded(windows: list[Window], poses: list[Pose], ball: Ball, profile: Profile) -> Ball:
    """The ball under the light that fits all images best, where the light is seen to differ from side to side.

    Map and light are solved for together: fitted in turns, the map would keep what light it has taken in.
    """
    for _ in range(SHADING_ROUNDS):
        equations = _Equations.of(windows, poses, ball, profile)
        seen = np.flatnonzero(equations.normal.diagonal() > 0)
        matrix, coupling = schur.with_prior(equations.normal, seen, ball.cells), equations.coupling[seen]
        coefficients = ball.coefficients.numpy()
        pull = (equations.of_map - schur.SMOOTHNESS * (schur.roughness_matrix(ball.cells) @ coefficients))[seen]
        cg = scipy.sparse.linalg.cg
        solved = np.stack([cg(matrix, column, maxiter=MAP_STEPS)[0] for column in coupling.T], 1)
        right, _ = cg(matrix, pull, maxiter=MAP_STEPS)
        # The constant of the light only scales the map.
        reduced, gradient = (equations.own - coupling.T @ solved)[1:, 1:], (equations.of_light - coupling.T @ right)[1:]
        change = np.linalg.solve(reduced + np.eye(projection.SHADES - 1) / SHADING_SD**2, gradient)
        if change @ gradient < EXPLAINED * equations.squares:
            return ball
        change = np.concatenate(([0.0], change))
        coefficients = coefficients.copy()
        coefficients[seen] += right - solved @ change
        shading = ball.shading + torch.from_numpy(change)
        ball = replace(ball, coefficients=torch.from_numpy(coefficients), shading=shading)
    return ball


@dataclass(frozen=True)
class _Equations:
    """Normal equations of the map's m coefficients and the light's 4, and the weighted sum of squared residuals.

    Attributes
    ----------
    normal : csr_matrix
        Of the map (m, m).
    coupling : ndarray
        Of map and light (m, 4).
    own : ndarray
        Of the light (4, 4).
    of_map, of_light : ndarray
        Right sides (m,) and (4,).
    squares : float
    """

    normal: scipy.sparse.csr_matrix
    coupling: Array
    own: Array
    of_map: Array
    of_light: Array
    squares: float

    @classmethod
    def of(cls, windows: list[Window], poses: list[Pose], ball: Ball, profile: Profile) -> _Equations:
        """Those of all images together."""
        count = cube_map.size(ball.cells)
        products, of_map = Products(ball.cells), np.zeros(count)
        coupling, own = np.zeros((count, projection.SHADES)), np.zeros((projection.SHADES, projection.SHADES))
        of_light, squares = np.zeros(projection.SHADES), 0.0
        for window, pose in zip(windows, poses, strict=True):
            now = forward_model.linearised(window, pose, ball)
            design = schur.design_matrix(window, now.look, now.light)
            lights = forward_model.lights(window, pose, ball).double().numpy()
            weights = pixel_weights.weights(window, pose, profile).double().numpy()
            rest = (window.levels - now.levels).double().numpy()
            weighted = design.multiply(weights[:, None]).tocsr()
            products.add(design, weights)
            of_map += weighted.T @ rest
            coupling += weighted.T @ lights
            own += lights.T @ (weights[:, None] * lights)
            of_light += lights.T @ (weights * rest)
            squares += float(weights @ rest**2)
        return cls(products.matrix(), coupling, own, of_map, of_light, squares)
