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
from torch import Tensor

from torchsphere.correlation import occlusion, znssd
from torchsphere.correlation.options import Options, adapt_pre_blur, margin
from torchsphere.correlation.reference import Filtered, Reference, build_reference, nuisances, scale, slopes
from torchsphere.geometry import motion_models
from torchsphere.imaging import crop
from torchsphere.planning.example_image import Example, blurred, rescaled, white_noise
from torchsphere.runtime.arrays import Array
from torchsphere.settings.limits import SettingError

#: Largest motion blur, px: section 3.3 of the paper.
MAX_BLUR_PX = 5.0

#: Largest turn per frame whose errors are those of the noise alone, deg (docs/constants.toml).
MAX_NOISE_ONLY_DEG = 2.0

#: Correlation of the errors of successive increments, which share an image (docs/constants.toml).
SUCCESSIVE_CORRELATION = -0.45

#: Least eigenvalue of the texture's operator, over the mean of the noise's operator.
MIN_EIGENVALUE = 1e-3

#: Least standard deviation of a step, px, and of a turn times the radius (docs/constants.toml).
MIN_STEP_SD_PX = 1e-6


@dataclass(frozen=True, kw_only=True)
class Setup:
    """A test: ball, speed and camera."""

    speed_m_s: float
    frame_rate: float  # frames per second
    px_per_mm: float  # scale in the plane of the ball
    diameter_mm: float
    mass_g: float
    shutter_s: float | None = None  # exposure time; None if not known
    noise: float | None = None  # sd of a pixel from image to image, grey levels, with rounding; None if not known
    direction_deg: float = 0.0  # of the flight in the image, from x (right) towards y (down)
    spin_rev_s: tuple[float, float, float] = (0.0, 0.0, 0.0)  # about x, y, z of the camera frame
    on_map: bool = True  # poses on a map of the ball, the tracker's default; False: steps from pairs, which add up

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is None or name == "on_map":
                continue
            may_be_negative = name in ("direction_deg", "spin_rev_s")
            values = np.atleast_1d(value)
            if not (np.isfinite(values).all() and (may_be_negative or (values > 0).all())):
                expected = "finite numbers" if may_be_negative else "a finite, positive number"
                raise ValueError(f"{name} = {value}: expected {expected}")
        # An exposure as long as the interval is valid, whatever the rounding of its last digits.
        if self.shutter_s is not None and self.shutter_s * self.frame_rate > 1 + 1e-6:
            raise SettingError(
                f"`shutter_us` = {1e6 * self.shutter_s:.4g}: longer than the {1e6 / self.frame_rate:.4g} us from frame "
                f"to frame at {self.frame_rate:g} frames/s; give a shorter one"
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

    The examples are rescaled to the test and, unless ``is_blurred``, blurred by its motion. Raises ValueError if the
    noise is not known or hardly any, or if the texture does not determine all modes.

    With the noise ``n_f - n_g`` of both images, the converged increment is off by ``A^-1 J^T (n_f - n_g)``, with the
    Jacobian ``J`` of the recorded reference and ``A = J^T J`` of the noise-free one (equations 7 to 10 of the paper).
    The pre-blur correlates the noise of neighbouring pixels: the covariance is ``2 sigma^2 A^-1 N A^-1``, with ``N``
    of the gradients blurred once more. The gradients of an example include its noise. The operator of its companion
    removes this part, and the operator of the test's noise is added to ``N``.
    """
    covariance = np.mean([_covariance(example, setup, is_blurred) for example in examples], axis=0)
    require_noise(covariance, setup.radius_px, f"{examples[0].origin}, noise of {setup.noise:g} grey levels")
    return np.asarray(covariance)


def require_noise(covariance: Array, radius_px: float, origin: str) -> None:
    """Raise ValueError unless steps of that covariance (5, 5), px and rad, scatter as those of a camera may."""
    variances = np.diagonal(covariance)
    if not (np.isfinite(covariance).all() and (variances >= 0).all()):
        raise ValueError(f"{origin}: the covariance of a step: expected finite, positive variances, got {variances}")
    sd = np.sqrt(variances) * [1.0, 1.0, radius_px, radius_px, radius_px]
    if sd.min() < MIN_STEP_SD_PX:
        raise ValueError(
            f"{origin}: a standard deviation of {sd.min():.2g} px from frame to frame, expected {MIN_STEP_SD_PX:g} px "
            "or more: no camera is so quiet; give images, or a noise, of a real camera"
        )


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


def _reference(images: Tensor, circle: Sequence[float], setup: Setup, options: Options) -> tuple[Reference, Tensor]:
    """The correlation's reference of the images (m, h, w) of one ball, and the motion (m, 5), px and rad."""
    circles = torch.tensor([[*circle]], dtype=torch.float64).expand(len(images), -1)
    half = crop.half_size(circle[2], margin(options))
    crops = crop.cut(images, circles[:, :2], half)
    filtered = Filtered.of(crops, options.pre_blur)
    reference = build_reference(filtered, circles, options.roi, options.pre_blur, blurred_every=1)
    # The crop follows the ball, so that the translation has no effect. The turn hides points and reduces weights.
    q = torch.tensor([[0.0, 0.0, *setup.increment[2:]]]).to(images).expand(len(images), -1)
    moved = motion_models.displacement(motion_models.finite, q, reference.points, reference.geometry)
    reference.weights.mul_(moved.isfinite().all(-1))
    return occlusion.weight_by_view(reference, q, motion_models.finite), q


def _operators(reference: Reference, gradient: Tensor, q: Tensor) -> Tensor:
    """Operators (m, 5, 5) of the images' gradients, all with offset, gain and light of the first image."""
    first = dataclasses.replace(reference, values=reference.values[:1].expand_as(reference.values))
    known = nuisances(first, motion_models.finite, reference.weights)
    jacobian = znssd.project(slopes(gradient, q, motion_models.finite, reference), known, reference.weights)
    return znssd.operator(jacobian, reference.weights)


@dataclass(frozen=True)
class Differences:
    """Standard deviations of plain differences, as the paper takes them (section 2.2 and table 3)."""

    velocity_m_s: Array  # (2,), of an increment over the frame interval
    spin_rad_s: Array  # (3,), likewise
    force_N: Array  # (2,), mass times the difference of successive velocities over the interval  # noqa: N815


def differences(covariance: Array, frame_rate: float, m_per_px: float, mass_kg: float) -> Differences:
    """Standard deviations, without smoothing, of increments with that ``covariance`` (5, 5), px and rad."""
    sd = np.sqrt(np.diagonal(covariance))
    velocity = sd[:2] * m_per_px * frame_rate
    # Successive errors have opposite signs: the difference of two has more than twice the variance of one.
    force = mass_kg * frame_rate * velocity * math.sqrt(2 * (1 - SUCCESSIVE_CORRELATION))
    return Differences(velocity, sd[2:] * frame_rate, force)
