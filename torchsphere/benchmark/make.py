"""Make a benchmark: each suite rendered by a separate process, the folder written whole or not at all."""

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

from torchsphere.benchmark.folder import (
    IMAGES,
    INDEX,
    NAME,
    TRUTH,
    VERSION,
    Benchmark,
    index_checksum,
    read_benchmark,
    read_images,
    read_truth,
    suite_checksum,
)
from torchsphere.benchmark.suites import Recipe, recipes
from torchsphere.results.atomic_output import atomic_folder, check_folder, recover
from torchsphere.runtime import steps
from torchsphere.settings.limits import SettingError

#: Decimals of the outline in frame 0, px: finer than any tracker, coarser than differences between processors.
_DECIMALS = 6

#: Folder of the packages, and the renderer's package: its name differs between an installation and a checkout.
_PACKAGES = Path(__file__).resolve().parents[2]
_RENDERER = "torchsphere_render" if (_PACKAGES / "torchsphere_render").is_dir() else "render"

#: Interval between two checks of the processes that render, s.
_PAUSE_S = 0.05


def make(
    suites: Sequence[str] | None,
    size: str,
    out: Path,
    *,
    overwrite: bool = False,
    seed: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    workers: int | None = None,
) -> Benchmark:
    """Make a benchmark's folder from the `suites.recipes` of ``suites``, ``size`` and ``seed``.

    ``progress(done, total)`` is called with numbers of frames; ``workers`` processes render at once, by default one per
    core. Raises if a suite is unknown or refused, the renderer is missing or fails, or ``out`` is in use.
    """
    todo = recipes(suites, size, seed)
    if workers is not None and workers < 1:
        raise SettingError(f"`workers` = {workers}: expected at least 1")
    earlier = ("benchmark", (INDEX,))
    recover(out, earlier[1])
    check_folder(out, overwrite, *earlier)
    _check_renderer()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    with atomic_folder(out, overwrite, *earlier) as new:
        steps.tell("rendering %d suites", len(todo))
        _render_all(todo, new, workers or cores, progress)
        entries, versions = zip(*(_description(recipe, new / recipe.name) for recipe in todo), strict=True)
        index: dict[str, Any] = {"benchmark": NAME, "version": VERSION, "size": size, "suites": list(entries)}
        index |= {"checksum": index_checksum(index), "renderer": versions[-1]}
        text = json.dumps(index, indent=2, ensure_ascii=False, allow_nan=False)
        (new / INDEX).write_text(text + "\n", encoding="utf-8")
    return read_benchmark(out)


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


def _render_all(
    todo: Sequence[Recipe], folder: Path, workers: int, progress: Callable[[int, int], None] | None
) -> None:
    """Render every suite into its folder; the first failure ends all processes."""
    # The longest suite starts first, so that no core waits for it at the end.
    waiting = sorted(todo, key=lambda recipe: recipe.frames)
    total, done = sum(recipe.frames for recipe in todo), 0
    running: dict[str, tuple[Recipe, subprocess.Popen[bytes]]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                recipe = waiting.pop()
                running[recipe.name] = recipe, _start_renderer(recipe, folder)
            ended = [entry for entry in running.values() if entry[1].poll() is not None]
            for recipe, process in ended:
                del running[recipe.name]
                if process.returncode != 0:
                    raise ValueError(f"suite {recipe.name!r}: {_reason(folder, recipe, process.returncode)}")
                for suffix in ("log", "json"):
                    (folder / f"{recipe.name}.{suffix}").unlink()
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


def _start_renderer(recipe: Recipe, folder: Path) -> subprocess.Popen[bytes]:
    """Start the process that renders a suite, with the preset ``NAME.json`` and the output in ``NAME.log``."""
    preset = folder / f"{recipe.name}.json"
    preset.write_text(json.dumps({"shot": recipe.shot}), encoding="utf-8")
    command = [sys.executable, "-m", _RENDERER, str(preset), "--out", str(folder / recipe.name)]
    command += ["--seed", str(recipe.seed), "--quiet"]
    # The process starts in the folder of the packages, so that a file "render.py" in the user's folder is not run.
    with (folder / f"{recipe.name}.log").open("wb") as log:
        return subprocess.Popen(command, cwd=_PACKAGES, stdout=log, stderr=log)


def _reason(folder: Path, recipe: Recipe, code: int) -> str:
    """The renderer's last line of output, with the suite's name instead of the temporary file's."""
    log, preset = (folder / f"{recipe.name}.{suffix}" for suffix in ("log", "json"))
    lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
    last = lines[-1] if lines else f"the renderer ended with the exit code {code} and without a message"
    return last.removeprefix(f"{_RENDERER.replace('_', '-')}: ").replace(str(preset), recipe.name)


def _description(recipe: Recipe, folder: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """The entry of a rendered suite in ``suites.json``, and the renderer's versions."""
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
        "circle": _first_circle(folder / TRUTH, "outline_"),
        "ball": _first_circle(folder / TRUTH, ""),
        "checksum": suite_checksum(images, read_truth(folder / TRUTH)),
    }
    versions = {name: version for name, version in scene["versions"].items() if version is not None}
    return entry, versions | {"variant": scene["variant"]}


def _camera(camera: dict[str, Any]) -> dict[str, Any] | None:
    """The pinhole camera with the fields of `torchsphere.geometry.camera.Camera`; None for an orthographic view."""
    if camera["model"] == "orthographic":
        return None
    principal = camera.get("principal_px") or [(camera["width"] - 1) / 2, (camera["height"] - 1) / 2]
    return {"focal_px": camera["focal_px"], "principal_px": principal, "distortion": camera["distortion"]}


def _first_circle(path: Path, prefix: str) -> list[float]:
    """Position and radius in the first row of the truth, px."""
    with path.open(newline="", encoding="utf-8") as stream:
        row = next(csv.DictReader(stream))
    return [round(float(row[f"{prefix}{name}_px"]), _DECIMALS) for name in ("x", "y", "radius")]
