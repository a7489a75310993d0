"""Settings of the correlation."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from torchsphere.geometry import motion_models
from torchsphere.geometry.camera import Camera
from torchsphere.imaging import interpolation
from torchsphere.settings.limits import ROI, is_whole, require_switch, require_within

#: Least pre-blur of small balls, px (docs/constants.toml).
MIN_PRE_BLUR_PX = 0.7

#: Room between the region of interest and the outline, in pre-blurs (docs/constants.toml).
PRE_BLUR_ROOM = 1.5


@dataclass(frozen=True)
class Options:
    """Settings of the correlation.

    Attributes
    ----------
    model : str
        Motion model, a key of `motion_models.MODELS`.
    roi : float
        Radius of the region of interest as a fraction of the ball's. By default `torchsphere.track` takes a smaller
        one for a small ball that is much brighter or darker than its background.
    pre_blur : float
        Standard deviation of the Gaussian that blurs both images first, px; 0 for none. By default
        `torchsphere.track` and `torchsphere.correlate` take a smaller one for a small ball.
    jacobian : str
        "constant": gradient of the reference, the paper's choice, built once. "autograd": gradient of the deformed
        image at each iterate, by automatic differentiation; exact and slow.
    max_iterations : int
        Gauss-Newton steps before a pair counts as not converged.
    tolerance_px : float
        A pair has converged when a step moves no point of the ball by more, px.
    min_zncc : float
        Least correlation coefficient of a valid pair.
    min_visible : float
        Least part of the region of interest that must be usable in both images.
    finite_from_deg : float
        Turn per pair from which `finite` takes the place of `rigid`: 0 always, 180 never.
    robust : bool
        Leave out parts that the ball's motion does not explain (occluders, reflections); models of a rigid ball only.
    camera : Camera, optional
        Camera of the models `pinhole` and `pinhole6`.
    """

    model: str = "rigid"
    roi: float = 0.95
    pre_blur: float = interpolation.PRE_BLUR_PX
    jacobian: str = "constant"
    max_iterations: int = 40
    tolerance_px: float = 2e-4
    min_zncc: float = 0.6
    min_visible: float = 0.3
    finite_from_deg: float = 0.0
    robust: bool = True
    camera: Camera | None = None

    def __post_init__(self) -> None:
        if self.model not in motion_models.MODELS:
            raise ValueError(f"unknown model {self.model!r}: expected one of {', '.join(motion_models.MODELS)}")
        if self.jacobian not in ("constant", "autograd"):
            raise ValueError(f"unknown jacobian {self.jacobian!r}: expected 'constant' or 'autograd'")
        given: Any = self.camera
        if given is not None and not isinstance(given, Camera):
            raise ValueError(f"camera = {given!r}: expected a torchsphere.Camera, as in Camera(focal_px=500)")
        if (motion_models.MODELS[self.model] in motion_models.PERSPECTIVE) != (self.camera is not None):
            raise ValueError(
                f"model {self.model!r}: a camera belongs to the models pinhole and pinhole6, which need one "
                "(its focal length in px, or the ball's distance); give both or neither"
            )
        require_switch("robust", self.robust)
        if not is_whole(self.max_iterations):
            raise ValueError(f"max_iterations = {self.max_iterations!r}: expected a whole number")
        limits = {"roi": ROI, "pre_blur": (0.0, 5.0), "max_iterations": (1, 10_000), "tolerance_px": (1e-9, 1.0)}
        limits |= {"min_zncc": (0.0, 1.0), "min_visible": (0.0, 1.0), "finite_from_deg": (0.0, 180.0)}
        for name, allowed in limits.items():
            require_within(name, getattr(self, name), allowed)


def options_for(function: Callable[..., Any], options: Mapping[str, Any]) -> Options:
    """`Options` from the keyword arguments of a ``function``; TypeError for an unknown name.

    With a camera, `pinhole` is the default model.
    """
    names = [field.name for field in fields(Options)]
    for name in options:
        if name not in names:
            own = [p.name for p in inspect.signature(function).parameters.values() if p.kind is not p.VAR_KEYWORD]
            similar = difflib.get_close_matches(name, own + names, 1)
            advice = f"did you mean {similar[0]}?" if similar else f"the settings are {', '.join(names)}"
            raise TypeError(f"{function.__name__} has no argument {name!r}: {advice}")
    model = {"model": "pinhole"} if options.get("camera") is not None else {}
    return Options(**model | dict(options))


def adapt_pre_blur(options: Options, radius: float) -> Options:
    """The options with a pre-blur that keeps the background of a ball of this radius, px, out of its region."""
    room = (1 - options.roi) * radius
    return replace(options, pre_blur=min(max(room / PRE_BLUR_ROOM, MIN_PRE_BLUR_PX), interpolation.PRE_BLUR_PX))


def margin(options: Options) -> float:
    """Width around the ball that a crop needs, px: error of the guess and reach of the pre-blur."""
    return 4 + 4 * options.pre_blur
