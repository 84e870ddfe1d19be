"""Lights that a subset of the camera samples samples: subsets, weights, rays, and unchanged means."""

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np
import pytest

import dmis
from dmis.base.vectors import Array
from dmis.estimator.allocation import shares_of
from dmis.estimator.patterns import BLOCKS, LEAST_LOOKS, MOST_HALVINGS, LightSubsets, PatternMap, separate_lights
from dmis.fit.round import Budget, Round
from dmis.fit.rule import Rule
from dmis.testing.scenes import ABOVE, box_scene
from dmis.variance.moments import Film
from tests.helpers import images_z_score, shared_scene

LIGHTS = 8
"""Lights of two techniques in ten-lights; two more have a single direction."""


@dataclass(frozen=True)
class Halved(Rule):
    """One round of equal numbers; `halvings` of all lights, or random ones; None: no halvings."""

    halvings: int | tuple[int, ...] | None = None
    at_random: bool = False
    begin: int = 0

    def rounds(self, budget: Budget) -> Generator[Round, Film, None]:
        shape, pattern = (LIGHTS + 1, *budget.shape), np.zeros(budget.shape, np.uint8)
        halvings = None if self.halvings is None else np.uint8(np.zeros(shape) + np.reshape(self.halvings, (-1, 1, 1)))
        if self.at_random:
            halvings = np.random.default_rng(1).integers(0, MOST_HALVINGS + 1, shape).astype(np.uint8)
        patterns = PatternMap(((1, 1),), pattern, halvings)
        more = {"patterns": patterns, "image_weight": budget.spp, "begin": self.begin}
        yield Round(budget.spp, shares_of(0.5), budget.settings, **more)


def lamps() -> dmis.Scene:
    return shared_scene("ten-lights", (32, 24))


def images(rule: Rule, seeds: range, **options: object) -> list[Array]:
    return [dmis.render(lamps(), rule, 16, seed=seed, parallel=1, **options).image for seed in seeds]


@pytest.mark.parametrize("samples", [24, 30, 56, 64])
@pytest.mark.parametrize("halvings", range(1, MOST_HALVINGS + 1))
def test_weights_add_up_in_all_sub_blocks(samples: int, halvings: int) -> None:
    """A light counts as if all camera samples looked at it, in each sub-block as far as they can be divided evenly."""
    number = np.arange(samples)
    subsets = LightSubsets(np.full((1, samples), halvings, np.uint8), number, np.full(samples, samples, np.int32))
    chosen, weight, block = subsets.of_light(0, None)
    assert len(chosen) == max(-(-samples // 2**halvings), LEAST_LOOKS)
    np.testing.assert_array_equal(chosen, np.arange(len(chosen)))
    assert weight.sum() == pytest.approx(samples)
    of_blocks = np.bincount(block, weight, BLOCKS)
    assert len(of_blocks) == BLOCKS and (of_blocks > 0).all() and np.ptp(of_blocks) <= weight[0] + 1e-6


@pytest.mark.parametrize(
    ("rule", "sampler"), [(Halved(MOST_HALVINGS), "sobol"), (Halved(0, at_random=True), "independent")]
)
def test_mean_does_not_depend_on_halvings(rule: Halved, sampler: str) -> None:
    found, expected = images(rule, range(4), sampler=sampler), images(Halved(), range(4, 8), sampler=sampler)
    assert abs(images_z_score(found, expected)) < 4


def test_fewer_rays() -> None:
    """A quarter of all samples of lamps, of delta lights, or of both, in a round that goes on from another, too."""
    rules = Halved(begin=32), Halved(2, begin=32), Halved((2,) * LIGHTS + (0,)), Halved((0,) * LIGHTS + (2,))
    every, *halved = (dmis.render(lamps(), rule, 64, parallel=1).rays for rule in rules)
    for rays, (of_lamps, of_deltas) in zip(halved, ((4, 4), (4, 1), (1, 4)), strict=True):
        for kind, part in (("shadow", of_lamps), ("brdf", of_lamps), ("delta", of_deltas)):
            assert rays[kind] == pytest.approx(every[kind] / part, rel=0.1)
        assert rays["camera"] == every["camera"]
    # lights that all look at cost nothing
    expected, found = images(Halved(), range(1)), images(Halved(0), range(1))
    np.testing.assert_array_equal(found, expected)


def test_deviation_has_lights_that_few_look_at() -> None:
    """Errors of images are those that their deviations say, with independent points."""
    renders = [dmis.render(lamps(), Halved(2), 32, seed=k, sampler="independent", parallel=1) for k in range(24)]
    variance = np.var([render.image for render in renders], axis=0, ddof=1, dtype=float).mean()
    said = np.mean([np.square(render.deviation, dtype=float) for render in renders])
    assert said == pytest.approx(variance, rel=0.15)


def test_where_there_is_a_choice() -> None:
    settings = dmis.Settings(integrator="direct")
    assert separate_lights(lamps().plan, settings) == LIGHTS
    assert separate_lights(lamps().plan, dmis.Settings(integrator="path", max_depth=3)) == 0
    assert separate_lights(lamps().plan, dmis.Settings(integrator="direct", lights="one")) == 0
    assert separate_lights(lamps().plan, dmis.Settings(integrator="direct", lights="tree")) == 1
    others = (dmis.PointLight((0, 0, 2), (1, 1, 1)), ABOVE, *(replace(ABOVE, radiance=(k, 1, 1)) for k in range(1, 33)))
    assert [separate_lights(box_scene(lights=others[:n]).plan, settings) for n in (1, 2, 33, 34)] == [0, 1, 32, 0]
