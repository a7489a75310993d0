"""Before the test: how far the ball will move between images, and how well the correlation will tell.

Sections 3.3 and 5.2 of the paper. The uncertainty of an increment comes from the package's own correlation operator, on
an example of the image with the motion blur of the test.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.correlation import occlusion, znssd
from torchsphere.correlation.options import Options, margin, suited
from torchsphere.correlation.reference import Filtered, Reference, build_reference, nuisances, scale, slopes
from torchsphere.geometry import motion_models
from torchsphere.imaging import crop
from torchsphere.planning.example_image import Example, blurred, rescaled, white_noise

#: Largest motion blur, px: section 3.3 of the paper.
MOST_BLUR_PX = 5.0

#: Turn per frame from which the changing view of the texture adds errors that noise does not explain, deg: measured
#: in `experiments.accuracy`.
NOISE_ONLY_UP_TO_DEG = 2.0

#: Correlation of the errors of successive increments, which share an image: measured, see `measurements`.
NEIGHBOURS = -0.45

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Setup:
    """A test: ball, speed and camera.

    Attributes
    ----------
    speed_m_s : float
        Of the ball.
    direction_deg : float
        Of its flight in the image, from x (right) towards y (down).
    spin_rev_s : tuple of float
        About x, y, z of the camera frame, revolutions per second.
    diameter_mm, mass_g : float
        Of the ball.
    frame_rate : float
        Frames per second.
    shutter_s : float or None
        Exposure time; None where it is not known.
    px_per_mm : float
        Scale in the plane of the ball.
    noise : float or None
        Standard deviation of a pixel from image to image, grey levels, rounding included; None where not known.
    """

    speed_m_s: float
    frame_rate: float
    px_per_mm: float
    diameter_mm: float
    mass_g: float
    shutter_s: float | None = None
    noise: float | None = None
    direction_deg: float = 0.0
    spin_rev_s: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            free = field.name in ("direction_deg", "spin_rev_s")
            if value is None:
                continue
            values = np.atleast_1d(value)
            if not (np.isfinite(values).all() and (free or (values > 0).all())):
                kind = "finite numbers" if free else "a finite, positive number"
                raise ValueError(f"{field.name} = {value}: expected {kind}")
        # An exposure as long as the interval, rounded in its last digits, is one.
        if self.shutter_s is not None and self.shutter_s * self.frame_rate > 1 + 1e-6:
            raise ValueError(
                f"an exposure of {1e6 * self.shutter_s:.4g} us is longer than the {1e6 / self.frame_rate:.4g} us from "
                f"frame to frame at {self.frame_rate:g} frames/s; give a shorter one"
            )

    @property
    def radius_px(self) -> float:
        """Radius of the ball in the image."""
        return 0.5 * self.diameter_mm * self.px_per_mm

    @property
    def m_per_px(self) -> float:
        """Size of a pixel."""
        return 1e-3 / self.px_per_mm

    @property
    def mass_kg(self) -> float:
        """Mass of the ball."""
        return 1e-3 * self.mass_g

    @property
    def blur(self) -> tuple[float, float]:
        """Motion (x, y) during the exposure, px; none where the exposure is not known."""
        width, angle = float(np.nan_to_num(self.blur_px)), math.radians(self.direction_deg)
        return width * math.cos(angle), width * math.sin(angle)

    @property
    def increment(self) -> Array:
        """Motion (5,) from frame to frame: px and rad."""
        angle = math.radians(self.direction_deg)
        step = self.speed_m_s / self.m_per_px / self.frame_rate
        turn = 2 * math.pi * np.array(self.spin_rev_s) / self.frame_rate
        return np.array([step * math.cos(angle), step * math.sin(angle), *turn])

    @property
    def turn_deg(self) -> float:
        """Turn from frame to frame."""
        return float(np.degrees(np.linalg.norm(self.increment[2:])))

    @property
    def blur_px(self) -> float:
        """Width of the motion blur: ``v t_e`` over the size of a pixel, section 3.3 of the paper; NaN if not known."""
        return math.nan if self.shutter_s is None else self.speed_m_s * self.shutter_s / self.m_per_px

    def frames_in_view(self, width_px: int) -> int:
        """Images that show the whole ball while it crosses a field of that width."""
        step = float(np.hypot(*self.increment[:2]))
        return max(int((width_px - 2 * self.radius_px) / step) + 1, 0)


def increment_covariance(examples: Sequence[Example], setup: Setup, *, is_blurred: bool = False) -> Array:
    """Expected covariance (5, 5) of an increment (dx, dy, wx, wy, wz), px and rad: the mean over the examples.

    Parameters
    ----------
    examples : sequence of Example
        What the ball looks like, one side or several; brought to the test's scale and blurred by its motion.
    setup : Setup
    is_blurred : bool
        The examples show the motion blur of the test already.

    Raises
    ------
    ValueError
        If the noise is not known, or the texture does not carry the modes.

    Notes
    -----
    With the noise ``n_f - n_g`` of both images, the converged increment is off by ``A^-1 J^T (n_f - n_g)``, where ``J``
    is the Jacobian of the recorded, ``A`` that of the noise-free reference, ``A = J^T J`` (equations 7 to 10 of the
    paper). The pre-blur correlates neighbours' noise: the covariance is ``2 sigma^2 A^-1 N A^-1``, as in
    `covariance`, with ``N`` of the gradients blurred once more. The noise of the example, which counts as
    texture in its gradients, is taken out by its companion; the noise of the test is put into ``N``.
    """
    return np.mean([_covariance(example, setup, is_blurred) for example in examples], axis=0)


def _covariance(example: Example, setup: Setup, is_blurred: bool) -> Array:
    if setup.noise is None:
        raise ValueError("the image noise is not given; without it there is no uncertainty to expect")
    options = suited(Options(), setup.radius_px)
    seen = rescaled(example, setup.radius_px)
    if not is_blurred:
        seen = blurred(seen, setup.blur)
    images = torch.stack((seen.image, seen.noise, white_noise(seen.image, setup.noise)))
    reference, q = _reference(images, seen.circle, setup, options)
    plain, twice = (_gram(reference, gradient, q) for gradient in (reference.gradient, reference.blurred_gradient))
    texture, carried = plain[0] - plain[1], twice[0] - twice[1] + twice[2]
    spread, vectors = torch.linalg.eigh(texture)
    if not bool(spread[0] > 1e-3 * plain[2].diagonal().mean()) or not bool(spread[0] > 0):
        raise ValueError(
            f"{seen.origin}: its texture does not tell all five degrees of freedom apart under a noise of "
            f"{setup.noise:g} grey levels; take a ball with a stronger pattern, or check the circle"
        )
    inverse = vectors @ torch.diag(1 / spread) @ vectors.T
    unit = scale(reference, 5)[0].double()
    covariance = 2 * setup.noise**2 * inverse @ carried @ inverse / (unit[:, None] * unit)
    return covariance.numpy()


def _reference(
    images: torch.Tensor, circle: tuple[float, float, float], setup: Setup, options: Options
) -> tuple[Reference, torch.Tensor]:
    """What the correlation makes of the images (m, h, w) of one ball, and the motion (m, 5), px and rad."""
    circles = torch.tensor([circle], dtype=torch.float64).expand(len(images), -1)
    half = crop.half_size(circle[2], margin(options))
    crops = crop.cut(images, circles[:, :2], half)
    filtered = Filtered.of(crops, options.pre_blur)
    reference = build_reference(filtered, circles, options.roi, options.pre_blur, blurred_every=1)
    # The ball is followed, so the translation does not matter; the turn hides points and weighs others less.
    q = torch.tensor([[0.0, 0.0, *setup.increment[2:]]]).to(images).expand(len(images), -1)
    visible = (
        motion_models.displacement(motion_models.finite, q, reference.points, reference.geometry).isfinite().all(-1)
    )
    reference.weights.mul_(visible)
    return occlusion.by_view(reference, q, motion_models.finite), q


def _gram(reference: Reference, gradient: torch.Tensor, q: torch.Tensor) -> torch.Tensor:
    """Operators (m, 5, 5) of the images' gradients, all with offset, gain and light of the first."""
    first = dataclasses.replace(reference, values=reference.values[:1].expand_as(reference.values))
    known = nuisances(first, motion_models.finite, reference.weights)
    jacobian = znssd.project(slopes(gradient, q, motion_models.finite, reference), known, reference.weights)
    return znssd.operator(jacobian, reference.weights)


@dataclass(frozen=True)
class Differences:
    """Standard deviations by plain differences, as the paper takes them (section 2.2 and table 3).

    Attributes
    ----------
    velocity_m_s : ndarray
        (2,): an increment over the frame interval.
    spin_rad_s : ndarray
        (3,), likewise.
    force_N : ndarray
        (2,): mass times the difference of two successive velocities over the interval.
    """

    velocity_m_s: Array
    spin_rad_s: Array
    force_N: Array  # noqa: N815  (N is newton)


def differences(covariance: Array, frame_rate: float, m_per_px: float, mass_kg: float) -> Differences:
    """What increments of that ``covariance`` (5, 5), px and rad, are worth without smoothing."""
    sd = np.sqrt(np.diagonal(covariance))
    velocity = sd[:2] * m_per_px * frame_rate
    # Errors of opposite sign: a difference of two increments has more than twice the variance of one.
    force = mass_kg * frame_rate * velocity * math.sqrt(2 * (1 - NEIGHBOURS))
    return Differences(velocity, sd[2:] * frame_rate, force)
