"""The command ``torchsphere demo``: the track of a synthetic shot, compared with the true motion."""

from __future__ import annotations

import importlib.util
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchsphere.cli.console import loading_libraries
from torchsphere.cli.options import add_command, add_quiet, add_verbose
from torchsphere.cli.outcome import status_text
from torchsphere.cli.track import measure_with_progress
from torchsphere.request import Request
from torchsphere.results import atomic_output
from torchsphere.runtime import steps
from torchsphere.runtime.shown_text import shown

if TYPE_CHECKING:
    from torchsphere.measure import Measurement
    from torchsphere.synthetic.demo_shot import Shot


def add(commands: Any) -> None:
    """Add the command to the parser."""
    text = "Track a synthetic shot and compare with its true motion."
    parser = add_command(commands, "demo", run, text, "example:  torchsphere demo --out demo")
    parser.add_argument(
        "--out", type=Path, default=Path("torchsphere-demo"), metavar="DIR", help="folder for the result (%(default)s)"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier result")
    add_quiet(parser, "no progress bar")
    add_verbose(parser)


def run(options: dict[str, Any]) -> int:
    """Make the shot, measure it and print both motions; raises ValueError or OSError for a bad result folder."""
    with loading_libraries():
        from torchsphere.synthetic import demo_shot

    atomic_output.recover(options["out"])
    steps.tell("rendering the shot")
    shot = demo_shot.make_shot()
    with tempfile.TemporaryDirectory() as folder:
        images, truth = demo_shot.write_shot(Path(folder), shot)
        request = Request(
            input=images,
            out=options["out"],
            fps=demo_shot.FRAME_RATE,
            diameter_mm=demo_shot.DIAMETER_MM,
            mass_g=demo_shot.MASS_G,
            telecentric=True,
            overwrite=options["overwrite"],
            overlay=importlib.util.find_spec("av") is not None,
            paraview=True,
        )
        files = {"shot.tif": images, "truth.csv": truth}
        done = measure_with_progress(request, options["quiet"], files, demo_shot.NAME)
    _print_comparison(shot, done)
    print(f"result: {shown(str(options['out']))}")
    return 0


def _print_comparison(shot: Shot, done: Measurement) -> None:
    from torchsphere.motion.track import status_counts
    from torchsphere.report.summary_tables import with_sd
    from torchsphere.synthetic import demo_shot

    tracked = done.track
    assert done.motion is not None  # the request has frame rate and scale
    assert done.impact is not None  # the shot has one
    print(f"frames {status_text(status_counts(tracked))}")
    print(f"\n{'per frame':<24} {'rms error':>10} {'stated sd':>10}  within 2 sd")
    for name, unit, rms, sd, within in demo_shot.frame_errors(shot, tracked):
        print(f"{f'{name} ({unit})':<24} {rms:>10.4f} {sd:>10.4f}  {100 * within:.0f} %")
    print(f"\n{'quantity':<28} {'true':>10} {'recovered':>20}  error / sd")
    rows = demo_shot.compare(shot, done.motion, done.impact)
    for row in rows:
        label = f"{row.name} ({row.unit})" if row.unit else row.name
        recovered = with_sd(row.measured, row.sd, "")
        decimals = len(recovered.split()[0].partition(".")[2])
        print(f"{label:<28} {row.true:>10.{decimals}f} {recovered:>20}  {row.ratio:+.1f}")
    agree = sum(abs(row.ratio) <= 2 for row in rows)
    print(f"\n{agree} of {len(rows)} quantities agree with the truth within 2 standard deviations")
