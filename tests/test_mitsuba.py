"""Against Mitsuba 3, where it is installed: the translation of scenes, its lobes beside ours, a converged mean."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dmis
from dmis.base import vectors
from dmis.base.color import LUMINANCE
from dmis.brdf.fresnel import ExactConductor
from dmis.brdf.lobe import Directions
from dmis.brdf.materials import glass, matte, metal, mirror, plastic, substrate
from dmis.brdf.models import ggx
from dmis.brdf.texture import Image
from dmis.light.area import DiskLight
from dmis.light.environment import EnvironmentLight
from dmis.scene.shading_points import ShadingPoints
from dmis.testing.scenes import box_scene

mi = pytest.importorskip("mitsuba")
BENCHMARKS = Path(__file__).parent.parent / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))
try:
    mi.set_variant("llvm_ad_rgb")
except ImportError as error:
    pytest.skip(f"needs LLVM: {error}", allow_module_level=True)

import drjit as dr  # noqa: E402
import mitsuba_lobes  # noqa: E402
import mitsuba_scene  # noqa: E402

N = 4096
GOLD = ((0.143124, 0.3749396, 1.442507), (3.983175, 2.385725, 1.603214))
MATERIALS = [
    matte((0.2, 0.5, 0.7)),
    plastic((0.2, 0.5, 0.7), (0.4, 0.3, 0.2), 0.1),
    plastic(0.3, 0.4, 0.02, eta=1 / 1.5),
    metal(*GOLD, 0.02),
    substrate((0.2, 0.5, 0.7), (0.4, 0.3, 0.2), 0.05, 0.05),
    ggx((0.1, 0.2, 0.3), (0.9, 0.8, 0.7), 0.3, fresnel=ExactConductor(*GOLD)),
]


def directions(rng, n=N):
    """Unit directions ``(3, n)``."""
    return vectors.normalise(rng.normal(size=(3, n)).astype(np.float32))


@pytest.mark.parametrize("material", MATERIALS, ids=lambda m: f"{m.name}-{len(m.lobes)}")
def test_lobes(material):
    """Values and densities of all pairs of directions, about shading normals that are not the geometric ones."""
    rng = np.random.default_rng(1)
    ng, wo, wi = directions(rng), directions(rng), directions(rng)
    wi[:, ::2] = vectors.normalise(2 * ng * vectors.dot(ng, wo) - wo + 0.1 * wi)[:, ::2]  # about the mirror direction
    n = vectors.normalise(ng + 0.2 * directions(rng))
    si = dr.zeros(mi.SurfaceInteraction3f, N)
    si.n, si.sh_frame = mi.Normal3f(*ng), mi.Frame3f(mi.Vector3f(*n))
    si.wi = si.to_local(mi.Vector3f(*wo))
    value, pdf = mitsuba_lobes.Lobes(material).eval_pdf(mi.BSDFContext(), si, si.to_local(mi.Vector3f(*wi)))
    ng, n = ng * np.sign(vectors.dot(ng, wo)), n * np.sign(vectors.dot(n, wo))
    glossy = box_scene(material).plan.groups[0].reflection
    surface = ShadingPoints(ng=ng, n=n, wo=wo, cos_o=vectors.dot(n, wo), dpdu=None, reflection=glossy)
    cosines = Directions(surface, wi)
    facing = vectors.dot(ng, wi) > 0
    ours = np.broadcast_to(surface.eval(cosines) * cosines.cos_i * facing, (3, N))
    clear = (np.abs(cosines.cos_o) > 0.02) & (cosines.cos_i > 0.02)  # rounding decides at grazing angles
    np.testing.assert_allclose(np.array(value)[:, clear], ours[:, clear], rtol=2e-3, atol=1e-5)
    np.testing.assert_allclose(np.array(pdf)[clear], (surface.pdf(cosines) * facing)[clear], rtol=2e-3, atol=1e-5)
    assert (ours[:, clear] > 0).any() and clear.mean() > 0.9


@pytest.mark.parametrize("material", MATERIALS, ids=lambda m: f"{m.name}-{len(m.lobes)}")
def test_albedo_of_the_samples(material):
    """The lobes' samples have the density that they state: the mean of their weights is the integral of the value."""
    rng = np.random.default_rng(2)
    n = 1 << 16
    si = dr.zeros(mi.SurfaceInteraction3f, n)
    si.n, si.sh_frame = mi.Normal3f(0, 0, 1), mi.Frame3f(mi.Vector3f(0, 0, 1))
    si.wi = mi.Vector3f(0.6, 0, 0.8)
    bsdf, context, u = mitsuba_lobes.Lobes(material), mi.BSDFContext(), rng.random((3, n), np.float32)
    weights = np.array(bsdf.sample(context, si, mi.Float(u[0]), mi.Point2f(*u[1:]))[1], float)
    z, phi = (np.arange(n) + 0.5) / n, 2 * np.pi * (np.arange(n) * 0.6180339887498949 % 1)
    r = np.sqrt(1 - z * z)
    wo = np.stack([r * np.cos(phi), r * np.sin(phi), z]).astype(np.float32)
    albedo = np.array(bsdf.eval(context, si, mi.Vector3f(*wo)), float).mean(axis=1) * 2 * np.pi
    error = weights.std(axis=1) / np.sqrt(n)
    assert (np.abs(weights.mean(axis=1) - albedo) < 5 * error + 0.005 * albedo).all()


def test_sky_and_texture():
    """Radiance in all directions of a rotated sky; values of an image, scaled and repeated."""
    rng = np.random.default_rng(4)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    light = EnvironmentLight(rng.random((8, 16, 3)), rotation, (1.0, 0.5, 2.0))
    si = dr.zeros(mi.SurfaceInteraction3f, N)
    wi = directions(rng)
    si.wi = -mi.Vector3f(*wi)
    np.testing.assert_allclose(np.array(mitsuba_scene._light(light).eval(si)), light.radiance(wi), atol=2e-4)
    image = Image(rng.random((5, 7, 3)), scale=(2.0, 3.0), offset=(0.3, -0.2))
    uv = rng.random((2, N), np.float32)
    si.uv = mi.Point2f(*uv)
    np.testing.assert_allclose(np.array(mitsuba_lobes.texture(image).eval(si)), image(uv), atol=2e-5)


def room(material):
    """A ball of a material on a floor, under a disk light and a dim sky."""
    ball = dmis.Part(
        dmis.geometry.shapes.sphere(1.0).transformed(dmis.geometry.transforms.translate((0, 0, 1))), material
    )
    floor = dmis.Part(dmis.geometry.shapes.quad((-4, -4, 0), (8, 0, 0), (0, 8, 0)), matte((0.6, 0.5, 0.4)))
    light = DiskLight((1.5, 0.0, 4.0), (-0.3, 0.0, -1.0), 0.8, (9.0, 8.0, 7.0))
    sky = EnvironmentLight(np.full((4, 8, 3), 0.2) * np.linspace(1, 2, 4)[:, None, None])
    camera = dmis.Camera.look_at((3, -5, 3), (0, 0, 0.8), fov=35, resolution=(40, 32))
    return dmis.Scene(camera, (floor, ball, dmis.light_part(light)), (light, sky))


@pytest.mark.parametrize("depth", [1, 4])
@pytest.mark.parametrize("material", [MATERIALS[4], mirror(0.8), glass()], ids=["substrate", "mirror", "glass"])
def test_paths_have_the_same_mean(material, depth):
    """Depth counts the same surfaces in both, mirrors and glass among them; each quarter of the image agrees."""
    scene = room(material)
    settings = dmis.Settings(integrator="path", max_depth=depth)
    other, camera = mitsuba_scene.translate(scene, exact=True), mitsuba_scene.sensor(scene.camera)
    integrator = mitsuba_scene.path(depth)
    ours, theirs = [], []
    for seed in range(6):
        ours.append(dmis.render(scene, "balance", 24, seed=seed, settings=settings, parallel=1).image)
        theirs.append(mitsuba_scene.render(other, camera, integrator, 64, seed))
    a, b = (np.array(x, float).reshape(6, 2, 16, 2, 20, 3).mean((2, 4)) for x in (ours, theirs))
    error = np.sqrt((a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)) / 6)
    z = (a.mean(axis=0) - b.mean(axis=0)) / error
    assert (np.abs(z) < 5).all() and np.abs(a.mean() / b.mean() - 1) < 0.02


def test_lights_are_picked_by_power():
    """The probability of each light is its share of the power: pi A L of the disk, pi R^2 4 pi L of an even sky."""
    scene = room(matte())
    scene = replace(scene, lights=(scene.lights[0], EnvironmentLight(np.full((4, 8, 3), 0.2))))
    low, high = scene.bounds
    disk = np.pi * np.pi * 0.8**2 * float(LUMINANCE @ (9.0, 8.0, 7.0))
    sky = np.pi * ((high - low) ** 2).sum() / 4 * 4 * np.pi * 0.2
    for by_power, expected in ((False, 0.5), (True, sky / (sky + disk))):
        world = mitsuba_scene.translate(scene, exact=True, by_power=by_power)
        skies = [emitter.is_environment() for emitter in world.emitters()]
        probability = world.pdf_emitter(mi.UInt32(skies.index(True)))
        np.testing.assert_allclose(np.array(probability), expected, rtol=5e-3)  # the disk's mesh is a polygon


@pytest.mark.slow
def test_scripts(tmp_path):
    """Both write rows: a gain over Mitsuba's best set-up in equal time, and images that agree."""
    from rows import read_rows

    arguments = ("--quick", "--repeats", "2", "--reference-spp", "64", "--folder", tmp_path)
    script("against_mitsuba.py", *arguments, "--tables", "speed", "errors", "--scenes", "teapot-area-light")
    script("against_mitsuba.py", *arguments, "--tables", "paths", "--scenes", "cornell")
    assert {row["contestant"] for row in read_rows(tmp_path / "mitsuba-speed.csv")} == {"dmis", "LLVM", "own", "scalar"}
    for kind in ("errors", "paths"):
        rows = read_rows(tmp_path / f"mitsuba-{kind}.csv")
        ratios = {row["compared"]: float(row["ratio"]) for row in rows if row["measure"] == "relmse"}
        assert rows[0]["set-up"].split(",")[0] in mitsuba_scene.SAMPLERS and min(ratios.values()) > 0
        assert kind == "paths" or ratios["auto"] < ratios["balance"]
    script("agreement.py", "--quick", "--seeds", "4", "--only", "mirror", "--csv", tmp_path / "agreement.csv")
    (row,) = read_rows(tmp_path / "agreement.csv")
    assert abs(float(row["mean"])) < 5 * float(row["s.e."])


def script(name, *arguments):
    """What a script of benchmarks/ prints."""
    done = subprocess.run(
        [sys.executable, BENCHMARKS / name, *arguments], capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
