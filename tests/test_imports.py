"""What an import loads: nothing heavy, no side effects. What may import what stands in pyproject.toml."""

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
    """What a script prints in a process of its own."""
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


#: Libraries that take a second or two, and those of figures and pages.
SLOW = ("torch", "kornia", "scipy", "matplotlib", "jinja2")
LOADED = f"print('loaded', *({set(SLOW)!r} & set(sys.modules)))"


@pytest.mark.parametrize(
    "line",
    [
        "--version",
        "--help",
        "track --help",
        "batch --help",
        "plan --help",
        "report --help",
        "benchmark run --help",
        "track shot.tif",
        "track shot.tif --out result --method guessing",
    ],
)
def test_help_and_a_wrong_option_wait_for_no_library(line: str) -> None:
    script = f"""
import sys
from torchsphere.cli.main import main
try:
    main({line.split()!r})
except SystemExit as stop:
    print("ended with", stop.code)
{LOADED}
"""
    code = 0 if line.startswith("--") or line.endswith("--help") else 2
    assert ran(script).splitlines()[-2:] == [f"ended with {code}", "loaded"]


def test_the_facts_of_a_recording_wait_for_no_library(tmp_path: Path) -> None:
    np.save(tmp_path / "shot.npy", np.zeros((3, 8, 9), np.uint8))
    script = (
        f"import sys; from torchsphere.cli.main import main; main(['info', {str(tmp_path / 'shot.npy')!r}]); {LOADED}"
    )
    printed = ran(script)
    assert "9 x 8 px" in printed
    assert printed.splitlines()[-1] == "loaded"


def test_a_report_is_drawn_again_without_what_measures() -> None:
    assert ran(f"import sys; import torchsphere.report.draw, torchsphere.report.pages; {LOADED}") == "loaded\n"


# Each name that a command does not need is time that it takes: `track` is the one that is run most.
def test_a_track_loads_no_other_command() -> None:
    script = "import sys; import torchsphere.cli.main, torchsphere.measure; print(*sys.modules)"
    loaded = set(ran(script).split())
    others = ("archive", "benchmark", "planning.plan", "planning.expected", "synthetic", "instruments")
    # The map's equations are sparse; a track without a map has none.
    assert {*(f"torchsphere.{name}" for name in others), "scipy.sparse"} & loaded == set()


def test_a_public_name_is_the_same_whoever_imports_its_module_first() -> None:
    script = """
import torchsphere.tracking.track, torchsphere.dynamics.impact, torchsphere.correlation.correlate
import torchsphere as ts
from torchsphere import kinematics
assert set(ts._HOMES) == set(ts.__all__) <= set(dir(ts))
print(*sorted(name for name in ts.__all__ if not callable(getattr(ts, name))), callable(kinematics))
"""
    assert ran(script).split() == ["True"]


def test_a_name_that_the_package_lacks_is_refused_as_by_any_module() -> None:
    with pytest.raises(AttributeError, match="module 'torchsphere' has no attribute 'tracks'"):
        _ = torchsphere.tracks
