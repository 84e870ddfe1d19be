"""Shapes of pbrt files: their meshes, which side of them is outside or bright, and what parts of a scene they make.

Shapes are kept in object space as they are read. At the end all of one material are joined into one mesh per kind
(flat or smooth, with or without texture coordinates), so that files of thousands of small shapes make few parts.

The side that a mesh's winding calls outside matters only to materials that transmit light, and to lights. Both follow
pbrt, whose rules are told in `_outside` and `_bright`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from dmis import geometry
from dmis.brdf import Dielectric, SpecularReflection, SpecularTransmission
from dmis.geometry import Mesh
from dmis.light import AreaLight, DiskLight, MeshLight, QuadLight, SphereLight
from dmis.material import Material
from dmis.pbrt_objects import similarity
from dmis.pbrt_parameters import Parameters
from dmis.pbrt_tokens import Floats, Token, blame
from dmis.rough_glass import RoughReflection, RoughTransmission
from dmis.scene import Part
from dmis.spectrum import Rgb

_CORNER_UV = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
"""Texture coordinates at the corners of each triangle of a mesh that has none."""


@dataclass(frozen=True, eq=False)
class Shape:
    """A shape where it stands in the file.

    Attributes
    ----------
    token
        The directive, for errors.
    kind
        Its class: trianglemesh, sphere, ...
    mesh
        Triangles in object space.
    to_world
        4x4 matrix.
    reverse
        Whether ReverseOrientation is on.
    mirrored
        Whether the transform it was made under changes handedness (an instance's own transform does not count).
    size
        Of an analytic disk (height, radius) or sphere (0, radius) that is whole; else None.
    """

    token: Token
    kind: str
    mesh: Mesh
    to_world: Floats
    reverse: bool
    mirrored: bool
    size: tuple[float, float] | None = None


def make_shape(name: Token, parameters: Parameters, to_world: Floats, reverse: bool) -> Shape:
    """The shape `name`."""
    if name.name not in _SHAPES or (name.name == "bilinearmesh" and name.source.dialect.name != "v4"):
        known = ", ".join(kind for kind in _SHAPES if kind != "bilinearmesh" or name.source.dialect.name == "v4")
        raise name.error(f"a shape must be one of {known}; others are not supported")
    for alpha in ("alpha", "shadowalpha"):
        found = parameters.items.get(alpha)
        if found is not None and found.kind == "float" and parameters.number(alpha, 1) == 1:
            continue
        parameters.refuse(alpha, "alpha is not supported: cut the holes into the mesh and remove the parameter")
    for displaced in ("displacement", "emissionfilename"):
        parameters.refuse(displaced, f"{displaced} is not supported; remove the parameter")
    parameters.refuse("S", "tangents are not supported; remove the parameter")
    with blame(name):
        mesh, size = _SHAPES[name.name](parameters)
    return Shape(parameters.directive, name.name, mesh, to_world, reverse, _mirrors(to_world), size)


# The shapes -------------------------------------------------------------------------------------------------------

_Made = tuple[Mesh, tuple[float, float] | None]


def _triangles(p: Parameters) -> _Made:
    points = _points(p)
    if "indices" not in p.items and len(points) == 3 and p.directive.source.dialect.name == "v4":
        faces = np.arange(3, dtype=np.int32)[None]
    else:
        faces = p.indices(len(points))
    normals = p.table("N", "normal", 3)
    uv = p.table("uv", ("float", "point2"), 2)
    st = p.table("st", ("float", "point2"), 2)
    uv = st if uv is None else uv
    for name, table in (("N", normals), ("st" if uv is st else "uv", uv)):
        if table is not None and len(table) != len(points):
            raise p.items[name].token.error(f"each of the {len(points)} points needs one {name}; got {len(table)}")
    return Mesh(points, faces, None if normals is None else geometry.mended(points, faces, normals), uv), None


def _loop(p: Parameters) -> _Made:
    scheme = p.string("scheme", "loop")
    if scheme != "loop":
        raise p.items["scheme"].token.error(f"the scheme of subdivision must be loop; got {scheme!r}")
    points = _points(p)
    names = p.directive.source.dialect.levels
    levels = p.integer(next((name for name in names if name in p.items), names[0]), 3)
    return geometry.loop_subdivide(points, p.indices(len(points)), levels), None


def _file(p: Parameters) -> _Made:
    name = p.string("filename")
    token = p.items["filename"].token
    if not name.lower().endswith(".ply"):
        raise token.error(f"a plymesh must be a .ply file; got {name!r}")
    with blame(token):
        return geometry.load_mesh(token.file(name)), None


def _sphere(p: Parameters) -> _Made:
    radius = p.number("radius", 1)
    if not radius > 0:
        raise ValueError(f"radius must be positive; got {radius}")
    low, high = sorted((p.number("zmin", -radius), p.number("zmax", radius)))
    phimax = p.number("phimax", 360)
    whole = low <= -radius and high >= radius and phimax == 360
    return geometry.sphere(radius, low, high, phimax), (0.0, radius) if whole else None


def _disk(p: Parameters) -> _Made:
    height, radius = p.number("height", 0), p.number("radius", 1)
    inner, phimax = p.number("innerradius", 0), p.number("phimax", 360)
    return geometry.disk(height, radius, inner, phimax), (height, radius) if inner == 0 and phimax == 360 else None


def _cylinder(p: Parameters) -> _Made:
    low, high = sorted((p.number("zmin", -1), p.number("zmax", 1)))
    return geometry.cylinder(p.number("radius", 1), low, high, p.number("phimax", 360)), None


def _bilinear(p: Parameters) -> _Made:
    """Parallelograms, each as two triangles; other bilinear patches are curved, or have uv that triangles have not."""
    points = _points(p)
    table = p.table("indices", "integer", 4)
    if table is None and len(points) != 4:
        raise p.missing("indices", "integer")
    quads = np.arange(4)[None] if table is None else table.astype(np.int64)
    if quads.min() < 0 or quads.max() >= len(points):
        raise p.items["indices"].token.error(f"indices must be from 0 to {len(points) - 1}, the last point")
    p.refuse("N", "normals of a bilinearmesh are not supported; use a trianglemesh")
    corners = points[quads]
    gap = corners[:, 0] + corners[:, 3] - corners[:, 1] - corners[:, 2]
    if not np.allclose(gap, 0, atol=1e-6 * np.abs(corners - corners[:, :1]).max()):
        raise p.items["P"].token.error("the patches of a bilinearmesh must be parallelograms; others are not supported")
    uv = p.table("uv", ("float", "point2"), 2)
    if uv is not None and len(uv) != len(points):
        raise p.items["uv"].token.error(f"each of the {len(points)} points needs one uv; got {len(uv)}")
    uvs = (
        np.tile([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], (len(quads), 1)) if uv is None else uv[quads.ravel()]
    )
    bent = uvs[0::4] + uvs[3::4] - uvs[1::4] - uvs[2::4]
    if not np.allclose(bent, 0, atol=1e-6 * max(1.0, float(np.abs(uvs).max()))):
        raise p.items["uv"].token.error("the uv of each patch of a bilinearmesh must be a parallelogram, too")
    faces = (4 * np.arange(len(quads))[:, None, None] + [[0, 1, 3], [0, 3, 2]]).reshape(-1, 3)
    return Mesh(corners.reshape(-1, 3), faces.astype(np.int32), None, uvs), None


_SHAPES: dict[str, Callable[[Parameters], _Made]] = {
    "trianglemesh": _triangles,
    "plymesh": _file,
    "loopsubdiv": _loop,
    "sphere": _sphere,
    "disk": _disk,
    "cylinder": _cylinder,
    "bilinearmesh": _bilinear,
}
_QUADRICS = ("sphere", "disk", "cylinder")


def _points(p: Parameters) -> Floats:
    points = p.table("P", "point", 3)
    if points is None:
        raise p.missing("P", "point")
    return points


# Parts ------------------------------------------------------------------------------------------------------------


def make_light_part(shape: Shape, material: Material, radiance: Rgb) -> tuple[Part, AreaLight]:
    """The part and the light of a shape that emits on one side, and the winding that says so.

    That side is the one on which pbrt samples the light: see `_bright`.
    """
    with blame(shape.token):
        mesh = shape.mesh.transformed(shape.to_world)
        mesh = _flipped(mesh, np.broadcast_to(_bright(mesh, shape), len(mesh.faces)))
        light = _light(shape, mesh, radiance)
    return Part(mesh, material, light), light


def areas(shape: Shape) -> Floats:
    """Areas in world space of what pbrt-v4 makes a light of: one of a sphere, disk or cylinder, else each triangle."""
    mesh = shape.mesh.transformed(shape.to_world)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    each = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    factor = similarity(shape.to_world)
    if shape.kind in _QUADRICS and shape.size is not None and factor is not None:
        return np.array([np.pi * (shape.size[1] * factor) ** 2 * (4 if shape.kind == "sphere" else 1)])
    if shape.kind == "bilinearmesh":
        return each[0::2] + each[1::2]
    return each.sum(keepdims=True) if shape.kind in _QUADRICS else each


def _bright(mesh: Mesh, shape: Shape) -> bool | np.ndarray:
    """Which faces of a mesh in world space must be turned so that their winding shows the side that emits.

    Disks, spheres and cylinders emit along their normal. Triangles do along their winding in world space (v2), or in
    object space (v3, v4), unless they have vertex normals, whose side it is then (v3, v4). ReverseOrientation turns
    all of them.
    """
    dialect, mirrored = shape.token.source.dialect.name, _mirrors(shape.to_world)
    if shape.kind in _QUADRICS:
        if mirrored and dialect != "v2":
            raise ValueError(f"a mirrored {shape.kind} that emits shines on both sides in {dialect}; do not mirror it")
        return shape.reverse != mirrored
    if dialect == "v2":
        return shape.reverse
    if mesh.normals is None:
        return shape.reverse != mirrored
    if dialect == "v3" and shape.reverse != mirrored:
        raise ValueError("a mesh with normals that emits and is turned shines on both sides in v3; remove its normals")
    return _against_normals(mesh) != (shape.reverse and dialect == "v4")


def _against_normals(mesh: Mesh) -> np.ndarray:
    """Which faces (F,) are wound against their vertex normals."""
    assert mesh.normals is not None
    flat = geometry.flat_normals(mesh.vertices, mesh.faces)
    return np.asarray(np.einsum("fkc,fc->f", mesh.normals[mesh.faces], flat) < 0)


def _light(shape: Shape, mesh: Mesh, radiance: Rgb) -> AreaLight:
    if shape.kind in ("disk", "sphere"):
        if shape.size is None:
            raise ValueError(f"a {shape.kind} that emits must be whole, because pbrt-v2 samples it as if it were")
        factor = similarity(shape.to_world)
        if factor is None:
            raise ValueError(f"a {shape.kind} that emits must not be stretched; scale all axes alike, or use a mesh")
        height, radius = shape.size
        linear, origin = shape.to_world[:3, :3], shape.to_world[:3, 3]
        centre = _triple(linear @ [0, 0, height] + origin)
        if shape.kind == "disk":
            normal = linear[:, 2] * (-1 if shape.reverse else 1)
            return DiskLight(centre, _triple(normal), radius * factor, radiance)
        if not shape.reverse:
            return SphereLight(centre, radius * factor, radiance)
    edges = _parallelogram(mesh)
    if edges is not None:
        return QuadLight(_triple(edges[0]), _triple(edges[1]), _triple(edges[2]), radiance)
    return MeshLight(mesh.vertices, mesh.faces, radiance)


def _parallelogram(mesh: Mesh) -> Floats | None:
    """Corner and two edges (3, 3) of two triangles that make a parallelogram with one normal, else None."""
    if len(mesh.faces) != 2:
        return None
    first, second = mesh.vertices[mesh.faces]
    scale = np.ptp(mesh.vertices, axis=0).max()
    for k in range(3):
        corner, a, b = np.roll(first, -k, axis=0)
        # the other triangle is (b, a, a + b - corner) or a rotation of it
        for j in range(3):
            if np.allclose(np.roll(second, -j, axis=0), [b, a, a + b - corner], rtol=0, atol=1e-6 * scale):
                return np.stack([corner, a - corner, b - corner])
    return None


def merge(shapes: Iterable[tuple[Shape, Material]]) -> list[Part]:
    """Parts of the shapes that do not emit: one for each material and kind of mesh, in order."""
    by_material: dict[int, list[tuple[Shape, Material]]] = {}
    for shape, material in shapes:
        by_material.setdefault(id(material), []).append((shape, material))
    parts = []
    for members in by_material.values():
        material = members[0][1]
        kinds: dict[tuple[bool, bool], list[Mesh]] = {}
        for _, run in groupby((shape for shape, _ in members), key=_sameness):
            mesh = _join(list(run), _has_sides(material))
            kinds.setdefault((mesh.normals is None, mesh.uv is None), []).append(mesh)
        parts += [Part(geometry.concatenate(meshes), material) for meshes in kinds.values()]
    return parts


def _sameness(shape: Shape) -> tuple[object, ...]:
    """Equal for shapes whose meshes can be joined before they are moved to the world."""
    mesh = shape.mesh
    sides = shape.reverse, shape.mirrored, shape.kind in _QUADRICS
    return id(shape.to_world), mesh.normals is None, mesh.uv is None, *sides


def _join(shapes: list[Shape], sides: bool) -> Mesh:
    """One mesh in world space of shapes that are the same in `_sameness`."""
    shape = shapes[0]
    with blame(shape.token):
        mesh = shape.mesh if len(shapes) == 1 else geometry.concatenate([s.mesh for s in shapes])
        mesh = mesh.transformed(shape.to_world)
    return _outside(mesh, shape) if sides else mesh


def _has_sides(material: Material) -> bool:
    """Whether the material is different inside and outside."""
    return any(
        isinstance(lobe, SpecularTransmission | RoughTransmission | RoughReflection)
        or (isinstance(lobe, SpecularReflection) and isinstance(lobe.fresnel, Dielectric))
        for lobe in material.lobes
    )


def _outside(mesh: Mesh, shape: Shape) -> Mesh:
    """Wind a mesh in world space so that its normals are on the side that pbrt takes for the outside.

    That is the side of the vertex normals of triangles, if there are any, else the winding, or in v2 dp/du x dp/dv: the
    winding's opposite where texture coordinates are mirrored. ReverseOrientation changes it, and so does a transform
    that changes handedness, except for vertex normals in v4.
    """
    dialect = shape.token.source.dialect.name
    turned = shape.mirrored
    flip = np.zeros(len(mesh.faces), bool)
    if shape.kind in _QUADRICS or mesh.normals is None:
        turned = _mirrors(shape.to_world)
    if shape.kind in _QUADRICS:
        if turned and dialect != "v2":
            raise shape.token.error(f"a mirrored {shape.kind} of glass is inside out in {dialect}; do not mirror it")
    elif mesh.normals is not None:
        flip = _against_normals(mesh)
        turned = turned and dialect != "v4"
    elif mesh.uv is not None and dialect == "v2":
        a, b, c = (mesh.uv[mesh.faces[:, k]] for k in range(3))
        (u1, v1), (u2, v2) = (b - a).T, (c - a).T
        flip = u1 * v2 - u2 * v1 < 0
    return _flipped(mesh, flip != (shape.reverse != turned))


def _flipped(mesh: Mesh, flip: np.ndarray) -> Mesh:
    """The mesh with the faces `flip` (F,) bool wound the other way, and the same texture coordinates everywhere."""
    if not flip.any():
        return mesh
    if mesh.uv is None:  # the default is by corner, and the corners change
        corner = mesh.faces.ravel()
        normals = None if mesh.normals is None else mesh.normals[corner]
        faces = np.arange(len(corner), dtype=np.int32).reshape(-1, 3)
        mesh = Mesh(mesh.vertices[corner], faces, normals, np.tile(_CORNER_UV, (len(mesh.faces), 1)))
    return replace(mesh, faces=np.where(flip[:, None], mesh.faces[:, [0, 2, 1]], mesh.faces))


def _mirrors(matrix: Floats) -> bool:
    return bool(np.linalg.det(matrix[:3, :3]) < 0)


def _triple(values: Floats) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
