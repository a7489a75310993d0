"""Imports load no heavy library and have no side effects. The contracts of imports are in pyproject.toml."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import torchsphere

ROOT = Path(__file__).resolve().parents[1]


def test_importing_loads_nothing_heavy_and_changes_nothing() -> None:
    script = """
import logging, os, random, sys
import numpy, torch
before = (torch.get_num_threads(), torch.get_default_dtype(), torch.is_grad_enabled(), torch.initial_seed(),
          torch.get_rng_state().tolist(), numpy.random.get_state()[1].tolist(), random.getstate(),
          list(logging.getLogger().handlers), dict(os.environ))
import torchsphere
for name in torchsphere.__all__:
    getattr(torchsphere, name)
after = (torch.get_num_threads(), torch.get_default_dtype(), torch.is_grad_enabled(), torch.initial_seed(),
         torch.get_rng_state().tolist(), numpy.random.get_state()[1].tolist(), random.getstate(),
         list(logging.getLogger().handlers), dict(os.environ))
heavy = {"mitsuba", "drjit", "matplotlib", "av", "dask", "distributed", "cv2", "skimage"} & set(sys.modules)
sys.exit(f"loaded {sorted(heavy)}" if heavy else "changed" if before != after else 0)
"""
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_torchsphere_imports_where_optional_libraries_are_missing() -> None:
    missing = ["matplotlib", "av", "mitsuba", "drjit", "dask", "distributed", "cv2", "skimage"]
    script = f"import sys; sys.modules.update(dict.fromkeys({missing!r})); from torchsphere import *"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def ran(script: str) -> str:
    """Output of a script in its own process."""
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


#: Libraries that take a second or two to load, and those of figures and pages.
SLOW = ("torch", "kornia", "scipy", "matplotlib", "jinja2")
LOADED = f"print('loaded', *({set(SLOW)!r} & set(sys.modules)))"


#: Commands that end before any work, and the exit code of each.
ENDS = {
    "--version": 0,
    "--help": 0,
    "track --help": 0,
    "pick --help": 0,
    "batch --help": 0,
    "plan --help": 0,
    "instruments --help": 0,
    "report --help": 0,
    "benchmark run --help": 0,
    "track shot.tif": 2,
    "track shot.tif --out result --method guessing": 2,
}


@pytest.fixture(scope="module")
def ends() -> dict[str, str]:
    """What each of these commands ends with, and which slow libraries it loads, one after the other in one process."""
    script = f"""
import sys
from torchsphere.cli.main import main
before = set()
for line in {tuple(ENDS)!r}:
    try:
        main(line.split())
    except SystemExit as stop:
        after = {set(SLOW)!r} & set(sys.modules)
        print("ENDED", line, "|", stop.code, *sorted(after - before))
        before = after
"""
    lines = (line.removeprefix("ENDED ") for line in ran(script).splitlines() if line.startswith("ENDED "))
    return dict(line.split(" | ") for line in lines)


@pytest.mark.parametrize("line", ENDS)
def test_help_and_refusals_load_no_slow_library(line: str, ends: dict[str, str]) -> None:
    assert ends[line] == str(ENDS[line])


def test_the_command_info_loads_no_slow_library(tmp_path: Path) -> None:
    np.save(tmp_path / "shot.npy", np.zeros((3, 8, 9), np.uint8))
    script = (
        f"import sys; from torchsphere.cli.main import main; main(['info', {str(tmp_path / 'shot.npy')!r}]); {LOADED}"
    )
    printed = ran(script)
    assert "9 x 8 px" in printed
    assert printed.splitlines()[-1] == "loaded"


def test_drawing_a_report_again_loads_no_library_of_the_measurement() -> None:
    assert ran(f"import sys; import torchsphere.report.draw, torchsphere.report.pages; {LOADED}") == "loaded\n"


# Loading unneeded modules takes time, and `track` is the most frequent command.
def test_a_track_loads_no_other_command() -> None:
    script = "import sys; import torchsphere.cli.main, torchsphere.measure; print(*sys.modules)"
    loaded = set(ran(script).split())
    others = ("archive", "benchmark", "pick", "planning.plan", "planning.expected", "synthetic", "instruments.signals")
    # Only the equations of a map are sparse.
    assert {*(f"torchsphere.{name}" for name in others), "scipy.sparse"} & loaded == set()


def test_a_public_name_does_not_depend_on_the_order_of_imports() -> None:
    script = """
import torchsphere.tracking.track, torchsphere.dynamics.impact, torchsphere.correlation.correlate
import torchsphere as ts
from torchsphere import kinematics
assert set(ts._HOMES) == set(ts.__all__) <= set(dir(ts))
print(*sorted(name for name in ts.__all__ if not callable(getattr(ts, name))), callable(kinematics))
"""
    assert ran(script).split() == ["True"]


def test_an_unknown_name_of_the_package_raises_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'torchsphere' has no attribute 'tracks'"):
        _ = torchsphere.tracks
