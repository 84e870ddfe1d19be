"""Reader of glTF 2 files, ``.glb`` and ``.gltf``: the JSON description, its arrays, and its triangles.

Source: Khronos Group, *glTF 2.0 Specification*. `dmis.formats.gltf.gltf_scene` reads lights and cameras.
"""

from __future__ import annotations

import base64
import json
import math
import struct
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from dmis.base.named_files import named_file
from dmis.base.vectors import Floats
from dmis.formats.model import MAX_FACES, Model
from dmis.geometry.mesh import Mesh, repair_normals
from dmis.geometry.transforms import rotate

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
EXTENSIONS = tuple(
    "KHR_lights_punctual KHR_materials_emissive_strength KHR_materials_ior KHR_materials_specular "
    "KHR_mesh_quantization KHR_node_visibility KHR_texture_transform".split()
)
"""Extensions that are read."""
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
"""Modes of a list, a strip and a fan of triangles; the latter two are refused."""


class Gltf:
    """Reads the JSON and the buffers of a glTF file, and counts in `model` the features that it leaves out."""

    def __init__(self, model: Model, data: bytes) -> None:
        self.model = model
        self._binary = b""
        text = data
        if data[:4] == b"glTF" or model.path.suffix.lower() == ".glb":
            magic, length, size = struct.unpack("<8sII", data[:16].ljust(16, b"\0"))
            end = 20 + size
            if magic != b"glTF\2\0\0\0":
                raise ValueError("it must be binary glTF of version 2; convert it")
            if len(data) < max(length, end):
                raise ValueError(f"it is cut off: it must have {max(length, end)} bytes; it has {len(data)}")
            text = data[20:end]
            self._binary = data[end + 8 :]
        self.json: dict[str, Any] = json.loads(text)
        version = str(self.json.get("asset", {}).get("version", "2.0"))
        if version.partition(".")[0] != "2":
            raise ValueError(f"it must be glTF of version 2; got version {version!r}; convert it")
        if missing := self.unread_extensions("extensionsRequired"):
            raise ValueError(f"it requires {', '.join(missing)}, which is not read; export it without, uncompressed")

    def unread_extensions(self, key: str) -> list[str]:
        """Return the extensions that the file lists and that would matter, ``extensionsUsed`` or those required."""
        unused = ("_materials_", "_texture_") if self.model.bare else ()
        names = set(self.json.get(key, ())) - set(EXTENSIONS)
        return sorted(name for name in names if not any(word in name for word in unused))

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
        folder = self.model.path.parent
        return named_file(folder, unquote(uri), None if self.model.outside else folder)

    def view(self, number: int) -> tuple[bytes, int]:
        """Return the bytes of a buffer view, and their stride in bytes; 0: elements follow each other."""
        view = self.item("bufferViews", number)
        begin, length = view.get("byteOffset", 0), view["byteLength"]
        data = self._buffers[view["buffer"]]
        if not 0 <= begin <= begin + length <= len(data):
            raise ValueError(f"its buffer view {number} must be within the {len(data)} bytes of its buffer")
        return data[begin : begin + length], view.get("byteStride", 0)

    def array(self, number: int) -> Any:
        """Return the elements of an accessor, ``(N, C)``: integers, or float64 where they are fractions."""
        accessor = self.item("accessors", number)
        count = accessor["count"]
        kind = np.dtype(_TYPES[accessor["componentType"]])
        columns = _COLUMNS[accessor["type"]]
        if "sparse" in accessor or "bufferView" not in accessor:
            raise ValueError(f"its accessor {number} must not be sparse or without data; export it without sparse data")
        data, stride = self.view(accessor["bufferView"])
        size = kind.itemsize * columns
        begin = accessor.get("byteOffset", 0)
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

    def item(self, kind: str, number: Any) -> dict[str, Any]:
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
        roots = self.item("scenes", self.json.get("scene", 0)).get("nodes", []) if scenes else None
        stack = [(k, np.eye(4)) for k in (sorted(set(range(len(nodes))) - children) if roots is None else roots)[::-1]]
        self.model.unread["other scene"] += max(len(scenes) - 1, 0)
        placed = []
        seen = set()
        while stack:
            number, parent = stack.pop()
            if number in seen:
                raise ValueError(f"its node {number} has several parents; a glTF scene is a tree")
            seen.add(number)
            node = self.item("nodes", number)
            if node.get("extensions", {}).get("KHR_node_visibility", {}).get("visible") is False:
                continue  # neither it nor what is below it is shown
            matrix = parent @ _local(node)
            placed.append((node, matrix))
            stack += [(child, matrix) for child in node.get("children", [])[::-1]]
        return placed

    def primitives(
        self, coordinates: Callable[[int | None], int] = lambda material: 0
    ) -> Iterator[tuple[Mesh, Floats | None, int | None]]:
        """Yield the triangles of the scene; points, lines, skins and morph targets are counted as left out.

        Each has its mesh in world space, with v of its texture coordinates from the bottom to the top; colours of the
        vertices, ``(V, 3)`` or ``(V, 4)``, linear, and the number of its material, or None. `coordinates` returns the
        set of texture coordinates for that number.

        Raises a ValueError if there are more than `MAX_FACES`, or thrice as many vertices, before any is yielded.
        """
        total = 0
        listed = []
        for node, matrix in self.nodes:
            if "mesh" not in node:
                continue
            mesh = self.item("meshes", node["mesh"])
            morphs = any(node.get("weights", mesh.get("weights", ())))
            for kind, is_so in {"skin": "skin" in node, "morphed mesh": morphs}.items():
                self.model.unread[f"{kind} (shown as it is modelled)"] += is_so
            for primitive in mesh["primitives"]:
                mode = primitive.get("mode", _TRIANGLES)
                if mode in (_STRIP, _FAN):
                    raise ValueError(f"its mesh {node['mesh']} must be a list of triangles; export no strips or fans")
                if mode != _TRIANGLES:
                    self.model.unread["set of points or lines"] += 1
                    continue
                position = self.item("accessors", primitive["attributes"]["POSITION"])
                corners = self.item("accessors", primitive["indices"]) if "indices" in primitive else position
                total += max(corners["count"], position["count"]) // 3
                listed += [(primitive, matrix)] if corners["count"] > 2 else []
        if total > MAX_FACES:
            most = f"{MAX_FACES} triangles, and {3 * MAX_FACES} vertices"
            raise ValueError(f"it must have at most {most}, because instances are copied")
        for primitive, matrix in listed:
            material = primitive.get("material")
            yield *self._placed(primitive, matrix, coordinates(material)), material

    def _placed(self, primitive: dict[str, Any], matrix: Floats, texture_set: int) -> tuple[Mesh, Floats | None]:
        """Return the triangles of a primitive moved by `matrix`, and the colours of their vertices."""
        names = "POSITION", "NORMAL", f"TEXCOORD_{texture_set}", "COLOR_0"
        numbers = (primitive["attributes"].get(name) for name in names)
        arrays: Any = (None if k is None else np.asarray(self.array(k), float) for k in numbers)
        vertices, given, uv, colours = arrays
        index = self.array(primitive["indices"])[:, 0] if "indices" in primitive else np.arange(len(vertices))
        faces = index[: len(index) // 3 * 3].reshape(-1, 3)
        linear = matrix[:3, :3]
        mirrored = np.linalg.det(linear) < 0
        world = vertices @ linear.T + matrix[:3, 3]
        normals = None
        if given is not None and np.linalg.cond(linear) < 1e12:  # else it is flat, and so are its normals
            normals = repair_normals(vertices, faces, given) @ np.linalg.inv(linear)
        if uv is not None:
            uv = uv * (1, -1) + (0, 1)
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
