"""Scenes of meshes and of mesh files: their materials, and a camera and lights where they have none."""

from __future__ import annotations

import os
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dmis.brdf.materials import Material
from dmis.formats.mesh_files import from_trimesh, load_mesh, placed_geometries, reading
from dmis.formats.model import Y_UP, Model, camera_of, up_axis, with_materials
from dmis.formats.model_lights import LEAST_LIT, default_lights, without_overlaps
from dmis.formats.ply import unread_of_ply
from dmis.geometry.mesh import Mesh
from dmis.light.light import Light
from dmis.scene.groups import light_part
from dmis.scene.scene import Scene, SceneWarning
from dmis.scene.suggestions import Suggestions


def mesh_scene(source: Any, resolution: Any, view: Any, lights: Any, material: Any, outside: bool) -> Scene:
    """Return the scene of a mesh or of a mesh file.

    `view` is the camera, the axis that is up, and the field of view; for these and the other arguments and their
    defaults see `dmis.load_scene`, which calls this function.
    """
    if view[1] not in (None, "y", "z"):
        raise ValueError(f"up must be y or z, the axis of the default camera; got {view[1]!r}")
    if isinstance(lights, Light):
        raise ValueError(f"lights must be a list; got one {type(lights).__name__}. Write lights=[...]")
    if isinstance(source, str | os.PathLike):
        model = read_file(Model(Path(source), outside, isinstance(material, Material)))
        names = [part.material.name for part in model.parts]
    else:
        model, names = read_mesh(source, isinstance(material, Material))
    if not model.parts:
        raise ValueError(
            f"{model.path}: mesh must have a triangle with an area and an opacity, because no ray hits others; got "
            f"{model.flat} without an area"
        )
    parts, name = with_materials(model.parts, names, material), model.path.stem
    bounds = np.array([part.mesh.bounds for part in parts])
    low, high, axis = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0), up_axis(model.path, view[1])
    camera, added = camera_of(model, parts, *view)
    if resolution is not None:
        camera = replace(camera, resolution=resolution)
    parts, share = without_overlaps(model, parts, camera)
    lamps = [part.light for part in parts if part.light is not None]
    file_lights = [light for light in model.lights if light.mesh() is None]
    lit = f"its emission, which reaches {share:.0%} of the image" if share >= LEAST_LIT else ""
    lit = "its lights" if file_lights else lit
    if model.flat:  # warnings are of the line that calls load_scene
        total = model.flat + sum(part.mesh.triangles for part in parts)
        text = f"{model.path}: {model.flat:,} of {total:,} triangles have no area and are left out"
        warnings.warn(SceneWarning(text), stacklevel=3)
    unread = [f"{kind} ({n})" if n > 1 else kind for kind, n in model.unread.items() if n]
    if unread:
        warnings.warn(SceneWarning(f"{model.path}: left out: {', '.join(unread)}"), stacklevel=3)
    if lights is None and lit:
        lights = file_lights
    elif lights is None:
        lights = default_lights(camera, low, high, axis if model.path.suffix.lower() in Y_UP else None)
        why = f"its emission reaches only {share:.1%} of the image" if lamps else "it has no lights"
        added.append(f"a sky and a lamp, because {why}")
    lights = [*lights, *lamps]
    of_parts = {id(part.light) for part in parts}
    parts += [light_part(light) for light in lights if light.mesh() is not None and id(light) not in of_parts]
    about = {"unread": unread, "added": added, "lit": lit, "cameras": list(model.cameras)}
    about |= {"bounds": [*low.tolist(), *high.tolist()], "up": "xyz"[axis.index(1.0)]}
    source = {key: value for key, value in about.items() if value}
    suggested = Suggestions("path") if lit else Suggestions()  # in a room, walls give light
    return Scene(camera, tuple(parts), tuple(lights), name, suggested, source)


def read_mesh(source: Any, bare: bool) -> tuple[Model, list[str]]:
    """Return the model of a mesh or of objects of trimesh, without their materials if it is bare, and parts' names."""
    model, names = Model(Path("scene")), list[str]()
    geometries: Any = [("", source)] if isinstance(source, Mesh) else placed_geometries(source)
    for name, mesh in geometries:
        if isinstance(mesh, Mesh):
            model.add(mesh)
        elif bare or not mesh.visual.defined:
            model.add(from_trimesh(mesh))
        else:  # its colours and its material are those of the file that trimesh writes
            from dmis.formats.gltf.gltf_scene import read_gltf

            read_gltf(mesh.export(file_type="glb"), model)
        names += [name] * (len(model.parts) - len(names))
    return model, names


def read_file(model: Model) -> Model:
    """Add the contents of a mesh file to its model, and return it."""
    suffix = model.path.suffix.lower()
    if suffix == ".obj":
        from dmis.formats.obj.mtl import read_obj_with_materials as read
    elif suffix in (".glb", ".gltf"):
        from dmis.formats.gltf.gltf_scene import read_gltf as read
    if suffix in (".obj", ".glb", ".gltf"):
        with reading(model.path) as data:
            read(data, model)
    elif (mesh := model.drop_flat(load_mesh(model.path))) is not None:
        model.add(mesh)
    if suffix == ".ply":
        model.unread.update(unread_of_ply(model.path))
    if model.bare and suffix in (".obj", ".ply"):
        model.unread.clear()
    return model
