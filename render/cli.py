"""The command line: ``torchsphere-render SHOT --out DIR``, in a checkout also ``python -m render``."""

from __future__ import annotations

import argparse
import importlib.util
import shlex
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn, TextIO

from tqdm import tqdm

from . import preset
from .output import WRITERS, check_folder, write_recording
from .shot import Shot

#: The package is called `render` in a checkout and `torchsphere_render` in an installation.
_NAME = __name__.partition(".")[0].replace("_", "-")
_PROGRAM = "python -m render" if _NAME == "render" else _NAME
_MISSING = "rendering needs mitsuba, which is not installed: pip install 'torchsphere[render]'"


class _Parser(argparse.ArgumentParser):
    """A parser that reports bad options like all other bad input: one sentence, exit code 2."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{_NAME}: {message}; see '{self.prog} --help'\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Render a shot; the exit code is 0 only if the recording was written, 2 if the request was refused."""
    parser = _parser()
    options = parser.parse_args(arguments)
    try:
        if options.list:
            _list()
            return 0
        if options.shot is None or options.out is None:
            parser.error("expected a SHOT and --out DIR, or --list")
        _render(options)
        return 0
    except (ValueError, OSError, ImportError) as error:
        _say(f"{_NAME}: {_sentence(error)}", sys.stderr)
        return 2
    except KeyboardInterrupt:
        _say(f"{_NAME}: interrupted; nothing was written", sys.stderr)
        return 130


def _parser(program: str = _PROGRAM) -> argparse.ArgumentParser:
    parser = _Parser(
        prog=program,
        description="Render a recording of a speckled ball whose motion is known exactly.",
        epilog=f"example:  {program} frontal-impact --out shot --frames 20 --set camera.width=256",
        allow_abbrev=False,
    )
    parser.add_argument("shot", nargs="?", metavar="SHOT", help="name of a preset, a .toml file, or a scene.json")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for the recording")
    parser.add_argument("--list", action="store_true", help="list the presets")
    parser.add_argument("--frames", type=int, metavar="N", help="number of frames")
    parser.add_argument("--seed", type=int, metavar="N", help="replaces all seeds: pattern, backdrop, noise")
    parser.add_argument("--samples", type=int, metavar="N", help="light paths per pixel")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="FIELD=VALUE",
        help="a field of the preset by its path: sensor.bit_depth=12, trajectory.spin_rev_s=[0,20,0]; repeatable",
    )
    parser.add_argument("--format", choices=tuple(WRITERS), default="tiff", help="kind of the frames (%(default)s)")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier recording")
    parser.add_argument("--quiet", action="store_true", help="no progress bar, no messages")
    return parser


def _list() -> None:
    width = max(map(len, preset.names()))
    for name in preset.names():
        _say(f"{name:<{width}}  {preset.load(name).description}")


def _render(options: argparse.Namespace) -> None:
    changes = list(options.set)
    changes += [] if options.frames is None else [f"frames={options.frames}"]
    changes += [] if options.samples is None else [f"quality.samples={options.samples}"]
    shot = preset.load(options.shot, changes, options.seed)
    check_folder(options.out, options.overwrite)
    if importlib.util.find_spec("mitsuba") is None:
        raise ModuleNotFoundError(_MISSING)
    # Imported here: presets are checked and listed without Mitsuba.
    from . import backend
    from .frames import render_frames

    chosen = backend.choose(shot.setup.quality.variant)
    if not options.quiet:
        _say(chosen.reason, sys.stderr)
    frames = _counted(render_frames(shot.setup, shot.trajectory, shot.times_s), shot.frames, options.quiet)
    variant = chosen.variant, chosen.reason
    written = write_recording(
        options.out, shot, frames, kind=options.format, overwrite=options.overwrite, variant=variant
    )
    if not options.quiet:
        _report(shot, options.out, written)


def _counted(frames: Iterable[Any], count: int, quiet: bool) -> Iterator[Any]:
    yield from tqdm(frames, total=count, unit="frame", desc="rendering", file=sys.stderr, leave=False, disable=quiet)


def _report(shot: Shot, folder: Path, frames: Path) -> None:
    setup = shot.setup
    _say(f"{shot.frames} frames of {setup.camera.width} x {setup.camera.height} px (width x height)")
    _say(f"result  {folder}")
    command = [
        *("torchsphere", "track", str(frames), "--out", f"{folder}-track", "--fps", f"{shot.frame_rate_hz:.15g}"),
        *("--diameter-mm", f"{setup.ball.diameter_mm:.15g}", "--mass-g", f"{shot.trajectory.mass_g:.15g}"),
    ]
    _say(f"track   {shlex.join(command)}")


def _sentence(error: Exception) -> str:
    """The error in one line; those of the system get a word of advice."""
    if isinstance(error, OSError) and error.strerror is not None:
        return f"{error.filename or 'file'}: {error.strerror.lower()}; check the name and the permissions"
    return " ".join(str(error).split())


def _say(text: str, stream: TextIO | None = None) -> None:
    print(text, file=stream or sys.stdout)
