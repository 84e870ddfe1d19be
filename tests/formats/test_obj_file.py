"""The reader of OBJ files: indices, polygons, forms of lines, and what cannot be read."""

import re

import numpy as np
import pytest

from dmis.formats.mesh_files import load_mesh
from dmis.geometry.mesh import Mesh

QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)


def load(folder, text: str | bytes) -> Mesh:
    path = folder / "a.obj"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return load_mesh(path)


def corners(mesh: Mesh) -> list[tuple[tuple[float, ...], ...]]:
    """Triangles by the positions of their corners, in an order that is the same for equal sets of triangles."""
    return sorted(
        min([tuple(map(tuple, np.roll(triangle, k, axis=0).tolist())) for k in range(3)])
        for triangle in mesh.vertices[mesh.faces]
    )


@pytest.mark.parametrize(
    "text",
    [
        QUAD.replace("v ", "v\t") + "f\t1 2 3 4\n",
        QUAD.replace("v", "   v") + "  f 1 2 3 4\n",
        QUAD + "f 1 2 \\\r\n 3 \\\r\n 4\n",
        QUAD + "f \\\n1 2 3 4",
        QUAD + "# C:\\scenes\\\nf 1 2 3 4\n",
        QUAD.replace("v", "V") + "VT 0 0\nVn 0 0 1 # up\nF 1/1/1 2/1/1 3/1/1 4/1/1#1\n",
        QUAD.replace("1 1 0", "1 1 0 # corner") + "f 1 2 3 4 # all\n",
        (QUAD + "f 1 2 3 4\n").replace("\n", "\r"),
        (QUAD + "f 1 2 3 4\n").replace("\n", "\r\n"),
        "\ufeff" + QUAD + "f 1 2 3 4\n",
        QUAD + "f 1 2\nf 1 2 3 4\nf\n",
        QUAD + "f -4 -3 -2 -1\nv 9 9 9\n",
        QUAD + "vn 0 0 1\nf -4//-1 -3//-1 -2//-1 -1//-1\nv 9 9 9\nvn 1 0 0\n",
        QUAD + "vt 0 0\nvt 1 1\nf 1/1 2/1 3/2\nf 1 3 4\n",
        QUAD + "vn 0 0 1\nvt 0 0\nf 1//1 2//1 3//1\nf 1/1 3/1 4/1\n",
        QUAD + "f 1/1/1 2/2/1 3/3/1 4/4/1\n",
    ],
)
def test_forms_of_lines(tmp_path, text):
    """Tabs, indents, continued lines, comments, ends of lines, indices of every kind: always the square."""
    assert corners(load(tmp_path, text)) == corners(Mesh(SQUARE, np.array([[0, 1, 2], [0, 2, 3]])))


def test_polygons_beside_faces_of_as_many_numbers(tmp_path):
    """A hexagon of bare indices has six numbers, as has a triangle with texture coordinates; each keeps its own."""
    text = QUAD + "v 0 0 1\nv 1 0 1\nvt .5 .5\nvn 0 1 0\nf 1 2 3 4 5 6\nf 1/1 2/1 3/1\nf 1//1 2//1 6//1\n"
    mesh = load(tmp_path, text)
    assert mesh.triangles == 6
    triangle = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1]])
    (smooth,) = np.flatnonzero((mesh.vertices[mesh.faces] == triangle).all(axis=(1, 2)))
    np.testing.assert_array_equal(mesh.normals[mesh.faces[smooth]], [[0, 1, 0]] * 3)
    assert (mesh.uv[mesh.faces] == 0.5).all(axis=(1, 2)).sum() == 1


@pytest.mark.parametrize("seed", range(6))
def test_concave_polygons_keep_their_outline(tmp_path, seed):
    """Stars, turned in space: triangles wound as the polygon, whose areas add up to its own, cover it once."""
    rng = np.random.default_rng(seed)
    n = 4 + 3 * seed
    angle, radius = np.sort(rng.random(n) + np.arange(n)) * 2 * np.pi / n, rng.uniform(0.2, 3, n)
    plane, axes = radius * [np.cos(angle), np.sin(angle)], np.linalg.qr(rng.standard_normal((3, 3)))[0]
    points = plane.T @ axes[:2]
    lines = [f"v {x} {y} {z}" for x, y, z in points.tolist()]
    mesh = load(tmp_path, "\n".join([*lines, "f " + " ".join(map(str, range(1, n + 1)))]))
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    areas = np.cross(b - a, c - a) @ np.cross(axes[0], axes[1]) / 2
    x, y = plane
    assert mesh.triangles == n - 2 and (areas > 0).all()
    assert areas.sum() == pytest.approx((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


@pytest.mark.parametrize("text", ["# caf\xe9\n", "usemtl Stra\xdfe\n", "o \xe9t\xe9\n", "g Fl\xe4che\xa0 \x85\n"])
@pytest.mark.parametrize("encoding", ["latin-1", "utf-8"])
def test_names_and_comments_in_either_encoding(tmp_path, text, encoding):
    assert load(tmp_path, f"{text}{QUAD}{text}f 1 2 3 4\n".encode(encoding)).triangles == 2


@pytest.mark.parametrize(
    "text, message",
    [
        (QUAD + "f 1 2 9\n", "line 5: 'f 1 2 9' has the vertex 9, but there are 4"),
        (QUAD + "f -5 2 3\nv 0 0 0\n", "line 5: 'f -5 2 3' has the vertex -5, but there are 4 above it"),
        (QUAD + "f 0 1 2\n", "line 5: .* has the corner '0'; write 1, 1/2, 1//3 or 1/2/3, counted from 1"),
        (QUAD + "vt 0 0\nf 1/1 2/1 3/2\n", "line 6: .* has the texture coordinate 2, but there are 1"),
        ("v 1 2\n" + QUAD + "f 1 2 3\n", "line 1: 'v 1 2' needs 3 numbers"),
        ("v 1 2 nought\n" + QUAD + "f 1 2 3\n", "line 1: 'v 1 2 nought' must have numbers only"),
        (QUAD + "f 1 2 3\nsurf 0 1 0 1 1 2 3 4\n", "line 6: 'surf 0 1 0 1 1 2 3 4' is not supported; export triangles"),
        (QUAD + "p 1 2\nl 3 4\n", "it has no faces, lines such as 'f 1 2 3'"),
        ((QUAD + "f 1 2 3").encode("utf-16"), "it is UTF-16 or binary; it must be text, save it as UTF-8"),
    ],
)
def test_bad_files(tmp_path, text, message):
    """The message names the file, the line, what is wrong with it and what may stand there."""
    with pytest.raises(ValueError, match=re.escape(str(tmp_path / "a.obj")) + " cannot be read as OBJ: " + message):
        load(tmp_path, text)


@pytest.mark.parametrize("seed", range(5))
def test_random_files_keep_their_triangles(tmp_path, seed):
    """Vertices, faces of 3 to 7 corners and materials at random; indices relative, absolute, with and without more."""
    rng = np.random.default_rng(seed)
    lines, points, expected = [], [], []
    forms = ("{0}", "{0}/{1}", "{0}//{1}", "{0}/{1}/{1}")
    allowed = rng.permutation(4)[: rng.integers(1, 5)]
    for _ in range(30):
        for _ in range(rng.integers(0, 9)):
            points.append((len(points), len(points) ** 2, 5))  # on a parabola, so that polygons are convex
            lines += ["v {} {} {}".format(*points[-1]), "vt .5 .5", "vn 0 0 1"]
        if rng.random() < 0.3:
            lines.append(f"usemtl {rng.integers(3)}")
        if len(points) >= 7:
            index = np.sort(rng.permutation(len(points))[: rng.integers(3, 8)])
            words = index - len(points) if rng.random() < 0.5 else index + 1
            lines.append("f " + " ".join(forms[rng.choice(allowed)].format(k, k) for k in words))
            expected += [np.array(points)[index[[0, k, k + 1]]] for k in range(1, len(index) - 1)]
    mesh = load(tmp_path, "\n".join(lines))
    assert corners(mesh) == corners(Mesh(np.concatenate(expected), np.arange(3 * len(expected)).reshape(-1, 3)))
