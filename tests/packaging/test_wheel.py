"""What the sdist and the wheel hold, built without a network from a copy of the project's files."""

from __future__ import annotations

import email
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from configparser import ConfigParser
from pathlib import Path

import pytest
from rendering import needs_mitsuba

import torchsphere

ROOT = Path(__file__).resolve().parents[2]
#: Files that a checkout may hold and that do not belong to the project.
LEFTOVERS = (
    "torchsphere/kernels/__pycache__/loop.nbi",
    "docs/_build/index.html",
    "experiments/cache/shot.npz",
)
BUILD = "import sys; from setuptools import build_meta; getattr(build_meta, sys.argv[1])(sys.argv[2])"


@pytest.fixture(scope="session")
def tracked() -> list[str]:
    """Give the names of the project's files."""
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        pytest.skip("git says which files belong to the project, and this copy has no .git")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return sorted(name for name in listed.split("\0") if name and (ROOT / name).is_file())


def built(kind: str, source: Path, out: Path) -> Path:
    """Run a hook of the build backend in a source tree."""
    done = subprocess.run(
        [sys.executable, "-c", BUILD, f"build_{kind}", str(out)],
        cwd=source,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    (made,) = out.iterdir()
    return made


@pytest.fixture(scope="session")
def sdist(tracked: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the sdist, unpacked."""
    place = tmp_path_factory.mktemp("sdist")
    for name in (*tracked, *LEFTOVERS):
        (place / "copy" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / (name if name in tracked else "LICENSE"), place / "copy" / name)
    (place / "dist").mkdir()
    with tarfile.open(built("sdist", place / "copy", place / "dist")) as archive:
        # Debian 12 has Python 3.11.2, which does not know filters; later versions warn without one.
        archive.extractall(place, **({"filter": "data"} if hasattr(tarfile, "data_filter") else {}))
    return place / f"torchsphere-{torchsphere.__version__}"


@pytest.fixture(scope="session")
def wheel(sdist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the wheel, built from the sdist and unpacked."""
    out = tmp_path_factory.mktemp("wheel")
    with zipfile.ZipFile(built("wheel", sdist, out)) as archive:
        archive.extractall(out / "unpacked")
    return out / "unpacked"


def files(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def run(wheel: Path, cwd: Path, script: str) -> subprocess.CompletedProcess[str]:
    """Run a script outside the project, with the unpacked wheel in front of all that is installed."""
    start = f"import sys; sys.path.insert(0, {str(wheel)!r})\n"
    return subprocess.run(
        [sys.executable, "-I", "-c", start + script], cwd=cwd, capture_output=True, text=True, check=False
    )


def test_the_sdist_holds_every_file_of_the_project_and_no_other(sdist: Path, tracked: list[str]) -> None:
    own = {name for name in files(sdist) if name in ("PKG-INFO", "setup.cfg") or ".egg-info/" in name}
    assert set(files(sdist)) - own == set(tracked)


def test_the_wheel_holds_the_two_packages_with_their_data_and_nothing_else(wheel: Path, tracked: list[str]) -> None:
    expected = [name for name in tracked if name.startswith("torchsphere/")]
    expected += [f"torchsphere_{name}" for name in tracked if name.startswith("render/")]
    assert [name for name in files(wheel) if ".dist-info/" not in name] == sorted(expected)
    assert "torchsphere_render/presets/frontal-impact.toml" in expected
    assert {"torchsphere/py.typed", "torchsphere_render/py.typed"} <= set(expected)


def test_the_wheel_has_both_commands(wheel: Path) -> None:
    (info,) = wheel.glob("*.dist-info")
    commands = ConfigParser()
    commands.read(info / "entry_points.txt")
    assert dict(commands["console_scripts"]) == {
        "torchsphere": "torchsphere.cli.main:main",
        "torchsphere-render": "torchsphere_render.cli:main",
    }
    assert (info / "top_level.txt").read_text().split() == ["torchsphere", "torchsphere_render"]


def test_the_version_is_one(wheel: Path) -> None:
    (info,) = wheel.glob("*.dist-info")
    assert email.message_from_string((info / "METADATA").read_text())["Version"] == torchsphere.__version__
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r"^version: (\S+)$", citation, re.MULTILINE) == [torchsphere.__version__]


def test_the_description_on_the_package_index_has_no_link_that_leads_nowhere_there(wheel: Path) -> None:
    (info,) = wheel.glob("*.dist-info")
    description = email.message_from_string((info / "METADATA").read_text(encoding="utf-8")).get_payload()
    assert description.startswith("# torchsphere")
    assert "Limits has all of them" in description
    targets = re.findall(r"\]\(([^)]*)\)", description)
    assert all(target.startswith("https://") for target in targets)
    assert "![" not in description


def test_every_module_of_the_installed_renderer_imports_under_its_new_name(wheel: Path, tmp_path: Path) -> None:
    script = """
import importlib, pkgutil
import torchsphere_render
for module in pkgutil.walk_packages(torchsphere_render.__path__, "torchsphere_render."):
    if module.name != "torchsphere_render.__main__":
        importlib.import_module(module.name)
print(torchsphere_render.__file__, "render" in sys.modules, "torchsphere" in sys.modules)
"""
    done = run(wheel, tmp_path, script)
    assert done.stdout.split() == [str(wheel / "torchsphere_render" / "__init__.py"), "False", "False"], done.stderr


def test_the_installed_renderer_names_its_own_command(wheel: Path, tmp_path: Path) -> None:
    script = """
from torchsphere_render.cli import main
main(["--list"])
main(["exmaple", "--out", "shot"])
main(["--help"])
"""
    done = run(wheel, tmp_path, script)
    assert done.stdout.startswith("drop-weight "), done.stderr
    assert "\nusage: torchsphere-render [-h]" in done.stdout
    assert "example: torchsphere-render frontal-impact" in done.stdout
    assert done.stderr.startswith("torchsphere-render: preset 'exmaple' is not known")


@needs_mitsuba
def test_a_benchmark_is_made_with_the_installed_renderer(wheel: Path, tmp_path: Path) -> None:
    (tmp_path / "render").mkdir()
    (tmp_path / "render" / "__main__.py").write_text("raise SystemExit('another package of this name')")
    script = """
from pathlib import Path
from torchsphere.benchmark import make
print(make._RENDERER, make.make(["small-ball-10"], "smoke", Path("bench")).suites[0].name)
"""
    done = run(wheel, tmp_path, script)
    assert done.stdout.split() == ["torchsphere_render", "small-ball-10"], done.stderr
