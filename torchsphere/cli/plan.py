"""The command ``torchsphere plan``: from its options to its folder."""

from __future__ import annotations

import contextlib
import functools
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from torchsphere.planning import camera_modes, example_image, free_flight, plan, rehearsal, table
from torchsphere.planning import text as plan_text
from torchsphere.planning.example_image import Example
from torchsphere.planning.expected import Setup
from torchsphere.planning.free_flight import Flight
from torchsphere.planning.plan import Plan
from torchsphere.recording import open_recording
from torchsphere.report import plan_figure
from torchsphere.results import atomic_output, writer
from torchsphere.settings.limits import option, require_finite, require_positive, require_within
from torchsphere.tracking.track import track

#: Effective modulus of a steel ball on an aluminium target, Pa: 1 / (0.91 / 210 GPa + 0.89 / 72 GPa), the ball and the
#: bar of the paper's section 5.
STEEL_ON_ALUMINIUM_PA = 60e9

NEEDED = ("speed", "fps", "shutter_us", "px_per_mm", "diameter_mm", "mass_g", "noise")
OF_IMAGES = ("speed", "px_per_mm", "noise", "image", "speckle_px", "grey", "modes", "field_mm", "blurred")


def run(options: dict[str, Any]) -> int:
    """Make the plan, write its folder, print its table; 0 when it was written.

    Raises
    ------
    ValueError, OSError
        With one sentence on what is wrong; then nothing has been written.
    """
    out, overwrite, quiet = (options.pop(name) for name in ("out", "overwrite", "quiet"))
    atomic_output.check_folder(out, overwrite)
    for name in (*NEEDED, "width", "field_mm", "contact_us", "speckle_px"):
        require_positive(name, options[name])
    require_within("restitution", options["restitution"], (0.0, 1.0))
    require_finite("direction_deg", options["direction_deg"])
    made = _from_flight(options, quiet) if options["flight"] is not None else _from_images(options, quiet)
    with atomic_output.atomic_folder(out, overwrite) as folder:
        writer.write_summary(folder, table.as_table(made))
        (folder / "summary.json").rename(folder / "plan.json")
        plan_figure.plan_figure(folder / "plan.png", made)
    if not quiet:
        print(f"{plan_text.text(made)}\nresult  {out}")
    return 0


def _from_images(options: dict[str, Any], quiet: bool) -> Plan:
    images, circles = options["image"] or [], options["circle"] or []
    if len(images) != len(circles):
        raise ValueError(
            f"{len(images)} --image and {len(circles)} --circle were given; each image needs its circle: find it with "
            "'torchsphere info'"
        )
    if images and (options["speckle_px"] is not None or options["grey"] is not None):
        raise ValueError("--image and a rendered pattern (--speckle-px, --grey) were both given; leave one out")
    if not images and options["blurred"]:
        raise ValueError("--blurred speaks of an image, and none was given; add --image, or leave it out")
    if options["field_mm"] is not None and options["modes"] is None:
        raise ValueError("--field-mm speaks of the camera's modes, and none were given; add --modes, or leave it out")
    if images and options["px_per_mm"] is None and options["diameter_mm"]:
        options["px_per_mm"] = 2 * circles[0][2] / options["diameter_mm"]
    missing = [option(name) for name in NEEDED if options[name] is None]
    if missing:
        raise ValueError(f"a plan needs {', '.join(missing)}; or give --flight, a recording without a target")
    setup = Setup(
        speed_m_s=options["speed"],
        direction_deg=options["direction_deg"] or 0.0,
        spin_rev_s=options["spin_rev_s"] or (0.0, 0.0, 0.0),
        frame_rate=options["fps"],
        shutter_s=1e-6 * options["shutter_us"],
        px_per_mm=options["px_per_mm"],
        diameter_mm=options["diameter_mm"],
        mass_g=options["mass_g"],
        noise=options["noise"],
    )
    modes = camera_modes.read_modes(options["modes"]) if options["modes"] is not None else []
    with _progress(quiet) as progress:
        return plan.from_images(
            _look(options, setup, images, circles),
            setup,
            _target(options, setup),
            width_px=_width(options),
            modes=modes,
            field_mm=options["field_mm"],
            is_blurred=bool(options["blurred"]),
            progress=progress,
        )


def _look(
    options: dict[str, Any], setup: Setup, images: Sequence[Path], circles: Sequence[tuple[float, float, float]]
) -> camera_modes.Look:
    """Examples of the ball: the images, or a pattern whose spots grow with the ball."""
    if images:
        noise = setup.noise or 0.0
        filmed = [example_image.filmed(path, circle, noise) for path, circle in zip(images, circles, strict=True)]
        return lambda radius_px: filmed
    speckle = 4.0 if options["speckle_px"] is None else options["speckle_px"]
    low, high = options["grey"] or (30.0, 220.0)

    @functools.lru_cache(maxsize=4)
    def look(radius_px: float) -> tuple[Example, ...]:
        return example_image.painted(radius_px, speckle * radius_px / setup.radius_px, low, high)

    return look


def _target(options: dict[str, Any], setup: Setup) -> rehearsal.Target:
    if options["contact_us"] is not None:
        return rehearsal.Target(1e-6 * options["contact_us"], options["restitution"], "given")
    origin = "estimated: elastic, steel on aluminium; what yields or bends takes longer, see --contact-us"
    return rehearsal.Target(rehearsal.hertz(setup, STEEL_ON_ALUMINIUM_PA), options["restitution"], origin)


def _width(options: dict[str, Any]) -> int | None:
    width = options["width"]
    return None if width is None else int(width)


def _from_flight(options: dict[str, Any], quiet: bool) -> Plan:
    given = [option(name) for name in OF_IMAGES if options[name] is not None]
    given += [
        name for name, key in (("--direction-deg", "direction_deg"), ("--spin-rev-s", "spin_rev_s")) if options[key]
    ]
    if given:
        raise ValueError(f"--flight measures what {', '.join(given)} would say; leave one of both out")
    path: Path = options["flight"]
    known = {key: options[name] for key, name in (("frame_rate", "fps"), ("diameter_mm", "diameter_mm"))}
    shutter = None if options["shutter_us"] is None else 1e-6 * options["shutter_us"]
    if (path / "summary.json").is_file():
        if options["circle"]:
            raise ValueError(f"--circle: {path} has been tracked already, with its own; leave the option out")
        flight = free_flight.from_result(path, mass_g=options["mass_g"], shutter_s=shutter, **known)
        return plan.from_flight(flight, _target(options, flight.setup), _width(options))
    circles = options["circle"] or [None]
    if len(circles) > 1:
        raise ValueError(f"{len(circles)} --circle were given for one recording; leave all but the first frame's out")
    flight, width = _tracked(path, circles[0], options["mass_g"], shutter, known, quiet)
    return plan.from_flight(flight, _target(options, flight.setup), _width(options) or width)


def _tracked(
    path: Path,
    circle: tuple[float, float, float] | None,
    mass_g: float | None,
    shutter_s: float | None,
    known: dict[str, Any],
    quiet: bool,
) -> tuple[Flight, int]:
    """The flight from a recording, and the width of its images."""
    with open_recording(path) as recording:
        known["frame_rate"] = known["frame_rate"] or recording.frame_rate
        exposure = shutter_s or recording.exposure_s
        # Before the work of tracking.
        free_flight.require(f"recording {path.name}", known["frame_rate"], known["diameter_mm"], mass_g)
        with _progress(quiet) as progress:
            # Increments from frame to frame, as in the paper's table; a map would hide what they scatter.
            tracked = track(recording, circle, sphere_map=False, progress=progress)
        origin = f"recording {path.name}"
        return free_flight.from_track(tracked, origin, mass_g=mass_g, shutter_s=exposure, **known), recording.shape[2]


@contextlib.contextmanager
def _progress(quiet: bool) -> Any:
    """A callback that shows a bar on stderr, or None."""
    if quiet:
        yield None
        return
    with tqdm(file=sys.stderr, leave=False, desc="planning", delay=1.0) as bar:

        def advance(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield advance
