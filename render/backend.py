"""The choice of Mitsuba's variant: on the GPU, compiled for the CPU (LLVM), or the slow one that runs anywhere.

Mitsuba compiles its kernels with LLVM. Some LLVM builds crash the whole process in code generation. The LLVM that the
extra `render` installs is therefore preferred, and any other is first tried in a separate process.
"""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

#: Fastest first.
VARIANTS = ("cuda_ad_mono", "llvm_ad_mono", "scalar_rgb")
_LIBRARY = "DRJIT_LIBLLVM_PATH"
#: Renders a small frame with the code that renders all frames.
_TRIAL = """
import importlib, sys
variant, folder, package = sys.argv[1:]
sys.path.insert(0, folder)
import mitsuba as mi
mi.set_variant(variant)
sys.exit(0 if importlib.import_module(package + ".frames").trial() else 1)
"""


@dataclass(frozen=True)
class Backend:
    """A variant of Mitsuba, and why it was chosen.

    Attributes
    ----------
    variant : str
        Mitsuba's name of the variant.
    reason : str
        A sentence that names the variant and says why it was chosen.
    """

    variant: str
    reason: str


def packaged_llvm() -> Path | None:
    """Find the LLVM library that the package karellen-llvm-core brings.

    Returns
    -------
    Path or None
        The library; None if the package is not installed.
    """
    try:
        files = importlib.metadata.distribution("karellen-llvm-core").files or []
    except importlib.metadata.PackageNotFoundError:
        return None
    libraries = sorted(Path(str(file.locate())).resolve() for file in files if file.name.startswith("libLLVM"))
    return next((library for library in libraries if library.is_file()), None)


def choose(variant: str | None = None) -> Backend:
    """Choose the variant and make it Mitsuba's current one.

    Parameters
    ----------
    variant : str, optional
        One of `VARIANTS`; None is the fastest that works on this machine.

    Returns
    -------
    Backend
        The variant and the reason.

    Raises
    ------
    ImportError
        If mitsuba is not installed.
    ValueError
        If the variant asked for does not work on this machine.
    """
    if importlib.util.find_spec("mitsuba") is None:
        raise ImportError("rendering needs mitsuba, which is not installed: pip install 'torchsphere[render]'")
    if variant is not None and variant not in VARIANTS:
        raise ValueError(
            f"variant = {variant!r}: expected one of {', '.join(VARIANTS)}, or none for the fastest that works"
        )
    _set_llvm()
    found = _find(variant)
    import mitsuba as mi

    if mi.variant() != found.variant:
        mi.set_variant(found.variant)
    return found


_known: dict[str | None, Backend] = {}


def _find(variant: str | None) -> Backend:
    if variant not in _known:
        _known[variant] = _asked(variant) if variant else _fastest()
    return _known[variant]


def _fastest() -> Backend:
    if has_gpu():
        return Backend(VARIANTS[0], f"rendering on the GPU ({VARIANTS[0]})")
    origin, obstacle = llvm()
    if not obstacle:
        return Backend(
            VARIANTS[1], f"rendering on the CPU with compiled kernels ({VARIANTS[1]}, LLVM {origin}); no GPU found"
        )
    return Backend(
        VARIANTS[2],
        f"rendering on the CPU without compiled kernels ({VARIANTS[2]}), several times slower: "
        f"no GPU found, and {obstacle}",
    )


def _asked(variant: str) -> Backend:
    if variant == VARIANTS[0] and not has_gpu():
        raise ValueError(
            f"variant = {variant!r}: no GPU that renders found here; expected {VARIANTS[1]} or {VARIANTS[2]}"
        )
    if variant == VARIANTS[1]:
        origin, obstacle = llvm()
        if obstacle:
            raise ValueError(f"variant = {variant!r}: {obstacle}; expected {VARIANTS[2]}")
        return Backend(variant, f"rendering on the CPU with compiled kernels ({variant}, LLVM {origin}), as asked for")
    return Backend(variant, f"rendering with {variant}, as asked for")


def has_gpu() -> bool:
    """Whether there is a GPU that Mitsuba can render with.

    Returns
    -------
    bool
        True if there is a CUDA device that rendered a trial frame correctly.
    """
    import drjit as dr

    return bool(dr.has_backend(dr.JitBackend.CUDA)) and works(VARIANTS[0])


def _set_llvm() -> None:
    """Tell drjit where the packaged LLVM is, unless the user names another; drjit reads this once, at import."""
    packaged = packaged_llvm()
    if packaged is not None and _LIBRARY not in os.environ and "drjit" not in sys.modules:
        os.environ[_LIBRARY] = str(packaged)


def llvm() -> tuple[str, str]:
    """Name the LLVM that Mitsuba uses, and try it unless it is the packaged one.

    Returns
    -------
    origin, obstacle : str
        Where the library comes from, and why it cannot be used; empty if it can be used.
    """
    packaged = packaged_llvm()
    given = os.environ.get(_LIBRARY)
    if given and packaged is not None and Path(given).resolve() == packaged:
        return "from karellen-llvm-core", ""
    if given:
        origin = f"from {_LIBRARY}"
    elif packaged is not None:
        origin = "of the system, for drjit was imported before the renderer could point it to karellen-llvm-core"
    else:
        origin = "of the system"
    if works(VARIANTS[1]):
        return origin, ""
    return origin, f"the LLVM {origin} is missing or fails (the package karellen-llvm-core brings one that works)"


def works(variant: str) -> bool:
    """Whether a variant renders; tried in a separate process, because a bad library crashes its process.

    Parameters
    ----------
    variant : str
        Mitsuba's name of the variant.

    Returns
    -------
    bool
        True if a trial frame was rendered correctly.
    """
    package = Path(__file__).resolve().parent
    trial = [sys.executable, "-c", _TRIAL, variant, str(package.parent), package.name]
    try:
        return subprocess.run(trial, capture_output=True, check=False, timeout=120).returncode == 0
    except subprocess.TimeoutExpired:
        return False
