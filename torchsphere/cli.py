"""The command line: ``torchsphere demo``, ``info``, ``track``; its other commands in modules of their own."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import importlib.util
import signal
import sys
import tempfile
import threading
import tomllib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

from tqdm import tqdm

from torchsphere import __version__, batch_cli, benchmark_cli, demo, motion, plan_cli, report_cli
from torchsphere.kinematics import METHODS
from torchsphere.measure import Measurement, Request, circle_text, measure
from torchsphere.recording import Recording, open_recording
from torchsphere.report import figures
from torchsphere.results import status_counts


class _Parser(argparse.ArgumentParser):
    """A parser that reports bad options as every other bad input: one sentence, exit code 2."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"torchsphere: {message}; see '{self.prog} --help'\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; the exit code is 0 only where the result was written."""
    options = vars(_parser().parse_args(arguments))
    command = options.pop("command")
    try:
        with _ending_in_order():
            return int(command(options))
    except (ValueError, OSError) as error:
        print(f"torchsphere: {_sentence(error)}", file=sys.stderr)
    except ModuleNotFoundError as error:
        print(f"torchsphere: the package {error.name!r} is missing; install torchsphere again", file=sys.stderr)
    except KeyboardInterrupt:
        print("torchsphere: interrupted; nothing was written", file=sys.stderr)
        return 130
    return 1


@contextlib.contextmanager
def _ending_in_order() -> Iterator[None]:
    """Make a request to end (SIGTERM), as job schedulers send it, an exception, so that what was begun is cleaned up.

    Unfinished folders are removed, and processes that were started end, too. The exit code is the shells' own, 143.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, _: Any) -> NoReturn:
        sys.exit(128 + number)

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _sentence(error: Exception) -> str:
    """The error in one line; the system's own errors lack the words for what to do."""
    if isinstance(error, OSError) and error.strerror is not None:
        return f"{error.filename or 'file'}: {error.strerror.lower()}; check the name and the permissions"
    return " ".join(str(error).split())


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="torchsphere", description="Motion of a speckled ball from high-speed footage.")
    parser.add_argument("--version", action="version", version=f"torchsphere {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)
    _add_demo(commands)
    _add_info(commands)
    _add_track(commands)
    batch_cli.add(commands)
    benchmark_cli.add(commands)
    plan_cli.add(commands)
    report_cli.add(commands)
    return parser


def _command(commands: Any, name: str, run: Any, help_text: str, example: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=help_text, description=help_text, epilog=f"example:  {example}", allow_abbrev=False
    )
    parser.set_defaults(command=run)
    return parser


def _add_demo(commands: Any) -> None:
    parser = _command(
        commands,
        "demo",
        _demo,
        "Track a synthetic shot and compare with its true motion.",
        "torchsphere demo --out demo",
    )
    parser.add_argument("--out", type=Path, default=Path("torchsphere-demo"), help="result folder (%(default)s)")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier result")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")


def _add_info(commands: Any) -> None:
    parser = _command(
        commands,
        "info",
        _info,
        "Say what a recording is, and find the ball in it.",
        "torchsphere info shot.cine --preview p.png",
    )
    parser.add_argument("input", type=Path, metavar="INPUT", help="file or folder of images")
    parser.add_argument("--preview", type=Path, metavar="FILE.png", help="draw the circle that is found")


def _add_track(commands: Any) -> None:
    parser = _command(
        commands,
        "track",
        _track,
        "Measure the motion of the ball in one recording.",
        "torchsphere track shot.cihx --out result --diameter-mm 30 --mass-g 110",
    )
    parser.add_argument("input", type=Path, metavar="INPUT", help="file or folder of images")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="result folder")
    parser.add_argument(
        "--circle", type=_numbers(3, "X,Y,R"), metavar="X,Y,R", help="outline in the first frame, px (found)"
    )
    parser.add_argument("--refine", action="store_true", default=None, help="fit the given circle to the image first")
    parser.add_argument("--frames", type=_frames, metavar="A:B", help="frames A to B - 1 only")
    parser.add_argument("--fps", type=float, metavar="F", help="frame rate, 1/s (the file's)")
    scale = parser.add_mutually_exclusive_group()
    scale.add_argument("--diameter-mm", type=float, metavar="D", help="diameter of the ball")
    scale.add_argument("--mm-per-px", type=float, metavar="S", help="size of a pixel")
    parser.add_argument("--mass-g", type=float, metavar="M", help="mass of the ball, for the force")
    parser.add_argument("--scale-sd-percent", type=float, metavar="P", help="uncertainty of that diameter or size (0)")
    parser.add_argument("--shell-mm", type=float, metavar="T", help="thickness of a hollow ball (solid)")
    parser.add_argument("--inertia-kg-m2", type=float, metavar="I", help="moment of inertia, if neither")
    parser.add_argument("--normal-deg", type=float, metavar="A", help="target's normal, from x towards y (found)")
    parser.add_argument("--method", choices=METHODS, help="how to differentiate (smoother)")
    parser.add_argument("--window", type=int, metavar="N", help="frames of savitzky-golay, odd (7)")
    parser.add_argument("--order", type=int, metavar="N", help="order of its polynomials (3)")
    parser.add_argument("--model", metavar="NAME", help=f"motion model: {', '.join(motion.MODELS)} (rigid)")
    camera = parser.add_argument_group("camera of the models pinhole and pinhole6")
    camera.add_argument("--focal-px", type=float, metavar="F", help="focal length over the size of a pixel")
    camera.add_argument(
        "--distance-mm", type=float, metavar="Z", help="or distance of the ball's centre, with --diameter-mm"
    )
    camera.add_argument(
        "--principal-px", type=_numbers(2, "X,Y"), metavar="X,Y", help="where the optical axis meets the image (middle)"
    )
    camera.add_argument(
        "--distortion", type=_numbers(3, "K1,K2,K3"), metavar="K1,K2,K3", help="radial, OpenCV's convention (none)"
    )
    parser.add_argument("--roi", type=float, metavar="FRACTION", help="region of interest, share of the radius (0.95)")
    parser.add_argument(
        "--ignore", action="append", metavar="FILE.png|POLYGON", help="region not to be used, as mask or 'x,y x,y x,y'"
    )
    parser.add_argument("--device", choices=("cpu", "cuda"), help="where to compute (cpu)")
    parser.add_argument(
        "--in-place", action="store_true", default=None, help="the ball turns without leaving its place"
    )
    parser.add_argument(
        "--map",
        choices=("auto", "on", "off"),
        help="map of the ball's texture against drift, for twice the precision, about 1 s a frame (auto: where needed)",
    )
    parser.add_argument("--lab-frame", action="store_true", default=None, help="kinematics with y up, z to the camera")
    parser.add_argument(
        "--config", type=Path, metavar="FILE.toml", help="these options from a file; the line above wins"
    )
    parser.add_argument("--overwrite", action="store_true", default=None, help="replace an earlier result")
    parser.add_argument(
        "--no-report",
        dest="report",
        action="store_false",
        default=None,
        help="no figures, no report, no images in the result",
    )
    parser.add_argument("--overlay", action="store_true", default=None, help="make overlay.mp4, too (extra 'video')")
    parser.add_argument("--paraview", action="store_true", default=None, help="make a series for ParaView, too")
    parser.add_argument("--quiet", action="store_true", help="no progress bar, no summary")


def _numbers(count: int, names: str) -> Callable[[str], tuple[float, ...]]:
    """What reads ``count`` numbers from 'a,b,c'; a refusal says the ``names``."""

    def read(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(v) for v in text.split(","))
        except ValueError:
            values = ()
        if len(values) != count:
            raise argparse.ArgumentTypeError(f"{text!r} is not {names}, {count} numbers")
        return values

    return read


def _frames(text: str) -> tuple[int | None, int | None]:
    try:
        first, last = (int(v) if v.strip() else None for v in text.split(":"))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not A:B, two frame numbers") from error
    return first, last


def _configured(path: Path) -> dict[str, Any]:
    """Options from a TOML file, by the names of the command line."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: is no TOML file ({error}); see the README for one") from error
    known = {f.name for f in dataclasses.fields(Request)} - {"input", "out"}
    options = {}
    for key, value in table.items():
        name = key.replace("-", "_")
        if name not in known:
            raise ValueError(f"{path}: unknown option {key!r}; expected one of {', '.join(sorted(known))}")
        options[name] = _typed(path, name, value)
    return options


#: Options of `Request` that are on or off; and those for what follows from the track, each a number.
SWITCHES = ("refine", "in_place", "lab_frame", "overwrite", "report", "overlay", "paraview")
KINEMATIC = ("scale_sd_percent", "shell_mm", "inertia_kg_m2", "normal_deg")


def _typed(path: Path, name: str, value: Any) -> Any:
    """The value as `Request` takes it; ValueError where the file has another kind of value."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    lengths = {"circle": 3, "principal_px": 2, "distortion": 3}
    if name in lengths and isinstance(value, list) and len(value) == lengths[name]:
        return _numbers(len(value), name)(",".join(map(str, value)))
    if name == "frames" and isinstance(value, str):
        return _frames(value)
    if name == "ignore" and isinstance(value, (str, list)):
        return [value] if isinstance(value, str) else [str(v) for v in value]
    if name in ("fps", "diameter_mm", "mm_per_px", "mass_g", "roi", "focal_px", "distance_mm", *KINEMATIC) and number:
        return float(value)
    if name in ("window", "order") and isinstance(value, int) and number:
        return value
    if name in ("model", "device", "map", "method") and isinstance(value, str):
        return value
    if name in SWITCHES and isinstance(value, bool):
        return value
    raise ValueError(f"{path}: {name} = {value!r} is not what this option takes; see 'torchsphere track --help'")


class _Bar:
    """A progress bar on stderr that appears with the first progress, so that a refusal stands alone."""

    def __init__(self) -> None:
        self._bar: tqdm[NoReturn] | None = None

    def __call__(self, done: int, total: int) -> None:
        if self._bar is None:
            self._bar = tqdm(total=total, unit="frame", file=sys.stderr, leave=False, desc="tracking")
        if done < self._bar.n:
            self._bar.reset(total)
            self._bar.set_description("on the map")
        self._bar.update(done - self._bar.n)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()


def _measured(
    request: Request, quiet: bool, extra: dict[str, Path] | None = None, name: str | None = None
) -> Measurement:
    if quiet:
        return measure(request, None, extra, name=name)
    with contextlib.closing(_Bar()) as bar:
        return measure(request, bar, extra, name=name)


def _track(options: dict[str, Any]) -> int:
    config, quiet = options.pop("config"), options.pop("quiet")
    given = {name: value for name, value in options.items() if value is not None}
    from_file = {} if config is None else _from_file(config, given)
    done = _measured(Request(**(from_file | given)), quiet)
    if not quiet:
        _print_result(done, given["out"])
    return 0


def _from_file(config: Path, given: dict[str, Any]) -> dict[str, Any]:
    try:
        options = _configured(config)
    except argparse.ArgumentTypeError as error:
        raise ValueError(f"{config}: {error}") from error
    # A scale on the command line takes the place of the other kind of scale in the file.
    if {"diameter_mm", "mm_per_px"} & given.keys():
        options = {k: v for k, v in options.items() if k not in ("diameter_mm", "mm_per_px")}
    return options


def _print_result(done: Measurement, out: Path) -> None:
    tracked = done.track
    counts = ", ".join(f"{count} {name}" for name, count in status_counts(tracked).items())
    circle = tracked.circle
    print(f"{len(tracked.status)} frames: {counts}")
    print(f"circle  {circle_text(circle)} px in frame {done.first_frame + circle.frame}")
    for sentence in done.warnings:
        print(f"note    {sentence}")
    print(f"result  {out}")


def _info(options: dict[str, Any]) -> int:
    with open_recording(options["input"]) as recording:
        for name, text in _facts(recording):
            print(f"{name:<11} {text}")
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
    from torchsphere.calibrate import calibrate
    from torchsphere.circle import find
    from torchsphere.options import Options
    from torchsphere.source import Source

    if path.suffix.lower() != ".png":
        raise ValueError(f"--preview {path}: expected a name that ends in .png")
    source = Source.open(recording, "cpu")
    circle = calibrate(source, find(source.images, source.count), None, Options())
    text = circle_text(circle)
    title = f"frame {circle.frame}: --circle {text}"
    figures.preview_figure(path, recording.images(circle.frame, circle.frame + 1)[0], circle, title)
    sd = f"sd {circle.sd_x:.2f}, {circle.sd_y:.2f}, {circle.sd_radius:.2f} px"
    print(f"{'circle':<11} --circle {text}   ({sd}; frame {circle.frame})")
    print(f"{'preview':<11} {path}")


def _demo(options: dict[str, Any]) -> int:
    shot = demo.make_shot()
    with tempfile.TemporaryDirectory() as folder:
        images, truth = demo.write_shot(Path(folder), shot)
        request = Request(
            input=images,
            out=options["out"],
            fps=demo.FRAME_RATE,
            diameter_mm=demo.DIAMETER_MM,
            mass_g=demo.MASS_G,
            overwrite=options["overwrite"],
            overlay=importlib.util.find_spec("av") is not None,
            paraview=True,
        )
        done = _measured(request, options["quiet"], {"shot.tif": images, "truth.csv": truth}, demo.NAME)
    _print_demo(shot, done, options["out"])
    return 0


def _print_demo(shot: demo.Shot, done: Measurement, out: Path) -> None:
    tracked = done.track
    assert done.motion is not None  # the request has frame rate and scale
    print(f"{len(tracked.status)} frames: {', '.join(f'{n} {name}' for name, n in status_counts(tracked).items())}")
    print(f"\n{'per frame':<24} {'rms error':>10} {'stated sd':>10}  within 2 sd")
    for name, unit, rms, sd, within in demo.frame_errors(shot, tracked):
        print(f"{f'{name} ({unit})':<24} {rms:>10.4f} {sd:>10.4f}  {100 * within:.0f} %")
    print(f"\n{'quantity':<32} {'true':>10} {'recovered':>10} {'sd':>8}  error / sd")
    rows = demo.compare(shot, tracked, done.motion)
    for row in rows:
        label = f"{row.name} ({row.unit})"
        print(f"{label:<32} {row.true:>10.3f} {row.measured:>10.3f} {row.sd:>8.3f}  {row.ratio:+.1f}")
    agree = sum(abs(row.ratio) <= 2 for row in rows)
    print(f"\n{agree} of {len(rows)} quantities agree with the truth within 2 standard deviations")
    print(f"result: {out}")
