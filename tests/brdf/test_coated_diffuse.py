"""A diffuse or metallic base under a coat: energy, random walks of light through the layers, tables, and scenes."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from helpers import Z_LIMIT, reflected, z_score

import dmis
from dmis.base.vectors import Array
from dmis.brdf.coated_conductor import CoatedConductor
from dmis.brdf.coated_diffuse import CoatedBase, internal_reflectance, transmittance
from dmis.brdf.fresnel import Coat, Dielectric, ExactConductor, dielectric
from dmis.brdf.lobe import Directions, Lambert
from dmis.brdf.materials import Material
from dmis.brdf.microfacet import GGX
from dmis.brdf.specular import SpecularReflection
from dmis.scene.groups import Part, bind
from dmis.testing.scenes import FLOOR, box_scene, surface
from dmis.testing.sphere import polar, uniforms

NODES, WEIGHTS = np.polynomial.legendre.leggauss(64)
COS, WEIGHTS = (NODES + 1) / 2, WEIGHTS / 2


def base(reflectance: float, *coat: float, bounces: int | None = None) -> Material:
    """The base alone, without what the coat's outer side reflects."""
    return Material((CoatedBase(reflectance, *coat, bounces=bounces),))


def leaving(material: Material, degrees: float, cos: Array) -> Array:
    """Share of the light from `degrees` that leaves per unit of the cosine, all around the normal."""
    w = np.stack([np.sqrt(1 - cos**2), 0 * cos, cos]).astype(np.float32)
    points = surface(material, polar(degrees), len(cos))
    return np.broadcast_to(points.eval(Directions(points, w)), w.shape)[0].astype(float) * (2 * np.pi * cos)


# Energy -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("eta", [1.05, 1.5, 2.5])
@pytest.mark.parametrize("degrees", [0.0, 40.0, 70.0, 85.0, 89.0])
def test_white_furnace(eta: float, degrees: float) -> None:
    """A white base and a smooth clear coat reflect everything."""
    points = surface(dmis.coated_diffuse(1, 0, eta), polar(degrees))
    ((_, mirrored),) = [lobe.scatter(points) for lobe in points.delta]
    diffuse = WEIGHTS @ leaving(base(1, eta), degrees, COS)
    assert mirrored.item() + diffuse == pytest.approx(1, abs=1e-4)
    assert diffuse == pytest.approx(transmittance(points.cos_o, eta).item(), abs=1e-5)


# Random walks -------------------------------------------------------------------------------------------------------


def facets(wo: Array, alpha: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Facets drawn with D cos_h, and their weight before shadowing: ``wo.h / (cos_o cos_h)``."""
    if alpha == 0:
        return np.stack([0 * wo[0], 0 * wo[0], 1 + 0 * wo[0]]), np.ones(wo.shape[1])
    u, phi = rng.random(wo.shape[1]), 2 * np.pi * rng.random(wo.shape[1])
    slope = alpha * np.sqrt(u / (1 - u))
    h = np.stack([slope * np.cos(phi), slope * np.sin(phi), 1 + 0 * slope]) / np.sqrt(1 + slope**2)
    return h, np.maximum((wo * h).sum(axis=0), 0) / (wo[2] * h[2])


def shadow(wo: Array, wi: Array, alpha: float) -> Array:
    o, i = ((np.sqrt(1 + alpha**2 * (1 / w[2] ** 2 - 1)) - 1) / 2 for w in (wo, wi))
    return 1 / (1 + o + i)


def meet(wo: Array, eta: float, alpha: float, rng: np.random.Generator) -> tuple[Array, Array, Array, Array]:
    """Light along -wo meets an interface: its way on, whether it crosses, and weights. By the rules of one facet."""
    h, weight = facets(wo, alpha, rng)
    cos_d = (wo * h).sum(axis=0)
    crosses = rng.random(wo.shape[1]) >= dielectric(np.maximum(cos_d, 0), np.asarray(eta))
    cos_t = np.sqrt(np.maximum(1 - (1 - cos_d**2) / eta**2, 0))
    on = np.where(crosses, h * (cos_d / eta - cos_t) - wo / eta, 2 * cos_d * h - wo)
    right = (on[2] < 0) == crosses
    on = np.where(right & (on[2] != 0), on, [[0.0], [0.0], [1.0]])
    return on, crosses, weight * right, shadow(wo, on, alpha)


Scatter = Callable[[Array, np.random.Generator], tuple[Array, Array]]


def lambertian(reflectance: float) -> Scatter:
    """A base that scatters light by the cosine: directions up and weights for directions to where it came from."""

    def scatter(w: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        u, phi = rng.random(w.shape[1]), 2 * np.pi * rng.random(w.shape[1])
        return np.stack([np.sqrt(u) * np.cos(phi), np.sqrt(u) * np.sin(phi), np.sqrt(1 - u)]), np.array(reflectance)

    return scatter


def metallic(metal: ExactConductor, alpha: float) -> Scatter:
    """A base of rough metal, its first channel."""

    def scatter(w: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        h, weight = facets(w, alpha, rng)
        cos_d = np.clip((w * h).sum(axis=0), 0, 1)
        up = 2 * cos_d * h - w
        weight = weight * (up[2] > 0) * metal(cos_d)[0]
        up = np.where(up[2] > 0, up, [[0.0], [0.0], [1.0]])
        return up, weight * shadow(w, up, alpha)

    return scatter


def walk(degrees: float, scatter: Scatter, coat: tuple[float, ...], bounces: int, count: int) -> Array:
    """Directions in which walks leave the layers, their weights, and the bounces before, ``(5, count)``."""
    eta, alpha, thickness = coat
    rng = np.random.default_rng(5)
    wo = np.repeat(polar(degrees)[:, None], count, axis=1)
    down, crosses, weight, masking = meet(wo, eta, alpha, rng)
    weight = weight * masking * crosses * np.exp(-thickness / np.abs(down[2]))
    walks = np.zeros((5, count))
    index = np.arange(count)
    for k in range(bounces):
        index, down, weight = index[weight > 0], down[:, weight > 0], weight[weight > 0]
        up, factor = scatter(-down, rng)
        weight = weight * factor * np.exp(-thickness / up[2])
        # seen from inside, with the axis turned round: wo is the direction back to the base
        on, crosses, factor, masking = meet(up * [[-1], [-1], [1]], 1 / eta, alpha, rng)
        down = on * [[1], [1], [-1]]
        weight = weight * factor * masking
        walks[:, index[crosses]] = *down[:, crosses], weight[crosses], np.full(crosses.sum(), k)
        weight = np.where(crosses, 0, weight * np.exp(-thickness / np.abs(on[2])))
    return walks


@pytest.mark.parametrize(
    "coat", [(1.5, 0.0, 0.0), (1.5, 0.0, 0.3), (2.2, 0.0, 0.01), (1.5, 0.3, 0.0), (1.8, 0.15, 0.05), (1.5, 0.8, 0.3)]
)
@pytest.mark.parametrize("degrees, reflectance", [(20.0, 0.9), (75.0, 0.5)])
def test_random_walks(coat: tuple[float, ...], degrees: float, reflectance: float) -> None:
    """Light that is followed from interface to interface leaves in the directions that the formula says, as often."""
    edges = np.linspace(0, 1, 7)
    _, _, cos, weight, bounce = walk(degrees, lambertian(reflectance), coat, 40, 2**17)
    for bounces in (1, 3, None):
        material = base(reflectance, *coat, bounces=bounces)
        for low, high in [(0.0, 1.0), *pairwise(edges)]:
            expected = (high - low) * (WEIGHTS @ leaving(material, degrees, low + (high - low) * COS))
            inside = (cos > low) & (cos <= high) & (bounce < (bounces or np.inf))
            assert abs(z_score(weight * inside, expected)) < Z_LIMIT


ALUMINIUM = (0.83, 0.6, 0.4), (5.1, 4.4, 3.5)
SMOOTH_METAL = ExactConductor(*ALUMINIUM)


@pytest.mark.parametrize(
    "alpha, coat, spread",
    [
        (0.2236, (1.5, 0.0, 0.01), (0.07, 0.12)),
        (0.0447, (1.5, 0.1414, 0.01), (0.13, 0.28)),
        (0.0, (1.5, 0.3162, 0.0), (0.13, 0.25)),
        (0.4, (1.8, 0.0, 0.3), (0.07, 0.12)),
    ],
)
@pytest.mark.parametrize("angle", [0, 1])
def test_random_walks_over_metal(alpha: float, coat: tuple, spread: tuple, angle: int) -> None:
    """As much light leaves as by walks, within 2 %, and most of it where the lobe says."""
    degrees, count = (30.0, 75.0)[angle], 2**16
    *wi, weight, _ = walk(degrees, metallic(SMOOTH_METAL, alpha), coat, 5, count)
    lobe = CoatedConductor(ALUMINIUM, alpha, *coat, bounces=5)
    points = surface(Material((lobe,)), polar(degrees), count)
    samples = points.sample(uniforms(count))
    directions = Directions(points, samples)
    pdf = np.where(directions.above, points.pdf(directions), np.inf)
    got = points.eval(directions)[0] * directions.cos_i / np.maximum(pdf, 1e-30)
    assert got.mean() == pytest.approx(weight.mean(), rel=0.02, abs=Z_LIMIT * weight.std() / np.sqrt(count))
    one, other = (np.histogram2d(*w[:2], 12, [[-1, 1]] * 2, weights=x)[0] for w, x in ((wi, weight), (samples, got)))
    assert np.abs(one / one.sum() - other / other.sum()).sum() / 2 < spread[angle]


@pytest.mark.parametrize("eta", [1.0, 1.5, 4.0])
@pytest.mark.parametrize("alpha, coat_alpha", [(0.02, 0.0), (0.0, 0.1), (0.3, 1.0), (1.0, 0.0), (1.0, 1.0)])
def test_coated_metal_reflects_no_more_than_it_gets(alpha: float, coat_alpha: float, eta: float) -> None:
    """At the ends of the range of indices, with a metal that absorbs next to nothing; the coat's own lobe included."""
    material = dmis.coated_conductor(1.0, 1e3, alpha, coat_alpha, eta)
    for degrees in (0, 60, 88):
        points = surface(material, polar(degrees))
        mirrored = sum(float(np.max(lobe.scatter(points)[1])) for lobe in points.delta)
        assert 0.05 < reflected(material, polar(degrees), 200, 100) + mirrored < 1.005


# Interfaces ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("eta", [1.1, 1.5, 3.0])
def test_diffuse_light_at_a_smooth_interface(eta: float) -> None:
    """The reflectance from inside follows from the one from outside, as the same rays go both ways."""
    outside = WEIGHTS @ (2 * COS * dielectric(COS, np.asarray(eta)))
    assert internal_reflectance(eta) == pytest.approx(1 - (1 - outside) / eta**2, abs=1e-6)
    assert internal_reflectance(eta, 1e-4) == pytest.approx(internal_reflectance(eta), abs=1e-3)


@pytest.mark.parametrize("alpha, thickness", [(1e-3, 0.0), (0.1, 0.1), (0.5, 0.0), (1.0, 0.01)])
def test_transmittance_is_that_of_facets(alpha: float, thickness: float) -> None:
    """The table against facets drawn with D cos_h, and no interval stands out."""
    for degrees in (0.0, 30.0, 65.0, 85.0):
        wo = np.repeat(polar(degrees)[:, None], 2**17, axis=1)
        on, crosses, weight, masking = meet(wo, 1.5, alpha, np.random.default_rng(2))
        share = weight * masking * crosses * np.exp(-thickness / np.abs(on[2]))
        got = transmittance(np.float32([wo[2, 0]]), 1.5, alpha, thickness).item()
        assert abs(z_score(share, got)) < Z_LIMIT or share.mean() == pytest.approx(got, abs=1e-6)
    cos = np.linspace(0, 1, 20001, dtype=np.float32)
    line = transmittance(cos, 1.5, alpha, thickness)
    assert line.dtype == np.float32 and (line >= 0).all() and (line < 1).all()
    assert np.abs(np.diff(line[200:], 2)).max() < 2e-4  # further down a nearly smooth interface is steep


# Materials and scenes -------------------------------------------------------------------------------------------------


def test_lobes_of_a_coat() -> None:
    """A mirror or GGX over the base; a black base is left out."""
    diffuse, mirror = dmis.coated_diffuse(0.5, eta=1.4).lobes
    assert isinstance(diffuse, CoatedBase) and isinstance(mirror, SpecularReflection) and mirror.fresnel == Coat(1.4)
    _, rough = dmis.coated_diffuse(0.5, 0.2).lobes
    assert isinstance(rough, GGX) and rough.fresnel == Dielectric(1.5) and rough.roughness.alpha == 0.2
    assert len(dmis.coated_diffuse(0).lobes) == 1
    values = surface(dmis.coated_diffuse((0.1, 0.2, 0.3), 0.2), polar(20), 5)
    assert values.eval(Directions(values, values.wo)).dtype == np.float32
    # index 1 reflects nothing, neither outside nor inside
    for alpha in (0, 0.3):
        made = dmis.coated_diffuse(0.7, alpha, 1.0)
        assert len(made.lobes) == 1
        # at the smallest cosine, 3e-4, the refracted one has lost half of its digits
        np.testing.assert_allclose(leaving(made, 40.0, COS), leaving(Material((Lambert(0.7),)), 40.0, COS), rtol=1e-4)


def test_coats_have_their_own_tables_in_a_scene() -> None:
    """Bases of one coat share a group; another index, roughness or thickness is another group. Values are as alone."""
    made = [
        dmis.coated_diffuse(0.2, 0.3),
        dmis.coated_diffuse((0.6, 0.2, 0.1), 0.3),
        dmis.coated_diffuse(0.2, 0.1),
        dmis.coated_diffuse(0.2, 0.3, 1.8),
        dmis.coated_diffuse(0.2, 0.3, thickness=0.5),
        dmis.coated_diffuse(0.2, 0.3, bounces=1),
    ]
    scene = box_scene(made[0], extra=tuple(Part(FLOOR, material) for material in made[1:]))
    assert scene.plan.part_group == [0, 0, 1, 2, 3, 4]
    for material, number in zip(made, scene.plan.part_group, strict=True):
        group = scene.plan.groups[number]
        row = np.full(2, [m is material for m in group.materials].index(True))
        points = surface(material, polar(30), 2)
        directions = Directions(points, points.wo)
        for lobe, own in zip(group.reflection, points.reflection, strict=True):
            got, expected = (np.broadcast_to(one.eval(directions), (3, 2)) for one in (bind(lobe, row, None), own))
            np.testing.assert_allclose(got, expected, rtol=1e-6)
