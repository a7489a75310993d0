"""Make a benchmark: each suite rendered by a process of its own, the folder whole or not at all."""

from __future__ import annotations

import csv
import importlib.util
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from torchsphere.benchmark.checksum import of_benchmark, of_suite
from torchsphere.benchmark.folder import INDEX, NAME, VERSION, Benchmark, read_benchmark
from torchsphere.benchmark.recorded import IMAGES, TRUTH, read_images, read_truth
from torchsphere.benchmark.suites import Recipe, recipes
from torchsphere.results.atomic_output import atomic_folder, check_folder

#: Called with numbers of frames: made so far, and to be made.
Progress = Callable[[int, int], None]

#: Decimals of the outline in frame 0, px: far below what matters, far above what processors differ in.
_DECIMALS = 6

#: Folder of the packages, and the renderer's package there: its name differs between an installation and a checkout.
_PACKAGES = Path(__file__).resolve().parents[2]
_RENDERER = "torchsphere_render" if (_PACKAGES / "torchsphere_render").is_dir() else "render"

#: Seconds between two looks at the processes that render.
_PAUSE_S = 0.05


def make(
    suites: Sequence[str] | None,
    size: str,
    out: Path,
    *,
    overwrite: bool = False,
    seed: int | None = None,
    progress: Progress | None = None,
    workers: int | None = None,
) -> Benchmark:
    """Make a benchmark's folder.

    Parameters
    ----------
    suites : sequence of str, optional
        Names of suites, or paths of ``.toml`` files; all that come with the package unless given.
    size : str
        ``smoke``, ``standard`` or ``full``.
    out : Path
        Name of the folder; it appears when all has been made. Nothing of an earlier one is used again.
    overwrite : bool
        Replace an earlier benchmark.
    seed : int, optional
        Added to the seed of each suite, for patterns and noise that nobody has seen before.
    progress : callable, optional
        Called as ``progress(done, total)`` with numbers of frames.
    workers : int, optional
        Processes that render at once; as many as there are processors unless given. The frames are the same.

    Returns
    -------
    Benchmark

    Raises
    ------
    ValueError
        Where a suite or the size is not known, or the renderer refuses a suite or fails.
    ModuleNotFoundError
        Where the renderer is not installed.
    OSError
        Where the folder cannot be written, or something else is there.
    """
    todo = recipes(suites, size, seed)
    if workers is not None and workers < 1:
        raise ValueError(f"workers = {workers}: expected at least 1")
    earlier = ("benchmark", (INDEX,))
    check_folder(out, overwrite, *earlier)
    _check_renderer()
    with atomic_folder(out, overwrite, *earlier) as new:
        _render_all(todo, new, workers or _processors(), progress)
        entries: list[dict[str, Any]] = []
        renderer: dict[str, str] = {}
        for recipe in todo:
            entry, renderer = _described(recipe, new / recipe.name)
            entries.append(entry)
        index: dict[str, Any] = {"benchmark": NAME, "version": VERSION, "size": size, "suites": entries}
        index |= {"checksum": of_benchmark(index), "renderer": renderer}
        text = json.dumps(index, indent=2, ensure_ascii=False, allow_nan=False)
        (new / INDEX).write_text(text + "\n", encoding="utf-8")
    return read_benchmark(out)


def _processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _check_renderer() -> None:
    installed = {
        _RENDERER: (_PACKAGES / _RENDERER).is_dir(),
        "mitsuba": importlib.util.find_spec("mitsuba") is not None,
    }
    for package, found in installed.items():
        if not found:
            raise ModuleNotFoundError(
                f"making a benchmark needs {package}, which is not installed: pip install 'torchsphere[render]'",
                name=package,
            )


def _render_all(todo: Sequence[Recipe], folder: Path, workers: int, progress: Progress | None) -> None:
    """Render every suite into its folder; the first that fails ends all."""
    # The longest first, so that none is left alone at the end.
    waiting = sorted(todo, key=lambda recipe: recipe.frames)
    total, done = sum(recipe.frames for recipe in todo), 0
    running: dict[str, tuple[Recipe, subprocess.Popen[bytes]]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                recipe = waiting.pop()
                running[recipe.name] = recipe, _started(recipe, folder)
            ended = [both for both in running.values() if both[1].poll() is not None]
            for recipe, process in ended:
                del running[recipe.name]
                if process.returncode != 0:
                    raise ValueError(f"suite {recipe.name!r}: {_reason(folder, recipe, process.returncode)}")
                _log(folder, recipe).unlink()
                _preset(folder, recipe).unlink()
                done += recipe.frames
                if progress is not None:
                    progress(done, total)
            if not ended:
                time.sleep(_PAUSE_S)
    finally:
        for _, process in running.values():
            process.terminate()
        for _, process in running.values():
            process.wait()


def _started(recipe: Recipe, folder: Path) -> subprocess.Popen[bytes]:
    """The process that renders a suite."""
    preset = _preset(folder, recipe)
    preset.write_text(json.dumps({"shot": recipe.shot}), encoding="utf-8")
    command = [sys.executable, "-m", _RENDERER, str(preset), "--out", str(folder / recipe.name)]
    command += ["--seed", str(recipe.seed), "--quiet"]
    # The renderer starts in the folder that holds it: a file of its name in the user's folder must not be run instead.
    with _log(folder, recipe).open("wb") as log:
        return subprocess.Popen(command, cwd=_PACKAGES, stdout=log, stderr=log)


def _preset(folder: Path, recipe: Recipe) -> Path:
    return folder / f"{recipe.name}.json"


def _log(folder: Path, recipe: Recipe) -> Path:
    return folder / f"{recipe.name}.log"


def _reason(folder: Path, recipe: Recipe, code: int) -> str:
    """Why the renderer failed: its own last words, without the temporary file's name."""
    lines = _log(folder, recipe).read_text(encoding="utf-8", errors="replace").strip().splitlines()
    last = lines[-1] if lines else f"the renderer ended with the exit code {code} and without a word"
    return last.removeprefix(f"{_RENDERER.replace('_', '-')}: ").replace(str(_preset(folder, recipe)), recipe.name)


def _described(recipe: Recipe, folder: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """What ``suites.json`` says of a suite, from what the renderer wrote; and the renderer's versions."""
    scene = json.loads((folder / "scene.json").read_text(encoding="utf-8"))
    shot, images = scene["shot"], read_images(folder / IMAGES)
    entry = {
        "name": recipe.name,
        "kind": recipe.kind,
        "title": recipe.title,
        "seed": recipe.seed,
        "frames": images.shape[0],
        "width": images.shape[2],
        "height": images.shape[1],
        "frame_rate_hz": scene["frame_rate_hz"],
        "diameter_mm": shot["ball"]["diameter_mm"],
        "camera": _camera(shot["camera"]),
        "circle": _first(folder / TRUTH, "outline_"),
        "ball": _first(folder / TRUTH, ""),
        "checksum": of_suite(images, read_truth(folder / TRUTH)),
    }
    versions = {name: version for name, version in scene["versions"].items() if version is not None}
    return entry, versions | {"variant": scene["variant"]}


def _camera(camera: dict[str, Any]) -> dict[str, Any] | None:
    """The pinhole camera as `torchsphere.geometry.camera.Camera` has it; None where the view is orthographic."""
    if camera["model"] == "orthographic":
        return None
    principal = camera.get("principal_px") or [(camera["width"] - 1) / 2, (camera["height"] - 1) / 2]
    return {"focal_px": camera["focal_px"], "principal_px": principal, "distortion": camera["distortion"]}


def _first(path: Path, kind: str) -> list[float]:
    """Place and radius in the truth's first row."""
    with path.open(newline="", encoding="utf-8") as stream:
        row = next(csv.DictReader(stream))
    return [round(float(row[f"{kind}{name}_px"]), _DECIMALS) for name in ("x", "y", "radius")]
