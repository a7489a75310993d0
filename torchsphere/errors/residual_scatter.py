"""Residuals that are alike over many pixels, as no noise is: light that moves, reflections, a body that is no sphere.

The steps are measured with their errors: `correlation.residual_noise` and `sphere_map.residual_scatter`.
"""

from __future__ import annotations

import dataclasses

from torchsphere.errors.evidence import Evidence
from torchsphere.motion.track import Track
from torchsphere.sphere_map.decision import MadeMap

#: Factor on the standard deviations of the steps, and residual over noise, of a residual that is no noise
#: (docs/constants.toml).
STRUCTURED_WIDENING, STRUCTURED_RESIDUAL = 3.0, 1.5


def without(track: Track, evidence: Evidence) -> Track:
    """The track with the errors of its steps by the noise of single pixels."""
    factors = evidence.residual_factors
    by_noise = track.covariance / (factors[:, :, None] * factors[:, None, :])
    return dataclasses.replace(track, covariance=by_noise)


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """Whether the residual images on the map are alike over many pixels, or too large."""
    made = track.findings.map
    if not isinstance(made, MadeMap):
        return []
    widened, over_noise = made.widened, made.residual_over_noise
    is_large = over_noise >= STRUCTURED_RESIDUAL
    # A codec's blocks are alike over many pixels; another sentence reports the codec.
    is_alike = widened >= STRUCTURED_WIDENING and not track.findings.coded
    if not (is_large or is_alike):
        return []
    signs = [f"they are {over_noise:.1f} times as large"] if is_large else []
    signs += [f"alike over many pixels, which widens standard deviations up to {widened:.1f} times"] if is_alike else []
    return [
        f"The residual images are no noise: {', and '.join(signs)}. The ball as modelled does not explain its images: "
        "likely causes are moving light or reflections, a wrong circle, a body that is no sphere, or a near camera. "
        "Look at the residual in the report."
    ]
