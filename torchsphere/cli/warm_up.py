"""The command ``torchsphere warm-up``: compile the loops over pixels before the first measurement."""

from __future__ import annotations

import time
from typing import Any

from torchsphere.cli.console import loading_libraries, say
from torchsphere.cli.options import add_command, add_quiet
from torchsphere.runtime import steps

#: Frames of the synthetic shot that are measured: enough for a map of the ball.
FRAMES = 12


def add(commands: Any) -> None:
    """Add the command to the parser."""
    text = "Compile the loops over pixels, once for each machine and version; else the first measurement does so."
    parser = add_command(commands, "warm-up", run, text, "example:  torchsphere warm-up")
    add_quiet(parser, "no output")


def run(options: dict[str, Any]) -> int:
    """Measure a few frames of the synthetic shot, which needs all loops that a usual recording needs."""
    import torchsphere as ts

    with loading_libraries():
        from torchsphere.kernels import jit
        from torchsphere.synthetic import demo_shot

    began = time.perf_counter()
    steps.tell("measuring %d frames of a synthetic shot", FRAMES)
    images = demo_shot.make_shot().images[:FRAMES]
    tracked = ts.track(images, log=False)
    ts.kinematics(tracked, frame_rate=demo_shot.FRAME_RATE, diameter_m=1e-3 * demo_shot.DIAMETER_MM)
    # A mask takes other loops, which look at each pixel's share.
    ts.track(images, ignore=images[0] > 250, sphere_map=False, log=False)
    kept = "kept on disk" if jit.are_kept() else "NOT kept on disk"
    say(options["quiet"], f"the loops are compiled and {kept} ({time.perf_counter() - began:.0f} s)")
    return 0
