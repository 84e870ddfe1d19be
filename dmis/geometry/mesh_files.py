"""Meshes from files: OBJ by `dmis.geometry.wavefront`, glTF by `dmis.geometry.gltf`, PLY and STL by trimesh."""

from __future__ import annotations

import io
import logging
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis.geometry.gltf import MAX_FACES, Gltf
from dmis.geometry.mesh import Mesh, concatenate, repair_normals, vertex_normals, weld
from dmis.geometry.wavefront import read_obj

if TYPE_CHECKING:
    import trimesh

logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else it prints tracebacks of damaged files
MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl")
"""Extensions that :func:`load_mesh` reads."""


def from_trimesh(mesh: trimesh.Trimesh) -> Mesh:
    """Convert a trimesh object to a `Mesh`; a ValueError if it has no triangles.

    Normals are kept if the object has some: from its file, or because a caller has read them, since trimesh computes
    missing normals on demand and keeps them. `load_mesh` keeps those of the file only.
    """
    if not len(getattr(mesh, "faces", ())):
        raise ValueError(f"mesh must be a trimesh.Trimesh with faces; got {mesh!r}")
    vertices = np.asarray(mesh.vertices)
    faces = np.asarray(mesh.faces)
    normals = None
    if "vertex_normals" in mesh._cache:
        normals = repair_normals(vertices, faces, np.array(mesh.vertex_normals))
    return Mesh(vertices, faces, normals, getattr(mesh.visual, "uv", None))


def placed_meshes(source: trimesh.Trimesh | trimesh.Scene) -> list[tuple[str, Mesh]]:
    """Return the geometries of a trimesh object with their names, an entry for each place where a scene has one.

    Geometries that the scene mirrors keep their outside, as glTF defines it. Raises a ValueError if it is no such
    object, or there are no triangles, or more than `MAX_FACES`.
    """
    import trimesh

    if isinstance(source, trimesh.Trimesh):
        return [("", from_trimesh(source))]
    if not isinstance(source, trimesh.Scene):
        raise ValueError(f"source must be a path, a name, a Mesh, or triangles of trimesh; got {type(source).__name__}")
    places = [source.graph[node] for node in source.graph.nodes_geometry]
    places = [(matrix, name) for matrix, name in places if isinstance(source.geometry[name], trimesh.Trimesh)]
    if not places:
        raise ValueError("mesh must hold triangles, because only they can be hit; got a scene without any")
    if sum(len(source.geometry[name].faces) for _, name in places) > MAX_FACES:
        raise ValueError(f"mesh must have at most {MAX_FACES} triangles, because instances are copied")
    meshes = []
    for matrix, name in places:
        placed = from_trimesh(source.geometry[name]).transformed(matrix)
        if np.linalg.det(matrix[:3, :3]) < 0:
            placed = Mesh(placed.vertices, placed.faces[:, ::-1], placed.normals, placed.uv)
        meshes.append((str(name), placed))
    return meshes


def load_mesh(path: str | os.PathLike[str], smooth: bool | None = None) -> Mesh:
    """Read a GLB, glTF, OBJ, PLY or STL file.

    Parameters
    ----------
    path
        The file; its extension names the format.
    smooth
        None: shading normals if the file has them. True: shading normals of the file, else means over all faces that
        meet at a *position* (in STL no two faces share a vertex). False: no shading normals.

    A FileNotFoundError if there is no such file; a ValueError that names it if the extension is unknown, or the file
    cannot be read or holds no triangles.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    with reading(path) as data:
        if suffix == ".obj":
            mesh = concatenate(list(read_obj(data)[0].values()))
        elif suffix in (".glb", ".gltf"):
            mesh = concatenate([mesh for mesh, *_ in Gltf(path, data, bare=True).primitives()])
        else:
            mesh = _load(data, suffix)
    if smooth is None or smooth == (mesh.normals is not None):
        return mesh
    normals = None
    if smooth:
        same = weld(mesh.vertices)
        normals = vertex_normals(mesh.vertices, same[mesh.faces])[same]
    return Mesh(mesh.vertices, mesh.faces, normals, mesh.uv)


@contextmanager
def reading(path: Path) -> Iterator[bytes]:
    """Give the bytes of a mesh file; errors of the block become a ValueError that names the file."""
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise ValueError(f"mesh file {path} must have one of the extensions {' '.join(MESH_SUFFIXES)}; got {suffix!r}")
    if not path.is_file():
        raise FileNotFoundError(f"mesh file {path} does not exist")
    try:
        with np.errstate(all="ignore"):  # what is not finite is refused by Mesh
            yield path.read_bytes()
    except Exception as error:  # trimesh's readers let errors of any type through
        damaged = "it is empty, damaged, or of a form that is not read; export it again"
        reason = str(error) if type(error) is ValueError else damaged
        raise ValueError(f"mesh file {path} cannot be read as {suffix[1:].upper()}: {reason}") from error


def _load(data: bytes, suffix: str) -> Mesh:
    """Return the mesh of the bytes of a PLY or STL file. The file may name others, which are not looked for."""
    if (mesh := _load_plain_ply(data)) is not None:
        return mesh
    import trimesh

    if suffix == ".ply":
        header, end, rest = data.partition(b"end_header")
        _check_ply(header.decode("latin-1"), rest)
        header = header.replace(b" texture_s", b" s").replace(b" texture_t", b" t")  # names that trimesh does not know
        data = header + end + rest
    # process=True would merge and reorder vertices; a material is an image
    loaded: Any = trimesh.load(io.BytesIO(data), file_type=suffix[1:], process=False, skip_materials=True)
    return concatenate([mesh for _, mesh in placed_meshes(loaded)])  # ASCII STL may hold several


_PLAIN_PLY = re.compile(
    rb"ply\s+format binary_little_endian 1[.]0\s+(?:comment .*\n)*"
    rb"element vertex (\d+)\s+((?:property float n?[xyz]\s+)+)"
    rb"element face (\d+)\s+property list uchar u?int vertex_ind(?:ices|ex)\s+end_header\r?\n"
)
"""Header of PLY files that `_load_plain_ply` reads."""


def _load_plain_ply(data: bytes) -> Mesh | None:
    """Return the mesh of a binary PLY file of positions, normals and triangles alone; None for other files.

    Those are left to trimesh, whose import takes 50 MB and half a second.
    """
    header = _PLAIN_PLY.match(data)
    columns = {b"xyz": 3, b"xyznxnynz": 6}.get(re.sub(rb"property float|\s", b"", header[2])) if header else None
    if header is None or columns is None:
        return None
    end = header.end() + 4 * columns * int(header[1])
    row = np.dtype([("corners", "u1"), ("face", "<i4", 3)])
    if len(data) != end + row.itemsize * int(header[3]):
        return None
    faces = np.frombuffer(data, row, offset=end)
    if not len(faces) or (faces["corners"] != 3).any():
        return None
    table = np.frombuffer(data[header.end() : end], "<f4").reshape(-1, columns).astype(np.float64)
    vertices, normals = table[:, :3], table[:, 3:]
    return Mesh(vertices, faces["face"], repair_normals(vertices, faces["face"], normals) if normals.any() else None)


def _check_ply(header: str, body: bytes) -> None:
    """Raise a ValueError for an ASCII PLY file with too few lines, or with fractions in lists, which trimesh reads."""
    if "format ascii" not in header:
        return
    lines = [line for line in body.splitlines() if line.strip()]
    end = 0
    for count, lists in re.findall(r"element \w+ (\d+)\s+(property list)?", header):
        begin, end = end, end + int(count)
        if end > len(lines):
            raise ValueError(f"it is cut off: its header needs {end} lines behind it; it has {len(lines)}")
        for row in map(bytes.split, lines[begin:end] if lists else []):
            if b"." in b" ".join(row[: 1 + int(float(row[0]))]):
                text = b" ".join(row[:9]).decode("latin-1")
                raise ValueError(f"the lists of a PLY file must hold whole numbers, indices of corners; got {text!r}")


def unread_of_ply(path: Path) -> dict[str, int]:
    """Return the numbers of materials and textures of a PLY file, and whether it has colours."""
    with path.open("rb") as file:
        header = file.read(2**16).partition(b"end_header")[0]
    numbers = {"material": header.count(b"element material"), "texture": header.count(b"comment TextureFile")}
    return numbers | {"vertex colours": len(re.findall(rb"property \w+ (?:diffuse_)?red\s", header))}
