"""Loading of scenes: pbrt files, the scenes that come with the library, and meshes with materials from Python.

>>> scene = load_scene("teapot-area-light", resolution=(256, 256))
>>> scene = load_scene("bunny.ply", material=plastic(), lights=[PointLight((2, -2, 3), (9, 9, 9))])
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmis.base.validate import did_you_mean
from dmis.brdf.materials import Material
from dmis.formats.mesh_files import MESH_SUFFIXES
from dmis.formats.shipped import SCENE_FOLDER, SHIPPED
from dmis.geometry.mesh import Mesh
from dmis.light.light import Light
from dmis.scene.camera import Camera
from dmis.scene.scene import Scene

if TYPE_CHECKING:
    import trimesh


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
        none and emits too little, a sky and a lamp (`dmis.formats.model_lights`). What the file emits stays.
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
        from dmis.formats.pbrt.read import read_pbrt  # where it is met: all readers are a third of dmis

        return read_pbrt(path, resolution, dialect=dialect, outside=outside)
    from dmis.formats.mesh_scene import mesh_scene

    return mesh_scene(source, resolution, (camera, up, fov), lights, material, outside)


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
