"""The settings of ``torchsphere track``, described once.

Options of ``track`` and ``batch``, TOML files and manifest columns follow from this description.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from torchsphere.settings.calibration import CAMERA_NUMBERS, Calibration
from torchsphere.settings.choices import AXES, BAYER, DEVICES, EXPORTS, MAPS, METHODS, MODELS, ORDER, WINDOW
from torchsphere.settings.limits import (
    FRAME_RATES,
    PIXEL_ASPECTS,
    ROI,
    SettingError,
    require_channel_class,
    require_finite,
    require_window,
    within,
)
from torchsphere.settings.setting import (
    FRAMES,
    NUMBER,
    RATIO,
    REGION,
    SWITCH,
    WHOLE,
    Group,
    Setting,
    check_ranges,
    choice,
    finite,
    numbers,
    one_of,
    percent,
    positive,
    settings_of,
    switch,
)

if TYPE_CHECKING:
    from torchsphere.geometry.camera import Camera

RECORDING = Group("recording and ball")
METHOD = Group("measurement")
CAMERA = Group("camera near the ball")
KINEMATICS = Group("velocity and force", "They need a frame rate and a scale: --diameter-mm or --mm-per-px.")
POLYNOMIALS = Group("local polynomials of --method savitzky-golay")
IMPACT = Group("impact")
OUTPUT = Group("output")


@dataclass(frozen=True, kw_only=True)
class Request:
    """The settings of one measurement.

    ``input`` is the recording, ``out`` the folder for the result. A `Setting` describes each other field.

    Raises
    ------
    SettingError
        If a setting is out of its range, or settings contradict each other.
    """

    input: Path
    out: Path
    circle: Annotated[
        tuple[float, float, float] | None,
        Setting(numbers("X,Y,R"), RECORDING, "X,Y,R", "outline in the first frame, px (found)", require_finite),
    ] = None
    refine: Annotated[bool, switch(RECORDING, "fit the given circle to the image first")] = False
    frames: Annotated[
        tuple[int | None, int | None], Setting(FRAMES, RECORDING, "A:B", "frames A to B - 1 only (all)")
    ] = (None, None)
    fps: Annotated[
        float | None, Setting(NUMBER, RECORDING, "F", "frame rate, 1/s (the file's)", within(FRAME_RATES))
    ] = None
    shutter_us: Annotated[float | None, positive(RECORDING, "T", "exposure, us (the file's, or by the smear)")] = None
    ignore: Annotated[
        Sequence[str],
        Setting(
            REGION,
            RECORDING,
            "FILE.png|POLYGON",
            "region not to be used, as mask or 'x,y x,y x,y'; may be repeated",
            repeats=True,
        ),
    ] = ()
    axes: Annotated[
        str | None,
        one_of(
            AXES, RECORDING, "order of the axes of an array: number n, height h, width w (nhw, and hwn in a MAT file)"
        ),
    ] = None
    pixel_aspect: Annotated[
        float | None,
        Setting(
            RATIO, RECORDING, "W:H", "sides of a pixel, as 11:10 or 1.1 (the file's, or square)", within(PIXEL_ASPECTS)
        ),
    ] = None
    bayer: Annotated[
        str | None,
        one_of(
            BAYER,
            RECORDING,
            "raw colour mosaic, by its first two rows: its green pixels are measured (the file's, or none)",
        ),
    ] = None
    in_place: Annotated[bool, switch(RECORDING, "the ball turns without leaving its place")] = False

    model: Annotated[str, one_of(MODELS, METHOD, "motion model")] = "rigid"
    map: Annotated[
        str,
        one_of(
            tuple(MAPS),
            METHOD,
            "map of the ball's texture: no drift, twice the precision; auto makes it where it can, off keeps to pairs",
        ),
    ] = "auto"
    roi: Annotated[
        float | None,
        Setting(
            NUMBER,
            METHOD,
            "FRACTION",
            "region of interest, share of the radius (0.95, less for a small ball unlike its background)",
            within(ROI),
        ),
    ] = None
    device: Annotated[str, Setting(choice(DEVICES), METHOD, "", "where to compute")] = "cpu"

    focal_px: Annotated[float | None, positive(CAMERA, "F", "focal length over the size of a pixel")] = None
    distance_mm: Annotated[
        float | None, positive(CAMERA, "Z", "or distance of the ball's centre, mm, with --diameter-mm")
    ] = None
    principal_px: Annotated[
        tuple[float, float] | None,
        Setting(numbers("X,Y"), CAMERA, "X,Y", "where the optical axis meets the image, px (middle)", require_finite),
    ] = None
    distortion: Annotated[
        tuple[float, float, float],
        Setting(numbers("K1,K2,K3"), CAMERA, "K1,K2,K3", "radial, OpenCV's convention (none)", require_finite),
    ] = (0.0, 0.0, 0.0)
    telecentric: Annotated[bool, switch(CAMERA, "the lens sees the ball from the same side wherever it is")] = False

    diameter_mm: Annotated[float | None, positive(KINEMATICS, "D", "diameter of the ball, mm, for the scale")] = None
    mm_per_px: Annotated[float | None, positive(KINEMATICS, "S", "or size of a pixel, mm")] = None
    scale_sd_percent: Annotated[float, percent(KINEMATICS, "P", "standard deviation of that diameter or size, %")] = 0.0
    mass_g: Annotated[float | None, positive(KINEMATICS, "M", "mass of the ball, g, for the force")] = None
    mass_sd_percent: Annotated[float, percent(KINEMATICS, "P", "standard deviation of that mass, %")] = 0.0
    fps_sd_percent: Annotated[float, percent(KINEMATICS, "P", "standard deviation of the frame rate, %")] = 0.0
    method: Annotated[str, one_of(METHODS, KINEMATICS, "how to differentiate")] = "smoother"
    cfc: Annotated[
        int | None,
        Setting(
            WHOLE,
            KINEMATICS,
            "N",
            "also filter raw differences by a class of ISO 6487 and SAE J211: 60, 180, 600 or 1000",
            require_channel_class,
        ),
    ] = None
    lab_frame: Annotated[bool, switch(KINEMATICS, "kinematics with y up and z to the camera")] = False

    window: Annotated[int, Setting(WHOLE, POLYNOMIALS, "N", "frames around each frame, odd")] = WINDOW
    order: Annotated[int, Setting(WHOLE, POLYNOMIALS, "N", "order of the polynomials")] = ORDER

    shell_mm: Annotated[float | None, positive(IMPACT, "T", "thickness of a hollow ball, mm (solid)")] = None
    inertia_kg_m2: Annotated[float | None, positive(IMPACT, "I", "or moment of inertia, kg m2")] = None
    normal_deg: Annotated[
        float | None, finite(IMPACT, "A", "normal from target to ball, deg from x towards y (found)")
    ] = None

    report: Annotated[
        bool, Setting(SWITCH, OUTPUT, "", "no figures, no report, no images in the result", flag="--no-report")
    ] = True
    overlay: Annotated[bool, switch(OUTPUT, "make overlay.mp4, too (extra 'video')")] = False
    paraview: Annotated[bool, switch(OUTPUT, "make a series for ParaView, too")] = False
    export: Annotated[
        Sequence[str],
        Setting(
            *(choice(tuple(EXPORTS)), OUTPUT, ""),
            "also all tables in one file, result.h5 (extra 'export') or result.mat; may be repeated",
            repeats=True,
        ),
    ] = ()
    overwrite: Annotated[bool, Setting(SWITCH, OUTPUT, "", "replace an earlier result", per_recording=False)] = False

    def __post_init__(self) -> None:
        check_ranges(self, SETTINGS)
        require_window(self.window, self.order)
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

    def motion_model(self) -> str:
        """The model of the motion: with a camera, pinhole takes the place of rigid."""
        return "pinhole" if self.model == "rigid" and self.camera() is not None else self.model

    def calibration(self, frame_rate: float | None) -> Calibration:
        """Frame rate, scale and mass with their uncertainties; the recording states ``frame_rate``."""
        return Calibration.of_options(vars(self), frame_rate)

    def camera(self) -> Camera | None:
        """The camera, or None if none is given."""
        if self.focal_px is None and self.distance_mm is None:
            return None
        # Torch takes 1.2 s to import, and --help and refusals do not need it.
        from torchsphere.geometry.camera import Camera

        given = {name: value for name in CAMERA_NUMBERS if (value := getattr(self, name)) is not None}
        return Camera.of_numbers(given, self.diameter_mm)


#: All settings by name, and the settings that a manifest may give for one recording.
SETTINGS = settings_of(Request)
PER_RECORDING = {name: setting for name, setting in SETTINGS.items() if setting.per_recording}


def check_settings(settings: Mapping[str, Any]) -> None:
    """Raise ValueError for settings that contradict each other."""
    Request(input=Path(), out=Path(), **settings)


def _require_shell(request: Request) -> None:
    """Raise SettingError if shell and inertia contradict each other, the mass or the diameter."""
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
    """Raise SettingError if the shell is thicker than the radius."""
    if shell_mm > radius_mm:
        raise SettingError(f"`shell_mm` = {shell_mm:g}: thicker than the ball's radius of {radius_mm:g} mm")


def _require_camera(request: Request) -> None:
    """Raise SettingError if camera, model and scale do not belong together."""
    if request.distance_mm is not None and request.diameter_mm is None:
        raise SettingError("`distance_mm` was given without `diameter_mm`; the distance in radii needs both")
    has_camera = request.focal_px is not None or request.distance_mm is not None
    if request.model.startswith("pinhole") and not has_camera:
        raise SettingError(
            f"`model` = {request.model}: needs a camera; give `focal_px`, or `distance_mm` with `diameter_mm`"
        )
    if has_camera and not request.model.startswith("pinhole") and request.model != "rigid":
        raise SettingError(
            f"`model` = {request.model}: knows no camera, and one was given; leave out the model or the camera"
        )
    if has_camera and request.telecentric:
        raise SettingError("`telecentric` was given with `focal_px` or `distance_mm`; a view has one of both")
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
            "`principal_px` and `distortion` belong to a camera; give `focal_px`, or `distance_mm` with `diameter_mm`"
        )
