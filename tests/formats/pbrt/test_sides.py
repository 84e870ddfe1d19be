"""Which side of a shape pbrt calls outside, and which emits: shading normals, winding, ReverseOrientation, mirrors.

Sources: shapes/triangle*.cpp, shapes/loopsubdiv.cpp, shapes/sphere.cpp and core/reflection.cpp of pbrt-v2 and v3,
shapes.h, util/mesh.cpp and util/loopsubdiv.cpp of v4; of v3 the last version.
"""

import itertools

import numpy as np
import pytest

import dmis
from dmis.formats.pbrt.read import read_pbrt
from dmis.formats.pbrt.tokens import PbrtError
from dmis.geometry.mesh import flat_normals

HEAD = {
    "v2": 'SurfaceIntegrator "directlighting"\nFilm "image"',
    "v3": 'Integrator "directlighting"\nFilm "image"',
    "v4": 'Integrator "path" "integer maxdepth" 1\nPixelFilter "box"\nFilm "rgb"',
}
SIDED = {"v2": 'Material "glass"', "v3": 'Material "plastic"', "v4": 'Material "dielectric"'}
SQUARE = 'Shape "trianglemesh" "point P" [-2 -2 0  2 -2 0  2 2 0  -2 2 0] "integer indices" [0 1 2 0 2 3]'


@pytest.fixture
def read(tmp_path):
    """Reads a scene of the dialect with the given world, camera and size of the image."""

    def read(dialect, world, camera="", side=16):
        path = tmp_path / "scene.pbrt"
        film = f'{HEAD[dialect]} "integer xresolution" {side} "integer yresolution" {side}'
        path.write_text(f"{camera}\n{film}\nWorldBegin\n{world}\n" + ("" if dialect == "v4" else "WorldEnd\n"))
        return read_pbrt(path, dialect=dialect)

    return read


# The two sides of v3's plastic and uber ----------------------------------------------------------------------------

# Fresnel's reflectance of a mirror direction at 30 and 60 degrees: F = (r_par^2 + r_perp^2) / 2 with n_i s_i = n_t s_t,
# r_par = (n_t c_i - n_i c_t) / (n_t c_i + n_i c_t), r_perp = (n_i c_i - n_t c_t) / (n_i c_i + n_t c_t)
# 1 to 1.5, 30: s_t = 1/3, c_t = .942809, r_par = .356229 / 2.241847 = .158900, r_perp = -.548188 / 2.280239 = -.240408
# 1 to 1.5, 60: s_t = .577350, c_t = .816497, r_par = -.066497 / 1.566497 = -.042449,
#               r_perp = -.724745 / 1.724745 = -.420204
# 1.5 to 1, 30: s_t = .75, c_t = .661438, r_par = -.126132 / 1.858182 = -.067879, r_perp = .637600 / 1.960476 = .325227
# 1.5 to 1, 60: s_t = 1.299: total reflection, as from 41.8 degrees on
ENTERING, LEAVING = {30: 0.041522, 60: 0.089187}, {30: 0.055190, 60: 1.0}

COAT = '"rgb Kd" [0 0 0] "rgb Ks" [1 1 1] "float roughness" .5 "bool remaproughness" "false"'
COATS = {
    "plastic": f'Material "plastic" {COAT}',
    "uber": f'Material "uber" {COAT} "float eta" 1.5',
    "mix": f'MakeNamedMaterial "a" "string type" "plastic" {COAT} '
    'MakeNamedMaterial "b" "string type" "matte" "rgb Kd" [0 0 0] '
    'Material "mix" "string namedmaterial1" "a" "string namedmaterial2" "b" "rgb amount" [.25 .25 .25]',
}


def mirrored_light(read, dialect, material, degrees, side, before=""):
    """Radiance that a square in the plane z = 0 mirrors from a distant light of 1 at an angle, seen from one side."""
    x, z = np.sin(np.radians(degrees)), side * np.cos(np.radians(degrees))
    camera = f'LookAt {-10 * x} 0 {10 * z}  0 0 0  0 1 0\nCamera "perspective" "float fov" .01'
    light = f'LightSource "distant" "point from" [{x} 0 {z}] "point to" [0 0 0]'
    scene = read(dialect, f"{light}\n{material}\n{before} {SQUARE}", camera, 2)
    return dmis.render(scene, "balance", 1, seed=1).image.mean()


@pytest.mark.parametrize("degrees", [30, 60])
@pytest.mark.parametrize("before", ["", "ReverseOrientation", "Scale 1 -1 1", "Scale 1 -1 1 ReverseOrientation"])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("kind", COATS)
def test_reflectance_of_v3_depends_on_the_side(read, kind, side, before, degrees):
    """At the mirror direction h = n, so f = D G F / (4 cos^2) with D = 1 / (pi alpha^2) and Smith's G, whose two
    Lambda are equal: 1 / (1 + 2 Lambda) = 1 / sqrt(1 + alpha^2 tan^2). The light's cosine takes one of f's away.

    plastic is FresnelDielectric(1.5, 1), uber FresnelDielectric(1, eta), from the side of the shading normal: z, unless
    ReverseOrientation turns it; of triangles without vertex normals it is the winding's in object space.
    """
    theta = np.radians(degrees)
    on_normal = (side > 0) != ("Reverse" in before)
    fresnel = (LEAVING if (kind != "uber") == on_normal else ENTERING)[degrees]
    spread = 4 / np.pi / np.sqrt(1 + (0.5 * np.tan(theta)) ** 2)
    expected = spread * fresnel / (4 * np.cos(theta)) * (0.25 if kind == "mix" else 1)
    value = mirrored_light(read, "v3", COATS[kind], degrees, side, before)
    assert value == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("kind", ["plastic", "uber"])
def test_reflectance_of_v2_is_the_same_on_both_sides(read, kind):
    """Blinn of exponent 2: D = 4 / (2 pi), G = 1 at 30 degrees (2 cos > cos), always from the inside of index 1.5."""
    material = f'Material "{kind}" "color Kd" [0 0 0] "color Ks" [1 1 1] "float roughness" .5'
    for side in (1, -1):
        expected = 2 / np.pi * LEAVING[30] / (4 * np.cos(np.radians(30)))
        assert mirrored_light(read, "v2", material, 30, side) == pytest.approx(expected, rel=1e-4)


# Triangles, and Loop subdivision -----------------------------------------------------------------------------------

CORNERS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])


def octahedron(kind, outward):
    """A Shape line; its faces are wound so that they show outwards or inwards; normals of "inward" show inwards."""
    faces = []
    for i, j, k in itertools.product((0, 1), repeat=3):  # + + + is x, y, z: counter-clockwise from outside
        a, b, c = i, 2 + j, 4 + k
        faces.append((a, b, c) if ((i + j + k) % 2 == 0) == outward else (a, c, b))
    lists = f'"point P" [{text(CORNERS)}] "integer indices" [{text(faces)}]'
    if kind == "loopsubdiv":
        return f'Shape "loopsubdiv" {lists} "integer LEVELS" 1'
    normals = "" if kind == "flat" else f' "normal N" [{text(-CORNERS if kind == "inward" else CORNERS)}]'
    return f'Shape "trianglemesh" {lists}{normals}'


def text(numbers):
    return " ".join(map(str, np.ravel(numbers)))


def shows(mesh):
    """1 if all faces of a mesh around the origin are wound so that they show outwards, -1 if all show inwards."""
    centres, normals = mesh.vertices[mesh.faces].mean(axis=1), flat_normals(mesh.vertices, mesh.faces)
    signs = np.sign(np.einsum("fc,fc->f", centres, normals))
    assert (signs == signs[0]).all()
    return int(signs[0])


def in_dialect(dialect, shape):
    """A Shape line with the words of a dialect."""
    words = ("levels", "point3 P") if dialect == "v4" else ("nlevels", "point P")
    return shape.replace("LEVELS", words[0]).replace("point P", words[1])


def one_part(read, dialect, material, shape, reverse, mirror):
    before = ("Scale 1 2 -1 " if mirror else "") + ("ReverseOrientation " if reverse else "")
    (part,) = read(dialect, f"{material} {before}{in_dialect(dialect, shape)}").parts
    return part


@pytest.mark.parametrize("dialect", ["v2", "v3", "v4"])
@pytest.mark.parametrize("outward", [True, False])
def test_normals_of_loopsubdiv_are_opposite_to_the_winding(read, dialect, outward):
    """At the corner z of the octahedron. The ring of pbrt starts at the corner after z in a face, and goes on to the
    face beyond the edge between the two. Of faces that show outwards, (x, y, z) is one: its ring begins with x; beyond
    the edge from z to x lies (x, z, -y), where -y follows z; then -x and y. With P_j = x, -y, -x, y,

        S = sum cos(2 pi j / 4) P_j = x - (-x) = 2 x,    T = sum sin(2 pi j / 4) P_j = -y - y = -2 y,

    and S x T = -4 x x y = -4 z: inwards. Turned faces walk the ring the other way, and have their normals outwards.
    """
    part = one_part(read, dialect, "", octahedron("loopsubdiv", outward), False, False)
    radial = part.mesh.vertices / np.linalg.norm(part.mesh.vertices, axis=1)[:, None]
    cos = np.einsum("vc,vc->v", part.mesh.normals, radial)[:6]  # the old corners, which lie on axes of symmetry
    np.testing.assert_allclose(cos, -1 if outward else 1, atol=1e-6)
    assert shows(part.mesh) == (1 if outward else -1)  # the winding stays


# Signs, + outwards. w: winding in object space; s: vertex normals, which no transform turns (-w of a loopsubdiv);
# r: -1 with ReverseOrientation; m: -1 with a mirroring transform, which turns the winding in world space: w m.
#
# Outside, the side of the shading normal:
#   v2: DifferentialGeometry turns dp/du x dp/dv, which is w m here, by r m: w r. With vertex normals it is built from
#       tangents around them, and turned again: s r m.
#   v3: without vertex normals w m, turned by r m: w r. With them the second tangent is turned by r only: s r.
#   v4: without as v3: w r. With them TriangleMesh turns them by r when it is made: s r.
# Bright, where the light is sampled:
#   v2: Triangle::Sample turns the winding in world space by r: w m r, with vertex normals or without.
#   v3: without vertex normals w m r m = w r; with them s, while a ray that hits sees s r: refused if r = -1.
#   v4: the same, of vertex normals that r has turned: s r.
CASES = list(itertools.product(["flat", "smooth", "inward", "loopsubdiv"], [1, -1], [1, -1], [1, -1]))


def outside(dialect, kind, w, r, m):
    if kind == "flat":
        return w * r
    s = {"smooth": 1, "inward": -1, "loopsubdiv": -w}[kind]
    return s * r * m if dialect == "v2" else s * r


def bright(dialect, kind, w, r, m):
    return w * m * r if dialect == "v2" else outside(dialect, kind, w, r, m)


@pytest.mark.parametrize("kind, w, r, m", CASES)
@pytest.mark.parametrize("dialect", ["v2", "v3", "v4"])
def test_outside_and_bright_side_of_meshes(read, dialect, kind, w, r, m):
    """Outside of glass in v2 and v4, of plastic in v3; light of plastic or a dielectric is wound as its part."""
    shape = octahedron(kind, w > 0)
    part = one_part(read, dialect, SIDED[dialect], shape, r < 0, m < 0)
    assert shows(part.mesh) == outside(dialect, kind, w, r, m)
    emitting = f'AreaLightSource "diffuse" "rgb L" [1 1 1] {SIDED["v4" if dialect == "v4" else "v3"]}'
    if dialect == "v3" and kind != "flat" and r < 0:
        with pytest.raises(PbrtError, match=r"shines on both sides in v3; remove ReverseOrientation"):
            one_part(read, dialect, emitting, shape, r < 0, m < 0)
        return
    part = one_part(read, dialect, emitting, shape, r < 0, m < 0)
    assert shows(part.mesh) == bright(dialect, kind, w, r, m)
    np.testing.assert_array_equal(part.light.faces, part.mesh.faces)


@pytest.mark.parametrize("kind, w, r, m", CASES)
def test_glass_of_v2_that_emits_inwards_is_refused(read, kind, w, r, m):
    """One winding cannot show the bright side and the outside where these differ."""
    shape = octahedron(kind, w > 0)
    emitting = 'AreaLightSource "area" Material "glass"'
    if outside("v2", kind, w, r, m) == bright("v2", kind, w, r, m):
        assert shows(one_part(read, "v2", emitting, shape, r < 0, m < 0).mesh) == outside("v2", kind, w, r, m)
        return
    with pytest.raises(PbrtError, match="emits on the inner side of its glass, which is not supported; give it"):
        one_part(read, "v2", emitting, shape, r < 0, m < 0)


@pytest.mark.parametrize("dialect", ["v2", "v3"])
def test_turned_faces_keep_the_texture_coordinates_that_are_read(read, tmp_path, dialect):
    """Default coordinates belong to corners, which change places; nothing reads them where all is constant."""
    texels = np.random.default_rng(1).random((2, 2, 3), np.float32)
    dmis.write_exr(tmp_path / "a.exr", {"RGB": texels})
    texture = 'Texture "a" "spectrum" "imagemap" "string filename" "a.exr" Material "uber" "rgb Kr" [1 1 1]'
    triangle = 'ReverseOrientation Shape "trianglemesh" "point P" [0 0 0 1 0 0 0 1 0] "integer indices" [0 1 2]'
    (part,) = read(dialect, f'{texture} "texture Kd" "a" {triangle}').parts
    corners = {tuple(v): tuple(uv) for v, uv in zip(part.mesh.vertices, part.mesh.uv, strict=True)}
    assert corners == {(0, 0, 0): (0, 0), (1, 0, 0): (1, 0), (0, 1, 0): (1, 1)}
    assert flat_normals(part.mesh.vertices, part.mesh.faces)[0, 2] == -1
    (part,) = read(dialect, f'{texture} "rgb Kd" [1 1 1] {triangle}').parts
    assert part.mesh.uv is None and flat_normals(part.mesh.vertices, part.mesh.faces)[0, 2] == -1


# Spheres, disks and cylinders ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", ['"sphere"', '"cylinder"'])
@pytest.mark.parametrize(
    "before, sign", [("", 1), ("ReverseOrientation", -1), ("Scale 1 1 -1", -1), ("Scale 1 1 -1 ReverseOrientation", 1)]
)
def test_outside_of_plastic_quadrics_of_v3(read, shape, before, sign):
    """SurfaceInteraction turns the normal in object space, outwards, by ReverseOrientation and by the handedness of the
    shape's transform, and the way to world space keeps sides: a mirrored sphere has its normals inwards."""
    (part,) = read("v3", f'Material "plastic" {before} Shape {shape}').parts
    assert shows(part.mesh) == sign
    # an instance's own transform moves normals to world space, and does not turn them
    instance = f'ObjectBegin "a" {before} Shape {shape} ObjectEnd Scale 1 1 -1 ObjectInstance "a"'
    (part,) = read("v3", f'Material "plastic" {instance}').parts
    assert shows(part.mesh) == sign


@pytest.mark.parametrize("dialect, material", [("v3", "glass"), ("v4", "dielectric")])
def test_mirrored_spheres_of_glass_are_refused(read, dialect, material):
    with pytest.raises(PbrtError, match=f"a mirrored sphere of glass is inside out in {dialect}; do not mirror it"):
        read(dialect, f'Material "{material}" Scale 1 1 -1 Shape "sphere"')
