"""The command ``torchsphere demo``: a synthetic shot, tracked as any other, and beside its true motion."""

from __future__ import annotations

import importlib.util
import tempfile
from pathlib import Path
from typing import Any

from torchsphere.cli.track import measured
from torchsphere.measure import Measurement
from torchsphere.request import Request
from torchsphere.results.writer import status_counts
from torchsphere.synthetic import demo_shot


def run(options: dict[str, Any]) -> int:
    """Make the shot, measure it and print both motions; 0 when the result was written.

    Raises
    ------
    ValueError, OSError
        With one sentence on what is wrong with the result folder.
    """
    shot = demo_shot.make_shot()
    with tempfile.TemporaryDirectory() as folder:
        images, truth = demo_shot.write_shot(Path(folder), shot)
        request = Request(
            input=images,
            out=options["out"],
            fps=demo_shot.FRAME_RATE,
            diameter_mm=demo_shot.DIAMETER_MM,
            mass_g=demo_shot.MASS_G,
            overwrite=options["overwrite"],
            overlay=importlib.util.find_spec("av") is not None,
            paraview=True,
        )
        done = measured(request, options["quiet"], {"shot.tif": images, "truth.csv": truth}, demo_shot.NAME)
    _print_demo(shot, done, options["out"])
    return 0


def _print_demo(shot: demo_shot.Shot, done: Measurement, out: Path) -> None:
    tracked = done.track
    assert done.motion is not None  # the request has frame rate and scale
    print(f"{len(tracked.status)} frames: {', '.join(f'{n} {name}' for name, n in status_counts(tracked).items())}")
    print(f"\n{'per frame':<24} {'rms error':>10} {'stated sd':>10}  within 2 sd")
    for name, unit, rms, sd, within in demo_shot.frame_errors(shot, tracked):
        print(f"{f'{name} ({unit})':<24} {rms:>10.4f} {sd:>10.4f}  {100 * within:.0f} %")
    print(f"\n{'quantity':<32} {'true':>10} {'recovered':>10} {'sd':>8}  error / sd")
    rows = demo_shot.compare(shot, done.motion)
    for row in rows:
        label = f"{row.name} ({row.unit})"
        print(f"{label:<32} {row.true:>10.3f} {row.measured:>10.3f} {row.sd:>8.3f}  {row.ratio:+.1f}")
    agree = sum(abs(row.ratio) <= 2 for row in rows)
    print(f"\n{agree} of {len(rows)} quantities agree with the truth within 2 standard deviations")
    print(f"result: {out}")
