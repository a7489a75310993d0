"""Options of ``torchsphere plan``."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

EXAMPLE = (
    "torchsphere plan --speed 72 --fps 36000 --shutter-us 12.3 --px-per-mm 3.6 --diameter-mm 30 --mass-g 110 "
    "--spin-rev-s 0,5,0 --noise 2 --width 512 --contact-us 230 --modes camera.csv --out plan"
)
OF_FLIGHT = "torchsphere plan --flight shot.cihx --diameter-mm 30 --mass-g 110 --out plan"
HELP = "Before the test: motion blur, frames in view, expected uncertainty of velocity, spin and force."


def add(commands: Any) -> None:
    """Add the command to those of ``torchsphere``."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "plan",
        help=HELP,
        description=HELP + " From an example image or a rendered pattern, or from a recording of a free flight.",
        epilog=f"examples:  {EXAMPLE}   or   {OF_FLIGHT}",
        allow_abbrev=False,
    )
    parser.set_defaults(command="plan")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for plan.json and plan.png")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier plan")
    parser.add_argument("--quiet", action="store_true", help="no progress bar, no table")
    test = parser.add_argument_group("the test")
    test.add_argument("--speed", type=float, metavar="V", help="of the ball, m/s")
    test.add_argument("--direction-deg", type=float, metavar="A", help="of its flight, from right towards down (0)")
    test.add_argument("--spin-rev-s", type=_numbers(3, "X,Y,Z"), metavar="X,Y,Z", help="its spin, rev/s (0,0,0)")
    test.add_argument("--diameter-mm", type=float, metavar="D", help="diameter of the ball")
    test.add_argument("--mass-g", type=float, metavar="M", help="mass of the ball")
    test.add_argument("--contact-us", type=float, metavar="T", help="duration of the contact (elastic, Hertz)")
    test.add_argument(
        "--restitution", type=float, default=0.3, metavar="E", help="speed after over before (%(default)g)"
    )
    camera = parser.add_argument_group("the camera")
    camera.add_argument("--fps", type=float, metavar="F", help="frame rate, 1/s")
    camera.add_argument("--shutter-us", type=float, metavar="T", help="exposure time")
    camera.add_argument("--px-per-mm", type=float, metavar="P", help="scale in the ball's plane (--circle's)")
    camera.add_argument("--noise", type=float, metavar="S", help="sd of a pixel between images, grey levels")
    camera.add_argument(
        "--width", type=int, metavar="W", help="of the image along the flight, px: for the frames in view"
    )
    camera.add_argument("--modes", type=Path, metavar="FILE.csv", help="its modes: width_px, height_px, fps_max")
    camera.add_argument("--field-mm", type=float, metavar="W", help="width that all modes show (they keep px per mm)")
    look = parser.add_argument_group("what the ball looks like: images of it, a rendered pattern, or a free flight")
    look.add_argument("--image", type=Path, action="append", metavar="FILE", help="sharp image; again for other sides")
    look.add_argument(
        "--circle",
        type=_numbers(3, "X,Y,R"),
        action="append",
        metavar="X,Y,R",
        help="outline in it, px (in the flight: found)",
    )
    look.add_argument("--blurred", action="store_true", default=None, help="the images show the test's motion blur")
    look.add_argument("--speckle-px", type=float, metavar="S", help="size of the rendered spots (4)")
    look.add_argument("--grey", type=_numbers(2, "LOW,HIGH"), metavar="LOW,HIGH", help="their grey levels (30,220)")
    look.add_argument("--flight", type=Path, metavar="INPUT", help="recording, or result of 'track', without a target")


def _numbers(count: int, names: str) -> Callable[[str], tuple[float, ...]]:
    """What reads ``count`` finite numbers from 'a,b,c'."""

    def read(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(v) for v in text.split(","))
        except ValueError:
            values = ()
        if len(values) != count or not all(map(math.isfinite, values)):
            raise argparse.ArgumentTypeError(f"{text!r} is not {names}, {count} numbers")
        return values

    return read
