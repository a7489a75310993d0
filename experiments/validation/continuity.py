"""What the last digit of a number decides: ``python -m experiments.validation.continuity``.

Claim: images changed by 1e-4 grey levels, other gains and offsets of the levels, another number of threads and another
processor change no status, and no number by more than a tenth of its standard deviation. A result that hangs on the
rounding of a sum differs from machine to machine, and one of both is wrong.

Each recording is measured once as it is, and once with each change, in a process of its own: the libraries choose
their code for a processor when they are loaded. The loops are compiled anew for the plainest processor, which takes
minutes. ``--recording NAME`` measures one alone and writes no table. Real recordings are left out where
``../shared/data`` is absent.
"""

from __future__ import annotations

import argparse
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import torchsphere as ts
from experiments.experiment import Array, publish, table
from experiments.validation.attack_cases import CASES
from torchsphere.recording.ignore_mask import read_ignore
from torchsphere.synthetic.demo_shot import make_shot

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"

#: Largest change of a number, in its standard deviations.
MOST = 0.1

#: Images (n, h, w), and the options of `ts.track`.
Given = tuple[Array, dict[str, Any]]


def film(frames: int, *, as_its_configuration: bool) -> Given:
    """A ball that turns in its place, as its configuration says or with the circle alone."""
    with ts.open_recording(DATA / "fictrac" / "sample.mp4") as recording:
        images = np.asarray(recording.images(0, frames), dtype=np.float64)
    circle: dict[str, Any] = {"circle": (109.1, 179.4, 45.0)}
    if not as_its_configuration:
        return images, circle
    animal = "96,156 113,147 106,128 82,130 81,150"
    cup = "71,213 90,219 114,218 135,211 154,196 150,217 121,228 99,234 75,225"
    return images, circle | {"in_place": True, "ignore": read_ignore((animal, cup), images.shape[1:])}


def silhouette() -> Given:
    """A real ball without texture."""
    with ts.open_recording(DATA / "photron" / "ball_12bit.cihx") as recording:
        return np.asarray(recording.images(0, len(recording)), dtype=np.float64), {}


def attacked(name: str, seed: int) -> Callable[[], Given]:
    """A recording of `experiments.validation.attack`."""

    def make() -> Given:
        made = CASES[name](seed)
        return made.images.double().numpy(), made.options

    return make


#: Recordings by their names in the table; seeds of the attack that its own table does not use.
RECORDINGS: dict[str, Callable[[], Given]] = {
    "demo": lambda: (make_shot().images.astype(np.float64), {}),
    "sample.mp4, in place": lambda: film(24, as_its_configuration=True),
    "sample.mp4, circle alone": lambda: film(60, as_its_configuration=False),
    "ball_12bit.cihx": silhouette,
    "nothing": attacked("nothing", 1001),
    "still blotches behind": attacked("still blotches behind", 1002),
    "camera at 10 radii": attacked("camera at 10 radii", 1003),
    "exposure blur of 3 px": attacked("exposure blur of 3 px", 1004),
    "lamp from one side": attacked("lamp from one side", 1005),
    "H.264, crf 30": attacked("H.264, crf 30", 1006),
    "plate in front": attacked("plate in front", 1007),
    "grows by 0.3 % per frame": attacked("grows by 0.3 % per frame", 1008),
    "noise of 12 levels": attacked("noise of 12 levels", 1009),
    "hand in front": attacked("hand in front", 1011),
}


@dataclass(frozen=True)
class Variation:
    """A change that must change nothing."""

    name: str
    images: Callable[[Array], Array] = np.copy
    environment: tuple[tuple[str, str], ...] = ()


def _a_little(images: Array) -> Array:
    return images + 1e-4 * np.random.default_rng(1).uniform(-1, 1, images.shape)


AS_IT_IS = Variation("as it is")
VARIATIONS = (
    Variation("levels + 1e-4", _a_little),
    Variation("levels x (1 + 1e-6)", lambda images: (1 + 1e-6) * images),
    Variation("levels / 65535", lambda images: images / 65535),
    Variation("levels / 255 + 3", lambda images: images / 255 + 3),
    Variation("levels x 1e4 + 1e6", lambda images: 1e4 * images + 1e6),
    Variation("two threads", environment=(("OMP_NUM_THREADS", "2"),)),
    Variation("loops for the plainest processor", environment=(("NUMBA_CPU_NAME", "generic"),)),
    Variation("NumPy without AVX2", environment=(("NPY_DISABLE_CPU_FEATURES", "AVX2 FMA3 AVX512F AVX512_SKX"),)),
    Variation("OpenBLAS for another core", environment=(("OPENBLAS_CORETYPE", "Prescott"),)),
    Variation("torch without AVX2", environment=(("ATEN_CPU_CAPABILITY", "default"),)),
)


def measure(recording: str, variation: str, out: Path) -> None:
    """Write the track of a recording under a variation, or the sentence that refuses it."""
    changes = {v.name: v.images for v in (AS_IT_IS, *VARIATIONS)}
    images, options = RECORDINGS[recording]()
    found: ts.Track | str
    try:
        found = ts.track(changes[variation](images).astype(np.float32), log=False, **options)
    except ValueError as refusal:
        found = str(refusal)
    out.write_bytes(pickle.dumps(found))


def measured(recording: str, variation: Variation) -> ts.Track | str:
    """The result of `measure` in a new process."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "track.pickle"
        command = [sys.executable, "-m", f"experiments.validation.{Path(__file__).stem}", recording, variation.name]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", **dict(variation.environment)}
        subprocess.run([*command, str(out)], check=True, env=environment)
        found: ts.Track | str = pickle.loads(out.read_bytes())
        return found


def changes(one: ts.Track | str, other: ts.Track | str) -> tuple[int, float]:
    """Number of statuses that differ between two tracks, and the largest difference of a number in its own sd.

    Positions and orientations are compared in the standard deviations of a step, of which most errors are less.
    """
    if isinstance(one, str) or isinstance(other, str):
        return (0, 0.0) if one == other else (-1, np.inf)
    sd = np.sqrt(np.diagonal(one.covariance, axis1=1, axis2=2))
    if (np.isfinite(one.increment) != np.isfinite(other.increment)).any():
        return int((one.status != other.status).sum()), np.inf
    typical = np.nanmedian(sd, axis=0, keepdims=True)
    known = np.isfinite(one.orientation).all((1, 2)) & np.isfinite(other.orientation).all((1, 2))
    turned = np.zeros((len(known), 3))
    turned[known] = (
        Rotation.from_matrix(one.orientation[known]) * Rotation.from_matrix(other.orientation[known]).inv()
    ).as_rotvec()
    in_sd = [
        (one.increment - other.increment) / sd,
        (one.position - other.position) / typical[:, :2],
        turned / np.where(np.isfinite(typical[:, 2:]), typical[:, 2:], np.inf),
        np.array([(one.circle.radius - other.circle.radius) / one.circle.sd_radius]),
        # A standard deviation that differs by a tenth of itself.
        np.log(np.sqrt(np.diagonal(other.covariance, axis1=1, axis2=2)) / sd),
    ]
    return int((one.status != other.status).sum()), max(float(np.abs(np.nan_to_num(part)).max()) for part in in_sd)


def compute(recordings: Sequence[str]) -> list[tuple[str, ...]]:
    """Rows of the table: a recording and its largest change under each variation."""
    rows = []
    for name in recordings:
        base = measured(name, AS_IT_IS)
        cells = []
        for variation in VARIATIONS:
            statuses, most = changes(base, measured(name, variation))
            cells.append(f"{most:.3f}" + (f", {statuses} statuses" if statuses else ""))
            print(f"{name}, {variation.name}: {cells[-1]}", file=sys.stderr, flush=True)
        rows.append((name, *cells))
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure all, or one recording under one variation into a file."""
    parser = argparse.ArgumentParser(prog=f"python -m experiments.validation.{Path(__file__).stem}")
    parser.add_argument("one", nargs="*", help="RECORDING VARIATION FILE: measure this one into the file")
    parser.add_argument("--recording", choices=RECORDINGS, action="append", help="only this one; may be given again")
    options = parser.parse_args(arguments)
    if options.one:
        recording, variation, out = options.one
        measure(recording, variation, Path(out))
        return
    present = [name for name in RECORDINGS if DATA.exists() or ("mp4" not in name and "cihx" not in name)]
    rows = table(("recording", *(v.name for v in VARIATIONS)), compute(options.recording or present))
    if options.recording:
        print(rows)
    else:
        publish("continuity", "validation.continuity", rows)


if __name__ == "__main__":
    main()
