"""Reader of glTF 2 files, ``.glb`` and ``.gltf``: the JSON description, its arrays, and its triangles.

Source: Khronos Group, *glTF 2.0 Specification*. Materials, lights and cameras are read by `dmis.formats.gltf`.
"""

from __future__ import annotations

import base64
import json
import math
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from dmis.base.named_files import named_file
from dmis.base.vectors import Floats
from dmis.geometry.mesh import Mesh, repair_normals
from dmis.geometry.transforms import rotate

MAX_FACES = 2**25
"""Most triangles of a mesh file, all instances counted."""
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_NEEDED = "KHR_draco_mesh_compression", "EXT_meshopt_compression", "EXT_mesh_gpu_instancing"
"""Extensions without which the triangles of a file that requires them cannot be read."""
_TRIANGLES = 4
"""Mode of a list of triangles."""


@dataclass(eq=False)
class Gltf:
    """A glTF file.

    Attributes
    ----------
    path, outside
        The file, and whether it may name files outside of its folder.
    data
        Its bytes.
    unread
        Numbers of things that are left out, by kind.
    """

    path: Path
    data: bytes
    outside: bool = False
    unread: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        text, self._binary = self.data, b""
        if self.path.suffix.lower() == ".glb":
            magic, length, size = struct.unpack("<8sII", self.data[:16].ljust(16, b"\0"))
            end = 20 + size
            if magic != b"glTF\2\0\0\0":
                raise ValueError("it must be binary glTF of version 2; convert it")
            if len(self.data) < max(length, end):
                raise ValueError(f"it is cut off: it must have {max(length, end)} bytes; it has {len(self.data)}")
            text, self._binary = self.data[20:end], self.data[end + 8 :]
        self.json: dict[str, Any] = json.loads(text)
        if missing := set(_NEEDED) & set(self.json.get("extensionsRequired", [])):
            name = missing.pop()
            raise ValueError(f"its triangles are compressed ({name}), which is not read; export it uncompressed")

    @cached_property
    def _buffers(self) -> list[bytes]:
        """The buffers; the first of a binary file is what follows its description."""
        listed = enumerate(self.json.get("buffers", []))
        return [self._binary if k == 0 and "uri" not in about else self.resource(about["uri"]) for k, about in listed]

    def resource(self, uri: str) -> bytes:
        """Return the bytes of a data URI or of a file beside this one."""
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2], validate=True)
        path = self.file(uri)
        if path is None:
            raise ValueError(f"there is no file {unquote(uri)[-60:]!r} in its folder")
        return path.read_bytes()

    def file(self, uri: str) -> Path | None:
        """Return the path of a file beside this one; None if there is none."""
        return named_file(self.path.parent, unquote(uri), None if self.outside else self.path.parent)

    def view(self, number: int) -> tuple[bytes, int]:
        """Return the bytes of a buffer view, and their stride in bytes; 0: elements follow each other."""
        view = self._item("bufferViews", number)
        begin, length = view.get("byteOffset", 0), view["byteLength"]
        data = self._buffers[view["buffer"]]
        if not 0 <= begin <= begin + length <= len(data):
            raise ValueError(f"its buffer view {number} must be within the {len(data)} bytes of its buffer")
        return data[begin : begin + length], view.get("byteStride", 0)

    def array(self, number: int) -> Any:
        """Return the elements of an accessor, ``(N, C)``: integers, or float64 where they are fractions."""
        accessor = self._item("accessors", number)
        if "sparse" in accessor or "bufferView" not in accessor:
            raise ValueError(f"its accessor {number} is sparse or has no data, which is not read; export it without")
        count, kind = accessor["count"], np.dtype(_TYPES[accessor["componentType"]])
        columns, (data, stride) = _COLUMNS[accessor["type"]], self.view(accessor["bufferView"])
        size, begin = kind.itemsize * columns, accessor.get("byteOffset", 0)
        stride = stride or size
        fits = 0 < count <= len(data) and begin >= 0 and size <= stride
        if not (fits and begin + stride * (count - 1) + size <= len(data)):
            raise ValueError(
                f"its accessor {number} must not have more elements than its {len(data)} bytes; got {count}"
            )
        table = np.ndarray((count, columns), kind, data, begin, (stride, kind.itemsize))
        if accessor.get("normalized", False) and kind.kind in "iu":
            return np.maximum(table / np.iinfo(kind).max, -1.0)
        return table.astype(np.float64) if kind.kind == "f" else table.astype(np.int64)

    def _item(self, kind: str, number: Any) -> dict[str, Any]:
        """Return an entry of a list of the description."""
        items = self.json.get(kind, [])
        if not (isinstance(number, int) and 0 <= number < len(items)):
            raise ValueError(f"it names number {number} of its {kind}, of which it has {len(items)}")
        return dict(items[number])

    @cached_property
    def nodes(self) -> list[tuple[dict[str, Any], Floats]]:
        """The nodes of the scene that is shown, each with its matrix to the world, ``(4, 4)``."""
        nodes = self.json.get("nodes", [])
        scenes = self.json.get("scenes", [])
        children = {child for node in nodes for child in node.get("children", [])}
        roots = self._item("scenes", self.json.get("scene", 0)).get("nodes", []) if scenes else None
        stack = [(k, np.eye(4)) for k in (sorted(set(range(len(nodes))) - children) if roots is None else roots)[::-1]]
        self.unread["other scene"] += max(len(scenes) - 1, 0)
        placed, seen = [], set()
        while stack:
            number, parent = stack.pop()
            if number in seen:
                raise ValueError(f"its node {number} has several parents; a glTF scene is a tree")
            seen.add(number)
            node = self._item("nodes", number)
            matrix = parent @ _local(node)
            placed.append((node, matrix))
            stack += [(child, matrix) for child in node.get("children", [])[::-1]]
        return placed

    def primitives(self) -> Iterator[tuple[Mesh, Floats | None, int | None]]:
        """Yield the lists of triangles of the scene; other primitives, skins and morph targets are counted as left out.

        Each has its mesh in world space, whose texture coordinates are those of the first set, v from the bottom to the
        top; colours of the vertices, ``(V, 3)`` or ``(V, 4)``, linear, and the number of its material, or None.

        Raises a ValueError if there are more than `MAX_FACES`, or thrice as many vertices, before any is yielded.
        """
        total, listed = 0, []
        for node, matrix in self.nodes:
            if "mesh" not in node:
                continue
            self.unread["skin (shown as it is modelled)"] += "skin" in node
            for primitive in self._item("meshes", node["mesh"])["primitives"]:
                self.unread["morph target"] += len(primitive.get("targets", []))
                if primitive.get("mode", _TRIANGLES) != _TRIANGLES:
                    self.unread["set of points, lines, strips or fans"] += 1
                    continue
                position = self._item("accessors", primitive["attributes"]["POSITION"])
                corners = self._item("accessors", primitive["indices"]) if "indices" in primitive else position
                total += max(corners["count"], position["count"]) // 3
                listed += [(primitive, matrix)] if corners["count"] > 2 else []
        if total > MAX_FACES:
            most = f"{MAX_FACES} triangles, and {3 * MAX_FACES} vertices"
            raise ValueError(f"it must have at most {most}, because instances are copied")
        for primitive, matrix in listed:
            yield *self._placed(primitive, matrix), primitive.get("material")

    def _placed(self, primitive: dict[str, Any], matrix: Floats) -> tuple[Mesh, Floats | None]:
        """Return the triangles of a primitive moved by `matrix`, and the colours of their vertices."""
        attributes = primitive["attributes"]
        vertices = np.asarray(self.array(attributes["POSITION"]), np.float64)
        index = self.array(primitive["indices"])[:, 0] if "indices" in primitive else np.arange(len(vertices))
        faces = index[: len(index) // 3 * 3].reshape(-1, 3)
        linear = matrix[:3, :3]
        mirrored = np.linalg.det(linear) < 0
        world = vertices @ linear.T + matrix[:3, 3]
        normals = uv = None
        if "NORMAL" in attributes and np.linalg.cond(linear) < 1e12:  # else it is flat, and so are its normals
            given = np.asarray(self.array(attributes["NORMAL"]), np.float64)
            normals = repair_normals(vertices, faces, given) @ np.linalg.inv(linear)
        if "TEXCOORD_0" in attributes:
            uv = np.asarray(self.array(attributes["TEXCOORD_0"]), np.float64) * (1, -1) + (0, 1)
        colours = np.asarray(self.array(attributes["COLOR_0"]), np.float64) if "COLOR_0" in attributes else None
        return Mesh(world, faces[:, ::-1] if mirrored else faces, normals, uv), colours


def _local(node: dict[str, Any]) -> Floats:
    """Return the matrix of a node, or that of its translation, rotation and scale, ``(4, 4)``."""
    if "matrix" in node:
        matrix = np.array(node["matrix"], np.float64).reshape(4, 4).T
    else:
        *axis, w = np.array(node.get("rotation", (0, 0, 0, 1)), np.float64)
        # |axis| = sin(angle / 2),  w = cos(angle / 2)
        half = math.atan2(np.linalg.norm(axis), w)
        matrix = rotate(math.degrees(2 * half), axis) if any(axis) else np.eye(4)
        matrix[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), np.float64)
        matrix[:3, 3] = node.get("translation", (0, 0, 0))
    if not np.isfinite(matrix).all() or not np.array_equal(matrix[3], (0, 0, 0, 1)):
        raise ValueError(f"the matrix of a node must be finite and affine; got {matrix.tolist()}")
    return matrix
