"""The command ``torchsphere plan``: the plan of a test from the options."""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchsphere.cli.console import loading_libraries, progress_bar, say
from torchsphere.cli.exit_codes import UsageError, usage
from torchsphere.cli.options import add_command, add_out, add_quiet, add_settings
from torchsphere.planning.plan_request import PLAN_SETTINGS, PlanRequest, Vector
from torchsphere.runtime import steps
from torchsphere.settings.configuration import given_settings

if TYPE_CHECKING:
    from torchsphere.planning.example_image import Example
    from torchsphere.planning.expected import Setup
    from torchsphere.planning.free_flight import Flight
    from torchsphere.planning.plan import ExampleSource, Plan
    from torchsphere.planning.rehearsal import Target

#: Effective modulus of steel on aluminium, Pa: 1 / (0.91 / 210 GPa + 0.89 / 72 GPa), as in the paper's section 5.
STEEL_ON_ALUMINIUM_PA = 60e9

#: Default size of the rendered spots, px, and default grey levels.
SPECKLE_PX, GREY = 4.0, (30.0, 220.0)


def add(commands: Any) -> None:
    """Add the command to the parser."""
    text = "Before the test: motion blur, frames in view, expected uncertainty of velocity, spin and force."
    example = (
        "torchsphere plan --speed 72 --fps 36000 --shutter-us 12.3 --px-per-mm 3.6 --diameter-mm 30 --mass-g 110 "
        "--spin-rev-s 0,5,0 --noise 2 --width 512 --contact-us 230 --modes camera.csv --out plan"
    )
    of_flight = "torchsphere plan --flight shot.cihx --diameter-mm 30 --mass-g 110 --out plan"
    parser = add_command(commands, "plan", run, text, f"examples:  {example}   or   {of_flight}")
    parser.description += " From an example image or a rendered pattern, or from a recording of a free flight."
    add_out(parser, "folder for plan.json and plan.png")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier plan")
    add_quiet(parser, "no progress bar, no table")
    add_settings(parser, PLAN_SETTINGS)


def run(options: dict[str, Any]) -> int:
    """Make the plan, write the folder, print the table; raises ValueError or OSError before anything is written."""
    from torchsphere.results import atomic_output

    out, overwrite, quiet = options["out"], options["overwrite"], options["quiet"]
    atomic_output.recover(out)
    atomic_output.check_folder(out, overwrite)
    with usage():
        request = PlanRequest(**given_settings(options, PLAN_SETTINGS))
    with loading_libraries():
        from torchsphere.planning import presentation
        from torchsphere.report import plan_figure
        from torchsphere.results import writer

    made = _from_images(request, quiet) if request.flight is None else _from_flight(request, request.flight, quiet)
    steps.tell("drawing the plan")
    with atomic_output.atomic_folder(out, overwrite) as folder:
        writer.write_summary(folder, presentation.as_table(made))
        (folder / "summary.json").rename(folder / "plan.json")
        plan_figure.plan_figure(made).savefig(folder / "plan.png")
    for line in (*presentation.text(made).splitlines(), f"result  {out}"):
        say(quiet, line)
    return 0


def _from_images(request: PlanRequest, quiet: bool) -> Plan:
    from torchsphere.planning import plan

    setup = _setup(request)
    modes = plan.read_modes(request.modes) if request.modes is not None else []
    with progress_bar(quiet, "planning", "step", delay_s=1.0) as progress:
        return plan.from_images(
            _examples(request, setup),
            setup,
            _target(request, setup),
            width_px=request.width,
            modes=modes,
            field_mm=request.field_mm,
            is_blurred=request.blurred,
            progress=progress,
        )


def _setup(request: PlanRequest) -> Setup:
    """The setup of the test; the request has checked that all numbers are given."""
    from torchsphere.planning.expected import Setup

    assert request.speed is not None
    assert request.fps is not None
    assert request.shutter_us is not None
    assert request.diameter_mm is not None
    assert request.mass_g is not None
    px_per_mm = request.px_per_mm or 2 * request.circle[0][2] / request.diameter_mm
    return Setup(
        speed_m_s=request.speed,
        direction_deg=request.direction_deg,
        spin_rev_s=request.spin_rev_s,
        frame_rate=request.fps,
        shutter_s=1e-6 * request.shutter_us,
        px_per_mm=px_per_mm,
        diameter_mm=request.diameter_mm,
        mass_g=request.mass_g,
        noise=request.noise,
        on_map=_on_map(request),
    )


def _on_map(request: PlanRequest) -> bool:
    """Whether the test will be tracked on a map of the ball, as 'track' does by default."""
    from torchsphere.settings.choices import MAPS

    return MAPS[request.map] is not False


def _examples(request: PlanRequest, setup: Setup) -> ExampleSource:
    """Examples of the ball: the images, or a rendered pattern with spots that scale with the ball."""
    from torchsphere.planning import example_image

    if request.image:
        filmed = [
            example_image.filmed_example(path, circle, setup.noise or 0.0)
            for path, circle in zip(request.image, request.circle, strict=True)
        ]
        return lambda radius_px: filmed
    speckle = SPECKLE_PX if request.speckle_px is None else request.speckle_px
    low, high = request.grey or GREY

    @functools.lru_cache(maxsize=4)
    def rendered(radius_px: float) -> tuple[Example, ...]:
        return example_image.rendered_examples(radius_px, speckle * radius_px / setup.radius_px, low, high)

    return rendered


def _target(request: PlanRequest, setup: Setup) -> Target:
    from torchsphere.planning import rehearsal

    if request.contact_us is not None:
        return rehearsal.Target(1e-6 * request.contact_us, request.restitution, "given")
    origin = "estimated: elastic, steel on aluminium; what yields or bends takes longer, see --contact-us"
    return rehearsal.Target(rehearsal.hertz_contact_s(setup, STEEL_ON_ALUMINIUM_PA), request.restitution, origin)


def _from_flight(request: PlanRequest, path: Path, quiet: bool) -> Plan:
    from torchsphere.planning import free_flight

    if (path / "summary.json").is_file():
        if request.circle:
            raise UsageError(f"--circle: {path} has been tracked already, with its own; leave the option out")
        given = (request.fps, request.diameter_mm, request.mass_g, _shutter_s(request))
        flight = free_flight.from_result(path, free_flight.FlightCalibration(*given))
        return _plan_of(flight, request, request.width)
    if len(request.circle) > 1:
        raise UsageError(
            f"{len(request.circle)} --circle were given for one recording; leave all but the first frame's out"
        )
    flight, width = _tracked(request, path, request.circle[0] if request.circle else None, quiet)
    return _plan_of(flight, request, request.width or width)


def _plan_of(flight: Flight, request: PlanRequest, width: int | None) -> Plan:
    """The plan from a flight, with the impact measured as the request says."""
    from torchsphere.planning import plan

    flight = dataclasses.replace(flight, setup=dataclasses.replace(flight.setup, on_map=_on_map(request)))
    return plan.from_flight(flight, _target(request, flight.setup), width)


def _shutter_s(request: PlanRequest) -> float | None:
    return None if request.shutter_us is None else 1e-6 * request.shutter_us


def _tracked(request: PlanRequest, path: Path, circle: Vector | None, quiet: bool) -> tuple[Flight, int]:
    """The flight from a recording, and the width of its images."""
    from torchsphere.planning import free_flight
    from torchsphere.recording import open_recording
    from torchsphere.tracking.track import track

    with open_recording(path) as recording:
        rate, exposure = request.fps or recording.frame_rate, _shutter_s(request) or recording.exposure_s
        origin = f"recording {path.name}"
        calibration = free_flight.FlightCalibration(rate, request.diameter_mm, request.mass_g, exposure)
        calibration.required(origin)
        with progress_bar(quiet, "planning", delay_s=1.0) as progress:
            # Increments from frame to frame, as in the paper's table; a map would hide the scatter.
            tracked = track(recording, circle, sphere_map=False, progress=progress)
        return free_flight.from_track(tracked, origin, calibration), recording.shape[2]
