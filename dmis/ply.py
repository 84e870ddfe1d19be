"""Binary PLY files of triangles, the form that large meshes have, in one step of NumPy.

Every other PLY file, and every one with a fault, is left to trimesh, whose import takes half a second and 50 MB.
"""

from __future__ import annotations

import re

import numpy as np

from dmis.mesh import Floats, Ints

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"},
}
_COMMENTS = rb"(?m)^(?:comment|obj_info).*\n"
_HEADER = (
    rb"ply\nformat binary_(little|big)_endian 1\.0\n"
    rb"element vertex (\d+)\n((?:property \w+ \w+\n)+)"
    rb"element face (\d+)\nproperty list (?:uchar|uint8) (?:int|uint|int32|uint32) vertex_ind(?:ex|ices)\n"
)
_END = b"end_header\n"
_POSITION, _NORMAL = ("x", "y", "z"), ("nx", "ny", "nz")
_TEXTURE = {"u", "v", "s", "t", "texture_u", "texture_v"}


def triangles(data: bytes) -> tuple[Floats, Ints, Floats | None] | None:
    """Vertices (V, 3), faces (F, 3) and normals (V, 3) of the file `data`, normals only if it has them.

    None if it is of another form: text, polygons, texture coordinates, more or fewer bytes than the header says.
    """
    start = data.find(_END, 0, 2**16) + len(_END)
    found = re.fullmatch(_HEADER, re.sub(_COMMENTS, b"", data[: max(start - len(_END), 0)]))
    if found is None:
        return None
    order = "<" if found[1] == b"little" else ">"
    fields = [(name, _TYPES.get(kind)) for _, kind, name in map(str.split, found[3].decode().splitlines())]
    names = {name for name, _ in fields}
    if len(names) < len(fields) or None in dict(fields).values() or names & _TEXTURE or not names.issuperset(_POSITION):
        return None
    vertex = np.dtype([(name, f"{order}{kind}") for name, kind in fields])
    face = np.dtype([("corners", "u1"), ("index", f"{order}i4", 3)])
    sizes = int(found[2]), int(found[4])
    if start + sizes[0] * vertex.itemsize + sizes[1] * face.itemsize != len(data):
        return None
    vertices = np.frombuffer(data, vertex, sizes[0], start)
    faces = np.frombuffer(data, face, sizes[1], start + vertices.nbytes)
    if not (faces["corners"] == 3).all():
        return None
    normals = _columns(vertices, _NORMAL) if names.issuperset(_NORMAL) else None
    return _columns(vertices, _POSITION), faces["index"].astype(np.int32), normals


def _columns(rows: np.ndarray, names: tuple[str, ...]) -> Floats:
    return np.stack([rows[name] for name in names], axis=1, dtype=np.float64)
