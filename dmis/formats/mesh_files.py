"""Meshes from files, without their materials, and meshes of objects of trimesh."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dmis.geometry.mesh import Mesh, concatenate, repair_normals, vertex_normals, weld

if TYPE_CHECKING:
    import trimesh

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


def placed_geometries(source: trimesh.Trimesh | trimesh.Scene) -> list[tuple[str, trimesh.Trimesh]]:
    """Return the triangle meshes of a trimesh object with their names, one for each place where a scene has one.

    Raises a ValueError if it is no such object, or there are no triangles, or more than `MAX_FACES`.
    """
    import trimesh

    from dmis.formats.model import MAX_FACES

    if isinstance(source, trimesh.Trimesh):
        return [("", source)]
    if not isinstance(source, trimesh.Scene):
        raise ValueError(f"source must be a path, a name, a Mesh, or triangles of trimesh; got {type(source).__name__}")
    places = [source.graph[node] for node in source.graph.nodes_geometry]
    places = [(matrix, name) for matrix, name in places if isinstance(source.geometry[name], trimesh.Trimesh)]
    if not places:
        raise ValueError("mesh must hold triangles, because only they can be hit; got a scene without any")
    if sum(len(source.geometry[name].faces) for _, name in places) > MAX_FACES:
        raise ValueError(f"mesh must have at most {MAX_FACES} triangles, because instances are copied")
    # those that are mirrored keep their outside
    return [(str(name), source.geometry[name].copy(include_cache=True).apply_transform(at)) for at, name in places]


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
            from dmis.formats.obj.obj_file import read_obj

            mesh = concatenate(list(read_obj(data)[0].values()))
        elif suffix in (".glb", ".gltf"):
            from dmis.formats.gltf.gltf_file import Gltf
            from dmis.formats.model import Model

            mesh = concatenate([mesh for mesh, *_ in Gltf(Model(path, bare=True), data).primitives()])
        elif suffix == ".ply":
            from dmis.formats.ply import read_ply

            mesh = read_ply(data)
        else:
            import logging

            import trimesh  # takes 50 MB and half a second

            logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else it prints tracebacks of damaged files
            # process=True would merge and reorder vertices
            mesh = from_trimesh(trimesh.load_mesh(io.BytesIO(data), file_type="stl", process=False))
    if smooth is None or smooth == (mesh.normals is not None):
        return mesh
    normals = None
    if smooth:
        same = weld(mesh.vertices)
        normals = vertex_normals(mesh.vertices, same[mesh.faces])[same]
    return Mesh(mesh.vertices, mesh.faces, normals, mesh.uv)


@contextmanager
def reading(path: Path, suffix: str = "") -> Iterator[bytes]:
    """Give the bytes of a mesh file to a block, whose errors become a ValueError that names the file.

    `suffix` is that of the format, by default the file's own.
    """
    suffix = suffix or path.suffix.lower()
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
