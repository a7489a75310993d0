"""The command ``torchsphere info``: facts about a recording and, with ``--preview``, the circle of the ball."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchsphere.cli.console import loading_libraries
from torchsphere.cli.exit_codes import DONE, UNUSABLE, UsageError, usage
from torchsphere.cli.options import add_command, add_settings, add_verbose
from torchsphere.request import SETTINGS, check_settings
from torchsphere.runtime.setting_names import as_options
from torchsphere.runtime.shown_text import shown
from torchsphere.settings.configuration import given_settings
from torchsphere.settings.limits import SettingError

if TYPE_CHECKING:
    from torchsphere.recording import Recording

#: Settings that tell how the images are read and shown.
SHOWN_AS = ("axes", "pixel_aspect", "bayer")


def add(commands: Any) -> None:
    """Add the command to the parser."""
    text = "Say what a recording is; with --preview, also where the ball is in it."
    parser = add_command(commands, "info", run, text, "example:  torchsphere info shot.cine --preview p.png")
    parser.add_argument("input", type=Path, metavar="INPUT", help="file or folder of images")
    parser.add_argument(
        "--preview",
        type=Path,
        metavar="FILE.png",
        help="find the ball, print its circle and draw it; without a ball, draw the image with a grid",
    )
    add_verbose(parser)
    add_settings(parser, {name: SETTINGS[name] for name in SHOWN_AS})


def run(options: dict[str, Any]) -> int:
    """Print the facts and draw the preview, also without a ball; raises ValueError or OSError for a bad file."""
    from torchsphere.recording import open_recording

    preview = options["preview"]
    if preview is not None and preview.suffix.lower() != ".png":
        raise UsageError(f"--preview {preview}: expected a name that ends in .png")
    with usage():
        shown_as = given_settings(options, {name: SETTINGS[name] for name in SHOWN_AS})
        check_settings(shown_as)
    with open_recording(options["input"], **shown_as) as recording:
        for name, text in _facts(recording):
            print(f"{name:<11} {shown(text)}")
        if preview is None:
            return DONE
        return _preview(recording, preview)


def _facts(recording: Recording) -> list[tuple[str, str]]:
    def known(value: Any, text: str, key: str) -> str:
        return "unknown" if value is None else f"{text}  (from {recording.origins.get(key, 'the file')})"

    count, height, width = recording.shape
    rate, exposure, trigger = recording.frame_rate, recording.exposure_s, recording.trigger_offset_frames
    facts = [
        ("recording", str(recording.path)),
        ("kind", recording.kind),
        ("frames", str(count)),
        ("size", f"{width} x {height} px (width x height)"),
        ("bit depth", known(recording.bit_depth, f"{recording.bit_depth}", "bit_depth")),
        ("frame rate", known(rate, f"{rate:g} frames/s" if rate else "", "frame_rate")),
        ("exposure", known(exposure, f"{1e6 * exposure:g} us" if exposure else "", "exposure_s")),
        ("trigger", known(trigger, f"first frame is number {trigger} from the trigger", "trigger_offset_frames")),
    ]
    return facts + [("note", as_options(note)) for note in recording.notes]


def _preview(recording: Recording, path: Path) -> int:
    """Draw the circle that is found, with all that may be the ball, or else the first image with a grid."""
    with loading_libraries():
        from torchsphere.errors.raw_mosaic import about
        from torchsphere.recording.frame_source import Source
        from torchsphere.report.preview_figure import grid_figure, preview_figure
        from torchsphere.tracking.start import found_in

    try:
        ready = found_in(Source.open(recording, "cpu").standardised())
    except SettingError as error:
        grid_figure(path, recording.images(0, 1)[0], "frame 0: no ball was found; read its --circle X,Y,R off the grid")
        print(f"{'circle':<11} {error.as_options()}")
        print(f"{'preview':<11} {path}   (frame 0 with a grid)")
        return UNUSABLE
    if ready.mosaic:
        print(f"{'note':<11} {as_options(about(ready.mosaic, recording))}")
    circle = ready.start.circle
    image, text = recording.images(circle.frame, circle.frame + 1)[0], circle.text()
    preview_figure(path, image, circle, f"frame {circle.frame}: --circle {text}")
    print(f"{'circle':<11} --circle {text}   ({circle.sd_text}; frame {circle.frame})")
    for number, (x, y, radius) in enumerate(circle.others, 2):
        print(f"{f'circle {number}':<11} --circle {x:.2f},{y:.2f},{radius:.2f}   (another round object)")
    choice = circle.choice("in the preview")
    if choice:
        print(f"{'note':<11} {as_options(choice)}")
    if circle.doubt:
        print(f"{'note':<11} {as_options(circle.warning('in the preview'))}")
    print(f"{'preview':<11} {shown(str(path))}")
    return DONE
