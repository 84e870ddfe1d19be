"""Models from files: their format, their materials in place of the file's, and their camera."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from dmis.brdf.materials import Material
from dmis.formats.gltf import read_gltf
from dmis.formats.model import DEFAULT_MATERIAL, Model
from dmis.formats.obj import read_obj_materials
from dmis.geometry.gltf import Gltf
from dmis.geometry.mesh_files import read_mesh, reading
from dmis.geometry.wavefront import read_obj
from dmis.scene.camera import Camera
from dmis.scene.groups import Part

Y_UP = ".glb", ".gltf", ".obj"
"""Extensions of files in which y is up, and which may have materials."""


def read_file(path: Path, outside: bool, bare: bool) -> Model:
    """Return the contents of a mesh file; `bare`: of an OBJ file without its materials."""
    model = Model(path, outside)
    if path.suffix.lower() == ".obj" and not bare:
        with reading(path) as data:
            read_obj_materials(read_obj(data), model)
    elif path.suffix.lower() in (".glb", ".gltf"):
        with reading(path) as data:
            read_gltf(Gltf(path, data, outside), model)
    else:
        mesh, unread = read_mesh(path)
        model.unread.update(unread)
        if (mesh_with_area := model.drop_flat(mesh)) is not None:
            model.add(mesh_with_area)
    if not model.parts:
        raise ValueError(
            f"{path}: mesh must have a triangle with an area, because no ray hits others; got {model.flat} without"
        )
    return model


def with_materials(model: Model, material: Any) -> list[Part]:
    """Return the parts of a file with a caller's material, one for all or by the names of the file's."""
    if material is None:
        return model.parts
    if not isinstance(material, Mapping):
        return [replace(part, material=material_of("", material)) for part in model.parts]
    names = sorted({part.material.name for part in model.parts})
    for name in material:
        if name not in names:
            raise ValueError(f"material must have names of materials in {model.path}: {names}; got {name!r}")
    return [replace(part, material=material.get(part.material.name, part.material)) for part in model.parts]


def material_of(name: str, material: Any) -> Material:
    """Return the material of the geometry `name`."""
    if material is None or isinstance(material, Material):
        return material or DEFAULT_MATERIAL
    if not isinstance(material, Mapping):
        raise ValueError(f"material must be a Material, or a dict of them by name; got {type(material).__name__}")
    if name not in material:
        names = ", ".join(map(repr, material)) or "none"
        raise ValueError(f"material must have an entry for the geometry {name!r}; given are: {names}")
    return material[name]


def camera_of(
    source: Any, model: Model, parts: Sequence[Part], camera: Any, up: str | None, fov: float | None
) -> tuple[Camera, list[str]]:
    """Return a caller's camera, or one of the file, by default its first, or one that sees all parts, and a note."""
    if isinstance(camera, Camera):
        return camera, []
    if camera is not None and camera not in model.cameras:
        names = ", ".join(map(repr, model.cameras)) or "none"
        raise ValueError(f"camera must be a Camera or the name of one in {model.path}: {names}; got {camera!r}")
    if camera is not None or (model.cameras and up is None):
        camera = model.cameras[camera] if camera is not None else next(iter(model.cameras.values()))
        return replace(camera, fov=camera.fov if fov is None else fov), []
    note = "a camera that sees all of it" if model.cameras else "a camera that sees all of it, because it has none"
    return Camera.fit([part.mesh for part in parts], up_axis(source, up), fov or 40.0), [note]


def up_axis(source: Any, up: str | None) -> tuple[float, float, float]:
    """Return the axis `up`, ``y`` or ``z``; None: that of the format of a file."""
    y_up = isinstance(source, str | os.PathLike) and Path(source).suffix.lower() in Y_UP
    return (0.0, 1.0, 0.0) if up == "y" or (up is None and y_up) else (0.0, 0.0, 1.0)
