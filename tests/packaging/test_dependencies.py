"""The dependencies that pyproject.toml declares are those that the code imports."""

from __future__ import annotations

import ast
import functools
import re
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

#: Modules by the distribution that brings them, if the names differ.
MODULES = {"pillow": "PIL", "opencv-python-headless": "cv2", "scikit-image": "skimage"}

#: Distributions that are used without an import: as a program, a plugin, a shared library, or by their types alone.
NO_IMPORT = {
    *("pytest-xdist", "ruff", "mypy", "import-linter", "types-tqdm", "pre-commit", "build", "twine", "setuptools"),
    *("furo", "myst-parser", "karellen-llvm-core", "dask"),
}

#: Modules of the project, and a rival tracker with an environment of its own (experiments/validation/field_method.py).
OWN = {"torchsphere", "render", "experiments", "muDIC", *(path.stem for path in (ROOT / "tests").glob("*.py"))}


def declared(*extras: str) -> set[str]:
    """Distributions of the plain installation and of some extras; of ``dask[distributed]``, both."""
    lines = [*PROJECT["dependencies"], *(line for extra in extras for line in PROJECT["optional-dependencies"][extra])]
    return {name for line in lines for name in re.findall(r"[\w-]+", re.split(r"[<>=;]", line)[0])}


@functools.cache
def imported(folder: str) -> frozenset[str]:
    """Modules that are not of the standard library, by the first part of their name."""
    names: set[str] = set()
    for path in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                names.add(node.module)
            elif isinstance(node, ast.Call) and ast.unparse(node.func) in ("pytest.importorskip", "load"):
                # `load` of the baselines takes the name of a library, others a path.
                names |= {arg.value for arg in node.args[:1] if isinstance(arg, ast.Constant)}
    return frozenset({name.partition(".")[0] for name in names} - set(sys.stdlib_module_names) - OWN)


def modules(distributions: set[str]) -> set[str]:
    return {MODULES.get(name, name).replace("-", "_") for name in distributions}


RUNTIME = ("video", "render", "dask", "baselines", "export")


@pytest.mark.parametrize(
    ("folder", "extras"),
    [
        ("torchsphere", RUNTIME),
        ("render", ("render",)),
        ("experiments", (*RUNTIME, "dev")),
        ("docs", ("docs",)),
        ("tests", (*RUNTIME, "docs", "dev")),
    ],
)
def test_every_library_that_is_imported_is_declared(folder: str, extras: tuple[str, ...]) -> None:
    assert imported(folder) - modules(declared(*extras)) == set()


def test_every_library_of_the_installation_is_imported_by_the_packages() -> None:
    used = imported("torchsphere") | imported("render")
    assert modules(declared(*RUNTIME) - NO_IMPORT) - used == set()


def test_every_library_of_the_development_is_imported_or_a_tool() -> None:
    used = imported("experiments") | imported("docs") | imported("tests")
    assert modules(declared("dev", "docs") - declared() - NO_IMPORT) - used == set()
