"""The pinned estimator: its settings are complete and held, and its images stay."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pin_preset
import pytest
from helpers import Z_LIMIT, means, shared_scene, z_score

import dmis
from dmis.base.vectors import Array
from dmis.estimator.settings import DEFAULTS, PRESETS, make_settings
from dmis.fit.fixed import Fixed
from dmis.fit.rule import merge_settings
from dmis.light.environment import EnvironmentLight
from dmis.pipeline.fingerprint import fingerprint
from dmis.testing.scenes import box_scene
from dmis.testing.sphere import sphere_rule, uniforms


@pytest.mark.parametrize("name", PRESETS)
def test_preset_is_complete(name: str) -> None:
    """A new field of Settings needs a value in each preset, the old behaviour."""
    preset = PRESETS[name]
    assert set(preset.values) == {field.name for field in fields(dmis.Settings)} - {"preset"}
    assert preset.choices.keys() <= preset.values.keys()
    assert make_settings(preset=name) == dmis.Settings(**preset.values, preset=name)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sampler": "sobol"}, "preset thesis has sampler 'independent' or 'lowdiscrepancy'; got 'sobol'"),
        ({"rule": "uniform"}, "preset thesis has techniques"),
        ({"settings": dmis.Settings(lights="all")}, "preset thesis has lights 'pbrt'; got 'all'"),
        ({"preset": "best"}, "preset must be thesis or thesis-shares or nearest or None; got 'best'"),
    ],
)
def test_pinned_values_are_held(box: dmis.Scene, options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        dmis.render(box, **{"rule": "balance", "spp": 8, "preset": "thesis", **options})


def test_open_values_are_the_callers(box: dmis.Scene) -> None:
    """S, integrator and depth, the heuristic and the reuse of the pilot; a rule states the last two."""
    assert dmis.render(box, spp=32, preset="thesis").provenance["rule"] == "thesis"
    options = {"shading_samples": 4, "integrator": "path", "max_depth": 3}
    for rule, stated in (
        ("balance:combiner=power", {"combiner": "power"}),
        ("thesis:reuse=yes", {"reuse_pilot": True}),
    ):
        result = dmis.render(box, rule, 8, preset="thesis", **options)
        assert result.provenance["settings"].items() >= {**options, **stated, "preset": "thesis"}.items()
    # scene decides the integrator
    for name, one in (("path", True), ("direct", False)):
        settings, _ = merge_settings(make_settings(preset="thesis"), replace(box, suggested=dmis.Suggestions(name)))
        assert settings.one_light == one and settings.preset == "thesis"


@pytest.mark.parametrize(
    ("rule", "preset", "weigh"),
    [
        ("thesis:patch=8", None, "heuristic"),
        ("thesis:patch=8", "thesis", "heuristic"),
        ("thesis:patch=8", "thesis-shares", "samples"),
        ("thesis:patch=8,combiner=power", "thesis", "samples"),
    ],
)
def test_what_w_is(box: dmis.Scene, rule: str, preset: str | None, weigh: str) -> None:
    """The preset says it, and the tilt without one; a rule that says it wins."""
    default = dmis.render(box, rule, 16, preset=preset)
    assert (default.weight == default.light_share).all() == (weigh == "samples")
    for other in ("thesis", "thesis-shares") if preset else (None,):
        stated = dmis.render(box, f"{rule},weigh={weigh}", 16, preset=other)
        np.testing.assert_array_equal(stated.image, default.image)


@pytest.mark.parametrize(
    ("name", "integrator", "samples"), [("teapot-area-light", "direct", 32), ("tt", "auto", 16), ("tt", "path", 2)]
)
def test_nearest_takes_numbers_from_the_file(name: str, integrator: str, samples: int) -> None:
    """Its points are pbrt-v2's; by paths there is one light and one BRDF sample, of a light that the points pick."""
    settings = dmis.Settings.as_in_file(shared_scene(name, (16, 12)), preset="nearest", integrator=integrator)
    assert settings == make_settings(preset="nearest", integrator=integrator, shading_samples=samples)
    assert (settings.sampler, settings.lights, settings.weigh) == ("lowdiscrepancy", "pbrt", "heuristic")


@pytest.mark.parametrize(("integrator", "same_as"), [("direct", "all"), ("path", "one")])
def test_lights_as_in_pbrt(box: dmis.Scene, integrator: str, same_as: str) -> None:
    """All lights in direct lighting, one at each vertex of a path."""
    scene = box.changed(lights=(*box.lights, dmis.PointLight((0, 0, 1), (1, 1, 1))))
    images = [
        dmis.render(scene, "balance", 4, lights=lights, integrator=integrator).image
        for lights in ("pbrt", same_as, {"all": "one", "one": "all"}[same_as])
    ]
    assert np.array_equal(images[0], images[1]) and not np.array_equal(images[0], images[2])


@pytest.fixture(scope="module")
def stored() -> dict[str, np.ndarray]:
    with np.load(pin_preset.FILE) as arrays:
        return dict(arrays)


@pytest.mark.parametrize(
    ("scenes", "step"),
    [(("teapot-area-light", "tt", "ten-lights"), 5), pytest.param(pin_preset.SCENES, 1, marks=pytest.mark.slow)],
)
def test_images_are_the_pinned_ones(
    stored: dict[str, np.ndarray], scenes: tuple[str, ...], step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A part of the configurations that has each rule, sampler and integrator; the slow test renders all."""
    monkeypatch.setattr(dmis, "load_scene", shared_scene)
    images = pin_preset.render_all(scenes, step)
    assert len(stored) == len(list(pin_preset.configurations())) == 80
    assert list(pin_preset.differences({name: stored[name] for name in images}, images)) == []


def test_changed_images_are_found(stored: dict[str, np.ndarray]) -> None:
    """One image that is noise away is found by the share of its blocks, one bright block by its standard error."""
    name = "killeroo-gold balance independent path"
    noisy = {**stored, name: stored[name] + np.array([1, 0])[:, None, None, None] * stored[name][1]}
    (line,) = pin_preset.differences(stored, noisy)
    assert "of the blocks agree to 1e-05" in line and name in line
    bright = {**stored, name: stored[name].copy()}
    row, column, channel = np.unravel_index(stored[name][1].argmax(), stored[name][1].shape)
    bright[name][0, row, column, channel] += 6 * stored[name][1].max()
    (line,) = pin_preset.differences(stored, bright)
    assert line.startswith(f"{name}: 1 of 324 values are more than 5 standard errors off")


# Compensation of the sky ----------------------------------------------------------------------------------------------

COMPENSATION = DEFAULTS["compensation"]
FAINT = 0.3
SKY = np.ones((8, 16, 3), np.float32)
SKY[:, :8] = FAINT
"""A sky with a faint half, below the mean: compensated samples alone do not reach it."""


def sky_scene(compensation: float | None = None, **options: Any) -> dmis.Scene:
    light = EnvironmentLight(SKY, compensation=compensation)
    return box_scene(dmis.matte(0.5), (light,), **{"resolution": (4, 4), "fov": 20, **options})


def image(scene: dmis.Scene, rule: Any = "balance", **settings: Any) -> Array:
    return dmis.render(scene, rule, 16, integrator="direct", **settings).image


@pytest.mark.parametrize("compensation", [0.0, 0.5, 0.9])
def test_light_samples_alone_reach_a_faint_half(compensation: float) -> None:
    """At w = 1 the floor reflects ``albedo / pi int L cos``, a fifth of it from the faint half."""
    scene = sky_scene()
    wi, weights = sphere_rule(np.array([0.0, 0.0, 1.0]), 512, 512, 1.0)
    (sky,) = scene.plan.sampled
    irradiance = (sky.radiance(wi.astype(np.float32))[0] * np.maximum(wi[2], 0)) @ weights
    values = means(scene, range(200), w=1.0, compensation=compensation)
    assert abs(z_score(values, 0.5 / np.pi * irradiance)) < Z_LIMIT


def test_compensated_samples_are_where_the_sky_is_bright() -> None:
    """A share of ``(1 - c) FAINT / (1 + FAINT)`` meets the faint half, but for the texels at its border."""
    light = EnvironmentLight(np.repeat(np.repeat(SKY, 8, axis=0), 8, axis=1)).compensated(0.9)
    p = np.zeros((3, 2**16), np.float32)
    faint = light.sample(p, uniforms(2**16)).wi[1] > 0
    assert np.mean(faint) == pytest.approx(0.1 * FAINT / (1 + FAINT), rel=0.2)
    # an even sky whose texels differ by roundings of float32 is sampled as without compensation
    light = EnvironmentLight(1 + 1e-7 * np.random.default_rng(1).random((8, 16, 3)))
    u, p = uniforms(100), np.zeros((3, 100), np.float32)
    assert np.array_equal(light.compensated(0.9).sample(p, u).pdf, light.sample(p, u).pdf)
    # only where brdf samples cover the rest
    rule = Fixed(techniques=("light", "uniform"))
    assert np.array_equal(image(sky_scene(), rule, compensation=0.9), image(sky_scene(), rule))


def test_a_light_of_a_setting_is_that_of_a_field(box: dmis.Scene) -> None:
    """Samples, densities, and that a compensation of the light's own comes first."""
    light, field = EnvironmentLight(SKY), EnvironmentLight(SKY, compensation=0.9)
    u, p = uniforms(1000), np.zeros((3, 1000), np.float32)
    a, b = light.compensated(0.9).sample(p, u), field.sample(p, u)
    assert np.array_equal(a.wi, b.wi) and np.array_equal(a.pdf, b.pdf)
    assert not np.array_equal(a.wi, light.sample(p, u).wi)
    assert field.compensated(0.5) is field and light.compensated(0) is light
    # a scene without a sky has its own lights
    assert box.plan.sampled_lights("all", 0.9) == box.plan.sampled
    assert np.array_equal(image(box, compensation=0.9), image(box))
    plan = sky_scene().plan
    assert plan.sampled_lights("all", 0.0) == plan.sampled and plan.sampled_lights("all", 0.9)[0] is not plan.sampled[0]
    # a light's own compensation overrides settings and rules; without one these decide
    half = image(sky_scene(), compensation=0.5)
    assert np.array_equal(image(sky_scene(0.5), compensation=0.9), half)
    assert np.array_equal(image(sky_scene(0.5)), half)
    assert np.array_equal(image(sky_scene(0.0), compensation=0.5), image(sky_scene(), compensation=0.0))
    assert np.array_equal(image(sky_scene()), image(sky_scene(), compensation=COMPENSATION))
    assert not np.array_equal(image(sky_scene()), half)


@pytest.mark.parametrize(
    ("rule", "settings", "expected"),
    [
        ("balance", {}, COMPENSATION),
        ("fixed:1", {}, 0.0),
        ("thesis:patch=4", {}, 0.0),
        ("auto", {}, COMPENSATION),
        ("auto", {"compensation": 0}, 0.0),
        ("auto:compensation=0", {}, 0.0),
        ("balance:compensation=0.9", {}, 0.9),
        ("fixed:light=0.5,brdf=0.5,compensation=0.5", {}, 0.5),
        ("thesis:patch=4", {"compensation": 0.5}, 0.5),
        ("auto", {"preset": "thesis"}, 0.0),
    ],
)
def test_precedence_of_settings(rule: str, settings: dict[str, Any], expected: float) -> None:
    """Rule options and settings come before the default, which is 0 where a technique is alone; the preset pins 0."""
    result = dmis.render(sky_scene(), rule, 16, integrator="direct", **settings)
    assert result.provenance["settings"]["compensation"] == expected


def test_it_is_part_of_the_render_and_not_of_the_reference() -> None:
    """A light's compensation is in the fingerprint of what is rendered, but not in that of the expected image."""
    plain, half = sky_scene(), sky_scene(0.5)
    assert fingerprint(plain) != fingerprint(half)
    assert fingerprint(plain, expected_image=True) == fingerprint(half, expected_image=True)
    brighter = plain.changed(lights=(EnvironmentLight(2 * SKY),))
    assert fingerprint(plain, expected_image=True) != fingerprint(brighter, expected_image=True)
    # a scene that is rescaled for float32 has other lights, and the same image
    scene = sky_scene()
    bright = scene.changed(lights=(replace(scene.lights[0], scale=(1e12,) * 3),))
    expected = image(scene, compensation=0.9) * 1e12
    np.testing.assert_allclose(image(bright, compensation=0.9), expected, rtol=1e-4)
