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

from dmis.base.color import Rgb
from dmis.base.validate import did_you_mean
from dmis.base.vectors import Array
from dmis.brdf.materials import Material, matte
from dmis.formats.emission import LEAST_LIT, without_overlaps
from dmis.formats.gltf import read_gltf
from dmis.formats.model import Y_UP, Model, camera_of, up_axis, with_materials
from dmis.formats.obj import read_obj_with_materials
from dmis.geometry.gltf import Gltf
from dmis.geometry.mesh import Mesh
from dmis.geometry.mesh_files import MESH_SUFFIXES, from_trimesh, load_mesh, placed_geometries, reading
from dmis.geometry.ply import unread_of_ply
from dmis.light.area import QuadLight
from dmis.light.environment import EnvironmentLight
from dmis.light.light import AreaLight, Light
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.scene import Scene, SceneWarning
from dmis.scene.suggestions import Suggestions

if TYPE_CHECKING:
    import trimesh

_HERE = Path(__file__).resolve().parent.parent
SCENE_FOLDER = _HERE / "_scenes" if (_HERE / "_scenes").is_dir() else _HERE.parent / "scenes"
"""Folder of the scenes that come with the library: of a wheel, or of a checkout."""
SHIPPED = tuple(sorted(path.stem for path in SCENE_FOLDER.glob("*.pbrt")))
"""Names of the scenes that come with the library."""
HELD_OUT = ("ten-lights", "veach-mis")
"""Names of those of them that are held out: no constant of the library is chosen on them, so that they can test it."""

SKY = 0.25
"""Radiance of the default sky of a mesh; its lamp adds the rest of 1."""
SOFT_SKY = (0.1, 0.32, 0.62)
"""Radiance of the default sky of a model with materials: below, at the horizon and above, linear in the height."""


def load_scene(
    source: str | os.PathLike[str] | Mesh | trimesh.Trimesh | trimesh.Scene,
    resolution: tuple[int, int] | None = None,
    *,
    camera: Camera | str | None = None,
    lights: Sequence[Light] | None = None,
    material: Material | Mapping[str, Material] | None = None,
    dialect: str | None = None,
    outside: bool = False,
    up: str | None = None,
    fov: float | None = None,
) -> Scene:
    """Load a scene from a file or by name, or make one of a mesh.

    Parameters
    ----------
    source
        A pbrt file, the name of a scene that comes with the library (`SHIPPED`), a glTF, OBJ, PLY or STL file,
        or a mesh. A pbrt scene is complete; for others the camera, lights and material may be arguments.
    resolution
        ``(width, height)`` in place of the file's or the camera's.
    camera
        Or name or number of one in the file, as text. Default: the first one in the file, else `Camera.fit`, with `up`.
    lights
        Area lights get a visible surface, which blocks light and reflects none. Default: those of the file; if it has
        none and emits too little (`LEAST_LIT`), a sky and a lamp (`default_lights`). What the file emits stays.
    material
        One for all, or a dict by the names of the file's materials, or of the geometries of a trimesh scene, which
        leaves the others. Default: those of a glTF or OBJ file or of trimesh, else matte grey.
    dialect
        Dialect of a pbrt file: ``v2``, ``v3`` or ``v4``. Default: detected from the words of the file.
    outside
        Whether a file may name files outside of its folder.
    up, fov
        Of a camera that sees all the axis that is up, ``y`` or ``z``, by default y in glTF and OBJ files, else z; of it
        or one of the file the angle across the shorter side of the image, in degrees.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the source is none of these, a file cannot be read, there is no such name of a material, or what a
        pbrt scene has itself is given for one (`dmis.formats.pbrt.tokens.PbrtError`).

    Warns
    -----
    SceneWarning
        If something of a file is left out, or an image is to be on a mesh without texture coordinates.
    """
    if (path := _pbrt_file(source)) is not None:
        model_options = {"camera": camera, "lights": lights, "material": material, "up": up, "fov": fov}
        if given := [name for name, value in model_options.items() if value is not None]:
            raise ValueError(f"{given[0]} must not be given for {source}, because a pbrt scene has its own")
        from dmis.formats.pbrt.read import read_pbrt  # here, because it takes a fifth of the time of all of dmis

        return read_pbrt(path, resolution, dialect=dialect, outside=outside)
    if up not in (None, "y", "z"):
        raise ValueError(f"up must be y or z, the axis of the default camera; got {up!r}")
    return _mesh_scene(source, resolution, (camera, up, fov), lights, material, outside)


def _mesh_scene(source: Any, resolution: Any, view: Any, lights: Any, material: Any, outside: bool) -> Scene:
    """Return the scene of a mesh or of a mesh file; see `load_scene` for the arguments and defaults."""
    if isinstance(lights, Light):
        raise ValueError(f"lights must be a list; got one {type(lights).__name__}. Write lights=[...]")
    if isinstance(source, str | os.PathLike):
        model = read_file(Path(source), outside, isinstance(material, Material))
        names = [part.material.name for part in model.parts]
    else:
        model, names = Model(Path("scene")), []
        geometries: Any = [("", source)] if isinstance(source, Mesh) else placed_geometries(source)
        for name, mesh in geometries:
            if isinstance(mesh, Mesh):
                model.add(mesh)
            elif isinstance(material, Material) or not mesh.visual.defined:
                model.add(from_trimesh(mesh))
            else:  # its colours and its material are those of the file that trimesh writes
                read_gltf(Gltf(Path("scene.glb"), mesh.export(file_type="glb")), model)
            names += [name] * (len(model.parts) - len(names))
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
    if model.flat:
        total = model.flat + sum(part.mesh.triangles for part in parts)
        text = f"{model.path}: {model.flat:,} of {total:,} triangles have no area and are left out"
        warnings.warn(SceneWarning(text), stacklevel=3)
    unread = [f"{kind} ({n})" if n > 1 else kind for kind, n in model.unread.items() if n]
    if unread:
        warnings.warn(SceneWarning(f"{model.path}: left out: {', '.join(unread)}"), stacklevel=3)  # of load_scene
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


def read_file(path: Path, outside: bool, bare: bool) -> Model:
    """Return the contents of a mesh file; `bare`: without notes on its materials."""
    model = Model(path, outside)
    if path.suffix.lower() == ".obj":
        with reading(path) as data:
            read_obj_with_materials(data, model)
        if bare:
            model.unread.clear()
    elif path.suffix.lower() in (".glb", ".gltf"):
        with reading(path) as data:
            read_gltf(Gltf(path, data, outside, bare), model)
    else:
        if (mesh := model.drop_flat(load_mesh(path))) is not None:
            model.add(mesh)
        if path.suffix.lower() == ".ply" and not bare:
            model.unread.update(unread_of_ply(path))
    return model


def light_part(light: AreaLight) -> Part:
    """Return the visible surface of an area light, which emits its radiance and reflects nothing."""
    mesh = light.mesh()
    if mesh is None:
        raise ValueError(f"light must have a visible surface; {type(light).__name__}.mesh() returns None")
    return Part(Mesh(mesh.vertices, mesh.faces, uv=mesh.uv), matte(0), light)


def _pbrt_file(source: Any) -> Path | None:
    """Return the pbrt file of a path or of the name of a shipped scene; None for meshes and their files."""
    if not isinstance(source, str | os.PathLike) or Path(source).suffix.lower() in MESH_SUFFIXES:
        return None
    path = Path(source)
    if path.suffix.lower() == ".pbrt":
        return path
    if str(path) in SHIPPED:
        return SCENE_FOLDER / f"{path}.pbrt"
    raise ValueError(
        f"a scene must be a file ending in {', '.join(('.pbrt', *MESH_SUFFIXES))}, or one of the scenes that come with "
        f"dmis: {', '.join(SHIPPED) or 'none'}; got {str(path)!r}{did_you_mean(str(path), SHIPPED, 0.5)}"
    )


def default_lights(camera: Camera, low: Array, high: Array, up: Rgb | None = None) -> list[Light]:
    """Return the lights of a mesh that has none: a sky, and a lamp that shows its shape.

    The sky has radiance `SKY`; with an axis `up` it is soft, `SOFT_SKY`, so that metals have something to reflect. The
    lamp is a square behind the camera, to the upper left and out of its view, that looks at the middle of the mesh,
    whose least and largest coordinates are `low` and `high` ``(3,)``, and is about as large. Under an even sky an
    unoccluded white surface that faces the lamp has radiance 1.
    """
    sky = EnvironmentLight(np.full((16, 32, 3), SKY))
    if up is not None:
        height = np.cos((np.arange(64) + 0.5) * np.pi / 64)
        soft = np.interp(height, (-1, 0, 1), SOFT_SKY)
        axes = np.eye(3) if up[2] else np.eye(3)[[0, 2, 1]]
        sky = EnvironmentLight(np.broadcast_to(soft[:, None, None], (64, 128, 3)), axes)
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
    return [sky, QuadLight(corner, u, v, (radiance,) * 3)]
