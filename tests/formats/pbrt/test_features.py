"""Small pbrt files for each feature of the scenes that papers use, against scenes made by hand and closed forms."""

import numpy as np
import pytest

import dmis
from dmis.brdf.coated_conductor import CoatedConductor
from dmis.brdf.coated_diffuse import CoatedBase
from dmis.formats.pbrt.lights import sphere_to_square, to_latitude_longitude
from dmis.formats.pbrt.notes import PbrtWarning
from dmis.formats.pbrt.read import read_pbrt
from dmis.formats.pbrt.spectra import GLASSES
from dmis.formats.pbrt.tokens import PbrtError
from dmis.image import write_exr
from dmis.light.light_sample import LightSample
from tests.formats.pbrt.test_leniency import HEADS

FILM = '"integer xresolution" 8 "integer yresolution" 8'
FLOOR = (
    'Shape "trianglemesh" "integer indices" [0 1 2 0 2 3] "point2 uv" [0 0 1 0 1 1 0 1] '
    '"point3 P" [-2 -2 0  2 -2 0  2 2 0  -2 2 0] '
)


MATTE = {"v2": 'Material "matte" "texture Kd"', "v4": 'Material "diffuse" "texture reflectance"'}
BUMPY = {"v2": ("matte", "bumpmap", "point"), "v4": ("diffuse", "displacement", "point3")}
MATTE["v3"], BUMPY["v3"] = MATTE["v2"], BUMPY["v2"]
MIXED = {"v3": '"string namedmaterial1" "a" "string namedmaterial2" "b"', "v4": '"string materials" ["a" "b"]'}


@pytest.fixture
def read(tmp_path):
    """Reads a floor of 4x4 below a camera at z = 4, in a dialect, with options and a world before it."""

    def read(dialect, world="", options="", add=FLOOR):
        head = HEADS[dialect].replace('"image"', f'"image" {FILM}').replace('"rgb"', f'"rgb" {FILM}')
        if dialect == "v2":
            head, add = f'{head} Film "image" {FILM}', add.replace("point2 uv", "float uv").replace("point3", "point")
        camera = "" if "Camera" in options else 'Camera "perspective" "float fov" 40'
        end = "" if dialect == "v4" else "WorldEnd"
        path = tmp_path / "scene.pbrt"
        path.write_text(f"{head}\nLookAt 0 0 4  0 0 0  0 1 0 {options} {camera}\nWorldBegin\n{world}\n{add}\n{end}")
        return read_pbrt(path, dialect=dialect)

    return read


def lobes(scene):
    return scene.parts[-1].material.lobes


def mean(scene, spp=16, seed=0, **options):
    """Mean colour of a render."""
    result = dmis.render(scene, "balance", spp, seed=seed, parallel=1, integrator="direct", **options)
    return result.image.mean(axis=(0, 1))


# Textures ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dialect", ["v2", "v3", "v4"])
def test_checkerboard(read, dialect):
    rgb = "rgb" if dialect == "v4" else "color"
    board = f'"{rgb} tex1" [.8 .4 .2] "{rgb} tex2" [.1 .2 .3] "float uscale" 5 "float vscale" 3 "float udelta" .5'
    scene = read(dialect, f'Texture "t" "spectrum" "checkerboard" {board}\n{MATTE[dialect]} "t"')
    image = lobes(scene)[0].reflectance
    uv = np.random.default_rng(1).random((2, 1000), np.float32) * 3 - 1
    even = (np.floor(uv[0] * 5 + 0.5) + np.floor(uv[1] * 3)) % 2 == 0
    inside = np.abs((uv * [[5], [3]] + [[0.5], [0]] + 0.5) % 1 - 0.5) > 1e-5
    expected = np.where(even, [[0.8], [0.4], [0.2]], [[0.1], [0.2], [0.3]])
    keep = inside.all(axis=0)
    np.testing.assert_allclose(image(uv)[:, keep], expected[:, keep], rtol=1e-6)


@pytest.mark.parametrize("dialect", ["v2", "v3", "v4"])
def test_mixed_textures_are_one_image(read, tmp_path, dialect):
    write_exr(tmp_path / "a.exr", {"RGB": np.random.default_rng(2).random((4, 4, 3)).astype(np.float32)})
    image = '"string filename" "a.exr"'
    rgb = "rgb" if dialect == "v4" else "color"
    world = f"""Texture "a" "spectrum" "imagemap" {image} Texture "b" "float" "imagemap" {image}
    Texture "x" "spectrum" "mix" "texture tex1" "a" "float amount" .25 "{rgb} tex2" [.2 .4 .6]
    Texture "y" "float" "mix" "texture amount" "b" "float tex1" .5 "float tex2" .1
    Texture "z" "spectrum" "mix" "float amount" .5
    """
    image, mixed, grey = (lobes(read(dialect, f'{world} {MATTE[dialect]} "{k}"'))[0].reflectance for k in "axz")
    np.testing.assert_allclose(mixed.texels, 0.75 * image.texels + 0.25 * np.array([0.2, 0.4, 0.6]), rtol=1e-6)
    assert grey == (0.5, 0.5, 0.5)
    with pytest.raises(PbrtError, match="a mix of several images"):
        read(dialect, f'{world} Texture "w" "spectrum" "mix" "texture tex1" "a" "texture amount" "b"')


# Materials --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "line, kind",
    [
        ('"coateddiffuse" "rgb reflectance" [.8 .5 .3] "float roughness" .2', CoatedBase),
        ('"coatedconductor" "rgb reflectance" [.8 .5 .3] "float conductor.roughness" .2', CoatedConductor),
    ],
)
def test_mixtures_of_coats(read, line, kind):
    """A share of a coated material is that share of its image."""
    coat = f'MakeNamedMaterial "a" "string type" {line}\n'
    black = 'MakeNamedMaterial "b" "string type" "diffuse" "rgb reflectance" [0 0 0]\n'
    mix = 'Material "mix" "string materials" ["a" "b"] "float amount" .25'
    light = 'LightSource "point" "rgb I" [9 9 9] "point3 from" [1 1 3]\n'
    whole, share = (read("v4", f"{light}{coat}{black}{line}") for line in ('NamedMaterial "a"', mix))
    assert [type(lobe) for lobe in lobes(share)] == [type(lobe) for lobe in lobes(whole)]
    assert isinstance(lobes(share)[0], kind)
    np.testing.assert_allclose(mean(share), 0.75 * mean(whole), rtol=1e-5)


@pytest.mark.parametrize("dialect", ["v3", "v4"])
def test_amount_of_a_mixture_may_be_an_image(read, tmp_path, dialect):
    write_exr(tmp_path / "a.exr", {"RGB": np.full((2, 2, 3), (0.2, 0.2, 0.2), np.float32)})
    kind, name = ("matte", "Kd") if dialect == "v3" else ("diffuse", "reflectance")
    named = f'MakeNamedMaterial "{{}}" "string type" "{kind}" "rgb {name}" [{{}} {{}} {{}}]'
    texture = f'Texture "t" "{"spectrum" if dialect == "v3" else "float"}" "imagemap" "string filename" "a.exr"'
    world = f"{named.format('a', 1, 1, 1)} {named.format('b', 0.5, 0.5, 0.5)} {texture}"
    world += f'Material "mix" {MIXED[dialect]} "texture amount" "t"'
    values = [np.unique(lobe.reflectance.texels).tolist() for lobe in lobes(read(dialect, world))]
    first = 0.2 if dialect == "v3" else 0.8
    np.testing.assert_allclose(np.ravel(values), [first, 0.5 * (1 - first)], rtol=1e-6)


# Lights -----------------------------------------------------------------------------------------------------------


def directions(n, seed=3):
    d = np.random.default_rng(seed).standard_normal((3, n))
    return d / np.linalg.norm(d, axis=0)


def test_square_skies_are_those_of_pbrt(read, tmp_path):
    """The sky of a square map whose texels hold a function of their direction has the values of the function."""
    side = 64
    fine = directions(500_000, 6)
    value = np.stack([1 + fine[2], 1.5 + fine[0], 1.2 + fine[1] * fine[2]])
    column, row = np.minimum((sphere_to_square(fine) * side).astype(int), side - 1)
    total = np.zeros((side, side, 3))
    np.add.at(total, (row, column), value.T)
    square = total / np.bincount(row * side + column, minlength=side * side).reshape(side, side, 1)
    write_exr(tmp_path / "sky.exr", {"RGB": square.astype(np.float32)})
    (light,) = read("v4", 'Rotate 30 0 0 1 LightSource "infinite" "string filename" "sky.exr" "float scale" 2').lights
    assert light.wrap == "clamp"  # its texels are no rows
    d = directions(500, 7)
    turn = np.radians(30)
    world = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]) @ d
    expected = 2 * np.stack([1 + d[2], 1.5 + d[0], 1.2 + d[1] * d[2]])
    np.testing.assert_allclose(light.radiance(world.astype(np.float32)), expected, atol=0.12)
    weights = np.sin((np.arange(side) + 0.5) * np.pi / side)[:, None, None]
    mean_of_map = (to_latitude_longitude(square) * weights).sum(axis=(0, 1)) / (weights.sum() * 2 * side)
    np.testing.assert_allclose(mean_of_map, square.mean(axis=(0, 1)), rtol=2e-3)
    write_exr(tmp_path / "sky.exr", {"RGB": square[:32].astype(np.float32)})
    with pytest.raises(PbrtError, match="must be square in v4; got 64x32"):
        read("v4", 'LightSource "infinite" "string filename" "sky.exr"')


@pytest.mark.parametrize("dialect", ["v3", "v4"])
@pytest.mark.parametrize("shape", ["quad", "mesh with normals", "disk"])
def test_twosided_lamps_shine_on_both_sides(read, dialect, shape):
    mesh = '"point3 P" [-1 -1 0 1 -1 0 1 1 0 -1 1 0] "integer indices" [0 1 2 0 2 3]'
    shapes = {
        "quad": f'Shape "trianglemesh" {mesh}',
        "mesh with normals": f'Shape "trianglemesh" {mesh} "normal N" [0 0 1 0 0 1 0 0 1 0 0 1]',
        "disk": 'Shape "disk"',
    }
    lamp = f'Translate 0 0 1 AreaLightSource "diffuse" "rgb L" [2 2 2] "bool twosided" "true" {shapes[shape]}'
    scene = read(dialect, f"AttributeBegin {lamp} AttributeEnd")
    assert len(scene.lights) == 2
    for z in (-1.0, 3.0):
        p = np.array([[0.2], [0.1], [z]], np.float32)
        samples: list[LightSample] = [light.sample(p, np.full((2, 1), 0.4, np.float32)) for light in scene.lights]
        assert sorted(float(s.radiance.max() * (s.pdf * s.emits).max() > 0) for s in samples) == [0, 1]
    assert mean(scene, 4).min() > 0.3


def test_spectra_textures_and_spots(read):
    with pytest.warns(PbrtWarning, match="index of refraction that differs with the wavelength.*'eta' of Material"):
        glass = lobes(read("v4", 'Material "dielectric" "spectrum eta" "glass-BK7"'))
    assert glass[0].fresnel.eta == 1.5168
    indices = 1.51680, 1.67003, 1.48656, 1.85025, 1.67271, 1.72828, 1.78472  # Schott's, at 587.6 nm
    np.testing.assert_allclose(list(GLASSES.values()), indices, atol=1e-4)
    # v3: a texture that is defined anew later is another one; v2 makes materials where shapes are
    red, green = (f'Texture "t" "color" "constant" "rgb value" [{rgb}]' for rgb in (".5 0 0", "0 .5 0"))
    for dialect, expected in (("v2", 0), ("v3", 0.5)):
        scene = read(dialect, f'{red} Material "matte" "texture Kd" "t" {green}')
        assert lobes(scene)[0].reflectance[0] == expected
    # spots of v4 fall off smoothly
    (spot,) = read("v4", 'LightSource "spot" "rgb I" [2 2 2] "float coneangle" 40 "float conedeltaangle" 10').lights
    angles = np.radians([0, 29, 33, 37, 41])
    p = np.stack([np.sin(angles), 0 * angles, np.cos(angles)]).astype(np.float32)
    inner, outer = np.cos(np.radians([30, 40]))
    t = np.clip((np.cos(angles) - outer) / (inner - outer), 0, 1)
    np.testing.assert_allclose(spot.sample(p).radiance[0], 2 * t * t * (3 - 2 * t), rtol=1e-4, atol=1e-6)


# Masks ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dialect", ["v2", "v3", "v4"])
def test_alpha_cuts_holes(read, tmp_path, dialect):
    """v2 and v3 ask whether alpha is 0, v4 takes it as a probability; shapes of one alpha make one part."""
    write_exr(tmp_path / "a.exr", {"RGB": np.repeat([[[0.25], [0]], [[1], [0.5]]], 3, axis=2).astype(np.float32)})
    texture = 'Texture "t" "float" "imagemap" "string filename" "a.exr"'
    leaf = FLOOR.replace("point2 uv", "float uv").replace("point3", "point") if dialect == "v2" else FLOOR
    scene = read(dialect, f'{texture} {leaf} "texture alpha" "t" {leaf} "texture alpha" "t"')
    (cut,) = [part for part in scene.parts if part.mask is not None]
    assert len(scene.parts) == 2 and cut.mesh.triangles == 4
    assert cut.mask.cutoff == (None if dialect == "v4" else 1e-6)
    rows = cut.mask.image.texels[..., 0]
    np.testing.assert_allclose(rows if dialect == "v2" else rows[::-1], [[0.25, 0], [1, 0.5]], rtol=1e-6)
    for value, masked in ((0, True), (0.5, dialect == "v4"), (1, False)):
        scene = read(dialect, f'{leaf} "float alpha" {value}')
        assert any(part.mask is not None for part in scene.parts) == masked


# Cameras ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dialect", ["v2", "v3", "v4"])
def test_cameras(read, dialect):
    lens = read(dialect, "", 'Camera "perspective" "float lensradius" .5 "float focaldistance" 3').camera
    assert (lens.projection, lens.lens_radius, lens.focal_distance, lens.fov) == ("perspective", 0.5, 3, 90)
    flat = read(dialect, "", 'Camera "orthographic" "float screenwindow" [-2 2 -2 2]').camera
    origin, direction = flat.lens_rays(np.float32([0, 8]), np.float32([0, 4]))
    np.testing.assert_allclose(np.abs(origin.T), [[2, 2, 4], [2, 0, 4]], atol=1e-6)
    np.testing.assert_allclose(direction.T, [[0, 0, -1]] * 2, atol=1e-6)
    name = 'spherical" "string mapping" "equirectangular' if dialect == "v4" else "environment"
    around = read(dialect, "", f'Camera "{name}"').camera
    np.testing.assert_allclose(around.lens_rays(np.float32([2]), np.float32([4]))[1][:, 0], [0, 0, -1], atol=1e-6)
    wide = read(dialect, "", 'Camera "perspective" "float screenwindow" [-.5 .5 -.5 .5]').camera
    film = '"rgb"' if dialect == "v4" else '"image"'
    tall = f'Film {film} "integer xresolution" 4 "integer yresolution" 8 Camera "perspective" "float screenwindow" '
    for camera in (wide, read(dialect, "", f"{tall} [-.5 .5 -1 1]").camera):
        np.testing.assert_allclose(np.tan(np.radians(camera.fov / 2)), 0.5)
    if dialect == "v4":
        with pytest.raises(PbrtError, match="maps of equal area are not supported"):
            read(dialect, "", 'Camera "spherical"')


@pytest.mark.parametrize("camera", ["orthographic", "environment"])
def test_quadrics_are_fine_for_other_cameras(read, camera):
    """The outline of a sphere is off by at most 1/32 of a pixel, in units of the image."""
    scene = read("v3", 'Shape "sphere" "float radius" .9', f'Camera "{camera}"', add="")
    mesh = scene.parts[0].mesh
    edges = mesh.vertices[mesh.faces] - mesh.vertices[np.roll(mesh.faces, 1, axis=1)]
    longest = np.linalg.norm(edges, axis=-1).max()
    assert longest**2 / (8 * 0.9) < 1 / 32 * scene.camera.pixel * (1 if camera == "orthographic" else 4.0)


# Relief -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("axis", "length"), [("u", 2 * np.pi), ("v", np.pi)])
@pytest.mark.parametrize("dialect", ["v3", "v4"])
def test_bump_maps_on_spheres(read, tmp_path, dialect, axis, length):
    """Heights that rise by 1/2 over u or v tilt the normal at the equator by (1/2) / |dp/du| or / |dp/dv|."""
    ramp = np.broadcast_to(np.linspace(0, 0.5, 256, dtype=np.float32), (256, 256))
    write_exr(tmp_path / "a.exr", {"RGB": np.repeat((ramp if axis == "u" else ramp.T[::-1])[..., None], 3, 2)})
    kind, name, point = BUMPY[dialect]
    place = "-1 -1 0" if axis == "u" else "0 -1 -1"
    world = f'LightSource "distant" "{point} from" [{place}] "{point} to" [0 0 0] '
    world += f'Texture "h" "float" "imagemap" "string filename" "a.exr" Material "{kind}"'
    view = 'Identity LookAt 0 -5 0 0 0 0 0 0 1 Camera "perspective" "float fov" 1'
    texts = f'{world} "texture {name}" "h"', world
    bumped, smooth = (mean(read(dialect, text, view, 'Shape "sphere"'))[0] for text in texts)
    np.testing.assert_allclose(bumped / smooth, (1 + 0.5 / length) / np.hypot(1, 0.5 / length), rtol=0.01)


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("dialect", ["v2", "v3", "v4"])
def test_slopes_of_bump_maps(read, tmp_path, dialect, smooth):
    """Heights of slope 1/8 along x, lit from (1, 0, 1); in v2 and v3 smooth normals turn back, by u of length 1."""
    ramp = np.broadcast_to(np.linspace(0, 0.5, 256, dtype=np.float32), (4, 256))
    write_exr(tmp_path / "a.exr", {"RGB": np.repeat(ramp[..., None], 3, 2)})
    kind, name, point = BUMPY[dialect]
    world = f'LightSource "distant" "{point} from" [1 0 1] "{point} to" [0 0 0] Texture "h" "float" "imagemap" '
    world += f'"string filename" "a.exr" Material "{kind}" "texture {name}" "h"'
    add = FLOOR + ' "normal N" [0 0 1  0 0 1  0 0 1  0 0 1]' * smooth
    view = 'Camera "perspective" "float fov" 1'
    bumped, even = (mean(read(dialect, text, view, add))[0] for text in (world, world.partition(' "texture')[0]))
    slope = 0.5 if smooth and dialect != "v4" else -0.125
    np.testing.assert_allclose(bumped / even, (1 + slope) / np.hypot(1, slope), rtol=2e-3)


@pytest.mark.parametrize("before", ["", "ReverseOrientation", "Scale -1 1 1"])
def test_green_of_normal_maps_is_across_the_outside(read, tmp_path, before):
    """v4: the second axis is n x dp/du, which ReverseOrientation turns; lit from (0, 1, 1)."""
    write_exr(tmp_path / "a.exr", {"RGB": np.full((4, 4, 3), [0.5, 0.8, 0.9], np.float32)})
    world = 'LightSource "distant" "point3 from" [0 1 1] "point3 to" [0 0 0] Material "diffuse"'
    mapped, even = (mean(read("v4", f"{world}{more} {before}"))[0] for more in (' "string normalmap" "a.exr"', ""))
    up = -0.6 if before.startswith("Scale") else 0.6
    np.testing.assert_allclose(mapped / even, up + 0.8, rtol=1e-3)


def test_float_textures_of_coloured_images(read, tmp_path):
    """v4 takes the opacity of an image that has some, v3 the luminance of what the file holds, and decodes that."""
    oiio = pytest.importorskip("OpenImageIO")
    pixels = np.zeros((2, 2, 4), np.uint8)
    pixels[..., 0], pixels[..., 3] = 255, [[255, 255], [0, 255]]
    for name, data in (("a.png", pixels), ("b.png", np.ascontiguousarray(pixels[..., :3]))):
        out = oiio.ImageOutput.create(str(tmp_path / name))
        out.open(str(tmp_path / name), oiio.ImageSpec(2, 2, data.shape[2], "uint8"))
        out.write_image(data)
        out.close()
    texture = 'Texture "t" "float" "imagemap" "string filename" '
    scene = read("v4", f'{texture} "a.png"', add=f'{FLOOR} "texture alpha" "t"')
    np.testing.assert_allclose(scene.parts[-1].mask.image.texels[..., 0], [[0, 1], [1, 1]], atol=1e-6)
    scene = read("v3", f'{texture} "b.png" Material "plastic" "texture roughness" "t"')
    alpha = read("v3", 'Material "plastic" "float roughness" 0.0372')
    got, expected = (lobes(one)[-1].roughness for one in (scene, alpha))
    np.testing.assert_allclose(got.alpha.texels, expected.alpha, rtol=2e-3)
