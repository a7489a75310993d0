"""Which of Mitsuba's variants renders: the GPU's, the compiled one (LLVM), or the slow one that runs anywhere.

Mitsuba compiles its kernels with LLVM. Some LLVM builds crash the whole process in code generation, so the one that
the extra `render` installs is preferred, and any other is first tried in a process of its own.
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
#: Renders a small frame, in the way that every frame is rendered.
_TRIAL = """
import sys
sys.path.insert(0, sys.argv[2])
import mitsuba as mi
mi.set_variant(sys.argv[1])
from render.frames import trial
sys.exit(0 if trial() else 1)
"""


@dataclass(frozen=True)
class Backend:
    """What renders.

    Attributes
    ----------
    variant : str
        Mitsuba's name for it.
    reason : str
        A sentence that says which it is and why.
    """

    variant: str
    reason: str


def packaged_llvm() -> Path | None:
    """Find the LLVM library that the package karellen-llvm-core brings.

    Returns
    -------
    Path or None
        The library; None where the package is not installed.
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
        One of `VARIANTS`; None is the fastest that works here.

    Returns
    -------
    Backend
        The variant and the reason.

    Raises
    ------
    ImportError
        Where mitsuba is not installed.
    ValueError
        Where the variant asked for does not work here.
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
        True where there is a CUDA device and a trial frame came out right on it.
    """
    import drjit as dr

    return bool(dr.has_backend(dr.JitBackend.CUDA)) and works(VARIANTS[0])


def _set_llvm() -> None:
    """Tell drjit where the packaged LLVM is; it asks once, when imported, and the user's own choice comes first."""
    packaged = packaged_llvm()
    if packaged is not None and _LIBRARY not in os.environ and "drjit" not in sys.modules:
        os.environ[_LIBRARY] = str(packaged)


def llvm() -> tuple[str, str]:
    """Say which LLVM Mitsuba uses, and try it out unless it is the packaged one.

    Returns
    -------
    origin, obstacle : str
        Where the library comes from, and why it cannot be used; the latter is empty where it can.
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
    """Whether a variant renders, tried in a process of its own, for a bad library takes the process down.

    Parameters
    ----------
    variant : str
        Mitsuba's name for it.

    Returns
    -------
    bool
        True where a trial frame came out right.
    """
    home = str(Path(__file__).resolve().parents[1])
    trial = [sys.executable, "-c", _TRIAL, variant, home]
    try:
        return subprocess.run(trial, capture_output=True, check=False, timeout=120).returncode == 0
    except subprocess.TimeoutExpired:
        return False
