"""Scenes from wherever they are: pbrt files, the scenes that come with the library, meshes with values from Python.

>>> scene = load_scene("teapot-area-light", resolution=(256, 256))
>>> scene = load_scene("bunny.ply", material=plastic(), lights=[PointLight((2, -2, 3), (9, 9, 9))])
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis import geometry
from dmis.camera import Camera
from dmis.geometry import FORMATS, Mesh
from dmis.light import AreaLight, EnvironmentLight, Light, MeshLight, QuadLight, SphereLight
from dmis.material import Material, matte
from dmis.scene import Part, Scene
from dmis.vec import frame

if TYPE_CHECKING:
    import trimesh

_HERE = Path(__file__).resolve().parent
_FOLDER = _HERE / "_scenes" if (_HERE / "_scenes").is_dir() else _HERE.parent / "scenes"  # of a wheel; of a checkout

SHIPPED = tuple(sorted(path.stem for path in _FOLDER.glob("*.pbrt")))
"""Names of the scenes that come with the library."""


def load_scene(
    source: str | os.PathLike[str] | Mesh | trimesh.Trimesh | trimesh.Scene,
    resolution: tuple[int, int] | None = None,
    *,
    camera: Camera | None = None,
    lights: Sequence[Light] | None = None,
    material: Material | Mapping[str, Material] | None = None,
    dialect: str | None = None,
    outside: bool = False,
) -> Scene:
    """Load or make a scene.

    Parameters
    ----------
    source
        A pbrt file, the name of a scene that comes with the library (`SHIPPED`), a GLB, OBJ, PLY or STL file,
        or a mesh. A pbrt scene has everything; a mesh needs what follows.
    resolution
        ``(width, height)`` in place of the file's or the camera's.
    camera
        Default: looks down at the whole mesh from an oblique angle, 640x480; z is up, but y in a GLB file, as glTF has
        it.
    lights
        Area lights also get a surface that is seen and blocks light, black but for what it emits. Default: a sky of
        radiance 1 in every direction, in which a white surface in the open has radiance 1.
    material
        One for all, or, for a trimesh scene, by the names of its geometries. Default: matte grey.
    dialect
        Of a pbrt file: ``v2``, ``v3`` or ``v4``. Default: what the file's own words say.
    outside
        Whether a pbrt file may name files outside of its folder.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the source is none of these, a scene has no such name, a file cannot be read, a geometry has no material, or
        a camera, lights or a material are given for a pbrt scene. `dmis.pbrt.PbrtError` is one of these.
    """
    if isinstance(source, str | os.PathLike):
        path = Path(source)
        suffix = path.suffix.lower()
        if suffix not in FORMATS:
            for name, value in (("camera", camera), ("lights", lights), ("material", material)):
                if value is not None:
                    raise ValueError(f"{name} must not be given for {path}, because a pbrt scene has its own")
            from dmis.pbrt import read_pbrt  # imported where used: it takes a fifth of the time of all of dmis

            path = path if suffix == ".pbrt" else _shipped(path)
            return read_pbrt(path, resolution, dialect=dialect, outside=outside)
        if isinstance(material, Mapping):
            raise ValueError(
                f"material must be one Material for {path}, because the geometries of a file are joined; "
                f"load_scene(trimesh.load(...)) takes one for each name"
            )
        named, title, up = {"": geometry.load_mesh(path)}, path.stem, "y" if suffix == ".glb" else "z"
    else:
        named, title, up = _meshes(source), "scene", "z"
    parts = [Part(mesh, _material_of(name.split("\0")[0], material)) for name, mesh in named.items()]
    if isinstance(lights, Light):
        raise ValueError(f"lights must be a sequence of lights; got {lights!r} alone")
    if lights is None:
        lights = [EnvironmentLight(np.ones((16, 32, 3)))]
    parts += [light_part(light) for light in lights if isinstance(light, AreaLight)]
    if camera is None:
        camera = _look_at_all(list(named.values()), up)
    if resolution is not None:
        camera = replace(camera, resolution=resolution)
    return Scene(camera, tuple(parts), tuple(lights), title)


def light_part(light: AreaLight) -> Part:
    """The visible surface of an area light: it emits what the light emits, and reflects nothing."""
    if isinstance(light, MeshLight):
        mesh = Mesh(light.vertices, light.faces)
    elif isinstance(light, QuadLight):
        mesh = geometry.quad(light.corner, light.edge_u, light.edge_v)
    elif isinstance(light, SphereLight):
        mesh = geometry.sphere(light.radius).transformed(geometry.translate(light.centre))
    else:
        normal = np.asarray(light.normal, float) / np.linalg.norm(light.normal)
        matrix = geometry.translate(light.centre)
        s, t = (axis[:, 0].astype(float) for axis in frame(normal[:, None]))
        matrix[:3, :3] = np.stack([s, t if np.cross(s, t) @ normal > 0 else -t, normal], axis=1)
        mesh = geometry.disk(radius=light.radius).transformed(matrix)
    return Part(Mesh(mesh.vertices, mesh.faces), matte(0), light)


def _shipped(name: Path) -> Path:
    if str(name) in SHIPPED:
        return _FOLDER / f"{name}.pbrt"
    raise ValueError(
        f"a scene must be a file ending in {', '.join(('.pbrt', *FORMATS))}, or one of the scenes that come with "
        f"dmis: {', '.join(SHIPPED) or 'none'}; got {str(name)!r}"
    )


def _meshes(source: Any) -> dict[str, Mesh]:
    """Meshes by the names of their geometries; instances of one have a zero character and a number behind it."""
    import trimesh

    if isinstance(source, Mesh):
        return {"": source}
    if isinstance(source, trimesh.Trimesh):
        return {"": geometry.from_trimesh(source)}
    if not isinstance(source, trimesh.Scene):
        raise ValueError(f"source must be a path, a name, a Mesh, or of trimesh; got {type(source).__name__}")
    meshes = {}
    for k, node in enumerate(source.graph.nodes_geometry):
        matrix, name = source.graph[node]
        name = str(name)
        if isinstance(source.geometry[name], trimesh.Trimesh):
            alone = trimesh.Scene()
            alone.add_geometry(source.geometry[name], geom_name=name, transform=matrix)
            meshes[f"{name}\0{k}"] = geometry.from_trimesh(alone)
    if not meshes:
        raise ValueError("source must hold triangles to be seen; got a trimesh scene without any")
    return meshes


def _material_of(name: str, material: Material | Mapping[str, Material] | None) -> Material:
    if material is None:
        return _DEFAULT
    if isinstance(material, Material):
        return material
    if not isinstance(material, Mapping):
        raise ValueError(f"material must be a Material, or a dict of them by name; got {type(material).__name__}")
    if name not in material:
        known = ", ".join(map(repr, material)) or "none"
        raise ValueError(f"material must have an entry for the geometry {name!r}; given are: {known}")
    return material[name]


_DEFAULT = matte()


def _look_at_all(meshes: list[Mesh], up: str) -> Camera:
    """A camera that sees the sphere about the bounding box, with one axis `up`."""
    low, high = np.min([m.bounds[0] for m in meshes], axis=0), np.max([m.bounds[1] for m in meshes], axis=0)
    centre, radius, fov = (low + high) / 2, np.linalg.norm(high - low) / 2, 40.0
    towards, axis = ((0.45, -0.75, 0.48), (0, 0, 1)) if up == "z" else ((0.45, 0.48, 0.75), (0, 1, 0))
    eye = centre + np.array(towards) / np.linalg.norm(towards) * radius / np.sin(np.radians(fov / 2))
    return Camera.look_at(tuple(eye.tolist()), tuple(centre.tolist()), axis, fov=fov)
