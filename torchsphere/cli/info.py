"""The command ``torchsphere info``: facts about a recording and, with ``--preview``, the circle of the ball."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchsphere.cli.options import add_command
from torchsphere.runtime.shown_text import shown

if TYPE_CHECKING:
    from torchsphere.recording import Recording


def add(commands: Any) -> None:
    """Add the command to the parser."""
    text = "Say what a recording is; with --preview, also where the ball is in it."
    parser = add_command(commands, "info", run, text, "example:  torchsphere info shot.cine --preview p.png")
    parser.add_argument("input", type=Path, metavar="INPUT", help="file or folder of images")
    parser.add_argument("--preview", type=Path, metavar="FILE.png", help="find the ball, print its circle and draw it")


def run(options: dict[str, Any]) -> int:
    """Print the facts and draw the preview; raises ValueError or OSError for a bad file, or if no ball is found."""
    from torchsphere.recording import open_recording

    with open_recording(options["input"]) as recording:
        for name, text in _facts(recording):
            print(f"{name:<11} {shown(text)}")
        if options["preview"] is not None:
            _preview(recording, options["preview"])
    return 0


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
    return facts + [("note", note) for note in recording.notes]


def _preview(recording: Recording, path: Path) -> None:
    from torchsphere.correlation.options import Options
    from torchsphere.detection.detect import find
    from torchsphere.recording.frame_source import Source
    from torchsphere.report.image_figures import preview_figure
    from torchsphere.tracking.initial_circle import calibrate_circle

    if path.suffix.lower() != ".png":
        raise ValueError(f"--preview {path}: expected a name that ends in .png")
    source = Source.open(recording, "cpu")
    circle = calibrate_circle(source, find(source.images, source.count), None, Options())
    image, text = recording.images(circle.frame, circle.frame + 1)[0], circle.text()
    preview_figure(path, image, circle, f"frame {circle.frame}: --circle {text}")
    print(f"{'circle':<11} --circle {text}   ({circle.sd_text}; frame {circle.frame})")
    for number, (x, y, radius) in enumerate(circle.others, 2):
        print(f"{f'circle {number}':<11} --circle {x:.2f},{y:.2f},{radius:.2f}   (another round object)")
    choice = circle.choice("in the preview")
    if choice:
        print(f"{'note':<11} {choice}")
    if circle.doubt:
        print(f"{'note':<11} {circle.warning('in the preview')}")
    print(f"{'preview':<11} {path}")
