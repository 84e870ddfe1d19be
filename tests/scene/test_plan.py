"""The plan: what is left out is never called and changes no bit; and which integrator a scene has."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from functools import partial
from typing import Any

import helpers
import numpy as np
import pytest
from helpers import Watched, image_tile, pixel_shares

import dmis
from dmis.brdf.ashikhmin_shirley import BlendBase
from dmis.brdf.lobe import Lambert
from dmis.brdf.materials import Material, matte, metal, mirror, plastic
from dmis.brdf.models import ggx
from dmis.brdf.specular import SpecularReflection
from dmis.brdf.texture import Image
from dmis.estimator import path, trace
from dmis.estimator.settings import Settings
from dmis.fit.round import Round
from dmis.fit.rule import merge_settings
from dmis.geometry.shapes import quad, sphere
from dmis.geometry.transforms import translate
from dmis.intersect import UNTRACED, Hits
from dmis.light.area import QuadLight
from dmis.light.delta import DistantLight, PointLight
from dmis.light.environment import EnvironmentLight
from dmis.light.light import Light
from dmis.pipeline.tile import render_tile
from dmis.scene.camera import Camera
from dmis.scene.groups import NO_GROUP, Part
from dmis.scene.scene import Scene
from dmis.scene.shading_points import ShadingPoints, Surfaces
from dmis.scene.suggestions import Suggestions
from dmis.testing.scenes import FLOOR, box_scene

LAMP = QuadLight((-0.5, -0.5, 2), (0, 1, 0), (1, 0, 0), (5, 4, 3))
POINT = PointLight((0, 0, 2), (1, 1, 1))
SUN = DistantLight((0, 0, 1), (1, 1, 1))
DARK, OFF = replace(LAMP, radiance=(0, 0, 0)), replace(POINT, intensity=(0, 0, 0))
GREY = Image(np.full((4, 4, 3), (0.5, 0.25, 0.125), np.float32))
GOLD = metal(roughness=0.05)
RED = plastic((0.5, 0.25, 0.125))
CHECKS = Image(np.indices((8, 8)).sum(axis=0)[..., None] % 2 * np.float32(0.8))


tile_of = partial(helpers.tile_of, seed=1, spp=4, sampler="auto", integrator="direct")


# What is not needed is not called -----------------------------------------------------------------------------------

# what is counted; a scene that needs it; one that does not
CALLS: dict[str, tuple[Any, str, Scene, Scene]] = {
    "BRDF sampling": (ShadingPoints, "sample", box_scene(plastic()), box_scene(plastic(), (POINT, SUN))),
    "BRDF densities": (ShadingPoints, "pdf", box_scene(plastic()), box_scene(plastic(), (POINT,))),
    "light sampling": (QuadLight, "sample", box_scene(matte()), box_scene(mirror())),
    "sampling of a dark light": (QuadLight, "sample", box_scene(), box_scene(lights=(DARK, POINT))),
    "a dark point light": (PointLight, "sample", box_scene(lights=(POINT,)), box_scene(lights=(LAMP, OFF))),
    "tangents": (ShadingPoints, "tangents", box_scene(ggx(alpha=0.1, alpha_v=0.3)), box_scene(metal())),
    "textures": (Image, "__call__", box_scene(matte(CHECKS)), box_scene(matte(GREY))),
    "environment lookups": (
        EnvironmentLight,
        "_lookup",
        box_scene(lights=(EnvironmentLight(np.ones((2, 4, 3))),)),
        box_scene(lights=(EnvironmentLight(np.zeros((2, 4, 3))), LAMP)),
    ),
    "BRDF of a black lobe": (ShadingPoints, "eval", box_scene(), box_scene(Material((Lambert((0, 0, 0)),)))),
    "mirrored rays": (
        path, "scatter", box_scene(mirror()), box_scene(Material((Lambert(0.5), SpecularReflection(0.0))))
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CALLS)
def test_left_out(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Called where it is needed, and never where it is not."""
    owner, attribute, needs, does_not = CALLS[name]
    called = counting(owner, attribute, monkeypatch)
    image, _ = tile_of(needs)
    assert called["times"] > 0 and (image.any() or name == "mirrored rays")
    _ = does_not.plan  # which looks once at a texture, to see that it is constant
    called.clear()
    image, _ = tile_of(does_not)
    assert called["times"] == 0


def counting(owner: Any, attribute: str, monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Counts how often a function, a method or a cached property is used."""
    called: Counter[str] = Counter()
    wrapped = vars(owner)[attribute]
    function = getattr(wrapped, "func", wrapped)

    def counted(*arguments: Any, **named: Any) -> Any:
        called["times"] += 1
        return function(*arguments, **named)

    patched: Any = property(counted) if function is not wrapped else counted
    for place in (owner, trace) if owner is path else (owner,):
        monkeypatch.setattr(place, attribute, patched)
    return called


@pytest.mark.parametrize("table", ["normals", "uv", "tangents"])
def test_tables_that_nothing_needs_are_not_built(table: str) -> None:
    """No texture coordinates for a constant texture, no tangents for isotropic lobes, no normals for flat meshes."""
    plain, needs = box_scene(matte(GREY)), {"normals": Part(sphere(0.2, segments=16), matte())}
    needs |= {"uv": Part(FLOOR, matte(CHECKS)), "tangents": Part(FLOOR, ggx(alpha=0.1, alpha_v=0.2))}
    tile_of(plain)
    assert table not in vars(plain.surfaces)
    other = replace(plain, parts=(needs[table],))
    other.prepare()
    assert table in vars(other.surfaces)


def test_black_surfaces_end_paths(monkeypatch: pytest.MonkeyPatch) -> None:
    """No ray leaves a surface without albedo, and no random number is drawn for one."""
    walls = Part(quad((-4, 1, 0), (8, 0, 0), (0, 0, 4)), matte(0.5))
    grey, black = (box_scene(Material((Lambert(a),)), extra=(walls,)) for a in (0.5, 0.0))
    assert tile_of(grey, integrator="path")[1]["bounce 1"] > 0
    called = counting(path, "bounce", monkeypatch)
    image, rays = tile_of(box_scene(Material((Lambert(0.0),))), integrator="path")
    assert not image.any() and rays["bounce 1"] == 0 and called["times"] == 0 and rays["shadow"] == 0
    assert tile_of(black, integrator="path")[1]["bounce 1"] < tile_of(grey, integrator="path")[1]["bounce 1"]
    scene = ball_scene()
    assert not replace(scene, parts=(Part(scene.parts[0].mesh, matte(0)),)).covered_pixels.any()  # type: ignore[union-attr]


def test_last_rays_are_followed_only_where_they_may_meet_a_light() -> None:
    """After the last surface only mirrors count, and only if there is a light to be met."""
    shiny = Material((Lambert(0.3), mirror(0.5).lobes[0]))
    seen = Part(
        quad((-1, 2, 0), (2, 0, 0), (0, 0, 2)), matte(0), lamp := QuadLight((-1, 2, 0), (2, 0, 0), (0, 0, 2), (3, 2, 1))
    )
    lit = box_scene(shiny, (lamp, POINT), (seen,))
    dark = box_scene(shiny, (POINT,))
    assert tile_of(dark, integrator="path", max_depth=1)[1]["bounce 1"] == 0
    image, rays = tile_of(lit, integrator="path", max_depth=1)
    # the mirror is picked in proportion to what it lets through, half of the time
    assert 0.3 < rays["bounce 1"] / rays["camera"] < 0.7
    assert image.any()


def test_lamps_that_paths_may_not_see_are_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """Behind surfaces that all scatter, a lamp is what a ray ends at, and no more: its surface is for the camera."""
    shape = Part(quad(LAMP.corner, LAMP.edge_u, LAMP.edge_v), Material(()), LAMP)
    looked: list[int] = []
    surface = Surfaces.shading_points

    def counted(surfaces: Surfaces, group: Any, hits: Hits, *rest: Any) -> Any:
        looked.append(group.emission is not None)
        return surface(surfaces, group, hits, *rest)

    monkeypatch.setattr(Surfaces, "shading_points", counted)
    for material, times in ((matte(0.5), 0), (Material((Lambert(0.3), mirror(0.5).lobes[0])), 1)):
        looked.clear()
        scene = box_scene(material, (LAMP,), (shape,), eye=(0, -1, 1))  # which sees the floor alone
        tile_of(scene, integrator="path", max_depth=2)
        assert sum(looked) == times


# What is left out changes nothing -------------------------------------------------------------------------------------


def scene_of(material: Material = RED, unseen: Material = GOLD, *more: Light) -> Scene:
    """A floor of a material and a ball under lights, `more` first; behind the camera a square of `unseen`."""
    camera = Camera.look_at((0, -3, 2), (0, 0, 0.3), fov=40, resolution=(16, 12))
    ball = sphere(0.5, segments=48).transformed(translate((0, 0, 0.5)))
    square = quad((-0.2, -3.9, 0.7), (0.4, 0, 0), (0, 0, 0.3))
    parts = Part(quad((-4, -4, 0), (8, 0, 0), (0, 8, 0)), material), Part(ball, GOLD), Part(square, unseen)
    lights = *more, LAMP, PointLight((2, -2, 2), (1, 1, 1))
    return Scene(camera, parts, lights, "plain", Suggestions("direct", 5))


UNUSED = {
    "nothing (the same scene)": scene_of(),
    "an image texture of one colour": scene_of(plastic(GREY)),
    "a black lobe": scene_of(replace(RED, lobes=(*RED.lobes, Lambert(0.0)))),
    "an area light without power": scene_of(RED, GOLD, DARK),
    "a point light without power": scene_of(RED, GOLD, OFF),
    "an environment without radiance": scene_of(RED, GOLD, EnvironmentLight(np.zeros((32, 64, 3)))),
    "a black surface out of sight": scene_of(unseen=matte(0)),
}
"""Scenes whose image does not need a feature."""
OUT_OF_SIGHT = {
    "another material": scene_of(unseen=matte((0.1, 0.2, 0.3), sigma=20)),
    "an image texture": scene_of(unseen=matte(CHECKS)),
    "an anisotropic lobe": scene_of(unseen=ggx(alpha=0.1, alpha_v=0.4)),
    "a mirror": scene_of(unseen=mirror()),
}
"""Those that paths see."""


@pytest.mark.parametrize("name", [*UNUSED, *OUT_OF_SIGHT])
def test_unused_features_change_no_bit(name: str) -> None:
    """Random numbers are drawn for what is used only, so even they are the same."""
    for integrator in ("direct", "path") if name in UNUSED else ("direct",):
        image, rays = tile_of(scene_of(), integrator=integrator)
        found, again = tile_of((UNUSED | OUT_OF_SIGHT)[name], integrator=integrator)
        np.testing.assert_array_equal(found, image)
        assert again == rays


def test_surface_of_a_light_without_power_is_a_surface() -> None:
    """It reflects, and does not glow."""
    dark = replace(LAMP, radiance=(0.0, 0.0, 0.0))
    part = Part(quad(dark.corner, dark.edge_u, dark.edge_v), matte(0.5), dark)
    scene, other = (box_scene(lights=(dark, POINT), extra=(p,)) for p in (part, replace(part, light=None)))
    assert [group.emission for group in scene.plan.groups] == [None]
    np.testing.assert_array_equal(tile_of(scene)[0], tile_of(other)[0])
    # a substrate is one model of two lobes
    scene = box_scene(dmis.substrate(kd=0))
    assert any(isinstance(lobe, BlendBase) for lobe in scene.plan.groups[0].reflection)


# Pixels that see nothing ----------------------------------------------------------------------------------------------


def ball_scene(resolution: tuple[int, int] = (40, 30), **camera: Any) -> Scene:
    """A small ball before nothing."""
    view = {"eye": (0.3, -4, 1), "target": (0.4, 0, 0.2), "fov": 40.0, **camera}
    eye, target, fov = view["eye"], view["target"], view["fov"]
    ball = sphere(0.4, segments=32).transformed(translate((0, 0, 0.5)))
    return Scene(Camera.look_at(eye, target, fov=fov, resolution=resolution), (Part(ball, plastic()),), (LAMP,))


def everything(scene: Scene) -> Scene:
    """The same scene, in which no pixel is known to see nothing."""
    other = replace(scene)
    vars(other)["covered_pixels"] = None
    return other


@pytest.mark.parametrize(
    "settings", [{}, {"combiner": "optimal"}, {"sampler": "sobol"}, {"allocation": "random"}, {"lights": "one"}]
)
def test_pixels_that_see_nothing_are_not_traced(settings: dict[str, Any]) -> None:
    """Only rays that miss are left out, most of them, and the image has the same bits."""
    scene = ball_scene()
    round_ = Round(8, pixel_shares(np.linspace(0.2, 0.8, 1200)), Settings(integrator="direct", **settings))
    tile = image_tile(scene, 3, round_)
    results, watched = [], []
    for one in (scene, everything(scene)):
        watched.append(Watched(one.intersector))
        results.append(render_tile(one, tile, watched[-1]))
    few, all_ = watched
    assert all_.rays == 40 * 30 * 8 and few.met == all_.met > 0
    assert few.rays < 0.25 * all_.rays
    np.testing.assert_array_equal(results[0].mean, results[1].mean)
    np.testing.assert_array_equal(results[0].root, results[1].root)
    told = [result.rays for result in results]
    assert told[0]["camera"] == few.rays and told[0]["camera"] + told[0][UNTRACED] == told[1]["camera"]
    assert all(told[0][kind] == told[1][kind] for kind in ("shadow", "brdf"))


@pytest.mark.parametrize("rule", ["balance", "thesis", "auto"])
def test_rules_do_not_see_the_difference(rule: str) -> None:
    """Learned weights are the same, too, with tiles that see nothing at all."""
    scene = ball_scene((90, 40), fov=90.0)
    results = [dmis.render(one, rule, 16, seed=2, parallel=1) for one in (scene, everything(scene))]
    for name in ("image", "variance", "weight", "samples"):
        np.testing.assert_array_equal(getattr(results[0], name), getattr(results[1], name))
    assert results[0].rays["camera"] < 0.7 * results[1].rays["camera"] and UNTRACED not in results[0].rays
    crops = [one.crop((20, 10, 60, 35)) for one in (scene, everything(scene))]
    crops[1] = everything(crops[1])
    images = [dmis.render(one, rule, 16, seed=2, parallel=1).image for one in crops]
    np.testing.assert_array_equal(*images)


@pytest.mark.parametrize("seed", range(8))
def test_visible_triangles_are_never_left_out(seed: int) -> None:
    """Triangles anywhere, large and tiny, far from the origin and beside the camera: no ray that hits is left out."""
    rng = np.random.default_rng(seed)
    centres = rng.normal(size=(40, 1, 3)) * 3
    size = 10.0 ** rng.uniform(-4, 0.5, (40, 1, 1))
    offset = rng.choice([0.0, 1e3, 1e5], 3)
    vertices = (centres + size * rng.normal(size=(40, 3, 3)) + offset).reshape(-1, 3)
    mesh = dmis.Mesh(vertices, np.arange(120).reshape(40, 3))
    eye, target = rng.normal(size=(2, 3)) * 2 + offset
    camera = Camera.look_at(tuple(eye), tuple(target), fov=float(rng.uniform(5, 150)), resolution=(48, 32))
    if seed % 2:
        camera = camera.crop((11, 5, 40, 27))
    scene = Scene(camera, (Part(mesh, matte()),), (PointLight(tuple(eye), (1, 1, 1)),))
    width, height = camera.resolution
    x, y = (rng.random(200_000, dtype=np.float32) * n for n in (width, height))
    hits = scene.intersector.closest(np.repeat(camera.origin, len(x), axis=1), camera.rays(x, y))
    if scene.covered_pixels is not None:
        row, column = (np.minimum(a.astype(int), n - 1) for a, n in ((y, height), (x, width)))
        assert scene.covered_pixels[row, column][hits.prim >= 0].all()


def test_nothing_is_provable_under_a_sky() -> None:
    """Every pixel sees the sky; without any light none sees anything."""
    scene = ball_scene()
    assert scene.covered_pixels is not None and scene.covered_pixels.any() and not scene.covered_pixels.all()
    assert replace(scene, lights=(EnvironmentLight(np.ones((2, 4, 3))),)).covered_pixels is None
    black = replace(scene, lights=())
    assert black.covered_pixels is not None and not black.covered_pixels.any()
    watched = Watched(black.intersector)
    round_ = Round(4, pixel_shares(0.5), Settings(integrator="direct"))
    image = render_tile(black, image_tile(black, 1, round_), watched)
    assert watched.rays == 0 and not image.mean.any()


# Which integrator ---------------------------------------------------------------------------------------------------


def test_default_integrator() -> None:
    """A scene made in Python is rendered by direct lighting, unless it or the settings name another integrator."""
    corner = box_scene(extra=(Part(quad((-4, 1, 0), (8, 0, 0), (0, 0, 4)), matte(0.8)),))
    assert "integrator: direct, max_depth 5, the default, because the scene names none" in corner.describe()
    assert "bounce 1" not in dmis.render(corner, "balance", 2, parallel=1).rays
    paths = replace(corner, suggested=Suggestions("path", 3))
    assert "integrator: path, max_depth 3, the scene's" in paths.describe()
    result = dmis.render(paths, "balance", 2, parallel=1)
    assert result.provenance["settings"]["integrator"] == "path" and result.rays["bounce 2"] > 0
    assert "bounce 3" not in result.rays


@pytest.mark.parametrize(
    "named, given, resolved",
    [
        ((None, None), ("direct", "auto"), ("direct", 5)),
        ((None, None), ("path", None), ("path", None)),
        (("path", 9), ("auto", "auto"), ("path", 9)),
        (("path", 9), ("direct", "auto"), ("direct", 5)),
        (("path", 9), ("auto", 3), ("path", 3)),
        (("path", None), ("auto", "auto"), ("path", 5)),
    ],
)
def test_merge_settings(named: Any, given: Any, resolved: Any) -> None:
    """The settings decide, else the scene, else the defaults."""
    scene = replace(box_scene(), suggested=Suggestions(*named))
    settings = merge_settings(Settings(integrator=given[0], max_depth=given[1]), scene)[0]
    assert (settings.integrator, settings.max_depth) == resolved
    assert merge_settings(settings, scene)[0] == settings and settings.sampler == "sobol"


DEPTHS = (0, -3, 0.5, np.nan, 10_001, np.int64(0), np.int64(-3), np.float32(0.5), True, "deep")


@pytest.mark.parametrize(
    "make, name, values, allowed",
    [
        (Settings, "integrator", ["bdpt"], "auto or direct or path"),
        (Settings, "max_depth", DEPTHS, "a whole number from 1 to 10000, auto or None"),
        (Suggestions, "integrator", ["bdpt", "auto", 0], "direct or path, or None"),
        (Suggestions, "max_depth", (*DEPTHS, "auto"), "a whole number from 1 to 10000, or None"),
        (partial(replace, box_scene()), "suggested", ["path"], "dmis.Suggestions, such as those of a file"),
        (partial(replace, box_scene()), "camera", [None], "a Camera"),
        (partial(replace, box_scene()), "parts", [None, 3, ["floor"]], "a sequence of parts of dmis"),
        (partial(replace, box_scene()), "lights", [LAMP], "a sequence of lights of dmis"),
    ],
)
def test_bad_requests_and_scenes(make: Any, name: str, values: Any, allowed: str) -> None:
    for value in values:
        with pytest.raises(ValueError, match=f"{name} must be {allowed}; got .*{re.escape(str(value))}"):
            make(**{name: value})


def test_description_names_what_is_done() -> None:
    """Materials times lights, what is left out, what it costs."""
    dark = replace(POINT, intensity=(0, 0, 0))
    parts = (
        Part(quad((1, 0, 0), (1, 0, 0), (0, 0, 1)), mirror()),
        Part(quad((2, 0, 0), (1, 0, 0), (0, 0, 1)), matte(0)),
    )
    text = box_scene(Material((Lambert(0.5), Lambert(0.0)), "paint"), (LAMP, POINT, dark), parts).describe()
    for words in (
        "1 x paint: Lambert; 2 triangles; needs nothing else; MIS of QuadLight; one sample of each PointLight, no BRDF",
        "1 x mirror: SpecularReflection; 2 triangles; needs nothing else; mirrored and refracted rays are followed: no",
        "2 triangles neither reflect nor emit",
        "left out: 1 lights that emit nothing",
        "left out: 1 lobes that reflect nothing",
        "integrator: direct, max_depth 5",
    ):
        assert words in text, (words, text)
    assert NO_GROUP not in box_scene().plan.part_group
