"""A result as a series for ParaView: the ball at its pose, and velocity, force and spin at its centre.

VTK's XML polygons (``.vtp``) with an index over time (``.pvd``), written by hand: the format needs no library. Arrays
are zlib-compressed blocks in base64, see "VTK XML Formats" in VTK's documentation.
"""

from __future__ import annotations

import base64
import shutil
import struct
import tempfile
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.scale import LAB_AXES
from torchsphere.geometry.orientation import matrices
from torchsphere.results.reader import ResultFolder

#: Parallels and meridians of the ball's mesh, the seam twice so that its texture does not run backwards there.
PARALLELS, MERIDIANS = 19, 37

TYPES = {"f": "Float32", "i": "Int32"}

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mesh:
    """The ball in its own frame: unit vectors (p, 3), texture coordinates (p, 2) from 0 to 1, triangles (m, 3)."""

    points: Array
    texture: Array
    triangles: NDArray[np.int32]


def write_paraview(result: ResultFolder) -> Path:
    """Write ``paraview/ball.pvd`` with its ``.vtp`` files into the result folder, and return its path.

    In m and s where scale and frame rate are known, in the frame of the results; otherwise in px, camera frame, and
    frames. The ball (part 0) has texture coordinates and the displacement of its points since the first frame with a
    pose; it is left out where no rotation was measured. Its centre (part 1) has velocity, force and spin as far as
    they are known, and is left out where the ball was not seen. An earlier series is replaced as a whole.

    Raises
    ------
    ValueError
        If the ball was seen in no frame.
    """
    if not result.known.any():
        raise ValueError(f"{result.path}: the ball was seen in no frame, so there is nothing to show in ParaView")
    new = Path(tempfile.mkdtemp(prefix=".paraview.", dir=result.path))
    try:
        _write(result, new)
        new.chmod(0o755)
        shutil.rmtree(result.path / "paraview", ignore_errors=True)
        new.replace(result.path / "paraview")
    finally:
        shutil.rmtree(new, ignore_errors=True)
    return result.path / "paraview" / "ball.pvd"


def _write(result: ResultFolder, folder: Path) -> None:
    mesh, centres, turned = sphere_mesh(), _centres(result), _orientations(result)
    radius = result.radius if result.motion is None else result.radius * float(result.summary["scale"]["m_per_px"])
    times = result.time_s if np.isfinite(result.time_s).all() else result.frame.astype(np.float64)
    first: Array | None = None
    entries = []
    for i in np.flatnonzero(np.isfinite(centres[:, 0])):
        number = f"{result.frame[i]:06d}"
        if np.isfinite(turned[i]).all() and np.isfinite(radius[i]):
            points = centres[i] + radius[i] * mesh.points @ turned[i].T
            first = points if first is None else first
            data = {"displacement": points - first}
            (folder / f"ball_{number}.vtp").write_text(polygons(points, mesh.triangles, data, mesh.texture))
            entries.append((times[i], 0, f"ball_{number}.vtp"))
        vertex = np.zeros((1, 1), dtype=np.int32)
        (folder / f"centre_{number}.vtp").write_text(polygons(centres[i : i + 1], vertex, _vectors(result, int(i))))
        entries.append((times[i], 1, f"centre_{number}.vtp"))
    rows = "".join(f'<DataSet timestep="{t:.12g}" part="{part}" file="{file}"/>\n' for t, part, file in entries)
    (folder / "ball.pvd").write_text(
        f'<?xml version="1.0"?>\n<VTKFile type="Collection" version="1.0" byte_order="LittleEndian">\n'
        f"<Collection>\n{rows}</Collection>\n</VTKFile>\n"
    )


def sphere_mesh() -> Mesh:
    """A unit sphere with its poles on the body's y axis."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, PARALLELS), np.linspace(0, 2 * np.pi, MERIDIANS), indexing="ij")
    points = np.stack((np.sin(polar) * np.sin(around), -np.cos(polar), -np.sin(polar) * np.cos(around)), -1)
    texture = np.stack((around / (2 * np.pi), 1 - polar / np.pi), -1)
    corner = np.arange(PARALLELS * MERIDIANS, dtype=np.int32).reshape(PARALLELS, MERIDIANS)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    # Corners counter-clockwise as seen from outside.
    both = np.stack((np.stack((a, c, b), -1), np.stack((a, d, c), -1)), 2)
    return Mesh(points.reshape(-1, 3), texture.reshape(-1, 2), both.reshape(-1, 3))


def polygons(points: Array, cells: NDArray[np.int32], vectors: dict[str, Array], texture: Array | None = None) -> str:
    """VTK's XML of ``points`` (p, 3) with ``cells`` (m, k), single vertices for k = 1, and ``vectors`` (p, 3) there."""
    kind = "Verts" if cells.shape[1] == 1 else "Polys"
    ends = np.arange(1, len(cells) + 1, dtype=np.int32) * cells.shape[1]
    arrays = "".join(_array(name, value) for name, value in vectors.items())
    named = ' Vectors="displacement"' if "displacement" in vectors else ""
    if texture is not None:
        arrays += _array("texture", texture)
        named += ' TCoords="texture"'
    return (
        '<?xml version="1.0"?>\n<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt32" compressor="vtkZLibDataCompressor">\n<PolyData>\n'
        f'<Piece NumberOfPoints="{len(points)}" NumberOf{kind}="{len(cells)}">\n'
        f"<Points>\n{_array('points', points)}</Points>\n<PointData{named}>\n{arrays}</PointData>\n"
        f"<{kind}>\n{_array('connectivity', cells.ravel())}{_array('offsets', ends)}</{kind}>\n"
        "</Piece>\n</PolyData>\n</VTKFile>\n"
    )


def _array(name: str, values: NDArray[np.float64] | NDArray[np.int32]) -> str:
    """One array as a compressed block: its header (blocks, block size, size of the last, compressed size), then it."""
    width = values.shape[1] if values.ndim == 2 else 1
    raw = values.astype("<i4" if values.dtype.kind == "i" else "<f4").tobytes()
    packed = zlib.compress(raw)
    header = struct.pack("<4I", 1, len(raw), 0, len(packed))
    text = (base64.b64encode(header) + base64.b64encode(packed)).decode()
    kind = TYPES[values.dtype.kind]
    return (
        f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{width}" format="binary">\n{text}\n</DataArray>\n'
    )


def _centres(result: ResultFolder) -> Array:
    """Centres (n, 3), m or px, in the plane of the ball's centre; NaN where it was not seen."""
    plane = result.position if result.motion is None else result.motion.position_m
    plane = np.where(result.known[:, None], plane, np.nan)
    return np.concatenate((plane, np.zeros((len(plane), 1))), 1)


def _orientations(result: ResultFolder) -> Array:
    """Orientations (n, 3, 3) in the frame of the results."""
    turned = matrices(result.quaternion)
    if result.motion is None or not result.lab_frame:
        return turned
    axes = np.asarray(LAB_AXES)
    return axes @ turned @ axes


def _vectors(result: ResultFolder, i: int) -> dict[str, Array]:
    """Velocity and force (1, 3) in the image plane, and spin, of one frame, where they are known."""
    motion = result.motion
    if motion is None:
        return {}
    in_plane = {"velocity_m_s": motion.velocity_m_s, "force_N": motion.force_N}
    vectors = {name: np.append(v[i], 0.0)[None] for name, v in in_plane.items() if v is not None}
    vectors["spin_rad_s"] = motion.spin_rad_s[i][None]
    return {name: v for name, v in vectors.items() if np.isfinite(v).all()}
