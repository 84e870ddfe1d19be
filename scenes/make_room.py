"""Make a room as GLB, as OBJ with MTL, and by hand as a scene of dmis: three descriptions of one image.

What: a floor of planks, coloured walls, a lamp on the ceiling, a chequered ball, a pot with a leaf that is cut out of
an image, and a camera; y is up. In matte materials the three agree; with `metals` the ball is brass and the pot glossy,
which only the GLB file can say.

Why: textures, lamps, masks, cameras, instances and mirrored nodes are read from files of other programs, and a scene
that was made without any reader tells whether they are read right.

Run: python scenes/make_room.py FOLDER      (writes room.glb, room-metals.glb, room.obj, room.mtl and their pictures)
"""

from __future__ import annotations

import io
import json
import struct
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import dmis
from dmis.base.vectors import Array, Floats
from dmis.geometry import shapes, transforms
from dmis.geometry.mesh import Mesh

SIZE = (320, 240)
EYE, TARGET, FOV = (0.25, 1.35, 3.7), (0.05, 0.95, 0.0), 42.0
LAMP = (14.0, 12.0, 9.0)


@dataclass(frozen=True, eq=False)
class Thing:
    """A mesh with what its material says: sRGB bytes of an image ``(H, W, 3 or 4)``, row 0 on top, or a colour."""

    name: str
    mesh: Mesh
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    image: Array | None = None
    emission: tuple[float, float, float] | None = None
    metallic: float = 0.0
    roughness: float | None = None  # None: matte


def quad(corner: Any, u: Any, v: Any) -> Mesh:
    """A parallelogram with texture coordinates from its corner on."""
    a, u, v = (np.array(x, float) for x in (corner, u, v))
    uv = [[0, 0], [1, 0], [1, 1], [0, 1]]
    return Mesh(np.array([a, a + u, a + u + v, a + v]), np.array([[0, 1, 2], [0, 2, 3]]), None, np.array(uv, float))


def ball(centre: Any, radius: float, rings: int = 48) -> Mesh:
    """A sphere with normals and texture coordinates, y up."""
    v, u = (a.ravel() for a in np.mgrid[: rings + 1, : 2 * rings + 1] / [[[rings]], [[2 * rings]]])
    theta, phi = np.pi * v, 2 * np.pi * u
    normals = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], axis=1)
    i, j = (a.ravel() for a in np.mgrid[:rings, : 2 * rings])
    k, row = i * (2 * rings + 1) + j, 2 * rings + 1
    upper, lower = (
        np.stack([k, k + row, k + 1], axis=1)[i > 0],
        np.stack([k + 1, k + row, k + row + 1], axis=1)[i < rings - 1],
    )
    faces = np.concatenate([upper, lower])
    return Mesh(np.array(centre) + radius * normals, faces, normals, np.stack([2 * u, 1 - v], axis=1))


def planks() -> Array:
    """Boards of wood, sRGB bytes ``(256, 256, 3)``."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:256, :256] / 256
    board = np.floor(8 * x)
    shade = rng.uniform(0.75, 1.1, 8)[board.astype(int)]
    grain = 0.06 * np.sin(40 * x + 3 * np.sin(5 * y + 7 * board) + 9 * board) + 0.05 * np.sin(
        160 * x + 4 * np.sin(9 * y)
    )
    groove = np.where(np.minimum(8 * x % 1, 1 - 8 * x % 1) < 0.03, 0.45, 1)
    return np.clip((shade + grain)[..., None] * groove[..., None] * (176, 128, 84), 0, 255).astype(np.uint8)


def checks() -> Array:
    """A chessboard of two colours, sRGB bytes ``(64, 64, 3)``."""
    even = np.add(*np.mgrid[:64, :64] // 8) % 2 == 0
    return np.where(even[..., None], (205, 214, 222), (58, 96, 120)).astype(np.uint8)


def leaf() -> Array:
    """A leaf with veins, cut out by its opacity, sRGB bytes and alpha ``(128, 64, 4)``."""
    y, x = np.mgrid[:128, :64]
    t, s = (127 - y) / 127, np.abs(x - 31.5) / 32
    inside = s < np.sin(np.pi * t) ** 0.8 * (1 - 0.35 * t)
    vein = (np.abs((t * 9 - 3 * s) % 1 - 0.5) > 0.42) | (s < 0.05)
    colour = np.where(vein[..., None], (120, 170, 70), (44, 122, 48))
    return np.concatenate([colour, 255 * inside[..., None]], axis=2).astype(np.uint8)


def things(metals: bool = False, leaves: bool = True) -> list[Thing]:
    """The contents of the room."""
    brass: dict[str, Any] = {"colour": (0.91, 0.72, 0.38), "metallic": 1.0, "roughness": 0.42}
    pot = shapes.cylindrical(0.3, 0.0, 0.5).mesh().transformed(transforms.rotate(-90, (1, 0, 0)))
    top = shapes.circular(0.5, 0.3).mesh().transformed(transforms.rotate(-90, (1, 0, 0)))
    move = transforms.translate((0.75, 0, -0.2))
    contents = [
        Thing("floor", quad((-2, 0, 2), (4, 0, 0), (0, 0, -4)), image=planks(), roughness=0.45 if metals else None),
        Thing("back", quad((-2, 0, -2), (4, 0, 0), (0, 2.6, 0)), (0.72, 0.7, 0.66)),
        Thing("left", quad((-2, 0, 2), (0, 0, -4), (0, 2.6, 0)), (0.66, 0.3, 0.22)),
        Thing("right", quad((2, 0, -2), (0, 0, 4), (0, 2.6, 0)), (0.24, 0.42, 0.52)),
        Thing("ceiling", quad((-2, 2.6, -2), (4, 0, 0), (0, 0, 4)), (0.8, 0.8, 0.78)),
        Thing("lamp", quad((-0.5, 2.55, -0.9), (1, 0, 0), (0, 0, 0.8)), (0, 0, 0), emission=LAMP),
        Thing("ball", ball((-0.7, 0.55, -0.3), 0.55), **(brass if metals else {"image": checks()})),
        Thing("pot", pot.transformed(move), (0.7, 0.32, 0.2), roughness=0.35 if metals else None),
        Thing("earth", top.transformed(move), (0.1, 0.07, 0.05)),
    ]
    for turn in (20, 150, 265) if leaves else ():
        stem = (
            move
            @ transforms.rotate(turn, (0, 1, 0))
            @ transforms.translate((0, 0.5, 0))
            @ transforms.rotate(25, (1, 0, 0))
        )
        blade = quad((-0.2, 0, 0), (0.4, 0, 0), (0, 0.9, 0)).transformed(stem)
        contents.append(Thing(f"leaf {turn}", blade, image=leaf()))
    return contents


def by_hand(contents: list[Thing], cutoff: float | None = 0.5) -> dmis.Scene:
    """The room as a scene of dmis, without any file: matte things only. `cutoff` is that of the leaves."""
    parts = []
    for thing in contents:
        kd: Any = thing.colour
        if thing.image is not None:
            s = thing.image[::-1, :, :3] / 255.0
            kd = dmis.Image(np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4))
        light = dmis.MeshLight(thing.mesh.vertices, thing.mesh.faces, thing.emission) if thing.emission else None
        is_cut = thing.image is not None and thing.image.shape[2] == 4
        mask = dmis.Mask(dmis.Image(thing.image[::-1, :, 3:] / 255.0), cutoff) if is_cut else None
        parts.append(dmis.Part(thing.mesh, dmis.matte(kd), light, mask=mask))
    camera = dmis.Camera.look_at(EYE, TARGET, (0, 1, 0), FOV, SIZE)
    return dmis.Scene(camera, tuple(parts), tuple(p.light for p in parts if p.light), "room")


def png(pixels: Array) -> bytes:
    """The bytes of a PNG file, with opacity if there are four channels."""
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


def write_obj(path: Path, contents: list[Thing]) -> None:
    """Write an OBJ file, and beside it its MTL file and pictures."""
    lines, materials, first = [f"mtllib {path.stem}.mtl"], [], np.ones(3, int)
    for thing in contents:
        mesh = thing.mesh
        lines += [f"o {thing.name}", f"usemtl {thing.name}"]
        tables = (("v", mesh.vertices), ("vt", mesh.uv), ("vn", mesh.normals))
        lines += [
            f"{word} " + " ".join(map(repr, row)) for word, rows in tables if rows is not None for row in rows.tolist()
        ]
        for face in mesh.faces:
            corners = [[str(k + n) if rows is not None else "" for n, (_, rows) in zip(first, tables)] for k in face]
            lines.append("f " + " ".join("/".join(corner).rstrip("/") for corner in corners))
        first += [0 if rows is None else len(rows) for _, rows in tables]
        materials += [f"newmtl {thing.name}", "Kd {} {} {}".format(*thing.colour)]
        if thing.emission:
            materials.append("Ke {} {} {}".format(*thing.emission))
        if thing.image is not None:
            name = f"{path.stem}-{thing.name.split()[0]}.png"
            (path.parent / name).write_bytes(png(thing.image))
            materials += [f"map_Kd {name}", *([f"map_d {name}"] if thing.image.shape[2] == 4 else [])]
    path.write_text("\n".join([*lines, ""]))
    path.with_suffix(".mtl").write_text("\n".join([*materials, ""]))


def write_glb(path: Path, contents: list[Thing]) -> None:
    """Write a GLB file with everything in it, as exporters do."""
    file: dict[str, Any] = {key: [] for key in ("nodes", "meshes", "materials", "textures", "images", "accessors")}
    file |= {"asset": {"version": "2.0"}, "scene": 0, "bufferViews": [], "samplers": [{}]}
    file["extensionsUsed"] = ["KHR_materials_specular", "KHR_materials_emissive_strength"]
    chunks: list[bytes] = []

    def add_view(data: bytes) -> int:
        begin = sum(map(len, chunks))
        chunks.append(data + b"\0" * (-len(data) % 4))
        file["bufferViews"].append({"buffer": 0, "byteOffset": begin, "byteLength": len(data)})
        return len(file["bufferViews"]) - 1

    def add_array(table: Floats, kind: str, columns: str) -> int:
        code = {"<f4": 5126, "<u4": 5125}[kind]
        view = add_view(np.ascontiguousarray(table, kind).tobytes())
        about = {"bufferView": view, "componentType": code, "count": len(table), "type": columns}
        if columns == "VEC3":
            about |= {"min": np.min(table, axis=0).tolist(), "max": np.max(table, axis=0).tolist()}
        file["accessors"].append(about)
        return len(file["accessors"]) - 1

    for number, thing in enumerate(contents):
        mesh = thing.mesh
        attributes = {"POSITION": add_array(mesh.vertices, "<f4", "VEC3")}
        if mesh.normals is not None:
            attributes["NORMAL"] = add_array(mesh.normals, "<f4", "VEC3")
        if mesh.uv is not None:
            attributes["TEXCOORD_0"] = add_array(mesh.uv * (1, -1) + (0, 1), "<f4", "VEC2")
        indices = add_array(mesh.faces.reshape(-1, 1), "<u4", "SCALAR")
        primitive = {"attributes": attributes, "indices": indices, "material": number}
        file["meshes"].append({"name": thing.name, "primitives": [primitive]})
        file["nodes"].append({"name": thing.name, "mesh": number})
        file["materials"].append(_glb_material(thing, file, add_view))
    eye, target = np.array(EYE), np.array(TARGET)
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross((0, 1, 0), back) / np.linalg.norm(np.cross((0, 1, 0), back))
    matrix = np.eye(4)
    matrix[:3] = np.stack([right, np.cross(back, right), back, eye], axis=1)
    file["cameras"] = [
        {
            "type": "perspective",
            "perspective": {"yfov": np.radians(FOV), "aspectRatio": SIZE[0] / SIZE[1], "znear": 0.1},
        }
    ]
    file["nodes"].append({"name": "view", "camera": 0, "matrix": matrix.T.ravel().tolist()})
    file["scenes"] = [{"nodes": list(range(len(file["nodes"])))}]
    body = b"".join(chunks)
    file["buffers"] = [{"byteLength": len(body)}]
    text = json.dumps({key: value for key, value in file.items() if value != []}).encode()
    text += b" " * (-len(text) % 4)
    head = b"glTF" + struct.pack("<II", 2, 28 + len(text) + len(body))
    path.write_bytes(
        head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(body), b"BIN\0") + body
    )


def _glb_material(thing: Thing, file: dict[str, Any], add_view: Any) -> dict[str, Any]:
    """The description of a thing's material; its image goes into the file."""
    surface = {
        "baseColorFactor": [*thing.colour, 1],
        "metallicFactor": thing.metallic,
        "roughnessFactor": thing.roughness or 1,
    }
    material: dict[str, Any] = {"name": thing.name, "pbrMetallicRoughness": surface}
    if thing.roughness is None:
        material["extensions"] = {"KHR_materials_specular": {"specularFactor": 0}}
    if thing.emission:
        strength = max(thing.emission)
        material["emissiveFactor"] = [x / strength for x in thing.emission]
        material.setdefault("extensions", {})["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}
    if thing.image is not None:
        file["images"].append({"mimeType": "image/png", "bufferView": add_view(png(thing.image))})
        file["textures"].append({"source": len(file["images"]) - 1, "sampler": 0})
        surface["baseColorTexture"] = {"index": len(file["textures"]) - 1}
        if thing.image.shape[2] == 4:
            material |= {"alphaMode": "MASK", "alphaCutoff": 0.5, "doubleSided": True}
    return material


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    write_glb(folder / "room.glb", things())
    write_glb(folder / "room-metals.glb", things(metals=True))
    write_obj(folder / "room.obj", things())
    print(*sorted(folder.glob("room*")), sep="\n")
