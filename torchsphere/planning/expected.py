"""Expected motion between images and its uncertainty, before the test: sections 3.3 and 5.2 of the paper.

The uncertainty of an increment comes from the package's own correlation operator, applied to an example of the image
with the motion blur of the test.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.correlation import occlusion, znssd
from torchsphere.correlation.options import Options, adapt_pre_blur, margin
from torchsphere.correlation.reference import Filtered, Reference, build_reference, nuisances, scale, slopes
from torchsphere.geometry import motion_models
from torchsphere.imaging import crop
from torchsphere.planning.example_image import Example, blurred, rescaled, white_noise

#: Largest motion blur, px: section 3.3 of the paper.
MAX_BLUR_PX = 5.0

#: Largest turn per frame whose errors are those of the noise alone, deg (docs/constants.md).
MAX_NOISE_ONLY_DEG = 2.0

#: Correlation of the errors of successive increments, which share an image (docs/constants.md).
SUCCESSIVE_CORRELATION = -0.45

#: Least eigenvalue of the texture's operator, over the mean of the noise's operator.
MIN_EIGENVALUE = 1e-3

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Setup:
    """A test: ball, speed and camera.

    Attributes
    ----------
    speed_m_s : float
        Speed of the ball.
    direction_deg : float
        Direction of its flight in the image, from x (right) towards y (down).
    spin_rev_s : tuple of float
        Spin about x, y, z of the camera frame, revolutions per second.
    diameter_mm, mass_g : float
        Diameter and mass of the ball.
    frame_rate : float
        Frames per second.
    shutter_s : float or None
        Exposure time; None if it is not known.
    px_per_mm : float
        Scale in the plane of the ball.
    noise : float or None
        Standard deviation of a pixel from image to image, grey levels, rounding included; None if not known.
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
        for name, value in vars(self).items():
            if value is None:
                continue
            may_be_negative = name in ("direction_deg", "spin_rev_s")
            values = np.atleast_1d(value)
            if not (np.isfinite(values).all() and (may_be_negative or (values > 0).all())):
                expected = "finite numbers" if may_be_negative else "a finite, positive number"
                raise ValueError(f"{name} = {value}: expected {expected}")
        # An exposure as long as the interval is valid, whatever the rounding of its last digits.
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
        """Motion (x, y) during the exposure, px; 0 if the exposure is not known."""
        length, angle = float(np.nan_to_num(self.blur_px)), math.radians(self.direction_deg)
        return length * math.cos(angle), length * math.sin(angle)

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
        """Length of the motion blur: ``v t_e`` over the size of a pixel, section 3.3 of the paper; NaN if not known."""
        return math.nan if self.shutter_s is None else self.speed_m_s * self.shutter_s / self.m_per_px

    def frames_in_view(self, width_px: int) -> int:
        """Images that show the whole ball on its way across a field of that width."""
        step = float(np.hypot(*self.increment[:2]))
        return max(int((width_px - 2 * self.radius_px) / step) + 1, 0)


def increment_covariance(examples: Sequence[Example], setup: Setup, *, is_blurred: bool = False) -> Array:
    """Expected covariance (5, 5) of an increment (dx, dy, wx, wy, wz), px and rad: the mean over the examples.

    Parameters
    ----------
    examples : sequence of Example
        One side of the ball or several; they are rescaled to the test and blurred by its motion.
    setup : Setup
    is_blurred : bool
        Whether the examples show the motion blur of the test already.

    Raises
    ------
    ValueError
        If the noise is not known, or the texture does not determine all modes.

    Notes
    -----
    With the noise ``n_f - n_g`` of both images, the converged increment is off by ``A^-1 J^T (n_f - n_g)``, with the
    Jacobian ``J`` of the recorded reference and ``A = J^T J`` of the noise-free one (equations 7 to 10 of the paper).
    The pre-blur correlates the noise of neighbouring pixels: the covariance is ``2 sigma^2 A^-1 N A^-1``, with ``N``
    of the gradients blurred once more. The example's noise, which counts as texture in its gradients, is subtracted by
    means of its companion; the noise of the test is added to ``N``.
    """
    return np.mean([_covariance(example, setup, is_blurred) for example in examples], axis=0)


def _covariance(example: Example, setup: Setup, is_blurred: bool) -> Array:
    if setup.noise is None:
        raise ValueError("the image noise is not given; the expected uncertainty needs it")
    options = adapt_pre_blur(Options(), setup.radius_px)
    example = rescaled(example, setup.radius_px)
    if not is_blurred:
        example = blurred(example, setup.blur)
    images = torch.stack((example.image, example.noise, white_noise(example.image, setup.noise)))
    reference, q = _reference(images, example.circle, setup, options)
    single, double = (_operators(reference, slope, q) for slope in (reference.gradient, reference.blurred_gradient))
    texture, noise = single[0] - single[1], double[0] - double[1] + double[2]
    eigenvalues, vectors = torch.linalg.eigh(texture)
    weakest = eigenvalues[0]
    if not bool(weakest > MIN_EIGENVALUE * single[2].diagonal().mean()) or not bool(weakest > 0):
        raise ValueError(
            f"{example.origin}: its texture does not determine all five degrees of freedom under a noise of "
            f"{setup.noise:g} grey levels; take a ball with a stronger pattern, or check the circle"
        )
    inverse = vectors @ torch.diag(1 / eigenvalues) @ vectors.T
    unit = scale(reference, 5)[0].double()
    covariance = 2 * setup.noise**2 * inverse @ noise @ inverse / (unit[:, None] * unit)
    return covariance.numpy()


def _reference(
    images: torch.Tensor, circle: tuple[float, float, float], setup: Setup, options: Options
) -> tuple[Reference, torch.Tensor]:
    """The correlation's reference of the images (m, h, w) of one ball, and the motion (m, 5), px and rad."""
    circles = torch.tensor([circle], dtype=torch.float64).expand(len(images), -1)
    half = crop.half_size(circle[2], margin(options))
    crops = crop.cut(images, circles[:, :2], half)
    filtered = Filtered.of(crops, options.pre_blur)
    reference = build_reference(filtered, circles, options.roi, options.pre_blur, blurred_every=1)
    # The crop follows the ball, so the translation does not matter; the turn hides points and weighs others less.
    q = torch.tensor([[0.0, 0.0, *setup.increment[2:]]]).to(images).expand(len(images), -1)
    visible = (
        motion_models.displacement(motion_models.finite, q, reference.points, reference.geometry).isfinite().all(-1)
    )
    reference.weights.mul_(visible)
    return occlusion.weight_by_view(reference, q, motion_models.finite), q


def _operators(reference: Reference, gradient: torch.Tensor, q: torch.Tensor) -> torch.Tensor:
    """Operators (m, 5, 5) of the images' gradients, all with offset, gain and light of the first image."""
    first = dataclasses.replace(reference, values=reference.values[:1].expand_as(reference.values))
    known = nuisances(first, motion_models.finite, reference.weights)
    jacobian = znssd.project(slopes(gradient, q, motion_models.finite, reference), known, reference.weights)
    return znssd.operator(jacobian, reference.weights)


@dataclass(frozen=True)
class Differences:
    """Standard deviations of plain differences, as the paper takes them (section 2.2 and table 3).

    Attributes
    ----------
    velocity_m_s, spin_rad_s : ndarray
        (2,) and (3,): an increment over the frame interval.
    force_N : ndarray
        (2,): mass times the difference of two successive velocities over the interval.
    """

    velocity_m_s: Array
    spin_rad_s: Array
    force_N: Array  # noqa: N815  (N is newton)


def differences(covariance: Array, frame_rate: float, m_per_px: float, mass_kg: float) -> Differences:
    """Standard deviations, without smoothing, of increments with that ``covariance`` (5, 5), px and rad."""
    sd = np.sqrt(np.diagonal(covariance))
    velocity = sd[:2] * m_per_px * frame_rate
    # Successive errors have opposite signs: the difference of two has more than twice the variance of one.
    force = mass_kg * frame_rate * velocity * math.sqrt(2 * (1 - SUCCESSIVE_CORRELATION))
    return Differences(velocity, sd[2:] * frame_rate, force)
