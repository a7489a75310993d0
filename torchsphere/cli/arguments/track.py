"""Options of ``torchsphere demo``, ``info`` and ``track``."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from torchsphere.settings import choices


def add(commands: Any) -> None:
    """Add the commands to those of ``torchsphere``."""
    _add_demo(commands)
    _add_info(commands)
    _add_track(commands)


def _add(commands: Any, name: str, help_text: str, example: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=help_text, description=help_text, epilog=f"example:  {example}", allow_abbrev=False
    )
    parser.set_defaults(command=name)
    return parser


def _add_demo(commands: Any) -> None:
    parser = _add(
        commands,
        "demo",
        "Track a synthetic shot and compare with its true motion.",
        "torchsphere demo --out demo",
    )
    parser.add_argument("--out", type=Path, default=Path("torchsphere-demo"), help="result folder (%(default)s)")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier result")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")


def _add_info(commands: Any) -> None:
    parser = _add(
        commands,
        "info",
        "Say what a recording is; with --preview, also where the ball is in it.",
        "torchsphere info shot.cine --preview p.png",
    )
    parser.add_argument("input", type=Path, metavar="INPUT", help="file or folder of images")
    parser.add_argument("--preview", type=Path, metavar="FILE.png", help="find the ball, print its circle and draw it")


def _add_track(commands: Any) -> None:
    parser = _add(
        commands,
        "track",
        "Measure the motion of the ball in one recording.",
        "torchsphere track shot.cihx --out result --diameter-mm 30 --mass-g 110",
    )
    parser.add_argument("input", type=Path, metavar="INPUT", help="file or folder of images")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="result folder")
    parser.add_argument(
        "--circle", type=numbers(3, "X,Y,R"), metavar="X,Y,R", help="outline in the first frame, px (found)"
    )
    parser.add_argument("--refine", action="store_true", default=None, help="fit the given circle to the image first")
    parser.add_argument("--frames", type=frames, metavar="A:B", help="frames A to B - 1 only")
    parser.add_argument("--fps", type=float, metavar="F", help="frame rate, 1/s (the file's)")
    scale = parser.add_mutually_exclusive_group()
    scale.add_argument("--diameter-mm", type=float, metavar="D", help="diameter of the ball")
    scale.add_argument("--mm-per-px", type=float, metavar="S", help="size of a pixel")
    parser.add_argument("--mass-g", type=float, metavar="M", help="mass of the ball, for the force")
    parser.add_argument("--scale-sd-percent", type=float, metavar="P", help="uncertainty of that diameter or size (0)")
    parser.add_argument("--shell-mm", type=float, metavar="T", help="thickness of a hollow ball (solid)")
    parser.add_argument("--inertia-kg-m2", type=float, metavar="I", help="moment of inertia, if neither")
    parser.add_argument("--normal-deg", type=float, metavar="A", help="target's normal, from x towards y (found)")
    parser.add_argument("--method", choices=choices.METHODS, help="how to differentiate (smoother)")
    parser.add_argument("--window", type=int, metavar="N", help="frames of savitzky-golay, odd (7)")
    parser.add_argument("--order", type=int, metavar="N", help="order of its polynomials (3)")
    parser.add_argument("--model", metavar="NAME", help=f"motion model: {', '.join(choices.MODELS)} (rigid)")
    camera = parser.add_argument_group("camera of the models pinhole and pinhole6")
    camera.add_argument("--focal-px", type=float, metavar="F", help="focal length over the size of a pixel")
    camera.add_argument(
        "--distance-mm", type=float, metavar="Z", help="or distance of the ball's centre, with --diameter-mm"
    )
    camera.add_argument(
        "--principal-px", type=numbers(2, "X,Y"), metavar="X,Y", help="where the optical axis meets the image (middle)"
    )
    camera.add_argument(
        "--distortion", type=numbers(3, "K1,K2,K3"), metavar="K1,K2,K3", help="radial, OpenCV's convention (none)"
    )
    parser.add_argument(
        "--roi",
        type=float,
        metavar="FRACTION",
        help="region of interest, share of the radius (0.95, less for a small ball unlike its background)",
    )
    parser.add_argument(
        "--ignore", action="append", metavar="FILE.png|POLYGON", help="region not to be used, as mask or 'x,y x,y x,y'"
    )
    parser.add_argument("--device", choices=choices.DEVICES, help="where to compute (cpu)")
    parser.add_argument(
        "--in-place", action="store_true", default=None, help="the ball turns without leaving its place"
    )
    parser.add_argument(
        "--map",
        choices=tuple(choices.MAPS),
        help="map of the ball's texture against drift, for twice the precision, up to 1 s a frame (auto: where needed)",
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


def numbers(count: int, names: str) -> Callable[[str], tuple[float, ...]]:
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


def frames(text: str) -> tuple[int | None, int | None]:
    """First frame and the one after the last, from 'A:B'."""
    try:
        first, last = (int(v) if v.strip() else None for v in text.split(":"))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not A:B, two frame numbers") from error
    return first, last
