"""Binary PLY files of triangles are read as trimesh reads them, and all others are left to it."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from dmis import geometry, ply

FOLDER = Path(__file__).resolve().parent.parent / "scenes" / "geometry"
V = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]])
F = np.array([[0, 1, 2], [0, 2, 3]])
N = np.array([[0, 0, 1], [0, 0.6, 0.8], [0, 0, 0], [np.nan, 0, 1]])


def file(order="little", vertex="float x,float y,float z", index="int", tail=b"", comment=b"", corners=3):
    """A file of V and F, and of N or zeros where `vertex` has more."""
    kinds, names = zip(*(field.split() for field in vertex.split(",")), strict=True)
    columns = dict(zip(("x", "y", "z", "nx", "ny", "nz"), np.concatenate([V, N], axis=1).T, strict=True))
    sign = "<" if order == "little" else ">"
    types = {"float": "f4", "double": "f8", "uchar": "u1"}
    rows = np.zeros(len(V), [(name, sign + types[kind]) for kind, name in zip(kinds, names, strict=True)])
    for name in names:
        rows[name] = columns.get(name, 0)
    faces = np.zeros(len(F), [("n", "u1"), ("i", f"{sign}i4", 3)])
    faces["n"], faces["i"] = corners, F
    properties = "".join(f"property {field}\n" for field in vertex.split(","))
    head = (
        f"element vertex {len(V)}\n{properties}element face {len(F)}\n"
        f"property list uchar {index} vertex_indices\nend_header\n"
    )
    start = b"ply\nformat binary_" + order.encode() + b"_endian 1.0\n" + comment
    return start + head.encode() + rows.tobytes() + faces.tobytes() + tail


@pytest.mark.parametrize("name", ["tt-windows", "tt-rim", "teapot", "cornell-vase"])
def test_as_trimesh_reads_it(name):
    data = (FOLDER / f"{name}.ply").read_bytes()
    vertices, faces, normals = ply.triangles(data)
    mesh = trimesh.load(FOLDER / f"{name}.ply", process=False)
    np.testing.assert_array_equal(vertices, mesh.vertices)
    np.testing.assert_array_equal(faces, mesh.faces)
    assert (normals is not None) == ("vertex_normals" in mesh._cache)
    if normals is not None:
        np.testing.assert_array_equal(normals, mesh.vertex_normals)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"order": "big"},
        {"index": "uint32", "comment": b"comment end of nothing\nobj_info 1\n"},
        {"vertex": "uchar red,double z,double y,double x"},
    ],
)
def test_forms(options):
    vertices, faces, normals = ply.triangles(file(**options))
    np.testing.assert_array_equal(vertices, V)
    np.testing.assert_array_equal(faces, F)
    assert normals is None


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"end_header\n",
        file()[:-1],
        file(tail=b"\0"),
        file(corners=4),
        file(vertex="float x,float y"),
        file(vertex="float x,float y,float z,float u,float v"),
        file().replace(b"float x", b"float y"),
        file().replace(b"float x", b"quaternion x"),
        file().replace(b"binary_little_endian", b"ascii"),
        file().replace(b"\n", b"\r\n", 3),
    ],
)
def test_others_are_left_to_trimesh(data):
    assert ply.triangles(data) is None


def test_lost_normals_are_mended(tmp_path):
    """Zeros, and what is not finite, become the mean of the faces' normals."""
    path = tmp_path / "mesh.ply"
    path.write_bytes(file(vertex="float x,float y,float z,float nx,float ny,float nz"))
    mesh = geometry.load_mesh(path)
    np.testing.assert_allclose(mesh.normals[:2], N[:2], atol=1e-7)
    np.testing.assert_allclose(mesh.normals[2:], geometry.vertex_normals(V, F)[2:])


def test_index_out_of_range(tmp_path):
    path = tmp_path / "mesh.ply"
    path.write_bytes(file()[:-4] + b"\x07\0\0\0")
    with pytest.raises(ValueError, match=r"mesh\.ply cannot be read as PLY: .* got 0 to 7"):
        geometry.load_mesh(path)


def test_no_trimesh_for_the_scenes():
    """Half a second and 50 MB of every render."""
    code = (
        "import sys, dmis; dmis.make_rule('auto'); dmis.load_scene('tt', resolution=(8, 8)); "
        "sys.exit('trimesh' in sys.modules or 'scipy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=FOLDER.parent.parent).returncode == 0
