"""Parts of a scene and area lights made of pbrt's shapes: the outside of their meshes, and their bright side.

Shapes that do not emit are joined by material into one mesh per kind (flat or smooth, with or without texture
coordinates), so that files of thousands of small shapes make few parts.

The side that a mesh's winding calls outside matters only to materials that differ by side, such as glass and pbrt-v3's
``plastic``, and to lights. Both follow pbrt, by the rules in `_outside` and `_bright`. Triangles of pbrt-v3 are those
of its last version: ReverseOrientation turns vertex normals that a ray hits, a mirroring transform does not.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, is_dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dmis.base.color import Rgb
from dmis.base.vectors import Floats
from dmis.brdf.distributions import Anisotropic, Elliptic
from dmis.brdf.materials import Material
from dmis.brdf.texture import Image
from dmis.formats.pbrt.lights import scale_of
from dmis.formats.pbrt.parameters import rgb
from dmis.formats.pbrt.pbrt_shapes import Shape, mirrors
from dmis.formats.pbrt.tokens import blame
from dmis.geometry.mesh import Mesh, concatenate, flat_normals
from dmis.light.area import DiskLight, QuadLight, SphereLight
from dmis.light.light import AreaLight
from dmis.scene.groups import Part

if TYPE_CHECKING:
    from dmis.scene.masks import Mask

_CORNER_UV = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
"""Texture coordinates at the corners of each triangle of a mesh that has none."""


def make_light_part(shape: Shape, material: Material, radiance: Rgb) -> tuple[Part, AreaLight]:
    """Return the part and the area light of a shape that emits, wound so that its outside is the bright side.

    That side is the one on which pbrt samples the light: see `_bright`.
    """
    if shape.mask is not None:
        raise shape.token.error(
            "a shape that emits must not have alpha, because the light is sampled without its holes"
        )
    with blame(shape.token):
        mesh = shape.mesh.transformed(shape.to_world)
        bright = np.broadcast_to(_bright(mesh, shape), len(mesh.faces))
        if _has_sides(material) and (_outside(mesh, shape) != bright).any():
            raise ValueError(
                f"in v2 this {shape.kind} emits on the inner side of its {material.name}, which is not supported; "
                "give it a material without an inside, such as matte"
            )
        mesh = _flipped(mesh, bright, material)
        light = _light(shape, mesh, radiance)
    return Part(mesh, _with_relief(material, shape.quadric is not None), light), light


def _bright(mesh: Mesh, shape: Shape) -> bool | np.ndarray:
    """Return the faces of a mesh in world space, as a mask, that must be turned so that their outside emits.

    Disks, spheres and cylinders emit along their normal. Triangles do along their winding in world space (v2), or in
    object space (v3, v4), unless they have vertex normals, whose side it is then (v3, v4). ReverseOrientation turns
    all of them; but in v3 vertex normals only where a ray hits them, and not where the light is sampled.
    """
    dialect, mirrored = shape.token.dialect, mirrors(shape.to_world)
    if shape.quadric is not None:
        if mirrored and dialect != "v2" and not shape.twosided:
            raise ValueError(f"a mirrored {shape.kind} that emits shines on both sides in {dialect}; do not mirror it")
        return shape.reverse != mirrored
    if dialect == "v2":
        return shape.reverse
    if mesh.normals is None:
        return shape.reverse != mirrored
    if dialect == "v3" and shape.reverse and not shape.twosided:
        raise ValueError(
            "a mesh with normals that emits and is turned shines on both sides in v3; "
            "remove ReverseOrientation, and turn the normals (of a loopsubdiv: the winding) if the other side is meant"
        )
    return _against_normals(mesh) != shape.reverse


def _against_normals(mesh: Mesh) -> np.ndarray:
    """Return whether each face is wound against its vertex normals, (F,)."""
    assert mesh.normals is not None
    flat = flat_normals(mesh.vertices, mesh.faces)
    return np.asarray(np.einsum("fkc,fc->f", mesh.normals[mesh.faces], flat) < 0)


def _light(shape: Shape, mesh: Mesh, radiance: Rgb) -> AreaLight:
    """Return the area light of a shape whose mesh in world space is `mesh`: a disk, a sphere, a quad or triangles."""
    if shape.quadric is not None and shape.kind != "cylinder":
        *aside, height = shape.quadric.at(np.zeros((1, 1)), np.ones((1, 1)))[0][0, 0]
        half = shape.kind == "sphere" and shape.quadric.arc < np.pi
        if half or shape.quadric.phimax < 360 or np.hypot(*aside) > 1e-9 * shape.quadric.radius:
            raise ValueError(f"a {shape.kind} that emits must be whole, because pbrt-v2 samples it as if it were")
        factor = scale_of(shape.to_world, f"a {shape.kind} that emits", "it is sampled as if it were round")
        radius = shape.quadric.radius * factor
        linear, origin = shape.to_world[:3, :3], shape.to_world[:3, 3]
        if shape.kind == "disk":
            normal = linear[:, 2] * (-1 if shape.reverse else 1)
            return DiskLight(rgb(linear @ [0, 0, height] + origin), rgb(normal), radius, radiance)
        if not shape.reverse:
            return SphereLight(rgb(origin), radius, radiance)
    edges = _parallelogram(mesh)
    if edges is not None:
        corner, u, v = map(rgb, edges)
        return QuadLight(corner, u, v, radiance)
    from dmis.light.mesh_light import MeshLight

    return MeshLight(mesh.vertices, mesh.faces, radiance)


def _parallelogram(mesh: Mesh) -> Floats | None:
    """Return the corner and two edges (3, 3) of two triangles that make a parallelogram with one normal, else None."""
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
    """Return the parts of shapes that do not emit: one for each material, mask and kind of mesh, in order."""
    groups: dict[tuple[object, ...], tuple[Material, Mask | None, list[Mesh]]] = {}
    for shape, material in shapes:
        mesh = _placed(shape, material)
        curved = shape.quadric is not None and material.relief is not None
        mask = None if shape.mask is None else id(shape.mask.image)
        key = id(material), curved, mesh.normals is None, mesh.uv is None, mask
        groups.setdefault(key, (_with_relief(material, curved), shape.mask, []))[2].append(mesh)
    order = {number: k for k, number in enumerate(dict.fromkeys(number for number, *_ in groups))}
    parts = (groups[key] for key in sorted(groups, key=lambda key: order[key[0]]))
    return [Part(concatenate(meshes), material, mask=mask) for material, mask, meshes in parts]


def _with_relief(material: Material, curved: bool) -> Material:
    """Return the material; on a quadric (`curved`) its bump map keeps dp/du and dp/dv, as in all versions of pbrt."""
    if not curved or material.relief is None:
        return material
    from dmis.brdf.relief import BumpMap  # loaded already

    relief = material.relief
    return replace(material, relief=replace(relief, unit_tangents=None)) if isinstance(relief, BumpMap) else material


def _placed(shape: Shape, material: Material) -> Mesh:
    """Return the mesh of a shape in world space, wound as its material needs it."""
    with blame(shape.token):
        mesh = shape.mesh.transformed(shape.to_world)
    if not _has_sides(material):
        return mesh
    dialect = shape.token.dialect
    mirrored = mirrors(shape.to_world) and shape.quadric is not None and dialect != "v2"
    if mirrored and any(lobe.transmissive for lobe in material.lobes):
        raise shape.token.error(f"a mirrored {shape.kind} of glass is inside out in {dialect}; do not mirror it")
    return _flipped(mesh, _outside(mesh, shape), material)


def _has_sides(material: Material) -> bool:
    """Return whether a material differs between its inside and its outside."""
    return material.relief is not None or any(lobe.has_sides() for lobe in material.lobes)


def _outside(mesh: Mesh, shape: Shape) -> np.ndarray:
    """Return whether each face (F,) of a mesh in world space must be turned so that its winding shows pbrt's outside.

    That is the side of the vertex normals of triangles, if there are any, else the winding, or in v2 dp/du x dp/dv: the
    winding's opposite where texture coordinates are mirrored. ReverseOrientation changes it, and in v2 a transform that
    changes handedness does so, too, if there are vertex normals. Disks, spheres and cylinders have the outside of their
    normals, turned by ReverseOrientation, and in v3 and v4 by a shape's transform that changes handedness.
    """
    early, mirrored = shape.token.dialect == "v2", mirrors(shape.to_world)
    if shape.quadric is not None:
        return np.full(len(mesh.faces), shape.reverse != (mirrored != (shape.mirrored and not early)))
    if mesh.normals is not None:
        return _against_normals(mesh) != (shape.reverse != (shape.mirrored and early))
    flip = np.full(len(mesh.faces), shape.reverse != mirrored)
    if mesh.uv is not None and early:
        a, b, c = (mesh.uv[mesh.faces[:, k]] for k in range(3))
        (u1, v1), (u2, v2) = (b - a).T, (c - a).T
        flip ^= u1 * v2 - u2 * v1 < 0
    return flip


def _flipped(mesh: Mesh, flip: np.ndarray, material: Material) -> Mesh:
    """Return the mesh with the faces `flip` (F,) bool wound the other way, and the same texture coordinates everywhere.

    Default coordinates, which are by corner, are written down only for a material that reads them: three vertices for
    each triangle take twice the time and memory of a large mesh.
    """
    if not flip.any():
        return mesh
    if mesh.uv is None and (material.relief is not None or any(_oriented(lobe) for lobe in material.lobes)):
        corner = mesh.faces.ravel()
        normals = None if mesh.normals is None else mesh.normals[corner]
        faces = np.arange(len(corner), dtype=np.int32).reshape(-1, 3)
        mesh = Mesh(mesh.vertices[corner], faces, normals, np.tile(_CORNER_UV, (len(mesh.faces), 1)))
    return replace(mesh, faces=np.where(flip[:, None], mesh.faces[:, [0, 2, 1]], mesh.faces))


def _oriented(value: object) -> bool:
    """Return whether a lobe, or the data nested in it, needs texture coordinates, or tangents derived from them."""
    if isinstance(value, Image | Anisotropic | Elliptic):
        return True
    return is_dataclass(value) and any(_oriented(getattr(value, field.name)) for field in fields(value))
