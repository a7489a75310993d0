"""The modules in docs/_ext, which make pages from the code."""

import importlib.util
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture(scope="module")
def extension() -> Callable[[str], ModuleType]:
    """Load a module by its name."""
    pytest.importorskip("sphinx", reason="the pages need Sphinx (extra 'docs')")

    def load(name: str) -> ModuleType:
        spec = importlib.util.spec_from_file_location(name, DOCS / "_ext" / f"{name}.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return load
