"""Loading of scenes: pbrt files, the scenes that come with the library, and meshes with materials from Python.

>>> scene = load_scene("teapot-area-light", resolution=(256, 256))
>>> scene = load_scene("bunny.ply", material=plastic(), lights=[PointLight((2, -2, 3), (9, 9, 9))])
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis.base.validate import did_you_mean
from dmis.base.vectors import Array
from dmis.brdf.materials import Material, matte
from dmis.geometry.mesh import Mesh, without_degenerate
from dmis.geometry.mesh_files import MESH_SUFFIXES, from_trimesh, placed_meshes, read_mesh
from dmis.light.area import QuadLight
from dmis.light.environment import EnvironmentLight
from dmis.light.light import AreaLight, Light
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.scene import Scene, SceneWarning

if TYPE_CHECKING:
    import trimesh

_HERE = Path(__file__).resolve().parent.parent
_FOLDER = _HERE / "_scenes" if (_HERE / "_scenes").is_dir() else _HERE.parent / "scenes"  # of a wheel; of a checkout
SHIPPED = tuple(sorted(path.stem for path in _FOLDER.glob("*.pbrt")))
"""Names of the scenes that come with the library."""
HELD_OUT = ("ten-lights", "veach-mis")
"""Names of those of them that are held out: no constant of the library is chosen on them, so that they can test it."""

SKY = 0.25
"""Radiance of the default sky of a mesh; its lamp adds the rest of 1."""


def load_scene(
    source: str | os.PathLike[str] | Mesh | trimesh.Trimesh | trimesh.Scene,
    resolution: tuple[int, int] | None = None,
    *,
    camera: Camera | None = None,
    lights: Sequence[Light] | None = None,
    material: Material | Mapping[str, Material] | None = None,
    dialect: str | None = None,
    outside: bool = False,
    up: str | None = None,
) -> Scene:
    """Load a scene from a file or by name, or make one of a mesh.

    Parameters
    ----------
    source
        A pbrt file, the name of a scene that comes with the library (`SHIPPED`), a GLB, OBJ, PLY or STL file,
        or a mesh. A pbrt scene is complete; for a mesh the camera, lights and material are arguments.
    resolution
        ``(width, height)`` in place of the file's or the camera's.
    camera
        Default: looks down at the whole mesh from an oblique angle, 640x480, with `up`.
    lights
        Area lights also get a visible surface that blocks light and reflects none. Default: an even sky and a
        square lamp behind the camera, to the upper left, see `default_lights`.
    material
        One for all, or, for a trimesh scene, by the names of its geometries. Default: matte grey, with a warning that
        names the materials, textures, colours and lights of a mesh file, which are not read.
    dialect
        Dialect of a pbrt file: ``v2``, ``v3`` or ``v4``. Default: detected from the words of the file.
    outside
        Whether a pbrt file may name files outside of its folder.
    up
        Axis of a mesh that is up for the default camera, ``y`` or ``z``. Default: y in a GLB file, as glTF has it, else
        z.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the source is none of these, a scene has no such name, a file cannot be read, a geometry has no material, or
        a camera, lights, a material or up are given for a pbrt scene (`dmis.formats.pbrt.tokens.PbrtError`).

    Warns
    -----
    SceneWarning
        If a mesh file holds materials and none is given, or triangles without area, or an image is to be on a mesh
        without texture coordinates. `dmis.formats.pbrt.notes.PbrtWarning` is one of these.
    """
    if (path := _pbrt_file(source)) is not None:
        for name, value in (("camera", camera), ("lights", lights), ("material", material), ("up", up)):
            if value is not None:
                raise ValueError(f"{name} must not be given for {source}, because a pbrt scene has its own")
        from dmis.formats.pbrt.read import read_pbrt  # here, because it takes a fifth of the time of all of dmis

        return read_pbrt(path, resolution, dialect=dialect, outside=outside)
    if up not in (None, "y", "z"):
        raise ValueError(f"up must be y or z, the axis of the default camera; got {up!r}")
    return _mesh_scene(source, resolution, camera, lights, material, up)


def _mesh_scene(source: Any, resolution: Any, camera: Camera | None, lights: Any, material: Any, up: Any) -> Scene:
    """Return the scene of a mesh or of a mesh file; see `load_scene` for the arguments and defaults."""
    named, title, file_up, unread = _named_meshes(source, material)
    parts = [Part(mesh, _material_of(name, material)) for name, mesh in named]
    bounds = np.array([mesh.bounds for _, mesh in named])
    low, high = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    if camera is None:
        camera = _look_at_all(low, high, up or file_up)
    if resolution is not None:
        camera = replace(camera, resolution=resolution)
    if lights is None:
        lights = default_lights(camera, low, high)
    parts += [light_part(light) for light in lights if light.mesh() is not None]
    return Scene(camera, tuple(parts), tuple(lights), title, source={"unread": list(unread)} if unread else {})


def _named_meshes(source: Any, material: Any) -> tuple[list[tuple[str, Mesh]], str, str, tuple[str, ...]]:
    """Return named meshes of a file or an object, the scene's name, the axis that is up, and what is not read."""
    if isinstance(source, Mesh):
        return [("", source)], "scene", "z", ()
    if not isinstance(source, str | os.PathLike):
        return _trimeshes(source), "scene", "z", ()
    path = Path(source)
    if isinstance(material, Mapping):
        raise ValueError(
            f"material must be one Material for {path}, because the geometries of a file are joined; "
            f"load_scene(trimesh.load(...)) takes one for each name"
        )
    mesh, unread = read_mesh(path)
    mesh, dropped = without_degenerate(mesh)
    if dropped:
        text = f"{path}: {dropped:,} of {dropped + mesh.triangles:,} triangles have no area and are left out"
        warnings.warn(SceneWarning(text), stacklevel=4)
    if unread and material is None:
        text = f"{path}: {', '.join(unread)} ignored, all is matte grey; give load_scene a material"
        warnings.warn(SceneWarning(text), stacklevel=4)  # the caller of load_scene
    return [("", mesh)], path.stem, "y" if path.suffix.lower() == ".glb" else "z", unread


def light_part(light: AreaLight) -> Part:
    """Return the visible surface of an area light, which emits its radiance and reflects nothing."""
    mesh = light.mesh()
    if mesh is None:
        raise ValueError(f"light must have a visible surface; {type(light).__name__}.mesh() returns None")
    return Part(Mesh(mesh.vertices, mesh.faces), matte(0), light)


def _pbrt_file(source: Any) -> Path | None:
    """Return the pbrt file of a path or of the name of a shipped scene; None for meshes and their files."""
    if not isinstance(source, str | os.PathLike) or Path(source).suffix.lower() in MESH_SUFFIXES:
        return None
    path = Path(source)
    if path.suffix.lower() == ".pbrt":
        return path
    if str(path) in SHIPPED:
        return _FOLDER / f"{path}.pbrt"
    raise ValueError(
        f"a scene must be a file ending in {', '.join(('.pbrt', *MESH_SUFFIXES))}, or one of the scenes that come with "
        f"dmis: {', '.join(SHIPPED) or 'none'}; got {str(path)!r}{did_you_mean(str(path), SHIPPED, 0.5)}"
    )


def _trimeshes(source: Any) -> list[tuple[str, Mesh]]:
    """Return the meshes of a source with their geometries' names."""
    import trimesh

    if not isinstance(source, trimesh.Scene | trimesh.Trimesh):
        raise ValueError(f"source must be a path, a name, a Mesh, or of trimesh; got {type(source).__name__}")
    return placed_meshes(source) if isinstance(source, trimesh.Scene) else [("", from_trimesh(source))]


def _material_of(name: str, material: Any) -> Material:
    """Return the material of the geometry `name`."""
    if material is None or isinstance(material, Material):
        return material or _DEFAULT
    if not isinstance(material, Mapping):
        raise ValueError(f"material must be a Material, or a dict of them by name; got {type(material).__name__}")
    if name not in material:
        names = ", ".join(map(repr, material)) or "none"
        raise ValueError(f"material must have an entry for the geometry {name!r}; given are: {names}")
    return material[name]


_DEFAULT = matte()


def default_lights(camera: Camera, low: Array, high: Array) -> list[Light]:
    """Return the lights of a mesh that has none: an even sky, and a lamp that shows its shape.

    The sky has radiance `SKY`. The lamp is a square behind the camera, to the upper left and out of its view, that
    looks at the middle of the mesh, whose least and largest coordinates are `low` and `high` ``(3,)``, and is about as
    large. An unoccluded white surface that faces the lamp has radiance 1.
    """
    middle = (low + high) / 2
    eye = np.asarray(camera.to_world, float)[:3, 3]
    right, up, forward = (axis / np.linalg.norm(axis) for axis in np.asarray(camera.to_world, float)[:3, :3].T)
    distance = max(float(np.linalg.norm(middle - eye)), float(np.linalg.norm(high - low)) / 2)
    # 0.4 behind the camera, which is more than the edges of the tilted square come forward
    centre = eye + distance * (0.9 * (up - right) - 0.4 * forward)
    towards, side = middle - centre, 0.7 * distance
    across = np.cross(towards, up)
    first = across * (side / np.linalg.norm(across))
    second = np.cross(towards, first) / np.linalg.norm(towards)
    # E = pi L sin^2 of the angle of a disk of the same area, pi r^2
    square = side**2 / np.pi
    radiance = (1 - SKY) * (1 + towards @ towards / square)
    corner, u, v = (tuple(place.tolist()) for place in (centre - (first + second) / 2, first, second))
    return [EnvironmentLight(np.full((16, 32, 3), SKY)), QuadLight(corner, u, v, (radiance,) * 3)]


def _look_at_all(low: Array, high: Array, up: str) -> Camera:
    """Return a camera that sees the sphere about a bounding box, with one axis `up`."""
    centre, radius, fov = (low + high) / 2, np.linalg.norm(high - low) / 2, 40.0
    towards, axis = ((0.45, -0.75, 0.48), (0, 0, 1)) if up == "z" else ((0.45, 0.48, 0.75), (0, 1, 0))
    eye = centre + np.array(towards) / np.linalg.norm(towards) * radius / np.sin(np.radians(fov / 2))
    return Camera.look_at(tuple(eye.tolist()), tuple(centre.tolist()), axis, fov=fov)
