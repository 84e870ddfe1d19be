"""Reader of PLY files, text or binary: positions, normals, texture coordinates and polygons.

Text is read as a binary file whose numbers are all float64. Source: G. Turk, *The PLY Polygon File Format*, 1994.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from dmis.geometry.mesh import Ints, Mesh, repair_normals
from dmis.geometry.polygons import triangulate

_NAMES = "char uchar short ushort int uint float double int8 uint8 int16 uint16 int32 uint32 float32 float64".split()
_KINDS = dict(zip(_NAMES, 2 * "i1 u1 i2 u2 i4 u4 f4 f8".split(), strict=True))
"""Types of numbers by their names in a header."""
_UV = ("u", "v"), ("s", "t"), ("texture_u", "texture_v"), ("texture_s", "texture_t")
"""Names of the texture coordinates of vertices."""
Columns = dict[str, tuple[Any, Ints]]
"""Properties of an element by name: the values of all rows, one after the other, and their number in each row."""


def read_ply(data: bytes) -> Mesh:
    """Return the mesh of the bytes of a PLY file.

    Texture coordinates are those of vertices, or of the corners of faces (``texcoord``); then each corner of a triangle
    is a vertex. Polygons are cut as those of OBJ files are, faces of two corners left out. Normals of length 0 are
    replaced, see `repair_normals`. Colours and other elements are not read.

    A ValueError if the file has no faces, is cut off, or names a vertex that it does not have.
    """
    elements = _elements(data)
    vertex, face = elements.get("vertex", {}), elements.get("face", {})
    positions, normals, *uvs = (
        np.stack([vertex[name][0] for name in names], axis=1).astype(np.float64) if set(names) <= set(vertex) else None
        for names in (("x", "y", "z"), ("nx", "ny", "nz"), *_UV)
    )
    index, sides = face.get("vertex_indices") or face.get("vertex_index") or (np.zeros(0), np.zeros(0, int))
    kept = np.repeat(sides > 2, sides)  # other faces have no area
    if positions is None or not kept.any():
        raise ValueError(f"it must have vertices and faces; it has the elements {', '.join(elements)}")
    corner = index.astype(np.int64)
    if (wrong := (corner != index) | (corner < 0) | (corner >= len(positions))).any():
        what = f"whole numbers below {len(positions)}, indices of vertices; got {index[wrong][0]:g}"
        raise ValueError(f"the lists of a PLY file must hold {what}")
    triangles = triangulate(sides[sides > 2], positions[corner[kept]])
    faces = corner[kept][triangles]
    if normals is not None:
        normals = repair_normals(positions, faces, normals) if normals.any() else None
    uv = next((uv for uv in uvs if uv is not None), None)
    of_corners, lengths = face.get("texcoord", (index, 0))
    if np.all(lengths == 2 * sides):
        uv = of_corners.reshape(-1, 2)[kept][triangles.ravel()]
        positions, normals = positions[faces.ravel()], None if normals is None else normals[faces.ravel()]
        faces = np.arange(faces.size).reshape(-1, 3)
    return Mesh(positions, faces, normals, uv)


def _elements(data: bytes) -> dict[str, Columns]:
    """Return the elements of a PLY file by name.

    The header has lines ``element NAME ROWS``, each with lines ``property KIND NAME``, or ``property list KIND KIND
    NAME`` with the types of the length and the entries. The rows of all elements follow it, one after the other.
    """
    header, *rest = re.split(rb"\nend_header[ \t]*\r?\n", data, maxsplit=1)
    lines = [line.split() for line in header.decode("latin-1").split("\n")]
    form = next(line[1] for line in lines if line[:1] == ["format"])
    order = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}[form]
    body = b"".join(rest)
    if form == "ascii":
        body = np.fromiter(map(float, body.split()), np.float64).tobytes()
    listed: list[tuple[str, int, dict[str, list[Any]]]] = []
    for word, *words in filter(None, lines):
        if word == "element":
            listed.append((words[0], int(words[1]), {}))
        elif word == "property":
            kinds = words[words[0] == "list" : -1]
            listed[-1][2][words[-1]] = [order + ("f8" if form == "ascii" else _KINDS[kind]) for kind in kinds]
    place = 0
    elements: dict[str, Columns] = {}
    for name, count, fields in listed:
        elements[name], place = _columns(body, place, count, fields)
    return elements


def _columns(body: bytes, place: int, count: int, fields: dict[str, list[Any]]) -> tuple[Columns, int]:
    """Return the properties of the `count` rows of an element that begin at `place`, and the place behind them.

    `fields` are the types of each property, of a list two. Rows are read in runs whose lists are as long as those of
    the first row of the run, so that a file of triangles alone is read at once. The next run is looked for in twice as
    many rows as the last one had: this bounds the time where lengths alternate.
    """
    runs: list[Any] = []
    most = count
    while fields and count > 0:
        entries: list[Any] = []
        for name, (*length, kind) in fields.items():
            size = 1
            if length:
                begin = place + np.dtype(entries).itemsize
                size = int(np.frombuffer(body[begin : begin + 8].ljust(8, b"\0"), length[0], 1)[0])
                entries.append((f"#{name}", *length))
            entries.append((name, kind, (size,)))
        row: Any = np.dtype(entries)
        most = min(most, count, (len(body) - place) // row.itemsize)
        if most < 1:
            raise ValueError("it is cut off: it must have as many rows as its header says")
        table = np.frombuffer(body, row, most, place)
        lists = [name for name in fields if f"#{name}" in row.names]
        alike = np.all([table[f"#{name}"] == table[name].shape[1] for name in lists], axis=0)
        rows = most if np.all(alike) else int(np.argmin(alike))
        if not rows:
            raise ValueError("the lists of a PLY file must have whole numbers of entries")
        runs.append(table[:rows])
        count -= rows
        place += rows * row.itemsize
        most = 2 * rows + 1
    columns = {}
    for name in fields if runs else ():
        sizes = np.repeat([run[name].shape[1] for run in runs], [len(run) for run in runs])
        columns[name] = np.concatenate([run[name].ravel() for run in runs]), sizes
    return columns, place


def unread_of_ply(path: Path) -> dict[str, int]:
    """Return the numbers of materials and textures of a PLY file, and whether it has colours."""
    with path.open("rb") as file:
        header = file.read(2**16).partition(b"end_header")[0]
    numbers = {"material": header.count(b"element material"), "texture": header.count(b"comment TextureFile")}
    return numbers | {"vertex colours": len(re.findall(rb"property \w+ (?:diffuse_)?red\s", header))}
