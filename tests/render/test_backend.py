"""The choice of the variant, and the reason given for it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from rendering import needs_mitsuba

from render import backend
from render.scene import Quality

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def forgetful(monkeypatch):
    """Forget the variants of earlier calls; keep none for later calls."""
    monkeypatch.setattr(backend, "_known", {})


@needs_mitsuba
def test_the_variant_and_the_reason_for_it_are_told():
    found = backend.choose()
    assert found.variant in backend.VARIANTS
    assert found.variant in found.reason
    import mitsuba as mi

    assert mi.variant() == found.variant


@needs_mitsuba
def test_a_variant_that_is_asked_for_is_used():
    import mitsuba as mi

    assert backend.choose("scalar_rgb").reason == "rendering with scalar_rgb, as asked for"
    assert mi.variant() == "scalar_rgb"


@needs_mitsuba
def test_a_fresh_process_finds_the_packaged_llvm_by_itself():
    if backend.packaged_llvm() is None:
        pytest.skip("the package karellen-llvm-core is not installed here")
    alone = {name: value for name, value in os.environ.items() if name != "DRJIT_LIBLLVM_PATH"}
    command = "from render import backend; print(backend.choose('llvm_ad_mono').reason)"
    said = subprocess.run(
        [sys.executable, "-c", command], capture_output=True, text=True, check=True, cwd=ROOT, env=alone
    )
    assert "LLVM from karellen-llvm-core" in said.stdout


@needs_mitsuba
@pytest.mark.usefixtures("forgetful")
@pytest.mark.parametrize("given", [None, "/somewhere/libLLVM.so"])
def test_without_gpu_and_with_an_llvm_that_fails_the_slow_variant_says_why(monkeypatch, given):
    monkeypatch.setattr(backend, "packaged_llvm", lambda: None)
    monkeypatch.setattr(backend, "has_gpu", lambda: False)
    monkeypatch.setattr(backend, "works", lambda variant: False)
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    if given:
        monkeypatch.setenv("DRJIT_LIBLLVM_PATH", given)
    found = backend.choose()
    assert found.variant == "scalar_rgb"
    assert "no GPU found" in found.reason
    assert ("DRJIT_LIBLLVM_PATH" if given else "LLVM of the system") in found.reason
    with pytest.raises(ValueError, match="variant = 'llvm_ad_mono': the LLVM"):
        backend.choose("llvm_ad_mono")


@needs_mitsuba
@pytest.mark.usefixtures("forgetful")
def test_the_users_own_llvm_comes_first(monkeypatch):
    monkeypatch.setattr(backend, "has_gpu", lambda: False)
    monkeypatch.setattr(backend, "works", lambda variant: True)
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/somewhere/libLLVM.so")
    assert "LLVM from DRJIT_LIBLLVM_PATH" in backend.choose().reason
    assert os.environ["DRJIT_LIBLLVM_PATH"] == "/somewhere/libLLVM.so"


@needs_mitsuba
@pytest.mark.usefixtures("forgetful")
def test_a_gpu_is_taken_where_it_works_and_refused_where_it_does_not(monkeypatch):
    monkeypatch.setattr(backend, "has_gpu", lambda: False)
    with pytest.raises(ValueError, match="no GPU"):
        backend.choose("cuda_ad_mono")
    monkeypatch.setattr(backend, "has_gpu", lambda: True)
    assert backend._fastest().variant == "cuda_ad_mono"


@needs_mitsuba
def test_the_slow_variant_passes_its_trial_and_an_unknown_one_does_not():
    assert backend.works("scalar_rgb")
    assert not backend.works("no_such_variant")


def test_without_mitsuba_the_error_names_the_extra(monkeypatch):
    monkeypatch.setattr(backend.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r"torchsphere\[render\]"):
        backend.choose()


@needs_mitsuba
def test_an_unknown_variant_is_refused():
    with pytest.raises(ValueError, match="variant = 'vulkan'"):
        backend.choose("vulkan")
    with pytest.raises(ValueError, match="variant = 'vulkan'"):
        Quality(variant="vulkan")


def test_the_parts_import_without_mitsuba():
    command = "import sys, render.frames, render.scene; sys.exit('mitsuba' in sys.modules or 'drjit' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", command], check=False, cwd=ROOT).returncode == 0
