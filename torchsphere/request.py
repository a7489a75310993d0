"""What to measure of a recording, and how: the settings of ``torchsphere track``, by name, without what measures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from torchsphere.settings.choices import MAPS, METHODS, MODELS, ORDER, WINDOW
from torchsphere.settings.limits import (
    FRAME_RATES,
    ROI,
    SettingError,
    require_finite,
    require_positive,
    require_window,
    require_within,
)

if TYPE_CHECKING:
    from torchsphere.geometry.camera import Camera


@dataclass(frozen=True, kw_only=True)
class Request:
    """What to measure, and how; the fields are the options of ``torchsphere track``.

    Attributes
    ----------
    input, out : Path
        Recording, and folder for the result.
    circle : tuple of float, optional
        Outline (x, y, radius) in the first frame that is tracked, px.
    refine : bool
        Fit the given circle to the image first.
    frames : tuple of int, optional
        First frame and the one after the last, of the recording.
    fps : float, optional
        Frame rate, 1/s; takes the place of the file's.
    diameter_mm, mm_per_px : float, optional
        Scale, by the ball or by a pixel; at most one of both.
    mass_g : float, optional
        Mass of the ball.
    model, roi, device
        As in `torchsphere.track`.
    focal_px, principal_px, distortion, distance_mm
        Camera of the pinhole models: as in `torchsphere.Camera`; or, instead of the focal length, the distance of the
        ball's centre, which needs its diameter.
    ignore : sequence of str
        Mask images or polygons that are not to be used.
    method, window, order
        How to differentiate, as in `torchsphere.kinematics`.
    scale_sd_percent : float
        Relative standard deviation of the given diameter or size of a pixel, %.
    shell_mm, inertia_kg_m2 : float, optional
        Thickness of a hollow ball, or the ball's moment of inertia; otherwise it is solid.
    normal_deg : float, optional
        Direction of the target's normal, from the target to the ball, from x towards y of the results' frame.
    in_place, lab_frame, overwrite : bool
        As the command line's options of these names.
    map : str
        "auto", "on" or "off": `sphere_map` of `torchsphere.track`.
    report : bool
        Keep some images and residual maps in the result, and draw figures and report.
    overlay, paraview : bool
        Make ``overlay.mp4``, which needs the report's images and PyAV, and a series for ParaView, too.
    """

    input: Path
    out: Path
    circle: tuple[float, float, float] | None = None
    refine: bool = False
    frames: tuple[int | None, int | None] = (None, None)
    fps: float | None = None
    diameter_mm: float | None = None
    mm_per_px: float | None = None
    mass_g: float | None = None
    model: str = "rigid"
    roi: float | None = None
    ignore: Sequence[str] = ()
    device: str = "cpu"
    in_place: bool = False
    lab_frame: bool = False
    overwrite: bool = False
    map: str = "auto"
    focal_px: float | None = None
    principal_px: tuple[float, float] | None = None
    distortion: tuple[float, float, float] = (0.0, 0.0, 0.0)
    distance_mm: float | None = None
    method: str = "smoother"
    window: int = WINDOW
    order: int = ORDER
    scale_sd_percent: float = 0.0
    shell_mm: float | None = None
    inertia_kg_m2: float | None = None
    normal_deg: float | None = None
    report: bool = True
    overlay: bool = False
    paraview: bool = False

    def __post_init__(self) -> None:
        _require_ranges(self)
        _require_shell(self)
        if self.diameter_mm is not None and self.mm_per_px is not None:
            raise SettingError(
                "`diameter_mm` and `mm_per_px` were both given; the scale needs one of them, leave one out"
            )
        if self.mass_g is not None and self.diameter_mm is None and self.mm_per_px is None:
            raise SettingError(
                "`mass_g` was given without a scale, so no force can follow; add `diameter_mm` or `mm_per_px`"
            )
        if self.refine and self.circle is None:
            raise SettingError(
                "`refine` was asked for without a circle to refine; a circle that is found is refined anyway"
            )
        if self.overlay and not self.report:
            raise SettingError(
                "`overlay` was asked for without the report, whose images it is drawn on; ask for both or neither"
            )
        _require_camera(self)
        self.camera()

    def camera(self) -> Camera | None:
        """The camera that was given, if any."""
        if not self.model.startswith("pinhole"):
            return None
        # With torch, which takes 1.2 s, and which --help and a wrong option have no need of.
        from torchsphere.geometry.camera import Camera

        radii = None
        if self.distance_mm is not None and self.diameter_mm is not None:
            radii = 2 * self.distance_mm / self.diameter_mm
        return Camera(self.focal_px, self.principal_px, self.distortion, radii)


def _require_ranges(request: Request) -> None:
    """Raise SettingError where a value is none that the setting may have, whether it comes to use or not."""
    for name in ("fps", "diameter_mm", "mm_per_px", "mass_g", "focal_px", "distance_mm", "shell_mm", "inertia_kg_m2"):
        require_positive(name, getattr(request, name))
    for name in ("circle", "normal_deg", "principal_px", "distortion", "scale_sd_percent"):
        require_finite(name, getattr(request, name))
    require_within("fps", request.fps, FRAME_RATES)
    require_within("roi", request.roi, ROI)
    require_window(request.window, request.order)
    if not 0 <= request.scale_sd_percent < 100:
        raise SettingError(f"`scale_sd_percent` = {request.scale_sd_percent:g}: expected 0 to below 100")
    for name, known in (("model", MODELS), ("method", METHODS), ("map", tuple(MAPS))):
        value = getattr(request, name)
        if value not in known:
            raise SettingError(f"`{name}` = {value!r}: expected one of {', '.join(known)}")


def _require_shell(request: Request) -> None:
    """Raise SettingError where shell and inertia do not go with each other, the mass or the diameter."""
    if request.shell_mm is None and request.inertia_kg_m2 is None:
        return
    if request.mass_g is None:
        raise SettingError(
            "`shell_mm` or `inertia_kg_m2` was given without `mass_g`; energies and spin need the mass, too"
        )
    if request.shell_mm is not None and request.inertia_kg_m2 is not None:
        raise SettingError(
            "`shell_mm` and `inertia_kg_m2` were both given; the inertia needs one of them, leave one out"
        )
    if request.shell_mm is not None and request.diameter_mm is not None:
        require_shell_within(request.shell_mm, request.diameter_mm / 2)


def require_shell_within(shell_mm: float, radius_mm: float) -> None:
    """Raise SettingError where a shell is thicker than its ball."""
    if shell_mm > radius_mm:
        raise SettingError(f"`shell_mm` = {shell_mm:g}: thicker than the ball's radius of {radius_mm:g} mm")


def _require_camera(request: Request) -> None:
    """Raise SettingError unless a camera is given where, and only where, the model takes one."""
    if request.distance_mm is not None and request.diameter_mm is None:
        raise SettingError("`distance_mm` was given without `diameter_mm`; the distance in radii needs both")
    has_camera = request.model.startswith("pinhole")
    if (request.focal_px is not None or request.distance_mm is not None) != has_camera:
        raise SettingError(
            f"`model` = {request.model}: the models pinhole and pinhole6 need a camera, and only they take one; give "
            "`focal_px`, or `distance_mm` with `diameter_mm`, together with one of them"
        )
    if request.focal_px is not None and request.distance_mm is not None:
        raise SettingError("`focal_px` and `distance_mm` were both given; one follows from the other, leave one out")
    if request.distance_mm is not None and request.diameter_mm is not None:
        radius_mm = request.diameter_mm / 2
        if request.distance_mm <= radius_mm:
            raise SettingError(
                f"`distance_mm` = {request.distance_mm:g}: lies within the ball, whose radius is {radius_mm:g} mm; "
                "give the distance of its centre from the camera"
            )
    if not has_camera and (request.principal_px is not None or any(request.distortion)):
        raise SettingError(
            f"`principal_px` and `distortion` belong to the models pinhole and pinhole6; {request.model} heeds neither"
        )
