"""Meshes from files: OBJ by `dmis.geometry.wavefront`; GLB, PLY and STL by trimesh, after checks of their bytes."""

from __future__ import annotations

import io
import json
import os
import reprlib
import struct
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis.geometry import wavefront
from dmis.geometry.mesh import Mesh, concatenate, repair_normals, vertex_normals, weld

if TYPE_CHECKING:
    import trimesh

MESH_SUFFIXES = (".glb", ".obj", ".ply", ".stl")
"""Extensions that :func:`load_mesh` reads."""
MAX_FILE_BYTES = 2**31
"""Largest mesh file."""
MAX_FACES = 2**25
"""Most triangles of a mesh file, all instances counted."""


def from_trimesh(mesh: trimesh.Trimesh | trimesh.Scene) -> Mesh:
    """Convert a trimesh object to a `Mesh`; the geometries of a scene are placed by its graph and joined.

    Normals are kept if the object has some: from its file, or because a caller has read them, since trimesh computes
    missing normals on demand and keeps them. `load_mesh` keeps those of the file only. Geometries that the graph
    mirrors keep their outside, as glTF defines it. Raises a ValueError if there are no triangles.
    """
    import trimesh

    if isinstance(mesh, trimesh.Scene):
        return concatenate([placed for _, placed in placed_meshes(mesh)])
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise ValueError(f"mesh must be a trimesh.Trimesh with faces, or a Scene of them; got {mesh!r}")
    vertices, faces, normals = np.asarray(mesh.vertices), np.asarray(mesh.faces), None
    if "vertex_normals" in mesh._cache:
        normals = repair_normals(vertices, faces, np.array(mesh.vertex_normals))
    return Mesh(vertices, faces, normals, getattr(mesh.visual, "uv", None))


def placed_meshes(scene: trimesh.Scene) -> list[tuple[str, Mesh]]:
    """Return the geometries of a trimesh scene with their names, an entry for each place where its graph has one.

    Raises a ValueError if there are no triangles, or more than `MAX_FACES`.
    """
    import trimesh

    places = [scene.graph[node] for node in scene.graph.nodes_geometry]
    places = [(matrix, name) for matrix, name in places if isinstance(scene.geometry[name], trimesh.Trimesh)]
    if not places:
        raise ValueError("mesh must hold triangles, because only they can be hit; got a scene without any")
    if sum(len(scene.geometry[name].faces) for _, name in places) > MAX_FACES:
        raise ValueError(f"mesh must have at most {MAX_FACES} triangles, because instances are copied")
    meshes = []
    for matrix, name in places:
        placed = from_trimesh(scene.geometry[name]).transformed(matrix)
        if np.linalg.det(matrix[:3, :3]) < 0:
            placed = Mesh(placed.vertices, placed.faces[:, ::-1], placed.normals, placed.uv)
        meshes.append((str(name), placed))
    return meshes


def load_mesh(path: str | os.PathLike[str], smooth: bool | None = None) -> Mesh:
    """Read a GLB, OBJ, PLY or STL file.

    Parameters
    ----------
    path
        The file; its extension names the format.
    smooth
        None: shading normals if the file has them. True: shading normals of the file, else means over all faces that
        meet at a *position* (in STL no two faces share a vertex). False: no shading normals.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the extension is unknown, or the file cannot be read or holds no triangles. Both messages name the file.
    """
    return read_mesh(path, smooth)[0]


def read_mesh(path: str | os.PathLike[str], smooth: bool | None = None) -> tuple[Mesh, tuple[str, ...]]:
    """Read a mesh file, see `load_mesh`, and return summaries of its ignored contents: "3 materials (wood, glass)"."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise ValueError(f"mesh file {path} must have one of the extensions {' '.join(MESH_SUFFIXES)}; got {suffix!r}")
    if not path.is_file():
        raise FileNotFoundError(f"mesh file {path} does not exist")
    try:
        data = _read_bytes(path)
        if suffix == ".obj":
            obj = wavefront.read_obj(data)
            mesh, unread = obj.mesh, _summaries({"material": list(obj.materials)}, obj.coloured)
        else:
            mesh, unread = _load(data, suffix), _unread(suffix, data)
    except Exception as error:  # trimesh's readers let errors of any type through
        reason = str(error)
        if type(error) is not ValueError:
            reason = "it is damaged, or of a form that is not read: its data do not fit its header; export it again"
        if path.stat().st_size == 0:
            reason = "it is empty"
        if isinstance(error, ImportError):  # of the package with which trimesh guesses encodings
            reason = "it is neither binary nor text of the format"
        raise ValueError(f"mesh file {path} cannot be read as {suffix[1:].upper()}: {reason}") from error
    if smooth is None or smooth == (mesh.normals is not None):
        return mesh, unread
    normals = None
    if smooth:
        same = weld(mesh.vertices)
        normals = vertex_normals(mesh.vertices, same[mesh.faces])[same]
    return Mesh(mesh.vertices, mesh.faces, normals, mesh.uv), unread


def _load(data: bytes, suffix: str) -> Mesh:
    """Return the mesh of the bytes of a GLB, PLY or STL file. The file may name others, which are not looked for."""
    import trimesh

    bare: dict[str, Any] = {}
    if suffix == ".glb":
        _check_glb(data)
    if suffix == ".ply":
        header, end, rest = data.partition(b"end_header")
        _check_ply(header.decode("latin-1"), rest)
        header = header.replace(b" texture_s", b" s").replace(b" texture_t", b" t")  # names that trimesh does not know
        data, bare = header + end + rest, {"skip_materials": True}  # a material is an image
    with np.errstate(all="ignore"):  # what is not finite is refused by Mesh
        # process=True would merge and reorder vertices
        loaded: Any = trimesh.load(io.BytesIO(data), file_type=suffix[1:], process=False, **bare)
        return from_trimesh(loaded)


def _check_ply(header: str, body: bytes) -> None:
    """Raise a ValueError for a PLY file whose lists hold fractions, of which trimesh would take the whole part."""
    lines = [line.split() for line in header.splitlines()]
    rule = "the lists of a PLY file must hold whole numbers, the indices of a face's corners"
    for line in lines:
        if line[:2] == ["property", "list"] and any(word.startswith(("float", "double")) for word in line[2:4]):
            raise ValueError(f"{rule}; got {' '.join(line)!r}")
    if ["format", "ascii", "1.0"] not in lines:
        return
    rows = [row for row in body.splitlines() if row.strip()]
    for line, first in pairwise(lines):
        if line[:1] == ["element"]:
            count = int(line[2])
            for row in map(bytes.split, rows[:count] if first[:2] == ["property", "list"] else []):
                if b"." in b" ".join(row[: 1 + int(float(row[0]))]):
                    raise ValueError(f"{rule}; got the row {b' '.join(row[:9]).decode('latin-1')!r}")
            rows = rows[count:]


def _unread(suffix: str, data: bytes) -> tuple[str, ...]:
    """Return summaries of the materials, textures, lights and colours of a GLB, PLY or STL file, which are not read."""
    kinds: dict[str, list[str]] = {}  # their names, "" if they have none
    colours = False
    if suffix == ".glb":
        gltf = _glb_json(data)
        for kind in ("material", "texture"):
            kinds[kind] = [str(entry.get("name", "")) for entry in gltf.get(f"{kind}s", [])]
        kinds["light"] = [""] * len(gltf.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights", []))
        primitives = (primitive for mesh in gltf.get("meshes", []) for primitive in mesh.get("primitives", []))
        colours = any("COLOR_0" in primitive.get("attributes", {}) for primitive in primitives)
    elif suffix == ".ply":
        header = data[: data.find(b"end_header")].decode("latin-1").splitlines()
        words = [line.split() for line in header]
        kinds["texture"] = [" ".join(line[2:]) for line in words if line[:2] == ["comment", "TextureFile"]]
        kinds["material"] = [""] * sum(int(line[2]) for line in words if line[:2] == ["element", "material"])
        colours = any(line[:1] == ["property"] and line[-1] in ("red", "diffuse_red") for line in words)
    return _summaries(kinds, colours)


def _summaries(kinds: dict[str, list[str]], colours: bool) -> tuple[str, ...]:
    """Return a summary of each kind of thing with at least one name, and ``colours`` if there are some."""
    summaries = [_summary(kind, names) for kind, names in kinds.items() if names]
    return (*summaries, "colours") if colours else tuple(summaries)


def _summary(kind: str, names: list[str]) -> str:
    """Return the number of things of one kind, and the names of the first four: "3 materials (wood, glass, lamp)"."""
    few = [name if len(name) <= 40 else f"{name[:37]}..." for name in names if name][:4]
    more = ", ..." if len(names) > len(few) else ""
    examples = f" ({', '.join(few)}{more})" if few else ""
    return f"{len(names)} {kind}{'s' if len(names) > 1 else ''}{examples}"


def _read_bytes(path: Path) -> bytes:
    if path.stat().st_size > MAX_FILE_BYTES:
        raise ValueError(f"a mesh file must have at most {MAX_FILE_BYTES} bytes; it has {path.stat().st_size}")
    return path.read_bytes()


def _check_glb(data: bytes) -> None:
    """Raise a ValueError for a GLB file of another version, a compressed one, or one with too large an array.

    trimesh would fill with zeros what it cannot decode, and an array of more elements than the file has bytes.
    """
    magic, version, length = struct.unpack("<4sII", data[:12].ljust(12, b"\0"))
    if magic != b"glTF" or (len(data) >= 8 and version != 2):
        got = f"version {version} of it" if magic == b"glTF" else "another format"
        raise ValueError(f"it must be binary glTF of version 2; got {got}, convert it")
    if len(data) < max(length, 20):
        raise ValueError(f"it is cut off: it must have {max(length, 20)} bytes; it has {len(data)}")
    gltf = _glb_json(data)
    if missing := set(_COMPRESSIONS) & set(gltf.get("extensionsRequired", [])):
        raise ValueError(f"its triangles are compressed ({missing.pop()}), which is not read; export it uncompressed")
    if wrong := [a["count"] for a in gltf.get("accessors", []) if not 0 <= a["count"] <= len(data)]:
        raise ValueError(f"it must not have an array of more elements than its {len(data)} bytes; got {wrong[0]}")


_COMPRESSIONS = "KHR_draco_mesh_compression", "EXT_meshopt_compression"
"""Extensions of glTF without which the triangles of a file that requires them cannot be read."""


def _glb_json(data: bytes) -> dict[str, Any]:
    """Return the JSON description of a GLB file."""
    (length,) = struct.unpack_from("<I", data, 12)
    try:
        description = json.loads(data[20 : 20 + length])
    except ValueError as error:
        raise ValueError(f"its description is not JSON: {error}") from None
    if not isinstance(description, dict):
        raise ValueError(f"its description must be a JSON object; got {reprlib.repr(description)}")
    return description
