"""Shapes of pbrt files: their meshes in object space, made from the parameters of Shape lines.

Quadrics keep their formula until the camera is known, which decides how finely they are tessellated
(`dmis.formats.pbrt.quadrics`). `dmis.formats.pbrt.parts` turns shapes into parts of a scene and lights.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis.base.vectors import Floats
from dmis.brdf.texture import Image
from dmis.formats.mesh_files import reading
from dmis.formats.pbrt.parameters import ParameterSet
from dmis.formats.pbrt.quadrics import choose_grids
from dmis.formats.pbrt.tokens import Token, blame, unzipped
from dmis.formats.ply import read_ply
from dmis.geometry.mesh import Mesh, repair_normals
from dmis.geometry.shapes import Quadric, circular, cylindrical, spherical
from dmis.scene.camera import Camera

if TYPE_CHECKING:
    from dmis.scene.masks import Mask

LEAST_ALPHA = 1e-6
"""Smallest alpha of a surface that is there in v2 and v3, which ask whether it is 0."""

OF_MATERIALS = "Kd Ks Kr Kt sigma roughness uroughness vroughness eta k index opacity bumpmap reflect transmit".split()
"""Parameters by which a Shape line would change the material in v2 and v3."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A shape of a pbrt file with its mesh, its transform and its place in the file.

    Attributes
    ----------
    token
        The directive, for errors.
    kind
        Its class: trianglemesh, sphere, ...
    mesh
        Triangles in object space; of a quadric a coarse tessellation, until `tessellate_quadrics`.
    to_world
        4x4 matrix.
    reverse
        Whether ReverseOrientation is on.
    mirrored
        Whether the transform of the Shape line changes handedness; that of an instance does not count.
    quadric
        The surface of a sphere, disk or cylinder; else None.
    mask
        Holes in the surface; None: there are none.
    twosided
        Whether this is one side of a lamp of which there are both.
    """

    token: Token
    kind: str
    mesh: Mesh
    to_world: Floats
    reverse: bool
    mirrored: bool
    quadric: Quadric | None = None
    mask: Mask | None = None
    twosided: bool = False


def make_shape(name: Token, parameters: ParameterSet, to_world: Floats, reverse: bool) -> Shape:
    """Return the shape `name` of a Shape line; `to_world` (4, 4) is the current transform."""
    name.among("a shape", SHAPES)
    if parameters.constant("shadowalpha", 1.0) != 1:
        parameters.refuse("shadows of another shape than the surface are not supported; use alpha", "shadowalpha")
    parameters.refuse("this is not supported; remove the parameter", "displacement", "emissionfilename", "S")
    if name.dialect != "v4":
        parameters.refuse("a parameter of materials must stand in a Material line before the shape", *OF_MATERIALS)
    with blame(name):
        surface = SHAPES[name.name](parameters)
        quadric = surface if isinstance(surface, Quadric) else None
        mesh = surface.mesh(8) if isinstance(surface, Quadric) else surface
        mask = make_mask(name.name, parameters)
    return Shape(parameters.directive, name.name, mesh, to_world, reverse, mirrors(to_world), quadric, mask)


def make_mask(kind: str, p: ParameterSet) -> Mask | None:
    """Return the mask of a shape's ``alpha``, None if it has no holes.

    v2 and v3 have alpha in triangle meshes only, and ask whether it is 0; in v4 it is a probability.
    """
    alpha, v4 = p.real("alpha", 1.0), p.dialect == "v4"
    if not v4 and kind not in ("trianglemesh", "plymesh"):
        return None
    if not isinstance(alpha, Image):
        if alpha >= 1 or (alpha > 0 and not v4):
            return None
        alpha = Image(np.full((1, 1, 1), alpha))
    if alpha.texels.min() < 0 or alpha.texels.max() > 1:
        alpha = replace(alpha, texels=np.clip(alpha.texels, 0, 1))
    from dmis.scene.masks import Mask

    return Mask(alpha, None if v4 else LEAST_ALPHA)


def _triangles(p: ParameterSet) -> Mesh:
    """Return the triangles of a ``trianglemesh``."""
    points = p.required_table("P", "point", 3)
    if "indices" not in p.items and len(points) == 3 and p.dialect == "v4":
        faces = np.arange(3, dtype=np.int32)[None]
    else:
        faces = p.indices(len(points))
    normals = p.table("N", 3, "normal", rows=len(points))
    normals = None if normals is None else repair_normals(points, faces, normals)
    st, uv = (p.table(name, 2, "float", "point2", rows=len(points)) for name in ("st", "uv"))
    return Mesh(points, faces, normals, st if uv is None else uv)


def _loop(p: ParameterSet) -> Mesh:
    """Return the subdivided triangles of a ``loopsubdiv``."""
    from dmis.geometry import subdivision

    p.string("scheme", "loop", ("loop",))
    points = p.required_table("P", "point", 3)
    levels = p.integer("levels", p.integer("nlevels", 3))  # the second name is that of v2, which v3 knows, too
    mesh = subdivision.loop_subdivide(points, p.indices(len(points)), levels)
    assert mesh.normals is not None
    # all versions of pbrt take S x T over a ring that runs clockwise: normals opposite to the winding
    return replace(mesh, normals=-mesh.normals)


def _file(p: ParameterSet) -> Mesh:
    """Return the mesh of the file of a ``plymesh``."""
    name = p.string("filename")
    token = p.items["filename"].token
    if not name.lower().endswith((".ply", ".ply.gz")):
        raise token.error(f"a plymesh must be a .ply or .ply.gz file; got {name!r}")
    path = token.file(name)
    with blame(token), reading(path, ".ply") as data:
        return read_ply(unzipped(path, data))


def _sphere(p: ParameterSet) -> Quadric:
    """Return a sphere, or the part of it between two heights and angles."""
    radius = p.number("radius", 1)
    if not radius > 0:
        raise ValueError(f"radius must be positive; got {radius}")
    low, high = sorted((p.number("zmin", -radius), p.number("zmax", radius)))
    return spherical(radius, low, high, p.number("phimax", 360))


def _disk(p: ParameterSet) -> Quadric:
    """Return a disk, or the part of it between two radii and angles."""
    inner, phimax = p.number("innerradius", 0), p.number("phimax", 360)
    return circular(p.number("height", 0), p.number("radius", 1), inner, phimax)


def _cylinder(p: ParameterSet) -> Quadric:
    """Return a cylinder, or the part of it between two angles."""
    low, high = sorted((p.number("zmin", -1), p.number("zmax", 1)))
    return cylindrical(p.number("radius", 1), low, high, p.number("phimax", 360))


SHAPES: dict[str, Callable[[ParameterSet], Mesh | Quadric]] = {
    "trianglemesh": _triangles,
    "plymesh": _file,
    "loopsubdiv": _loop,
    "sphere": _sphere,
    "disk": _disk,
    "cylinder": _cylinder,
}
"""Functions that make surfaces, by the kind of shape."""


def mirrors(matrix: Floats) -> bool:
    """Return whether a matrix (4, 4) changes handedness."""
    return bool(np.linalg.det(matrix[:3, :3]) < 0)


def tessellate_quadrics(
    shapes: Sequence[Shape], lamps: int, camera: Camera, most: int
) -> tuple[list[Shape], dict[str, Any] | None]:
    """Return the shapes, with quadrics tessellated as the camera needs, and a report; see `dmis.formats.pbrt.quadrics`.

    The first `lamps` of the shapes emit. `most` is the largest number of triangles. The report is None if there is no
    quadric, else it has their number ``shapes``, their ``triangles``, and their largest error in ``pixels`` (of spheres
    that emit: ``lamp_pixels``).
    """
    lamp = [k < lamps and shape.kind == "sphere" and not shape.reverse for k, shape in enumerate(shapes)]
    curved = [(s.quadric, s.to_world, emits) for s, emits in zip(shapes, lamp, strict=True) if s.quadric is not None]
    if not curved:
        return list(shapes), None
    others = sum(shape.mesh.triangles for shape in shapes if shape.quadric is None)
    meshes: dict[tuple[object, ...], Mesh] = {}  # instances of one shape share a mesh
    finished, pixels, triangles = [], [0.0, 0.0], 0
    grids = iter(choose_grids(curved, camera, most - others))
    for shape, emits in zip(shapes, lamp, strict=True):
        if shape.quadric is not None:
            u, v, error = next(grids)
            key = id(shape.quadric), u.tobytes(), v.tobytes()
            meshes[key] = meshes.get(key) or shape.quadric.mesh_between(u, v)
            shape = replace(shape, mesh=meshes[key])
            pixels[emits], triangles = max(pixels[emits], error), triangles + shape.mesh.triangles
        finished.append(shape)
    report = {"shapes": len(curved), "triangles": triangles, "pixels": pixels[False], "lamp_pixels": pixels[True]}
    return finished, report
