"""Models: the contents of a file, the files that it names, its camera, and replacement of its materials."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from dmis.base.color import Rgb
from dmis.base.named_files import found_file
from dmis.base.validate import number
from dmis.brdf.materials import Material, matte
from dmis.brdf.texture import Image
from dmis.geometry.mesh import Mesh, have_area
from dmis.light.light import Light
from dmis.light.mesh_light import MeshLight
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.masks import Mask

DEFAULT_MATERIAL = matte()
MAX_FACES = 2**25
"""Most triangles of a mesh file, all instances counted."""
Y_UP = ".glb", ".gltf", ".obj"
"""Extensions of files in which y is up, and which may have materials."""


@dataclass
class Model:
    """The contents of a file of a model.

    Attributes
    ----------
    path
        The file.
    outside
        Whether it may name files outside of its folder.
    bare
        Whether a caller's material replaces those of the file, of which no notes are made then.
    parts, lights
        Those of a scene; a light with a surface is that of a part, too.
    cameras
        By name.
    unread
        Numbers of things that are left out, by kind: ``{"normal map": 2}``.
    flat
        Number of triangles without area, which are left out.
    """

    path: Path
    outside: bool = False
    bare: bool = False
    parts: list[Part] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    cameras: dict[str, Camera] = field(default_factory=dict)
    unread: Counter[str] = field(default_factory=Counter)
    flat: int = 0

    def add(
        self,
        mesh: Mesh,
        material: Material = DEFAULT_MATERIAL,
        light: MeshLight | None = None,
        mask: Mask | None = None,
    ) -> None:
        """Add a mesh with its material, the light of its triangles, and its mask, which a light is left without."""
        if mask is not None and light is not None:
            self.unread["mask of a surface that emits"] += 1
            mask = None
        self.parts.append(Part(mesh, material, light, mask=mask))
        if light is not None:
            self.lights.append(light)

    def lamp(self, mesh: Mesh, radiance: Rgb | Image, two_sided: bool = False) -> MeshLight | None:
        """Return the light of a mesh whose triangles emit; None, and counted, if they overlap, so that none is one."""
        faces = np.concatenate([mesh.faces, mesh.faces[:, ::-1]]) if two_sided else mesh.faces
        try:
            return MeshLight(mesh.vertices, faces, radiance, mesh.uv if isinstance(radiance, Image) else None)
        except ValueError as error:
            if "overlap" not in str(error):
                raise
            self.unread["emission of triangles that overlap"] += 1
            return None

    def drop_flat(self, mesh: Mesh) -> Mesh | None:
        """Return a mesh without its triangles that have no area, which are counted; None if all are such."""
        kept = have_area(mesh)
        self.flat += int((~kept).sum())
        if kept.all():
            return mesh
        return Mesh(mesh.vertices, mesh.faces[kept], mesh.normals, mesh.uv) if kept.any() else None

    def file(self, name: str) -> Path | None:
        """Return the path of a file that this one names, see `found_file`; None, and counted, if there is none.

        Raises a ValueError if it is outside of the folder of the model, unless that is allowed.
        """
        path = found_file(self.path.parent, name, None if self.outside else self.path.parent)
        self.unread[f"missing file {name[-60:]!r}"] += path is None
        return path


def with_materials(parts: list[Part], names: Sequence[str], material: Any) -> list[Part]:
    """Return parts with a caller's material, one for all, or a dict by their `names`, which leaves the others."""
    if material is None:
        return parts
    if isinstance(material, Material):
        return [replace(part, material=material) for part in parts]
    if not isinstance(material, Mapping):
        raise ValueError(f"material must be a Material, or a dict of them by name; got {type(material).__name__}")
    for name in material:
        if name not in names:
            known = sorted(set(names))
            raise ValueError(
                f"material must have names of materials or geometries of the source, {known}; got {name!r}"
            )
    return [replace(part, material=material.get(name, part.material)) for name, part in zip(names, parts, strict=True)]


def camera_of(
    model: Model, parts: Sequence[Part], camera: Any, up: str | None, fov: float | None
) -> tuple[Camera, list[str]]:
    """Return a caller's camera, or one of the file, by default its first, or one that sees all parts, and a note."""
    if fov is not None:
        number("fov", fov)
    if isinstance(camera, Camera):
        return camera, []
    if isinstance(camera, str) and camera.isdigit() and camera not in model.cameras:
        camera = dict(enumerate(model.cameras)).get(int(camera), camera)
    if camera is not None and camera not in model.cameras:
        names = ", ".join(map(repr, model.cameras)) or "none"
        raise ValueError(
            f"camera must be a Camera, or the name or number of one in {model.path}: {names}; got {camera!r}"
        )
    if camera is not None or (model.cameras and up is None):
        camera = model.cameras[camera] if camera is not None else next(iter(model.cameras.values()))
        return replace(camera, fov=camera.fov if fov is None else fov), []
    note = "a camera that sees all of it" if model.cameras else "a camera that sees all of it, because it has none"
    return Camera.fit([part.mesh for part in parts], up_axis(model.path, up), fov or 40.0), [note]


def up_axis(path: str | os.PathLike[str], up: str | None) -> tuple[float, float, float]:
    """Return the axis `up`, ``y`` or ``z``; None: that of the format of a file."""
    is_y = up == "y" if up is not None else Path(path).suffix.lower() in Y_UP
    return (0.0, 1.0, 0.0) if is_y else (0.0, 0.0, 1.0)
