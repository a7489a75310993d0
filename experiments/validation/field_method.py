"""A field method as a rival: muDIC's displacements, then the motion of a sphere. Needs neither torchsphere nor torch.

    python -m venv field && field/bin/pip install muDIC
    field/bin/python experiments/validation/field_method.py BENCHMARK OUT
    torchsphere benchmark score BENCHMARK OUT --name mudic

muDIC (0.2.1) correlates a mesh of square elements over the ball's front between successive frames, from a start that is
right to a pixel: the last motion of the front, or a template match. What the nodes moved by is then fitted by the exact
rotation and translation of a sphere with the radius that was given. A frame of which not half of the nodes follow the
fit is lost, and the next one is compared with the last that was not; the orientation is known up to there.

Settings, the best of those tried on the size `smoke` (mean error of the step, px and deg, over all suites): see `H`,
`ELEMENT_PX` and `BLUR_PX`. Linear elements throughout; muDIC's own stop, 40 steps at most.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import logging
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

#: Half the side of the mesh over the radius, side of an element, and blur of the images before, px.
H, ELEMENT_PX, BLUR_PX = 0.6, 10.0, 0.7
#: Margin around the mesh, px; largest distance of a node that follows the fit, px; least share of such nodes.
ROOM_PX, OUTLIER_PX, SHARE = 16, 0.5, 0.5
COLUMNS = ("frame", "x_px", "y_px", "dx_px", "dy_px", "wx_rad", "wy_rad", "wz_rad", "ms")


def field(f: Array, g: Array, half: int) -> tuple[Array, Array]:
    """Positions (m, 2) of the nodes from the middle of the crops, and their displacements (m, 2), px."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        import muDIC as mudic  # noqa: N813  (a module, whatever its letters)

        logging.disable(logging.CRITICAL)
        stack = mudic.image_stack_from_list([f, g])
        middle, count = (len(f) - 1) // 2, max(2, round(2 * half / ELEMENT_PX))
        edges = {"Xc1": middle - half, "Xc2": middle + half, "Yc1": middle - half, "Yc2": middle + half}
        mesh = mudic.Mesher(type="q4").mesh(stack, **edges, n_elx=count, n_ely=count, GUI=False)
        found = mudic.DICAnalysis(mudic.DICInput(mesh, stack, maxit=40)).run()
    x, y = np.asarray(found.xnodesT), np.asarray(found.ynodesT)
    places = np.stack((x, y), -1)
    return places[:, 0] - middle, places[:, -1] - places[:, 0]


def sphere_motion(places: Array, moved: Array, radius: float) -> tuple[Array, float]:
    """Motion (5,) that fits the nodes' displacements best, and the share of the nodes that follow the fit.

    A node at (x, y) from the ball's centre is the surface point (x, y, -s), which turns with the ball.
    """
    seen = np.hypot(*places.T) < 0.97 * radius
    front = np.column_stack((places[seen], -np.sqrt(radius**2 - np.square(places[seen]).sum(1))))

    def residual(q: Array) -> Array:
        turned = Rotation.from_rotvec(q[2:] / radius).apply(front)
        return np.asarray((turned[:, :2] - front[:, :2] + q[:2] - moved[seen]).ravel())

    if not np.isfinite(moved[seen]).all():
        return np.full(5, np.nan), 0.0
    fit = least_squares(residual, np.zeros(5), loss="soft_l1", f_scale=0.1)
    follows = np.hypot(*residual(fit.x).reshape(-1, 2).T) < OUTLIER_PX
    return fit.x / np.array([1, 1, radius, radius, radius]), float(follows.mean())


def crop(image: Array, centre: NDArray[np.intp], half: int) -> Array | None:
    """Square crop, or None if it leaves the image."""
    x, y = centre - half
    inside = x >= 0 and y >= 0 and x + 2 * half < image.shape[1] and y + 2 * half < image.shape[0]
    return image[y : y + 2 * half + 1, x : x + 2 * half + 1] if inside else None


def template_shift(f: Array, g: Array, here: Array, radius: float) -> Array | None:
    """Motion of the ball's front in whole px, by the best match of its middle anywhere in ``g``."""
    from skimage.feature import match_template

    half, centre = round(0.6 * radius), np.rint(here).astype(np.intp)
    template = crop(f, centre, half)
    if template is None or template.std() == 0:
        return None
    match = match_template(g, template, pad_input=True)
    y, x = np.unravel_index(match.argmax(), match.shape)
    return np.array([x, y]) - centre.astype(np.float64)


def pair(f: Array, g: Array, here: Array, front: Array, radius: float) -> tuple[Array, float]:
    """Motion (5,) of a ball at ``here`` whose front moves by about ``front``, and the share of nodes that follow it."""
    half = max(round(H * radius), 4)
    at, shift = np.rint(here).astype(np.intp), np.rint(front).astype(np.intp)
    crops = crop(f, at, half + ROOM_PX), crop(g, at + shift, half + ROOM_PX)
    if crops[0] is None or crops[1] is None:
        return np.full(5, np.nan), 0.0
    try:
        places, moved = field(crops[0], crops[1], half)
    # muDIC raises various errors if a matrix is singular or a point leaves the image.
    except Exception:
        return np.full(5, np.nan), 0.0
    return sphere_motion(places + (at - here), moved + shift, radius)


def track(images: NDArray[Any], circle: tuple[float, float, float]) -> Iterator[tuple[int, Array, Array]]:
    """Frame numbers from 1 on, positions (2,) and increments (5,); NaN if lost."""
    radius, here = circle[2], np.array(circle[:2])
    f = gaussian_filter(images[0].astype(np.float64), BLUR_PX)
    q, last = np.full(5, np.nan), 0
    for frame in range(1, len(images)):
        g = gaussian_filter(images[frame].astype(np.float64), BLUR_PX)
        gap, share, found = frame - last, 0.0, q
        if np.isfinite(q).all():
            front = gap * (q[:2] + radius * np.array([-q[3], q[2]]))
            found, share = pair(f, g, here, front, radius)
        if share < SHARE:
            start = template_shift(f, g, here, radius)
            if start is not None:
                found, share = pair(f, g, here, start, radius)
        if share < SHARE:
            yield frame, np.full(2, np.nan), np.full(5, np.nan)
            continue
        here, f, q, last = here + found[:2], g, found / gap, frame
        yield frame, here, found if gap == 1 else np.full(5, np.nan)


def write(path: Path, suite: dict[str, Any], images: NDArray[Any]) -> None:
    """Write the predictions of one suite in the benchmark's format."""
    began = time.perf_counter()
    found = list(track(images, tuple(suite["circle"])))
    ms = 1e3 * (time.perf_counter() - began) / len(found)
    with path.open("w", newline="", encoding="utf-8") as stream:
        stream.write(f"# suite: {suite['name']}\n# checksum: {suite['checksum']}\n")
        stream.write(f"# settings: muDIC, linear elements of {ELEMENT_PX:g} px, then the motion of a sphere\n")
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerow((0, *suite["circle"][:2], *5 * [""], ms))
        writer.writerows((frame, *place.tolist(), *step.tolist(), ms) for frame, place, step in found)


def main() -> None:
    """Track all suites of the benchmark, or those in the further arguments."""
    bench, out, *names = sys.argv[1:]
    Path(out).mkdir(parents=True, exist_ok=True)
    for suite in json.loads(Path(bench, "suites.json").read_text(encoding="utf-8"))["suites"]:
        if not names or suite["name"] in names:
            print(suite["name"], file=sys.stderr, flush=True)
            write(Path(out, f"{suite['name']}.csv"), suite, tifffile.imread(Path(bench, suite["name"], "frames.tif")))


if __name__ == "__main__":
    main()
