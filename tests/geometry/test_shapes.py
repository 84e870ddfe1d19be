"""Meshes: subdivision against what is known of its limit, tessellations against exact normals, files, faults."""

import pickle
import re

import numpy as np
import pytest
import trimesh
from helpers import script, triangle_ply

from dmis.formats import mesh_files
from dmis.formats.mesh_files import from_trimesh, load_mesh, placed_geometries
from dmis.geometry import subdivision
from dmis.geometry.mesh import Mesh, concatenate, flat_normals, vertex_normals
from dmis.geometry.shapes import circular, cylindrical, quad, sphere, spherical
from dmis.geometry.subdivision import loop_subdivide
from dmis.geometry.transforms import look_at, rotate, scale, translate

OCTAHEDRON = (
    np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float),
    np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]),
)
TETRAHEDRON = (
    np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float),
    np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]),
)
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float), np.array([[0, 1, 2]])
ICOSAHEDRON = tuple(np.asarray(a) for a in (lambda m: (m.vertices, m.faces))(trimesh.creation.icosahedron()))


def fan(n: int, height: float = 0.3, angle: float = 360) -> tuple[np.ndarray, np.ndarray]:
    """A cone of n triangles around vertex 0, closed for 360 degrees; then n neighbours, else n + 1."""
    rim = np.radians(np.linspace(0, angle, n + 1))[: n if angle == 360 else n + 1]
    points = np.stack([np.cos(rim), np.sin(rim), 0 * rim], axis=1)
    k = np.arange(n)
    faces = np.stack([0 * k, 1 + k, 1 + (k + 1) % len(rim)], axis=1)
    return np.concatenate([[[0, 0, height]], points]), faces


def patch(n: int = 5, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A bumpy, slightly irregular n x n sheet of quads cut into triangles; it has a boundary."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    points = np.stack([x, y, 0 * x], axis=2).reshape(-1, 3) + rng.uniform(-0.2, 0.2, (n * n, 3))
    index = np.arange(n * n).reshape(n, n)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    return points, np.concatenate([np.stack([a, b, c], 2).reshape(-1, 3), np.stack([a, c, d], 2).reshape(-1, 3)])


def net_of(vertices, faces):
    return subdivision._half_edges(np.asarray(faces, np.int64), len(vertices))


CAGES = {
    "octahedron": OCTAHEDRON,
    "tetrahedron": TETRAHEDRON,
    "icosahedron": ICOSAHEDRON,
    "triangle": TRIANGLE,
    "sheet": patch(),
    **{f"cone{n}": fan(n) for n in (3, 4, 5, 6, 7, 13)},
    **{f"open{n}": fan(n, angle=200) for n in (2, 3, 4, 5, 9)},
}
cages = pytest.mark.parametrize("cage", CAGES.values(), ids=CAGES)


# Mesh


def test_mesh_keeps_contiguous_arrays_and_unit_normals():
    v = np.asfortranarray(np.arange(9.0).reshape(3, 3))
    faces = np.array([[0, 1, 2]], np.int64)[:, ::-1]
    mesh = Mesh(v, faces, normals=np.full((3, 3), 2.0), uv=np.zeros((3, 2), np.float32))
    for array in (mesh.vertices, mesh.faces, mesh.normals, mesh.uv):
        assert array.flags.c_contiguous
    assert (mesh.vertices.dtype, mesh.faces.dtype, mesh.uv.dtype) == (np.float64, np.int32, np.float64)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1)
    assert mesh.triangles == 1
    copy = pickle.loads(pickle.dumps(mesh))
    np.testing.assert_array_equal(copy.faces, mesh.faces)


def test_transformed_keeps_normals_perpendicular():
    """A sphere becomes an ellipsoid, whose normals are known."""
    matrix = translate([1, 2, 3]) @ rotate(30, [1, 2, 3]) @ scale([1, 2, 0.5])
    ball = sphere(segments=32)
    mesh = ball.transformed(matrix)
    exact = ball.vertices / [1, 2, 0.5]  # gradient of x² + y²/4 + 4z² at the point (x, 2y, z/2)
    exact = exact @ matrix_of_turn(30, [1, 2, 3]).T
    np.testing.assert_allclose(mesh.normals, exact / np.linalg.norm(exact, axis=1, keepdims=True), atol=1e-12)
    np.testing.assert_allclose(mesh.vertices, (np.c_[ball.vertices, np.ones(len(ball.vertices))] @ matrix.T)[:, :3])
    assert (agreement(mesh) > 0.9).all()
    mirrored = ball.transformed(scale([-1, 1, 1]))  # faces the other way, with normals that stay
    np.testing.assert_array_equal(mirrored.faces, ball.faces)
    np.testing.assert_allclose(mirrored.normals, mirrored.vertices, atol=1e-12)


def matrix_of_turn(degrees, axis):
    """Rodrigues' formula, vector by vector."""
    k, t = np.asarray(axis) / np.linalg.norm(axis), np.radians(degrees)
    return np.stack([e * np.cos(t) + np.cross(k, e) * np.sin(t) + k * (k @ e) * (1 - np.cos(t)) for e in np.eye(3)], 1)


def agreement(mesh: Mesh) -> np.ndarray:
    """Cosines between the face normals and the normals at the corners, (F, 3)."""
    return (flat_normals(mesh.vertices, mesh.faces)[:, None] * mesh.normals[mesh.faces]).sum(axis=2)


def test_concatenate_mixed():
    smooth, flat = sphere(segments=8), quad([0, 0, 5], [1, 0, 0], [0, 1, 0])
    mesh = concatenate([smooth, Mesh(flat.vertices, flat.faces)])
    assert mesh.triangles == smooth.triangles + 2
    np.testing.assert_allclose(mesh.normals[mesh.faces[-2:]], np.broadcast_to([0, 0, 1], (2, 3, 3)))
    np.testing.assert_allclose(mesh.vertices[mesh.faces[-2:]], flat.vertices[flat.faces])
    assert not mesh.uv[len(smooth.vertices) :].any()
    assert concatenate([flat, flat]).normals is None
    # zero normals in a file are mended
    normals = OCTAHEDRON[0].copy()
    normals[2], normals[3] = 0, np.nan
    thing = trimesh.Trimesh(*OCTAHEDRON, process=False)
    thing.vertex_normals = normals
    np.testing.assert_allclose(from_trimesh(thing).normals, OCTAHEDRON[0], atol=1e-12)


# Transforms


def test_transforms_by_hand():
    p = np.array([1, 2, 3, 1])
    np.testing.assert_allclose(translate([10, 20, 30]) @ p, [11, 22, 33, 1])
    np.testing.assert_allclose(scale([1, 2, 3]) @ p, [1, 4, 9, 1])
    np.testing.assert_allclose(scale(2) @ p, [2, 4, 6, 1])
    np.testing.assert_allclose(rotate(90, [0, 0, 7]) @ p, [-2, 1, 3, 1], atol=1e-12)
    np.testing.assert_allclose(rotate(-90, [1, 0, 0]) @ p, [1, 3, -2, 1], atol=1e-12)
    np.testing.assert_allclose(rotate(50, [1, 2, 3])[:3, :3], matrix_of_turn(50, [1, 2, 3]))
    # look at is left handed
    matrix = look_at([0, 0, 5], [0, 0, 0], [0, 1, 0])
    np.testing.assert_allclose(matrix @ [0, 0, 5, 1], [0, 0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(matrix @ [0, 0, 0, 1], [0, 0, 5, 1], atol=1e-12)  # z is forward
    np.testing.assert_allclose(matrix @ [0, 1, 5, 1], [0, 1, 0, 1], atol=1e-12)  # y is up
    np.testing.assert_allclose(matrix @ [-1, 0, 5, 1], [1, 0, 0, 1], atol=1e-12)  # and x = up x d points to -x
    assert np.linalg.det(matrix) == pytest.approx(1)


# Normals


def test_normals():
    box = trimesh.creation.box()
    normals = vertex_normals(np.asarray(box.vertices), np.asarray(box.faces))
    np.testing.assert_allclose(normals, np.sign(box.vertices) / np.sqrt(3), atol=1e-12)
    # normals ignore faces without area
    v = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [2, 0, 0], [9, 9, 9.0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 1, 2]])
    np.testing.assert_array_equal(flat_normals(v, faces), [[0, -1, 0], [0, 0, 1], [0, 0, 1]])
    np.testing.assert_array_equal(vertex_normals(v, faces), [[0, -1, 0]] * 3 + [[0, 0, 1]] * 2)


# Loop subdivision


@cages
@pytest.mark.parametrize("levels", [0, 1, 3])
def test_loop_counts_and_euler(cage, levels):
    v, f = cage
    mesh = loop_subdivide(v, f, levels)
    assert mesh.triangles == len(f) * 4**levels
    assert len(mesh.vertices) - len(edges_of(mesh.faces)) + mesh.triangles == len(v) - len(edges_of(f)) + len(f)
    assert np.isfinite(mesh.vertices).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1)


def edges_of(faces: np.ndarray) -> np.ndarray:
    """Undirected edges, (E, 2)."""
    return np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)


def test_loop_weights_by_hand():
    """One step of a closed cone of valence 5 and of a single triangle."""
    v, f = fan(5)
    rule, _ = subdivision._refine(net_of(v, f))
    np.testing.assert_allclose(rule.toarray()[0], [5 / 8] + [3 / 40] * 5)
    assert rule.toarray()[1].tolist() == [0, 3 / 4, 1 / 8, 0, 0, 1 / 8]
    spoke = 3 / 8 * (v[0] + v[1]) + 1 / 8 * (v[2] + v[5])
    rim = (v[1] + v[2]) / 2
    for expected in (spoke, rim):
        assert np.isclose((rule @ v)[len(v) :], expected).all(axis=1).sum() == 1
    rule, _ = subdivision._refine(net_of(*fan(3)))
    np.testing.assert_allclose(rule.toarray()[0], [7 / 16] + [3 / 16] * 3)


def test_loop_boundary_is_the_cubic_b_spline():
    """A vertex of a uniform cubic B-spline has its limit at (1, 4, 1)/6; the masks 1/8, 3/4, 1/2 are its refinement."""
    v, f = patch()
    net = net_of(v, f)
    edge = net.twin < 0
    after, before = (np.zeros(len(v), int) for _ in range(2))
    after[net.tail[edge]], before[net.head[edge]] = net.head[edge], net.tail[edge]
    spline = (v[before] + 4 * v + v[after])[net.rim] / 6
    pushed = (v[before] + 3 * v + v[after])[net.rim] / 5  # the mask that pbrt and this library use, 1/5 for 1/6
    np.testing.assert_allclose(loop_subdivide(v, f, 0).vertices[net.rim], pushed, atol=1e-12)
    np.testing.assert_allclose(loop_subdivide(v, f, 6).vertices[: len(v)][net.rim], spline, atol=2e-3)


@cages
def test_loop_limit_points_are_the_same_from_every_level(cage):
    """Inside, that is; the boundary's 1/5 is an approximation that fades with the levels (see above)."""
    v, f = cage
    inside = ~net_of(v, f).rim
    first, *later = (loop_subdivide(v, f, levels).vertices[: len(v)] for levels in range(4))
    for points in later:
        np.testing.assert_allclose(points[inside], first[inside], atol=1e-12)


@pytest.mark.parametrize("cage", [OCTAHEDRON, fan(7, 0.8), patch()], ids=["octahedron", "cone7", "sheet"])
def test_loop_normals_converge_to_those_of_fine_triangles(cage):
    """The same points, seen as ever finer meshes: the masks approach the mean of the tiny faces around."""
    v, f = cage
    gaps = []
    for levels in (2, 4, 6):
        mesh = loop_subdivide(v, f, levels)
        inside = ~net_of(mesh.vertices, mesh.faces).rim
        mean = vertex_normals(mesh.vertices, mesh.faces)
        gaps.append(np.linalg.norm(mesh.normals - mean, axis=1)[inside].max())
        assert (agreement(mesh) > 0).all()
    assert gaps[2] < 0.3 * gaps[0] < 0.1
    boundary = np.linalg.norm(mesh.normals - mean, axis=1)[~inside]
    assert not len(boundary) or np.median(boundary) < 0.05


def test_loop_boundary_tangents_on_a_regular_half_ring():
    """On flat half rings of any valence S runs along the boundary, T inwards, and both ignore where the origin is."""
    masks = subdivision._tangent_masks(9)[1]
    for n in range(2, 10):
        angle = np.pi * np.arange(n) / (n - 1)
        weights = masks[n, :n]
        ring = np.exp(1j * angle)
        s, t = weights.real @ ring, weights.imag @ ring  # complex numbers stand for points of the plane
        assert s == pytest.approx(2)
        if n > 2:  # two neighbours on a straight boundary have nothing inwards
            assert t.real == pytest.approx(0, abs=1e-12) and t.imag > 0.5
    np.testing.assert_array_equal(masks[4, :4].imag, [-1, 2, 2, -1])


# Bézier patches and quadrics


@pytest.fixture(scope="module")
def make_teapot():
    return script("scenes/make_teapot.py")


def test_teapot_file_is_up_to_date(make_teapot):
    mesh, file = make_teapot.bezier_patches(make_teapot.teapot(), make_teapot.DIVISIONS), load_mesh(make_teapot.FILE)
    np.testing.assert_array_equal(file.faces, mesh.faces)
    np.testing.assert_allclose(file.vertices, mesh.vertices, atol=1e-6)
    np.testing.assert_allclose(file.normals, mesh.normals, atol=1e-6)


def test_spheres_and_zones():
    mesh = sphere(2, segments=64)
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 2)
    np.testing.assert_allclose(mesh.normals, mesh.vertices / 2, atol=1e-9)
    assert (agreement(mesh) > 0.99).all()
    _, same = np.unique(mesh.vertices, axis=0, return_inverse=True)
    net = subdivision._half_edges(same.ravel()[mesh.faces].astype(np.int64), int(same.max()) + 1)
    assert (net.twin >= 0).all()  # watertight at the seam and the poles
    # sphere zone
    mesh = spherical(2, -1, 1.5, 90).mesh(64)
    np.testing.assert_allclose([mesh.vertices[:, 2].min(), mesh.vertices[:, 2].max()], [-1, 1.5])
    assert (mesh.vertices[:, :2] > -1e-12).all()
    v0, v1 = np.arccos(-1 / 2), np.arccos(1.5 / 2)
    np.testing.assert_allclose(mesh.vertices[:, 2], 2 * np.cos(v0 + mesh.uv[:, 1] * (v1 - v0)), atol=1e-8)
    x, y, _ = mesh.vertices.T
    np.testing.assert_allclose(np.arctan2(y, x), mesh.uv[:, 0] * np.pi / 2, atol=1e-8)
    np.testing.assert_allclose(spherical(1, -9, 9).mesh(8).vertices, sphere(segments=8).vertices)


def test_cylinder_and_quad():
    mesh = cylindrical(2, -1, 3, 180).mesh(100)
    assert mesh.triangles == 100
    np.testing.assert_allclose(np.hypot(*mesh.vertices[:, :2].T), 2)
    np.testing.assert_allclose(mesh.normals, mesh.vertices / 2 * [1, 1, 0], atol=1e-8)
    np.testing.assert_allclose(mesh.vertices[:, 2], -1 + 4 * mesh.uv[:, 1])
    assert (agreement(mesh) > 0.99).all()
    # quad
    mesh = quad([1, 2, 3], [2, 0, 0], [1, 3, 0])
    assert mesh.triangles == 2 and area_of(mesh).sum() == pytest.approx(6)
    np.testing.assert_allclose(flat_normals(mesh.vertices, mesh.faces), [[0, 0, 1]] * 2)
    np.testing.assert_allclose(mesh.vertices, [1, 2, 3] + mesh.uv @ [[2, 0, 0], [1, 3, 0]])


@pytest.mark.parametrize("inner, phimax", [(0, 360), (0.5, 360), (0, 100), (0.5, 100)])
def test_disk(inner, phimax):
    mesh = circular(3, 2, inner, phimax).mesh()
    np.testing.assert_allclose(flat_normals(mesh.vertices, mesh.faces), np.broadcast_to([0, 0, 1], (mesh.triangles, 3)))
    np.testing.assert_array_equal(mesh.vertices[:, 2], 3)
    np.testing.assert_allclose(area_of(mesh).sum(), np.pi * (4 - inner**2) * phimax / 360, rtol=1e-3)
    r = np.hypot(*mesh.vertices[:, :2].T)
    np.testing.assert_allclose(1 - mesh.uv[:, 1], (r - inner) / (2 - inner), atol=1e-8)
    assert mesh.normals is None


def area_of(mesh: Mesh) -> np.ndarray:
    """Area of each face, (F,)."""
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


# Files


@pytest.mark.parametrize("suffix", sorted({*mesh_files.MESH_SUFFIXES} - {".gltf"}))
@pytest.mark.parametrize("smooth", [True, False])
def test_file_round_trip(tmp_path, suffix, smooth):
    v, f = OCTAHEDRON
    normals = v @ matrix_of_turn(10, [1, 1, 1]).T  # not what trimesh would compute
    path = tmp_path / f"octahedron{suffix}"
    option = {".ply": "vertex_normal", ".obj": "include_normals", ".glb": "include_normals"}.get(suffix)
    thing = trimesh.Trimesh(v, f, vertex_normals=normals if smooth else None, process=False)
    thing.export(path, **({option: smooth} if option else {}))
    mesh = load_mesh(path)
    np.testing.assert_allclose(mesh.vertices[mesh.faces], v[f], atol=1e-6)
    if suffix == ".stl":
        assert mesh.normals is None and len(mesh.vertices) == 3 * len(f)
    else:
        np.testing.assert_array_equal(mesh.faces, f)
        if smooth:
            np.testing.assert_allclose(mesh.normals, normals, atol=1e-6)
        else:
            assert mesh.normals is None
    assert load_mesh(path, smooth=False).normals is None
    mesh = load_mesh(str(path), smooth=True)
    if not smooth or suffix == ".stl":
        np.testing.assert_allclose(mesh.normals, mesh.vertices, atol=1e-6)  # welded: radial by symmetry
    else:
        np.testing.assert_allclose(mesh.normals, normals, atol=1e-6)


def test_scene_graph_is_applied(monkeypatch):
    scene = trimesh.Scene()
    thing = trimesh.Trimesh(*OCTAHEDRON, process=False)
    scene.add_geometry(thing, transform=translate([5, 0, 0]))
    scene.add_geometry(thing, transform=translate([0, 7, 0]) @ scale([-1, 2, 1]))
    scene.add_geometry(trimesh.PointCloud([[0, 0, 0]]))
    mesh = concatenate([from_trimesh(placed) for _, placed in placed_geometries(scene)])
    assert mesh.triangles == 16 and mesh.normals is None
    centre = np.where(np.arange(16)[:, None] < 8, [5, 0, 0], [0, 7, 0])
    outwards = mesh.vertices[mesh.faces].mean(axis=1) - centre
    assert ((flat_normals(mesh.vertices, mesh.faces) * outwards).sum(axis=1) > 0).all()  # the mirrored one too
    np.testing.assert_allclose(mesh.vertices.max(axis=0), [6, 9, 1])
    monkeypatch.setattr("dmis.formats.model.MAX_FACES", 15)
    with pytest.raises(ValueError, match="at most 15 triangles, because instances are copied"):
        placed_geometries(scene)


# Faults

V, F = TRIANGLE
FIVE = np.random.default_rng(1).uniform(size=(5, 3))


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda: Mesh(V[:, :2], F), r"vertices must have shape \(V, 3\); got \(3, 2\)"),
        (lambda: Mesh(V * 1e19, F), r"vertices must be finite, within 1e\+18 of 0, .* in row 1"),
        (lambda: Mesh(V, F + 1), r"faces must be indices from 0 to 2, because there are 3 vertices; got 1 to 3"),
        (lambda: Mesh(V, F[:0]), r"faces must be integers of shape \(F, 3\), F >= 1, .*; got shape \(0, 3\)"),
        (lambda: Mesh(V, F, normals=V), r"normals must not be zero, .* in row 0"),
        (lambda: Mesh(V, F, uv=np.full((3, 2), 1e19)), r"uv must be finite, within 1e\+18 of 0, .* in row 0"),
        (lambda: Mesh(V, F).transformed(np.diag([1, 1, 0, 1])), r"matrix must be invertible, because normals"),
        (lambda: concatenate([]), r"meshes must hold at least one mesh"),
        (lambda: placed_geometries(trimesh.Scene()), r"mesh must hold triangles"),
        (lambda: from_trimesh(trimesh.PointCloud(V)), r"mesh must be a trimesh.Trimesh with faces"),
        (lambda: look_at(V[0], V[0], V[1]), r"the line of sight from eye to target must not be zero"),
        (lambda: look_at(V[0], V[1], V[1]), r"up must not be parallel to the line of sight"),
        (lambda: loop_subdivide(V, F, -1), r"levels must be a whole number of at least 0; got -1"),
        (lambda: loop_subdivide(V, F, 13), r"levels must leave at most 16777216 triangles, .* got 13 for 1 triangles"),
        (lambda: loop_subdivide(V, [[0, 1, 1]], 1), r"three different corners; got \[0, 1, 1\] in face 0"),
        (lambda: loop_subdivide(FIVE, [[0, 1, 2], [1, 0, 3], [0, 1, 4]], 1), r"not so at edge \(0, 1\)"),
        (lambda: loop_subdivide(FIVE, [[0, 1, 2], [0, 3, 4]], 1), r"its ring; got several at vertex 0"),
        (lambda: spherical(1, 2, 3), r"zmin must be below zmax on a sphere of radius 1, .*; got 2, 3"),
        (lambda: spherical(phimax=0), r"phimax must be above 0 and at most 360 degrees; got 0"),
        (lambda: quad(V[0], V[1], V[1]), r"u x v must not be zero"),
    ],
)
def test_faults(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize(
    "name, content, message",
    [
        ("mesh.xyz", b"", r"must have one of the extensions \.glb \.gltf \.obj \.ply \.stl; got '\.xyz'"),
        ("empty.ply", b"", r"cannot be read as PLY"),
        ("cut.glb", b"glTF\2\0\0\0\x40\0\0\0\x08\0\0\0JSON{}  ", r"it is cut off: it must have 64 bytes; it has 24"),
        ("broken.stl", b"\x00" * 90, r"cannot be read as STL"),
        ("other.glb", b'{"asset": {"version": "2.0"}}', r"must be binary glTF of version 2; convert it"),
        ("broken.obj", b"what is this", r"cannot be read as OBJ"),
        ("points.ply", triangle_ply(face=None).encode(), r"cannot be read as PLY"),
        ("fractions.ply", triangle_ply(face="3 0 1.5 2").encode(), r"must hold whole numbers below 3, .*; got 1\.5"),
    ],
)
def test_bad_files(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match=re.escape(str(path)) + ".*" + message):
        load_mesh(path)


def write_ply(path, form, faces, corners, uv=None):
    """Write vertices with a colour, faces with a number behind their list, and an element that is not read."""
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(form)
    head = ["ply", f"format {form} 1.0", "comment element face 9", f"element vertex {len(corners)}"]
    head += [*(f"property double {x}" for x in "xyz"), "property uchar red", f"element face {len(faces)}"]
    head += ["property list ushort float texcoord"] * (uv is not None) + ["property list uchar uint vertex_indices"]
    head += ["property short flags", "element edge 1", "property list int int two", "end_header"]
    rows = [[(corner, "f8"), (7, "u1")] for corner in corners]
    for face in faces:
        lists = [] if uv is None else [(2 * len(face), "u2"), (np.take(uv, face, axis=0).ravel(), "f4")]
        rows.append([*lists, (len(face), "u1"), (face, "u4"), (-3, "i2")])
    rows.append([(2, "i4"), ([0, 1], "i4")])
    if order:
        body = b"".join(np.array(x, order + kind).tobytes() for row in rows for x, kind in row)
    else:
        body = "\n".join(" ".join(map(str, np.hstack([x for x, _ in row]).tolist())) for row in rows).encode()
    path.write_bytes("\n".join([*head, ""]).encode() + body)


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("textured", [False, True])
def test_polygons_of_ply(tmp_path, form, textured):
    """Faces of 3, 4, 5 and 2 corners, one of them concave, cover their areas once; files cut off are refused."""
    arrow = [(2, 0, 0), (0.5, 0.5, 0), (0, 2, 0), (0, 0, 0)]  # its second corner is concave, so that a fan overlaps
    house = [(x, y, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0.5, 2), (0, 1))]
    corners = np.array([*arrow, *house])
    faces = [[0, 1, 2, 3], [4, 5, 6], [4, 5, 6, 7, 8], [0, 1], [8, 5, 6]]
    path = tmp_path / "a.ply"
    write_ply(path, form, faces, corners, corners[:, :2] / 2 if textured else None)
    mesh = load_mesh(path)
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    areas = np.cross(b - a, c - a)[:, 2] / 2
    assert (areas > 0).all() and len(areas) == 7
    sums = [areas[:2].sum(), areas[2], areas[3:6].sum(), areas[6]]
    np.testing.assert_allclose(sums, [1, 0.5, 1.5, 0.5])
    if textured:
        np.testing.assert_allclose(mesh.uv, mesh.vertices[:, :2] / 2)
    data = path.read_bytes()
    for end in (data.index(b"end_header") + 12, len(data) - 60, len(data) - 1):
        path.write_bytes(data[:end])
        with pytest.raises(ValueError, match=r"a\.ply cannot be read as PLY: it is cut off: it must have as many rows"):
            load_mesh(path)
    write_ply(path, form, [[0, 1, 9]], corners)
    with pytest.raises(ValueError, match=r"the lists of a PLY file must hold whole numbers below 9, .*; got 9"):
        load_mesh(path)


@pytest.mark.parametrize("names", [("u", "v"), ("s", "t"), ("texture_u", "texture_v"), ("texture_s", "texture_t")])
def test_names_of_texture_coordinates_in_ply(tmp_path, names):
    """All that pbrt knows."""
    rows = "0 0 0 .1 .2", "1 0 0 .3 .4", "0 1 0 .5 .6"
    (tmp_path / "a.ply").write_text(triangle_ply(rows, names=("x", "y", "z", *names)))
    np.testing.assert_allclose(load_mesh(tmp_path / "a.ply").uv, [[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]], rtol=1e-6)
