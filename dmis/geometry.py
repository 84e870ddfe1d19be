"""Where meshes come from: files through trimesh, bicubic Bézier patches, the quadrics of pbrt; and what moves them.

Everything that a ray can hit is in the end a `Mesh` in world space (`dmis.mesh`); subdivision surfaces are made in
`dmis.subdivision`. Of pbrt only the meaning of its transforms and shape parameters is kept here, so that a number in a
scene file is a number here. Angles are degrees.
"""

from __future__ import annotations

import io
import json
import os
import struct
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from dmis.checks import whole
from dmis.mesh import Floats, direction, positive, vector, weld
from dmis.mesh import Mesh as Mesh
from dmis.mesh import concatenate as concatenate
from dmis.mesh import flat_normals as flat_normals
from dmis.mesh import vertex_normals as vertex_normals
from dmis.subdivision import MAX_TRIANGLES as MAX_TRIANGLES
from dmis.subdivision import loop_subdivide as loop_subdivide

if TYPE_CHECKING:
    import trimesh

FORMATS = (".glb", ".obj", ".ply", ".stl")
"""Extensions that :func:`load_mesh` reads."""
MAX_BYTES = 2**31
"""Largest mesh file."""
MAX_FACES = 2**25
"""Most triangles of a mesh file, all instances counted."""


def from_trimesh(mesh: trimesh.Trimesh | trimesh.Scene) -> Mesh:
    """Take the arrays out of a trimesh object; the parts of a scene are placed by its graph and joined.

    Normals are taken if the object has some: from its file, or because they were asked for, since trimesh makes up
    missing ones on demand and keeps them. `load_mesh` has those of the file only. Parts that the graph mirrors keep
    their outside, as glTF wants it. ValueError if there are no triangles.
    """
    import trimesh

    if isinstance(mesh, trimesh.Scene):
        sizes = {name: len(getattr(part, "faces", ())) for name, part in mesh.geometry.items()}
        if sum(sizes[mesh.graph[node][1]] for node in mesh.graph.nodes_geometry) > MAX_FACES:
            raise ValueError(f"mesh must have at most {MAX_FACES} triangles, because instances are copied")
        parts = []
        for node in mesh.graph.nodes_geometry:
            matrix, name = mesh.graph[node]
            if isinstance(mesh.geometry[name], trimesh.Trimesh):
                part = from_trimesh(mesh.geometry[name]).transformed(matrix)
                mirrored = np.linalg.det(matrix[:3, :3]) < 0
                parts.append(Mesh(part.vertices, part.faces[:, ::-1], part.normals, part.uv) if mirrored else part)
        if not parts:
            raise ValueError("mesh must hold triangles, because only they can be hit; got a scene without any")
        return concatenate(parts)
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise ValueError(f"mesh must be a trimesh.Trimesh with faces, or a Scene of them; got {mesh!r}")
    vertices, faces, normals = np.asarray(mesh.vertices), np.asarray(mesh.faces), None
    if "vertex_normals" in mesh._cache:
        normals = mended(vertices, faces, np.array(mesh.vertex_normals))
    return Mesh(vertices, faces, normals, getattr(mesh.visual, "uv", None))


def mended(vertices: Floats, faces: npt.NDArray[Any], normals: Floats) -> Floats:
    """`normals` with those of the faces in place of zeros and NaN, which exporters write at a loss; on the side of the
    others.
    """
    lost = np.asarray(~(np.isfinite(normals).all(axis=1) & normals.any(axis=1)))[:, None]
    if not lost.any():
        return normals
    known = np.where(lost, 0, normals)
    against = np.einsum("fkc,fc->f", known[faces], flat_normals(vertices, faces)) < 0
    return np.where(lost, vertex_normals(vertices, np.where(against[:, None], faces[:, ::-1], faces)), normals)


def load_mesh(path: str | os.PathLike[str], smooth: bool | None = None) -> Mesh:
    """Read a GLB, OBJ, PLY or STL file.

    Parameters
    ----------
    path
        The file; its extension names the format.
    smooth
        None: shading normals if the file has them. True: if it has none, make them, averaged over all faces that meet
        at a *position* (in STL no two faces share a vertex). False: leave them out.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the extension is unknown, or the file cannot be read or holds no triangles. Both messages name the file.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(f"mesh file {path} must have one of the extensions {' '.join(FORMATS)}; got {suffix!r}")
    if not path.is_file():
        raise FileNotFoundError(f"mesh file {path} does not exist")
    import trimesh

    try:
        data = _bytes(path)
        if suffix == ".glb":
            _check_accessors(data)
        if suffix == ".ply":  # names that trimesh does not know
            header, end, rest = data.partition(b"end_header")
            data = header.replace(b" texture_s", b" s").replace(b" texture_t", b" t") + end + rest
        # It may name other files, anywhere. Given bytes alone, trimesh does not know where they would be
        bare: dict[str, Any] = {"skip_materials": True} if suffix == ".ply" else {}  # an image
        with np.errstate(all="ignore"):  # what is not finite is refused below
            loaded: Any = trimesh.load(
                io.BytesIO(data), file_type=suffix[1:], process=False, **bare
            )  # process=True would merge and reorder vertices
            mesh = from_trimesh(loaded)
    except Exception as error:  # whatever trimesh's readers meet comes through
        reason = "it is empty" if path.stat().st_size == 0 else f"{type(error).__name__}: {error}"
        if isinstance(error, ImportError):  # which it would guess other encodings with
            reason = "it is neither binary nor text of the format"
        raise ValueError(f"mesh file {path} cannot be read as {suffix[1:].upper()}: {reason}") from error
    if smooth is None or smooth == (mesh.normals is not None):
        return mesh
    normals = None
    if smooth:
        same = weld(mesh.vertices)
        normals = vertex_normals(mesh.vertices, same[mesh.faces])[same]
    return Mesh(mesh.vertices, mesh.faces, normals, mesh.uv)


def _bytes(path: Path) -> bytes:
    if path.stat().st_size > MAX_BYTES:
        raise ValueError(f"a mesh file must have at most {MAX_BYTES} bytes; it has {path.stat().st_size}")
    return path.read_bytes()


def _check_accessors(data: bytes) -> None:
    """Refuse a GLB file that asks for more elements than it has bytes; what it leaves out would be made of zeros."""
    (length,) = struct.unpack_from("<I", data, 12)
    accessors = json.loads(data[20 : 20 + length]).get("accessors", [])
    if most := [a["count"] for a in accessors if not 0 <= a["count"] <= len(data)]:
        raise ValueError(f"it has {len(data)} bytes, and an array of {most[0]} elements")


# Transforms: 4x4 matrices that act on columns (x, y, z, 1)


def translate(offset: npt.ArrayLike) -> Floats:
    """Matrix that moves by `offset` (3,)."""
    m = np.eye(4)
    m[:3, 3] = vector("offset", offset)
    return m


def scale(factors: npt.ArrayLike) -> Floats:
    """Matrix that scales x, y, z by `factors`, three numbers or one for all."""
    factors = np.asarray(factors, np.float64)
    return np.diag([*vector("factors", np.full(3, factors) if factors.ndim == 0 else factors), 1.0])


def rotate(degrees: float, axis: npt.ArrayLike) -> Floats:
    """Matrix that turns about `axis` (3,), from x to y about z if `degrees` are positive."""
    x, y, z = a = direction("axis", axis)
    sin, cos = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    m = np.eye(4)
    m[:3, :3] = cos * np.eye(3) + (1 - cos) * np.outer(a, a) + sin * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return m


def look_at(eye: npt.ArrayLike, at: npt.ArrayLike, up: npt.ArrayLike) -> Floats:
    """Matrix from world to camera, pbrt's ``LookAt``; camera space is x right, y up, z forward: left-handed.

    The columns of its inverse are x = up x z, y = z x x, z = at - eye, all of unit length, and the eye.
    """
    origin = vector("eye", eye)
    z = direction("at - eye", vector("at", at) - origin)
    x = np.cross(direction("up", up), z)
    if np.linalg.norm(x) < 1e-9:
        raise ValueError(f"up must not be parallel to the line of sight {z.tolist()}; got {up!r}")
    x /= np.linalg.norm(x)
    m = np.eye(4)
    m[:3, :3] = x, np.cross(z, x), z
    m[:3, 3] = -m[:3, :3] @ origin
    return m


# Normals


def bezier_patches(control: npt.ArrayLike, divisions: int = 16) -> Mesh:
    """Tessellate bicubic Bézier patches, with analytic normals.

    Parameters
    ----------
    control
        Control points of P patches, (P, 4, 4, 3). u runs along axis 1, v along axis 2, and dp/du x dp/dv is outside.
    divisions
        Quads along a side of a patch, >= 1.

    Returns
    -------
    Mesh
        P·2·divisions² triangles, less those without area; uv are each patch's (u, v). Patches that share a boundary
        curve share its points to the last bit. Where a tangent vanishes, at a pole, the normal is the limit inside.
    """
    net = np.asarray(control, np.float64)
    if net.ndim != 4 or net.shape[1:] != (4, 4, 3) or not len(net) or not np.isfinite(net).all():
        raise ValueError(f"control must be finite, of shape (P, 4, 4, 3), P >= 1, 16 points a patch; got {net.shape}")
    t = np.linspace(0, 1, whole("divisions", divisions, 1) + 1)
    cubic = np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]])  # Bernstein, row i for t^i
    power = np.vander(t, 4, increasing=True)
    basis = power @ cubic, power[:, :3] @ (cubic[1:] * [[1], [2], [3]]), power[:, :2] @ (cubic[2:] * [[2], [6]])

    def derivative(i: int, j: int) -> Floats:
        return np.einsum("ui,vj,pijk->puvk", basis[i], basis[j], net, optimize=True)

    pu, pv, puv = derivative(1, 0), derivative(0, 1), derivative(1, 1)
    normal = np.cross(pu, pv)
    # Where that vanishes, the direction in which it grows towards the inside of the patch.
    sign = np.where(t < 0.5, 1.0, -1.0)[:, None]
    growth = sign[:, None] * (np.cross(derivative(2, 0), pv) + np.cross(pu, puv))
    growth += sign * (np.cross(puv, pv) + np.cross(pu, derivative(0, 2)))
    length = np.linalg.norm(normal, axis=3, keepdims=True)
    least = 1e-9 * length.max(axis=(1, 2), keepdims=True)
    normal = np.where(length > least, normal, growth)
    normal[np.linalg.norm(normal, axis=3) <= least[..., 0]] = 0
    return _grid(derivative(0, 0), normal, np.stack(np.broadcast_arrays(t[:, None], t), axis=2))


def sphere(
    radius: float = 1,
    zmin: float | None = None,
    zmax: float | None = None,
    phimax: float = 360,
    segments: int = 256,
) -> Mesh:
    """The part of a sphere about the origin between heights `zmin` and `zmax`, up to azimuth `phimax`; normals out.

    `segments` quads go around a full circle. The heights default to the poles and are clamped to them. uv are pbrt's:
    azimuth, and polar angle from `zmin` to `zmax`.
    """
    low, high = -positive("radius", radius) if zmin is None else zmin, radius if zmax is None else zmax
    bottom, top = (np.arccos(np.clip(z / radius, -1, 1)) for z in (low, high))
    if not bottom > top:
        raise ValueError(f"zmin must be below zmax on a sphere of radius {radius}, else it is empty; got {low}, {high}")
    phi, uv = _sweep(phimax, segments, max(1, whole("segments", segments, 3) // 2))
    theta = bottom + uv[..., 1] * (top - bottom)
    normal = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=2)
    return _grid(radius * normal, normal, uv)


def cylinder(radius: float = 1, zmin: float = -1, zmax: float = 1, phimax: float = 360, segments: int = 256) -> Mesh:
    """An open cylinder about the z axis, up to azimuth `phimax`; normals outwards; uv are pbrt's: azimuth, height."""
    positive("radius", radius)
    if not zmin < zmax:
        raise ValueError(f"zmin must be below zmax, else the cylinder is empty; got {zmin}, {zmax}")
    phi, uv = _sweep(phimax, segments, 1)
    normal = np.stack([np.cos(phi), np.sin(phi), 0 * phi], axis=2)
    return _grid(radius * normal + [0, 0, zmin] + [0, 0, zmax - zmin] * uv[..., 1:], normal, uv)


def disk(
    height: float = 0, radius: float = 1, innerradius: float = 0, phimax: float = 360, segments: int = 256
) -> Mesh:
    """A flat disk or ring at z = `height`, up to azimuth `phimax`; normal +z; uv are pbrt's: azimuth, rim to centre."""
    if not 0 <= innerradius < positive("radius", radius):
        raise ValueError(f"innerradius must be at least 0 and less than the radius {radius}; got {innerradius}")
    phi, uv = _sweep(phimax, segments, 1)
    r = radius + uv[..., 1] * (innerradius - radius)
    return _grid(np.stack([r * np.cos(phi), r * np.sin(phi), 0 * r + height], axis=2), None, uv)


def quad(corner: npt.ArrayLike, u: npt.ArrayLike, v: npt.ArrayLike) -> Mesh:
    """A flat parallelogram with sides `u`, `v` (3,) from `corner` (3,); normal u x v; uv (1, 1) is opposite."""
    corner, u, v = vector("corner", corner), vector("u", u), vector("v", v)
    direction("u x v", np.cross(u, v))
    uv = np.array([[[0.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [1.0, 1.0]]])
    return _grid(corner + uv[..., :1] * u + uv[..., 1:] * v, None, uv)


def _sweep(phimax: float, segments: int, rows: int) -> tuple[Floats, Floats]:
    """Azimuth (A, B) in radians and uv (A, B, 2) of a grid turned about the z axis."""
    if not 0 < phimax <= 360:
        raise ValueError(f"phimax must be above 0 and at most 360 degrees; got {phimax}")
    columns = int(np.ceil(whole("segments", segments, 3) * phimax / 360))
    uv = np.stack(np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1), indexing="ij"), axis=2)
    return np.radians(phimax) * uv[..., 0], uv


def _grid(points: Floats, normals: Floats | None, uv: Floats) -> Mesh:
    """Triangulate a grid of points (A, B, 3), or P of them (P, A, B, 3); outside is the first axis times the second.

    Points equal up to rounding become equal, so that nothing shines through; triangles that lose their area are
    dropped. A zero normal is replaced by that of the triangles.
    """
    index = np.arange(points.size // 3).reshape(-1, *uv.shape[:2])
    a, b, c, d = index[:, :-1, :-1], index[:, 1:, :-1], index[:, 1:, 1:], index[:, :-1, 1:]
    faces = np.stack([a, b, c, a, c, d], axis=3).reshape(-1, 3)
    points = points.reshape(-1, 3)
    same = weld(points)
    corner = same[faces]
    faces = faces[(corner != np.roll(corner, 1, axis=1)).all(axis=1)]
    if normals is not None:
        normals = normals.reshape(-1, 3)
        normals = np.where(normals.any(axis=1, keepdims=True), normals, vertex_normals(points, faces))
    return Mesh(points[same], faces, normals, np.tile(uv.reshape(-1, 2), (len(index), 1)))
