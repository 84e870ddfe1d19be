"""Lights: sampling against density, geometry, energy, orientation."""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest
import trimesh
from helpers import Z_LIMIT, pickled

from dmis.base.color import LUMINANCE
from dmis.base.vectors import Array, frame, normalise
from dmis.brdf.texture import Image
from dmis.geometry.shapes import sphere
from dmis.light.area import DiskLight, QuadLight, SphereLight
from dmis.light.delta import DistantLight, PointLight, SpotLight
from dmis.light.environment import EnvironmentLight
from dmis.light.light_sample import INFINITE_DISTANCE, LightSample
from dmis.light.mesh_light import MeshLight
from dmis.light.selection import select_lights
from dmis.light.triangle_order import compact_order, shortest_edge_last
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.sobol import Sobol
from dmis.samplers.streams import stream
from dmis.samplers.warp import square_to_sphere
from dmis.testing.light_checks import check_light
from dmis.testing.outcome import require
from dmis.testing.sphere import columns, polar, uniforms

WHITE = (1.0, 2.0, 3.0)
TILT = np.stack([*frame(polar(50, 130)), polar(50, 130)], axis=1)
"""A rotation that is no symmetry of anything."""
RANDOM_SKY = np.random.default_rng(1).random((8, 16, 3)) ** 3
ONE_TEXEL = np.zeros((8, 16, 3))
ONE_TEXEL[2, 5] = (10.0, 20.0, 5.0)
BENT = np.array([[-0.3, -0.4, 2.0], [0.9, -0.4, 1.8], [0.9, 0.6, 2.1], [-0.3, 0.7, 1.7]])
"""Corners of two triangles at an angle, both facing the origin, with the common edge 0-2."""
BENT_FACES = np.array([[0, 2, 1], [0, 3, 2]])
COLOURS = np.random.default_rng(2).random((3, 4, 3)) ** 2
CORNERS_OF_IMAGE = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])

LIGHTS = {
    "disk": DiskLight((0.3, -0.5, 2.0), (0.2, 0.1, -1.0), 0.8, WHITE),
    "quad": QuadLight((0.5, -1.0, 1.5), (0.3, 1.5, 0.2), (1.2, 0.3, -0.1), WHITE),
    "sphere": SphereLight((0.4, 0.8, 1.6), 0.7, WHITE),
    "near sphere": SphereLight((0.0, 0.0, 1.0), 0.99, WHITE),
    "mesh": MeshLight(BENT, BENT_FACES, WHITE),
    "image": MeshLight(BENT, BENT_FACES, Image(COLOURS), CORNERS_OF_IMAGE),
    "grey image": MeshLight(BENT, BENT_FACES, Image(COLOURS[..., :1]), CORNERS_OF_IMAGE),
    "sky": EnvironmentLight(RANDOM_SKY),
    "sky that repeats": EnvironmentLight(RANDOM_SKY, wrap="repeat"),
    "grey sky": EnvironmentLight(RANDOM_SKY[..., :1]),
    "tilted sky": EnvironmentLight(RANDOM_SKY, TILT, (2.0, 1.0, 0.5)),
    "one texel": EnvironmentLight(ONE_TEXEL),
    "constant sky": EnvironmentLight(np.ones((1, 1, 3))),
    "black sky": EnvironmentLight(np.zeros((4, 8, 3))),
    "compensated sky": EnvironmentLight(RANDOM_SKY, compensation=0.9),
    "compensated constant sky": EnvironmentLight(np.ones((2, 4, 3)), compensation=0.9),
}
each_light = pytest.mark.parametrize("name", LIGHTS)
ORIGIN = (0.0, 0.0, 0.0)


def sampled(name: str, count: int = 2**16, p: tuple[float, ...] = ORIGIN, seed: int = 1) -> tuple[Array, LightSample]:
    points = columns(np.array(p), count)
    return points, LIGHTS[name].sample(points, uniforms(count, seed))


@each_light
def test_checks(name: str) -> None:
    """Samples, densities, visible surface, irradiance, finite values, renders."""
    require(check_light(LIGHTS[name], name))


@pytest.mark.parametrize(
    "light", [PointLight((1, 2, 3), WHITE), SpotLight((0, 0, 2), (0, 0, -1), WHITE), DistantLight((0, 3, 4), WHITE)]
)
def test_checks_of_deltas(light: Any) -> None:
    """Methods and finite values."""
    require(check_light(light))


@pytest.mark.parametrize("distance, radius", [(2.0, 1.0), (1.001, 1.0), (100.0, 0.5), (1e4, 1e-2)])
def test_sphere_closed_form(distance: float, radius: float) -> None:
    """Seen straight up, ``E = pi L (r/d)^2``; in the cone of a far light nothing is lost to rounding (1e-5)."""
    light = SphereLight((0, 0, distance), radius, (2.0, 2.0, 2.0))
    light_sample = light.sample(columns(np.zeros(3), 2**16), uniforms(2**16))
    samples = 2.0 * light_sample.wi[2] / light_sample.pdf
    expected = np.pi * 2 * (radius / distance) ** 2
    assert abs(samples.mean(dtype=float) - expected) < Z_LIMIT * samples.std() / 256 + 1e-5 * expected
    met = light.hit(columns(np.zeros(3), 2**16), light_sample.wi)
    # at 1e4 the outline is 1e-6 wide and a unit vector's step 6e-8 of that: a tenth of them fall outside
    assert met.emits.mean() > (0.85 if distance == 1e4 else 0.999)


def test_closed_mesh_shines_outwards() -> None:
    """A sphere of triangles: samples on its far side do not emit, and those that it hides; `hit` finds the nearest one.

    So the pdf that `hit` gives is that of the near triangle, which is what MIS needs where the far one is dark.
    """
    mesh = sphere(0.7, segments=48).transformed(np.block([[np.eye(3), np.array([[0.4], [0.8], [1.6]])], [0, 0, 0, 1]]))
    light = MeshLight(mesh.vertices, mesh.faces, WHITE)
    p = columns(np.zeros(3), 2**16)
    light_sample = light.sample(p, uniforms(2**16))
    assert 0.2 < light_sample.emits.mean() < 0.5
    wi = light_sample.wi[:, light_sample.emits].copy()
    met = light.hit(np.zeros_like(wi), wi)
    np.testing.assert_allclose(met.emits.mean(), 1, atol=1e-3)


def test_a_sphere_is_dark_from_inside() -> None:
    """Neither light samples nor given directions meet a sphere around the receiver, be it one of many lights or not."""
    light = SphereLight((0.0, 0.0, 0.1), 1.0, WHITE)
    p, u = columns(np.array((0.3, 0.2, 0.0)), 500), uniforms(500)
    for of in (light, select_lights("even", (light.pieces(),))):
        for light_sample in (of.sample(p, u), of.hit(p, square_to_sphere(u))):
            assert not light_sample.emits.any() and not light_sample.pdf.any()


def test_a_mesh_shows_its_picture() -> None:
    """At points of its triangles by their coordinates."""
    rng, picture = np.random.default_rng(3), Image(np.random.default_rng(4).random((3, 5, 3)), wrap="clamp")
    uv, places = np.array([[0, 0], [1, 0], [1, 0.6], [0, 0.9]]), rng.dirichlet((1, 1, 1), 500)
    light = MeshLight(BENT, BENT_FACES, picture, uv)
    for face in BENT_FACES:
        wi = normalise((places @ BENT[face]).T.astype(np.float32))
        expected = picture((places @ uv[face]).T.astype(np.float32))
        np.testing.assert_allclose(light.hit(np.zeros_like(wi), wi).radiance, expected, atol=1e-4)


@pytest.mark.parametrize("dark", [False, True])
def test_triangles_of_a_picture_are_sampled_by_their_light(dark: bool) -> None:
    """Area times the sum of mean luminance and a tenth of that of all, here of a second triangle that may be black."""
    corners = BENT[BENT_FACES]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    luminance = np.array([1.0, 0.0 if dark else 1.0])
    picture = Image(luminance[None, :, None] * [0.9, 0.8, 0.7], wrap="clamp", nearest=True)
    light = MeshLight(BENT, BENT_FACES, picture, np.array([[0.5, 0.5], [0, 0.5], [0.5, 0.5], [1, 0.5]]))
    wi = normalise(corners.mean(axis=1).T.astype(np.float32))
    weight = luminance + 0.1 * np.average(luminance, weights=area)
    ratio = light.hit(columns(np.zeros(3), 2), wi).pdf / LIGHTS["mesh"].hit(columns(np.zeros(3), 2), wi).pdf
    np.testing.assert_allclose(ratio, weight / np.average(weight, weights=area), rtol=1e-4)


# Environment -------------------------------------------------------------------------------------------------------


def test_environment_directions_and_scale() -> None:
    """``u = phi / 2 pi`` from +x towards +y, ``v = theta / pi`` from +z, as in pbrt-v2; texel centres are exact."""
    sky = EnvironmentLight(RANDOM_SKY)
    for row, column in ((0, 0), (2, 5), (7, 15), (4, 8)):
        theta, phi = np.pi * (row + 0.5) / 8, 2 * np.pi * (column + 0.5) / 16
        w = columns(np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)]))
        np.testing.assert_allclose(sky.radiance(w)[:, 0], RANDOM_SKY[row, column], atol=1e-5)
    # the middle of the map is -x on the horizon, its left edge +x
    for x, sides in ((-1.0, [7, 8]), (1.0, [0, 15])):
        light_sample = sky.radiance(columns(np.array([x, 0, 0])))[:, 0]
        np.testing.assert_allclose(light_sample, RANDOM_SKY[3:5, sides].mean(axis=(0, 1)), atol=1e-5)
    # a rotated map is the map seen along rotated directions, times the scale; a few roundings times the contrast 1
    w = np.stack([polar(d, a) for d in (10, 60, 100) for a in (0, 100, 210)], axis=1).astype(np.float32)
    plain, tilted = EnvironmentLight(RANDOM_SKY), LIGHTS["tilted sky"]
    turned = np.ascontiguousarray((TILT @ w).astype(np.float32))
    np.testing.assert_allclose(tilted.radiance(turned), plain.radiance(w) * np.float32([[2], [1], [0.5]]), atol=2e-5)
    # A number or a colour shines alike from everywhere
    w = np.stack([polar(d, 77) for d in (10, 90, 170)], axis=1).astype(np.float32)
    for value, colour in ((0.5, (0.5, 0.5, 0.5)), ((3, 2, 1), (3, 2, 1))):
        np.testing.assert_allclose(EnvironmentLight(value).radiance(w).T, [colour] * 3, rtol=1e-6)


@pytest.mark.parametrize("wrap, towards_poles", [("clamp", (1, 0)), ("repeat", (0.5, 0.5))])
def test_environment_at_the_poles(wrap: Literal["clamp", "repeat"], towards_poles: tuple[float, float]) -> None:
    """Straight up and down a map of a white row and a black one; with `repeat` as in pbrt-v2 and v3."""
    sky = EnvironmentLight(np.array([1.0, 0.0]).reshape(2, 1, 1), wrap=wrap)
    up_and_down = np.array([[0, 0], [0, 0], [1, -1]], np.float32)
    np.testing.assert_allclose(sky.radiance(up_and_down)[0], towards_poles, atol=1e-6)


@pytest.mark.parametrize("wrap", ["clamp", "repeat"])
@pytest.mark.parametrize("share", [None, 0.6])
def test_environment_density_by_hand(share: float | None, wrap: Literal["clamp", "repeat"]) -> None:
    """A texel has the mean luminance of its interpolant times the sine at its middle; compensated, what is above the
    mean of the sky.
    """
    sky = EnvironmentLight(RANDOM_SKY, compensation=share, wrap=wrap)
    theta, phi = np.meshgrid((np.arange(64) + 0.5) * np.pi / 64, (np.arange(128) + 0.5) * np.pi / 64, indexing="ij")
    w = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)]).astype(np.float32)
    luminance = (LUMINANCE @ sky.radiance(w.reshape(3, -1))).reshape(8, 8, 16, 8).mean(axis=(1, 3))
    sine = np.sin((np.arange(8) + 0.5) * np.pi / 8)[:, None].repeat(16, axis=1)
    plain = luminance * sine
    above = np.maximum(luminance - np.average(luminance, weights=sine), 0) * sine
    expected = (1 - (share or 0)) * plain / plain.sum() + (share or 0) * above / above.sum()
    at = np.ascontiguousarray(w[:, 3::8, 3::8].reshape(3, -1))
    density = sky.hit(np.zeros_like(at), at).pdf * 2 * np.pi**2 * np.hypot(at[0], at[1])
    np.testing.assert_allclose(density, expected.ravel() * 128, rtol=1e-4)


@pytest.mark.parametrize("pole", [0, 180])
def test_environment_density_near_the_poles(pole: float) -> None:
    """Within a texel it is one over the sine of the polar angle, for given directions and for samples."""
    w = np.stack([polar(abs(pole - away), 40) for away in (11.0, 1.0, 1e-2, 1e-4)], axis=1).astype(np.float32)
    density = LIGHTS["sky"].hit(columns(np.zeros(3), 4), w).pdf * np.hypot(w[0], w[1])
    np.testing.assert_allclose(density, density[0], rtol=1e-5)
    v = np.float32([1e-5, 1e-3, 0.1, 0.5])
    u = np.stack([np.full(4, 1 - 1e-6 if pole else 0.0), 1 - v if pole else v]).astype(np.float32)
    light_sample = LIGHTS["sky"].sample(columns(np.zeros(3), 4), u)
    met = LIGHTS["sky"].hit(columns(np.zeros(3), 4), light_sample.wi)
    np.testing.assert_allclose(light_sample.pdf, met.pdf, rtol=0.05)  # pi is rounded by 9e-8, and the angle is 4e-6


@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, -1e-8, 0), (1e-8, 0, 1)])
def test_environment_poles_and_seam_are_finite(direction: tuple[float, float, float]) -> None:
    """No NaN at the poles, where sin(theta) is 0, nor at the seam, and no index outside the map."""
    for name in ("sky", "constant sky", "one texel"):
        light_sample = LIGHTS[name].hit(columns(np.zeros(3)), columns(np.array(direction, float)))
        assert np.isfinite(light_sample.pdf).all() and np.isfinite(light_sample.radiance).all()


def test_tables_of_environments() -> None:
    """Texels of any u are those that a search of the cumulative sum finds, for a map of extreme contrast."""
    texels = np.random.default_rng(2).random((16, 32, 3)) ** 40
    texels[5:9] = 0
    sky = EnvironmentLight(texels)
    cdf = sky._distribution[0][1:]
    u = np.concatenate([uniforms(5000)[0].astype(float), cdf[:-1], [0.0, 1 - 2**-24]])
    u = u[u < 1]
    expected = np.minimum(np.searchsorted(cdf, u, side="right"), len(cdf) - 1)
    np.testing.assert_array_equal(sky._texel(u), expected)
    # Beside a sun 224 texels share 2^-22 of the first number, of which float32 has four values there
    texels = np.ones((16, 32, 1))
    texels[8, 3] = 1e9
    u = np.stack([np.repeat(np.arange(4) * 2.0**-24, 2**12), np.tile(np.linspace(0, 1 - 2**-12, 2**12), 4)])
    x, y, z = EnvironmentLight(texels).sample(np.zeros((3, 2**14), np.float32), u.astype(np.float32)).wi
    texel = np.stack([np.arctan2(y, x) % (2 * np.pi) * 16 / np.pi, np.arccos(z) * 16 / np.pi]).astype(int)
    assert len(np.unique(texel[:, texel[1] < 7], axis=1).T) == 224
    # although the plain sky has made its own before
    sky, p = EnvironmentLight(RANDOM_SKY), columns(np.zeros(3), 500)
    sky.sample(p, uniforms(500))
    samples = (
        light.sample(p, uniforms(500))
        for light in (sky.compensated(0.6), EnvironmentLight(RANDOM_SKY, compensation=0.6))
    )
    np.testing.assert_array_equal(*(light_sample.wi for light_sample in samples))


# Lights of one direction -------------------------------------------------------------------------------------------


def test_lights_of_one_direction_by_hand() -> None:
    """``I / d^2`` from the direction of the light, distance d, always in sight."""
    light = PointLight((1, 2, 3), (4, 8, 12))
    light_sample = light.sample(columns(np.array((1.0, 2.0, 1.0))))
    assert light.brightness(10.0) == pytest.approx(0.12)
    assert light.is_at(np.array([1, 2, 3 + 1e-6]), 0) and not light.is_at(np.array([1, 2, 3 + 1e-3]), 1e-6)
    np.testing.assert_allclose(light_sample.radiance, [[1], [2], [3]], rtol=1e-6)
    np.testing.assert_allclose(light_sample.wi, [[0], [0], [1]], atol=1e-7)
    assert light_sample.distance == pytest.approx(2) and light_sample.emits.all() and (light_sample.pdf == 1).all()
    # the same radiance and direction everywhere, from infinitely far away
    light_sample = DistantLight((0, 3, 4), WHITE).sample(columns(np.array((7.0, 8.0, 9.0)), 3))
    np.testing.assert_allclose(light_sample.wi, np.repeat([[0], [0.6], [0.8]], 3, axis=1), atol=1e-7)
    np.testing.assert_allclose(np.broadcast_to(light_sample.radiance, (3, 3)), np.repeat([[1], [2], [3]], 3, axis=1))
    assert (light_sample.distance == INFINITE_DISTANCE).all() and light_sample.emits.all()
    # inner = outer is a step, without a division by zero
    light = SpotLight((0, 0, 0), (0, 0, -1), WHITE, outer=30, inner=30)
    light_sample = light.sample(np.concatenate([columns(-polar(d)) for d in (29.9, 30.1)], axis=1))
    np.testing.assert_allclose(light_sample.radiance, np.float32([[1, 0], [2, 0], [3, 0]]), rtol=1e-5)


@pytest.mark.parametrize("degrees, factor", [(0.0, 1.0), (24.9, 1.0), (30.1, 0.0), (180.0, 0.0), (27.5, None)])
def test_spot_by_hand(degrees: float, factor: float | None) -> None:
    """Full inside, dark outside, ``d^4`` in between with d linear in the cosine."""
    if factor is None:
        cos = np.cos(np.radians([30, 27.5, 25]))
        factor = ((cos[1] - cos[0]) / (cos[2] - cos[0])) ** 4
    light = SpotLight((0, 0, 0), (0, 0, -2), (8.0, 8.0, 8.0))
    p = -2 * polar(degrees) * [1, 1, 1]
    light_sample = light.sample(columns(p))
    np.testing.assert_allclose(
        light_sample.radiance[0], 2 * factor, rtol=1e-4
    )  # d is a difference of cosines: 1e-7/0.04
    assert bool(light_sample.emits[0]) == (factor > 0)
    np.testing.assert_allclose(light_sample.wi[:, 0], -p / 2, atol=1e-6)


@pytest.mark.parametrize("outer", [0.01, 0.1, 1.0])
def test_narrow_spots_keep_their_falloff(outer: float) -> None:
    """A hundredth of a degree is 1 - cos of 1.5e-8, which a float32 cosine does not tell from 0."""
    angles = np.radians(outer) * np.array([0.0, 0.3, 0.6, 0.8, 0.95])
    light = SpotLight((0, 0, 0), (0, 0, -1), (1.0, 1.0, 1.0), outer=outer, inner=outer / 2)
    light_sample = light.sample(np.stack([np.sin(angles), 0 * angles, -np.cos(angles)]).astype(np.float32))
    d = np.clip((np.radians(outer) ** 2 - angles**2) / (np.radians(outer) ** 2 * 0.75), 0, 1)
    np.testing.assert_allclose(light_sample.radiance[0], d**4, atol=2e-3)


@pytest.mark.parametrize("name", LIGHTS)
def test_pickling(name: str) -> None:
    """A light that comes back from pickle samples the same; a mesh light's Embree handle is rebuilt."""
    points, light_sample = sampled(name, 200)
    again = pickled(LIGHTS[name])
    np.testing.assert_array_equal(again.sample(points, uniforms(200)).wi, light_sample.wi)
    np.testing.assert_array_equal(again.hit(points, light_sample.wi).pdf, LIGHTS[name].hit(points, light_sample.wi).pdf)


ANY: Any = np.ones((1, 1, 3))


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: DiskLight(ORIGIN, (0, 0, 1), 0.0, WHITE), "radius must be positive"),
        (lambda: QuadLight(ORIGIN, (1, 0, 0), (2, 0, 0), WHITE), "must not be parallel"),
        (lambda: MeshLight(np.zeros((3, 3)), np.array([[0, 1, 2]]), WHITE), "positive area"),
        (lambda: EnvironmentLight(-np.ones((2, 2, 3))), "texels must be finite and not negative"),
        (lambda: EnvironmentLight(1e38 * ANY, scale=(1e10, 1, 1)), r"texels times scale must be below 3.4e38.*e\+47"),
        (lambda: EnvironmentLight(ANY, 2 * np.eye(3)), "to_world must be a 3x3 rotation"),
        (lambda: EnvironmentLight(ANY, wrap="mirror"), "wrap must be clamp or repeat; got 'mirror'"),  # type: ignore[arg-type]
        (lambda: EnvironmentLight(ANY, compensation=1.0), "compensation must be a number from 0 to 1, but less than 1"),
        (lambda: PointLight(ORIGIN, (-1, 0, 0)), "intensity must be"),
        (lambda: PointLight((1e19, 0, 0), WHITE), r"position must be within 1e\+18"),
        (lambda: SpotLight(ORIGIN, (0, 0, 1), WHITE, outer=20, inner=30), "need 0 <= inner <= outer"),
        (lambda: DistantLight((0, 0, 0), WHITE), "direction must not be zero"),
    ],
)
def test_bad_lights(make: Callable[[], Any], message: str) -> None:
    """Errors name the argument and the constraint."""
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("radius", [1.0, 1e4, 1e6])
def test_the_near_end_of_a_large_sphere(radius: float) -> None:
    """Its distance is positive and has the digits that the centre's has, although both ends are millions away."""
    light = SphereLight((0.0, 0.0, radius + 2), radius, (1, 1, 1))
    p = np.zeros((3, 500), np.float32)
    for light_sample in (light.sample(p, uniforms(500)), light.hit(p, columns((0.6, 0.0, 0.8), 500))):
        cos = light_sample.wi[2].astype(float)
        along = (radius + 2) * cos
        near = (4 * radius + 4) / (along + np.sqrt(np.maximum(along**2 - (4 * radius + 4), 0)))
        assert (light_sample.distance > 0).all()
        if light_sample.emits.all():
            np.testing.assert_allclose(np.median(light_sample.distance / near), 1, rtol=1e-7 * radius + 1e-5)


# Triangles of mesh lights, in an order that keeps Sobol points even ---------------------------------------------------

SEEDS = 48


def tube(sectors: int = 256) -> trimesh.Trimesh:
    """A cylinder of radius .02 and height 1.2, without caps, of 2 long triangles for each sector."""
    angle = np.linspace(0, 2 * np.pi, sectors, endpoint=False)
    ring = np.stack([0.02 * np.cos(angle), 0.02 * np.sin(angle), 0 * angle], axis=1)
    i, j = np.arange(sectors), (np.arange(sectors) + 1) % sectors
    lower, upper = np.stack([i, j, i + sectors], axis=1), np.stack([j, j + sectors, i + sectors], axis=1)
    return trimesh.Trimesh(np.concatenate([ring, ring + [0, 0, 1.2]]), np.stack([lower, upper], 1).reshape(-1, 3))


def ball() -> trimesh.Trimesh:
    """An icosphere of 1,280 triangles."""
    return trimesh.creation.icosphere(subdivisions=3)


def variance(light: MeshLight, p: Array, n: int, sobol: bool) -> float:
    """Relative variance of the mean of n light samples at a point that faces up."""
    means = []
    for seed in range(SEEDS):
        if sobol:
            sampler = Sobol(PixelBlock(stream(3, 0, 0), 3, np.array([seed]), [n], 2))
            sampler.start(np.zeros(n, np.int64), np.arange(n))
            u = sampler.draw((0, 0), None)
        else:
            u = np.random.default_rng(seed).random((2, n), dtype=np.float32)
        sample = light.sample(np.tile(p, (1, n)), u)
        values = sample.radiance[0] * np.abs(sample.wi[2]) / np.maximum(sample.pdf, 1e-30)
        means.append(np.where(sample.emits, values, 0).mean())
    return np.var(means) / np.mean(means) ** 2


@pytest.mark.parametrize(
    ("mesh", "p", "least"),
    [(tube(), [0.6, -0.5, 0.2], 200), (tube(), [-0.4, 0.3, -0.5], 200), (ball(), [3, 1, -2], 10)],
)
def test_even_points_stay_even_on_a_mesh_light(mesh: trimesh.Trimesh, p: list[float], least: float) -> None:
    light = MeshLight(np.asarray(mesh.vertices), np.asarray(mesh.faces), (1, 1, 1))
    point = np.array(p, np.float32)[:, None]
    independent, even = (variance(light, point, 256, sobol) for sobol in (False, True))
    assert independent / even > least, f"256 samples: independent {independent:.2e}, Sobol {even:.2e}"


def test_order_is_a_permutation_of_compact_parts() -> None:
    mesh = ball()
    triangles = mesh.triangles[np.random.default_rng(0).permutation(len(mesh.faces))]
    order = compact_order(triangles)
    assert (np.sort(order) == np.arange(len(order))).all()

    def widths(triangles: Array) -> list[float]:
        area = trimesh.triangles.area(triangles)
        part = (16 * (np.cumsum(area) - area / 2) / area.sum()).astype(int)
        return [float(np.linalg.norm(np.ptp(triangles[part == k].mean(axis=1), axis=0))) for k in range(16)]

    assert max(widths(triangles[order])) < 2 < 3 < min(widths(triangles))  # diagonals of bounds, of a sphere's 3.5


@pytest.mark.parametrize("triangles", [np.zeros((5, 3, 3)), np.eye(3)[None]])
def test_few_and_degenerate_triangles_have_an_order(triangles: Array) -> None:
    assert sorted(compact_order(triangles)) == list(range(len(triangles)))


def test_shortest_edge_is_turned_last_and_winding_kept() -> None:
    vertices = np.random.default_rng(1).random((30, 3))
    faces = np.arange(30).reshape(10, 3)
    turned = shortest_edge_last(vertices, faces)
    a, b, c = np.moveaxis(vertices[turned], 1, 0)
    assert (np.linalg.norm(a - c, axis=1) <= np.minimum(*(np.linalg.norm(x - b, axis=1) for x in (a, c)))).all()
    before, after = (np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]) for v in (vertices[faces], vertices[turned]))
    np.testing.assert_allclose(after, before, atol=1e-12)
