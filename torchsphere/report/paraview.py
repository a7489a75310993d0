"""A result as a ParaView series: the ball at its pose, and velocity, force and spin at its centre.

The files are polygons in VTK's XML format (``.vtp``), whose arrays are compressed blocks in base64, and an index over
time (``.pvd``): see "VTK XML Formats" in the documentation of VTK.
"""

from __future__ import annotations

import base64
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torchsphere.geometry.orientation import matrices
from torchsphere.results.atomic_output import atomic_folder
from torchsphere.results.reader import ResultFolder
from torchsphere.runtime.arrays import Array

#: Parallels and meridians of the ball's mesh. The last meridian repeats the first, whose texture coordinate is 0 and 1.
PARALLELS, MERIDIANS = 19, 37

#: VTK's name and the byte layout of an array, by NumPy's kind of its values.
TYPES = {"f": ("Float32", "<f4"), "i": ("Int32", "<i4")}


@dataclass(frozen=True)
class Mesh:
    """The ball in its own frame: unit vectors (p, 3), texture coordinates (p, 2) from 0 to 1, triangles (m, 3)."""

    points: Array
    texture: Array
    triangles: NDArray[np.int32]


def write_paraview(result: ResultFolder) -> Path:
    """Write ``paraview/ball.pvd`` with its ``.vtp`` files into the result folder, and return its path.

    Lengths are in m and times in s, in the frame of `ResultFolder.motion`, if scale and frame rate are known;
    otherwise in px and frames, camera frame; the motion along the axis, where it is known, is since the first frame.
    The ball (part 0) has texture coordinates and the displacement of its
    points since the first frame with a pose; frames without rotation lack this part. The centre (part 1) has velocity,
    force and spin as far as they are known; frames without the ball lack this part. The whole series replaces an
    earlier one. Raises ValueError if the ball was seen in no frame.
    """
    if not result.known.any():
        raise ValueError(f"{result.path}: the ball was seen in no frame, so there is nothing to show in ParaView")
    folder = result.path / "paraview"
    with atomic_folder(folder, overwrite=True, kind="ParaView series", files=("ball.pvd",)) as new:
        _write(result, new)
    return folder / "ball.pvd"


def _write(result: ResultFolder, folder: Path) -> None:
    mesh, centres = sphere_mesh(), _centres(result)
    orientations = matrices(result.quaternion) * np.outer(result.axis_signs, result.axis_signs)
    radius = _radii(result)
    times = result.time_s if np.isfinite(result.time_s).all() else result.frame.astype(np.float64)
    first: Array | None = None
    entries = []
    for i in np.flatnonzero(np.isfinite(centres[:, 0])):
        number = f"{result.frame[i]:06d}"
        if np.isfinite(orientations[i]).all() and np.isfinite(radius[i]):
            points = centres[i] + radius[i] * mesh.points @ orientations[i].T
            first = points if first is None else first
            data = {"displacement": points - first}
            (folder / f"ball_{number}.vtp").write_text(polygons(points, mesh.triangles, data, mesh.texture))
            entries.append((times[i], 0, f"ball_{number}.vtp"))
        vertex = np.zeros((1, 1), dtype=np.int32)
        (folder / f"centre_{number}.vtp").write_text(polygons(centres[i : i + 1], vertex, _vectors(result, int(i))))
        entries.append((times[i], 1, f"centre_{number}.vtp"))
    rows = "".join(f'<DataSet timestep="{t:.12g}" part="{part}" file="{file}"/>\n' for t, part, file in entries)
    (folder / "ball.pvd").write_text(
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="1.0" byte_order="LittleEndian">\n'
        f"<Collection>\n{rows}</Collection>\n</VTKFile>\n"
    )


def sphere_mesh() -> Mesh:
    """Unit sphere with its poles on the y axis of the ball."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, PARALLELS), np.linspace(0, 2 * np.pi, MERIDIANS), indexing="ij")
    points = np.stack((np.sin(polar) * np.sin(around), -np.cos(polar), -np.sin(polar) * np.cos(around)), -1)
    texture = np.stack((around / (2 * np.pi), 1 - polar / np.pi), -1)
    corner = np.arange(PARALLELS * MERIDIANS, dtype=np.int32).reshape(PARALLELS, MERIDIANS)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    # Corners are counter-clockwise, seen from outside.
    both = np.stack((np.stack((a, c, b), -1), np.stack((a, d, c), -1)), 2)
    return Mesh(points.reshape(-1, 3), texture.reshape(-1, 2), both.reshape(-1, 3))


def polygons(points: Array, cells: NDArray[np.int32], vectors: dict[str, Array], texture: Array | None = None) -> str:
    """VTK's XML of ``points`` (p, 3), ``cells`` (m, k), vertices if k = 1, and ``vectors`` (p, 3) at the points."""
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
    """An array as one compressed block."""
    width = values.shape[1] if values.ndim == 2 else 1
    kind, layout = TYPES[values.dtype.kind]
    raw = values.astype(layout).tobytes()
    packed = zlib.compress(raw)
    # Number of blocks, size of a block, size of a shorter last block (none), compressed size.
    header = struct.pack("<4I", 1, len(raw), 0, len(packed))
    text = (base64.b64encode(header) + base64.b64encode(packed)).decode()
    return (
        f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{width}" format="binary">\n{text}\n</DataArray>\n'
    )


def _centres(result: ResultFolder) -> Array:
    """Centres (n, 3) of the ball, m or px, with z = 0; NaN if the ball was not seen."""
    plane = result.position if result.motion is None else result.motion.position_m
    plane = np.where(result.known[:, None], plane, np.nan)
    depth = None if result.motion is None else result.motion.depth
    if depth is None:
        return np.column_stack((plane, np.zeros(len(plane))))
    return np.column_stack((plane, depth.z_m - depth.z_m[np.isfinite(depth.z_m)][0]))


def _radii(result: ResultFolder) -> Array:
    """Radius (n,) of the ball in each frame: the same in all where it moves along the optical axis, as is known."""
    if result.motion is None:
        return result.radius
    radius = result.radius * float(result.summary["scale"]["m_per_px"])
    return radius if result.motion.depth is None else np.full_like(radius, radius[np.isfinite(radius)][0])


def _vectors(result: ResultFolder, i: int) -> dict[str, Array]:
    """Velocity, force and spin (1, 3) of frame ``i``, as far as they are known."""
    motion = result.motion
    if motion is None:
        return {}
    vectors = {}
    for name in ("velocity_m_s", "force_N"):
        in_plane, along = getattr(motion, name), getattr(motion.depth, name, None)
        if in_plane is not None:
            vectors[name] = np.append(in_plane[i], 0.0 if along is None else along[i])[None]
    vectors["spin_rad_s"] = motion.spin_rad_s[i][None]
    return {name: v for name, v in vectors.items() if np.isfinite(v).all()}
