"""What to measure of a recording, and how: the settings of ``torchsphere track``, by name, without what measures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from torchsphere.choices import MAPS, METHODS, ORDER, WINDOW

if TYPE_CHECKING:
    from torchsphere.perspective import Camera


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
        for name in (
            "fps",
            "diameter_mm",
            "mm_per_px",
            "mass_g",
            "focal_px",
            "distance_mm",
            "shell_mm",
            "inertia_kg_m2",
        ):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} = {value:g}: expected a finite, positive number")
        if self.diameter_mm is not None and self.mm_per_px is not None:
            raise ValueError("diameter_mm and mm_per_px were both given; the scale needs one of them, leave one out")
        if self.mass_g is not None and self.diameter_mm is None and self.mm_per_px is None:
            raise ValueError("mass_g was given without a scale, so no force can follow; add diameter_mm or mm_per_px")
        if self.method not in METHODS:
            raise ValueError(f"method = {self.method!r}: expected one of {', '.join(METHODS)}")
        if (self.shell_mm is not None or self.inertia_kg_m2 is not None) and self.mass_g is None:
            raise ValueError("shell_mm or inertia_kg_m2 was given without mass_g; energies and spin need the mass, too")
        if self.normal_deg is not None and not math.isfinite(self.normal_deg):
            raise ValueError(f"normal_deg = {self.normal_deg:g}: expected a finite number of degrees")
        if self.map not in MAPS:
            raise ValueError(f"map = {self.map!r}: expected one of {', '.join(MAPS)}")
        if self.refine and self.circle is None:
            raise ValueError(
                "refine was asked for without a circle to refine; a circle that is found is refined anyway"
            )
        if self.overlay and not self.report:
            raise ValueError("overlay was asked for without report, whose images it is drawn on; leave no_report out")
        if self.distance_mm is not None and self.diameter_mm is None:
            raise ValueError("distance_mm was given without diameter_mm; the distance in radii needs both")
        if (self.focal_px is not None or self.distance_mm is not None) != self.model.startswith("pinhole"):
            raise ValueError(
                f"model {self.model!r}: the models pinhole and pinhole6 need a camera, and only they take one; give "
                "focal_px, or distance_mm with diameter_mm, together with one of them"
            )
        if not self.model.startswith("pinhole") and (self.principal_px is not None or any(self.distortion)):
            raise ValueError(
                f"principal_px and distortion belong to the models pinhole and pinhole6; {self.model!r} heeds neither"
            )
        self.camera()

    def camera(self) -> Camera | None:
        """The camera that was given, if any."""
        if not self.model.startswith("pinhole"):
            return None
        # With torch, which takes 1.2 s, and which --help and a wrong option have no need of.
        from torchsphere.perspective import Camera

        radii = None
        if self.distance_mm is not None and self.diameter_mm is not None:
            radii = 2 * self.distance_mm / self.diameter_mm
        return Camera(self.focal_px, self.principal_px, self.distortion, radii)
