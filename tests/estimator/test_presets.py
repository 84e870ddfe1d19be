"""The pinned estimator: its settings are complete and held, and its images stay."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pin_preset
import pytest
from helpers import shared_scene

import dmis
from dmis.estimator.settings import PRESETS, make_settings
from dmis.fit.rule import merge_settings


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


def test_scene_decides_the_integrator(box: dmis.Scene) -> None:
    for name, one in (("path", True), ("direct", False)):
        settings, _ = merge_settings(make_settings(preset="thesis"), replace(box, suggested=dmis.Suggestions(name)))
        assert settings.one_light == one and settings.preset == "thesis"


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
