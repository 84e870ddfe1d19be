"""Lobes of all models: sampling, densities, energy, symmetry, closed forms, and agreement in renders."""

import itertools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import mirror_hemisphere, reflected

import dmis
from dmis.base.vectors import dot
from dmis.brdf.fresnel import Dielectric
from dmis.brdf.lobe import Directions
from dmis.pipeline.fingerprint import fingerprint
from dmis.testing.lobe_checks import check_lobe
from dmis.testing.outcome import require
from dmis.testing.scenes import box_scene, surface
from dmis.testing.sphere import columns, polar, sphere_rule, uniforms

MODELS = {
    "lambert": dmis.matte(1.0),
    "oren-nayar 20": dmis.matte(1.0, 20),
    "oren-nayar 90": dmis.matte(1.0, 90),
    "blinn 500": dmis.metal(roughness=0.002),
    "substrate 50": dmis.substrate(1.0, 0.5, 0.02, 0.02),
    "substrate 300 8": dmis.substrate(1.0, 0.5, 1 / 300, 1 / 8),
    "phong 5": dmis.phong(0, 1, 5),
    "phong 1000": dmis.phong(0, 1, 1000),
    "lafortune off-specular": dmis.lafortune(0, 1, 30, c_n=0.7),
    "lafortune retro": dmis.lafortune(0, 1, 30, c_t=0.95, c_n=1),
    "blinn-phong 8": dmis.blinn_phong(0, 1, 8),
    "blinn-phong 1000": dmis.blinn_phong(0, 1, 1000),
    "ward 0.05": dmis.ward(0, 1, 0.05),
    "ward 0.6": dmis.ward(0, 1, 0.6),
    "ward 0.1 0.4": dmis.ward(0, 1, 0.1, 0.4),
    "ashikhmin-shirley 20": dmis.ashikhmin_shirley(0.6, 0.3, 20),
    "ashikhmin-shirley 10 300": dmis.ashikhmin_shirley(0.6, 0.3, 10, 300),
    "torrance-sparrow 10": dmis.torrance_sparrow(0, 1, 10),
    "torrance-sparrow 20": dmis.torrance_sparrow(0, 1, 20, Dielectric(1.5)),
    "torrance-sparrow 1e4": dmis.torrance_sparrow(0, 1, 1e4, Dielectric(1.5)),
    "cook-torrance 0.1": dmis.cook_torrance(0, 1, 0.1),
    "cook-torrance 0.5": dmis.cook_torrance(0, 1, 0.5, fresnel=Dielectric(1.5)),
    "cook-torrance 0.4 0.1": dmis.cook_torrance(0, 1, 0.4, 0.1),
    "ggx 0.03": dmis.ggx(0, 1, 0.03),
    "ggx 0.3": dmis.ggx(0, 1, 0.3, fresnel=Dielectric(1.5)),
    "ggx 1": dmis.ggx(0, 1, 1.0),
    "ggx 0.05 0.5": dmis.ggx(0, 1, 0.05, 0.5),
    "ggx over lambert": dmis.ggx(0.4, 0.5, 0.2),
    "rough glass 0.05": dmis.rough_glass(alpha=0.05),
    "rough glass 0.8": dmis.rough_glass(alpha=0.8, eta=1.3),
    "rough glass 0.4 0.1": dmis.rough_glass(alpha=0.4, alpha_v=0.1),
    "coated diffuse": dmis.coated_diffuse(1.0),
    "coated diffuse 0.3": dmis.coated_diffuse(0.9, 0.3, 1.7, 0.1, 5),
    "coated metal 0.1": dmis.coated_conductor(1, 1e3, 0.1),  # it absorbs next to nothing
    "coated metal 0.3 0.2": dmis.coated_conductor(1, 1e3, 0.3, 0.2),
    "coated metal 0 0.2": dmis.coated_conductor(1, 1e3, 0.0, 0.2),
    "metallic-roughness 0.6": dmis.metallic_roughness((0.9, 0.5, 0.2), 0.5, 0.6),
}
each_model = pytest.mark.parametrize("name", MODELS)


# Sampling -----------------------------------------------------------------------------------------------------------


@each_model
def test_checks(name: str) -> None:
    """Samples, densities, energy, symmetry, finite values, renders of each lobe."""
    for lobe in MODELS[name].lobes:
        require(check_lobe(lobe, name))


# Energy and symmetry ------------------------------------------------------------------------------------------------


def page_table() -> dict[str, list[float]]:
    """Numbers of the table of docs/brdfs.md, by the first cell of each row."""
    text = (Path(__file__).parents[2] / "docs" / "brdfs.md").read_text("utf-8")
    lines = text[text.index("| lobe |") :].split("\n\n")[0].splitlines()[2:]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    return {row[0]: [float(x) for x in re.findall(r"\d+\.\d+", " ".join(row[1:]))] for row in cells}


PAGE = {
    "Phong 50": dmis.phong(0, 1, 50),
    "Blinn-Phong 50": dmis.blinn_phong(0, 1, 50),
    "Ward 0.15": dmis.ward(0, 1, 0.15),
    "Ashikhmin–Shirley 100, coat": dmis.ashikhmin_shirley(0, 1, 100),
    "Torrance–Sparrow 50": dmis.torrance_sparrow(0, 1, 50),
    "Cook–Torrance 0.2": dmis.cook_torrance(0, 1, 0.2),
    "Cook–Torrance 0.5": dmis.cook_torrance(0, 1, 0.5),
    "GGX 0.2": dmis.ggx(0, 1, 0.2),
    "GGX 0.5": dmis.ggx(0, 1, 0.5),
    "GGX 1": dmis.ggx(0, 1, 1.0),
}


def test_albedos_of_the_page() -> None:
    """docs/brdfs.md gives albedo and accepted mass of white lobes, rounded to a hundredth."""
    table = page_table()
    assert table.keys() == PAGE.keys()
    for name, numbers in table.items():
        for k, degrees in enumerate((0.0, 75.0)):
            wo = polar(degrees)
            w, weights = mirror_hemisphere(wo)
            some = surface(PAGE[name], wo, w.shape[1])
            mass = float(some.reflection[-1].pdf(Directions(some, w)) @ weights)
            got = reflected(PAGE[name], polar(degrees, 25.0)), mass
            np.testing.assert_allclose(got, numbers[2 * k : 2 * k + 2], atol=0.006, err_msg=name)


# Forms --------------------------------------------------------------------------------------------------------------


EXTREME = {
    "phong": (dmis.phong(0, 1, 0.01), dmis.phong(0, 1, 1e6)),
    "lafortune": (dmis.lafortune(0, 1, 0.01, 1, 0.01), dmis.lafortune(0, 1, 1e6, 0, 1)),
    "blinn-phong": (dmis.blinn_phong(0, 1, 0.01), dmis.blinn_phong(0, 1, 1e6)),
    "ward": (dmis.ward(0, 1, 1e-4), dmis.ward(0, 1, 10.0), dmis.ward(0, 1, 1e-4, 10.0)),
    "ashikhmin-shirley": (dmis.ashikhmin_shirley(0.5, 0.5, 0.01), dmis.ashikhmin_shirley(0.5, 1, 1e6, 0.01)),
    "torrance-sparrow": (dmis.torrance_sparrow(0, 1, 0.01), dmis.torrance_sparrow(0, 1, 1e6)),
    "cook-torrance": (dmis.cook_torrance(0, 1, 1e-4), dmis.cook_torrance(0, 1, 10.0, 1e-4, Dielectric())),
    "ggx": (dmis.ggx(0, 1, 1e-4), dmis.ggx(0, 1, 10.0), dmis.ggx(0, 1, 1e-4, 10.0, Dielectric())),
    "coated metal": (dmis.coated_conductor(alpha=1e-4), dmis.coated_conductor(alpha=1, coat_alpha=1, coat_eta=4)),
    "materials of pbrt": (
        *(dmis.matte(0.5, 30), dmis.plastic(0.3, 0.4, 0.02), dmis.plastic(0.3, 0.4, 0.1, 1 / 1.5)),
        *(dmis.metal(roughness=0.002), dmis.shiny_metal(0.8, 0.5, 0.05), dmis.substrate(0.2, 0.5, 0.02, 0.1)),
        dmis.uber(0.3, 0.3, 0.2, 0.2, 0.01, opacity=0.7),
    ),
    "rough glass": tuple(
        dmis.rough_glass(alpha=alpha, alpha_v=alpha_v, eta=eta)
        for alpha, alpha_v in ((1e-4, None), (10.0, None), (1e-4, 10.0))
        for eta in (1.5, 1.001, 1 / 1.001, 3.0)
    ),
    "coated diffuse": (dmis.coated_diffuse(1), dmis.coated_diffuse(1, 1e-4), dmis.coated_diffuse(1, 10.0, 4.0, 9.0)),
}


@pytest.mark.parametrize("name", EXTREME)
@pytest.mark.parametrize("degrees", [0.0, 60.0, 89.9, 89.9999, 90.0])
def test_extreme_roughness_is_finite(name: str, degrees: float) -> None:
    """No NaN, infinity or negative value, at the horizon, straight back, in the mirror direction, at the ends of u."""
    wo = polar(degrees)
    wo[2] = max(wo[2], 0)
    special = [wo, wo * [-1, -1, 1], -wo, wo * [1, 1, -1], (0, 0, 1), (0, 0, -1), (1, 0, 0), polar(89.99999, 205.0)]
    wi = np.concatenate([columns(v) for v in special], axis=1)
    edge = np.float32(1 - 2**-24)
    ends = np.array([[0, 0, edge, edge, 0.5, 0.5], [0, edge, 0, edge, 0, edge]], np.float32)
    u = np.concatenate([ends, uniforms(1000)], axis=1)
    for material, outside, beyond in itertools.product(EXTREME[name], (True, False), (False, True)):
        if beyond and name != "rough glass":
            continue
        points, many = (surface(material, wo, n, outside=outside) for n in (wi.shape[1], u.shape[1]))
        if beyond:
            points, many = points.beyond(), many.beyond()
        sampled = many.sample(u)
        assert np.isfinite(sampled).all()
        np.testing.assert_allclose(dot(sampled, sampled), 1, atol=1e-5)
        for at, w in ((points, wi), (many, sampled)):
            directions = Directions(at, w)
            f, pdf = np.broadcast_to(at.eval(directions), w.shape), at.pdf(directions)
            assert np.isfinite(f).all() and (f >= 0).all()
            assert np.isfinite(pdf).all() and (pdf >= 0).all()
            assert beyond or not pdf[w[2] < 0].any()


# Scenes -------------------------------------------------------------------------------------------------------------


def test_tangent_of_a_part_is_laid_upon_its_surface() -> None:
    """A narrow lobe along the given direction, wherever the mesh's own coordinates point; parts differ in theirs."""
    material = dmis.ggx(0, 1, 0.01, 0.5)
    for tangent in ((1.0, 0.0, 0.3), (0.0, 2.0, 0.0), (1.0, 1.0, 0.0)):
        base = box_scene(material)
        scene = replace(base, parts=(replace(base.parts[0], tangent=tangent),))
        (group,) = scene.plan.groups
        origin, down = np.float32([[0.1], [0.2], [1]]), np.float32([[0], [0], [-1]])
        hits = scene.intersector.closest(origin, down)
        points, _ = scene.shading_points(group, hits, None, down)
        s, t = points.tangents
        flat = np.array([*tangent[:2], 0.0]) / np.linalg.norm(tangent[:2])
        np.testing.assert_allclose(s[:, 0], flat, atol=1e-6)
        np.testing.assert_allclose(np.cross(points.n[:, 0], s[:, 0]), t[:, 0], atol=1e-6)
        assert fingerprint(scene) != fingerprint(base)
    isotropic = box_scene(dmis.ggx(0, 1, 0.1))
    isotropic = replace(isotropic, parts=(replace(isotropic.parts[0], tangent=(1, 0, 0)),))
    assert isotropic.plan.groups[0].tangent is None
    # A direction that is perpendicular to the surface says nothing of it: any frame will do, and it is unit
    points = surface(dmis.ggx(0, 1, 0.1, 0.5), polar(30.0), 4, dpdu=(0, 0, 2))
    s, t = points.tangents
    for a, b, expected in ((s, s, 1), (t, t, 1), (s, t, 0), (s, points.n, 0)):
        np.testing.assert_allclose(dot(a, b), expected, atol=1e-6)


@pytest.mark.parametrize("exponent", [1e-3, 0.02])
def test_a_lobe_ends_where_its_cosine_does(exponent: float) -> None:
    """Beyond 90 degrees from its axis it is 0, however small its power; so all rules have one mean."""
    wo = polar(60.0)
    w, weights = sphere_rule(wo * [-1, -1, 1], 500, 200)
    points = surface(dmis.phong(0, 1, exponent), wo, w.shape[1])
    directions = Directions(points, w)
    beyond = wo * [-1, -1, 1] @ w < -1e-6
    assert not points.eval(directions)[:, beyond].any() and not points.pdf(directions)[beyond].any()
    some = surface(dmis.phong(0, 1, exponent), wo, 2**14)
    accepted = (some.sample(uniforms(2**14))[2] > 0).mean()
    np.testing.assert_allclose(points.pdf(directions).astype(float) @ weights, accepted, atol=0.01)


def test_reflectances_that_add_up_to_more_than_1_are_named() -> None:
    with pytest.warns(
        UserWarning, match=r"ggx reflects up to 1\.1 of the light, kd = 0\.1 beside ks = 1, .* lower one"
    ):
        dmis.ggx(0.1)
    dmis.ggx(0.1, fresnel=Dielectric(1.5)), dmis.ggx((1, 0.5, 0), (0, 0.5, 1))
