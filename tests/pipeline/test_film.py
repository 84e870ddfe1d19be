"""The film of a pass: tiles merged in any order, with a checkpoint or not; scenes with nothing to mix."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
import pytest
from helpers import pixel_shares

import dmis
from dmis import Settings
from dmis.base.patches import PATCH, by_colour, patch_sum
from dmis.base.vectors import Array
from dmis.estimator.allocation import shares_of
from dmis.estimator.records import Record
from dmis.fit.best_pattern import looks_at
from dmis.fit.round import Fit, Round
from dmis.fit.sample_density import FirstRound
from dmis.pipeline.job import resolve
from dmis.pipeline.passes import Passes
from dmis.pipeline.result import costly_pilot
from dmis.pipeline.tile import Tile
from dmis.testing.scenes import box_scene
from dmis.variance.moments import Film, pilot_shares

RESOLUTION = (2 * PATCH, PATCH + 1)
ROUND = Round(2, pixel_shares(0.5), Settings())


@pytest.fixture
def tiles():
    """Three tiles of random moments and sums that cover an image whose last row is a patch of its own."""
    rng, areas = np.random.default_rng(1), [((0, 4), (0, 4)), ((0, 4), (4, 8)), ((4, 5), (0, 8))]
    tiles = []
    for number, ((top, bottom), (left, right)) in enumerate(areas):
        shape = bottom - top, right - left
        moments = rng.random((2, *shape, 3), np.float32)
        sums = {"curve": rng.random((2, *(-(-n // PATCH) for n in shape)))}
        tile = Tile(1, 3, number, (slice(top, bottom), slice(left, right)), ROUND)
        tiles.append((tile, Film(number + 1, *moments, {"camera": 10**number}, sums)))
    return tiles


def test_tiles_are_merged_to_their_places_in_any_order(tiles):
    """Pixels, patches, rays and marks are those of the tiles, whatever the order in which these arrive."""
    for order in permutations(tiles):
        film = Film(2, *np.zeros((2, *RESOLUTION[::-1], 3), np.float32))
        for tile, part in order:
            film.merge(part, tile.area)
        assert film.rays == {"camera": 111} and film.mean.dtype == film.root.dtype == np.float32
        for tile, part in tiles:
            np.testing.assert_array_equal(film.mean[tile.area], part.mean)
            np.testing.assert_array_equal(film.root[tile.area], part.root)
        left, right, bottom = (part.sums["curve"] for _, part in tiles)
        whole = np.concatenate([np.concatenate([left, right], axis=-1), bottom], axis=-2)
        np.testing.assert_array_equal(film.sums["curve"], whole)


def test_variance_of_the_pilot_in_an_image(box: dmis.Scene):
    """Weights 6 and 2; variances of the mean 12 / (4 3) = 1 and 6 / (2 1) = 3 in one pixel, unknown in the other."""
    shape = (1, 2, 3)
    final = Film(4, np.ones(shape, np.float32), np.full(shape, np.sqrt(12), np.float32))
    pilot = Film(np.array([[[2], [1]]]), np.full(shape, 5, np.float32), np.full(shape, np.sqrt(6), np.float32))
    shares = pilot_shares([(final, 6), (pilot, 2)])
    assert shares == {"pilot_samples": 0.25, "pilot_variance": pytest.approx(3 * 2**2 / (6**2 + 3 * 2**2))}
    # of each colour: all closest hits, those that need no ray included, all other rays, and squares of one sample
    film = film_of(box, statistic=FirstRound)
    hits = sum(n for kind, n in film.rays.items() if kind.startswith(("camera", "untraced", "bounce")))
    assert film.sums["closest hits"].sum() == hits
    assert film.sums["occlusion rays"].sum() == sum(film.rays.values()) - hits
    squares = patch_sum(by_colour(np.square(film.mean).mean(axis=2)), PATCH)
    np.testing.assert_allclose(film.sums["squares"], squares, rtol=1e-5)


@pytest.mark.parametrize(
    "samples, variance, named", [(0.06, 0.81, True), (0.06, 0.19, False), (0.2, 0.39, False), (0.2, 0.41, True)]
)
def test_pilots_that_are_named(samples, variance, named):
    """With more than a fifth of the variance, and more than twice their share of the samples."""
    text = costly_pilot({"pilot_samples": samples, "pilot_variance": variance})
    assert bool(text) == named and (
        not named or f"is {samples:.0%} of the image's samples and makes {variance:.0%}" in text
    )
    assert costly_pilot({}) == ""


def film_of(scene: dmis.Scene, **changes: Any) -> Film:
    """Return the film of a round of a render by paths."""
    job = resolve(scene, "balance", 4, 1, dmis.Settings(integrator="path", sampler="sobol"))
    with Passes(job, 1) as passes:
        return passes.render(replace(Round(1, shares_of(0.5), job.settings), **changes))


@pytest.mark.parametrize("directions", [True, False])
def test_directions_of_records(box: dmis.Scene, directions: bool) -> None:
    """Rays from recorded points in recorded directions meet the lamp; there are none unless they are asked for."""
    kept: list[Record] = []

    class Keep(FirstRound):
        wants = dmis.Wants(directions=directions)

        def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
            kept.extend(records)

    film_of(box, statistic=Keep, spp=4, settings=dmis.Settings(integrator="direct", max_depth=5, sampler="sobol"))
    assert {record.technique_index for record in kept} == {0, 1}
    for record in kept:
        if record.wi is None or record.p is None:
            assert not directions and record.wi is record.p
            continue
        assert directions and record.wi.shape == record.p.shape == record.value.shape
        np.testing.assert_allclose(np.linalg.norm(record.wi, axis=0), 1, rtol=1e-5)
        on_lamp = record.p + record.wi * ((3 - record.p[2]) / record.wi[2])  # a square at z = 3
        assert (np.abs(on_lamp[:2]) < 1 + 1e-4).all() and (record.p[2] >= -1).all()


def test_a_statistic_is_of_the_pixels_that_have_samples(box: dmis.Scene) -> None:
    """It is made for these, and its sums stand in their places; the others are black."""

    class Told:
        """Statistic of the number of pixels it is made for, and of the samples that it gets."""

        wants = dmis.Wants(sums="colours")

        def __init__(self, pixels: int, shading_samples: int) -> None:
            self._samples = np.zeros(pixels)

        def add(self, records: Any, radiance: Any, count: int) -> None:
            self._samples += count
            assert radiance.shape == (3, count * len(self._samples))

        def sums(self) -> dict[str, Any]:
            return {"samples": self._samples}

    height, width = box.camera.resolution[::-1]
    mask = looks_at((height, width))
    film = film_of(box, statistic=Told, spp=3 * mask)
    np.testing.assert_array_equal(film.sums["samples"], patch_sum(by_colour(3.0 * mask), PATCH))
    assert (film.mean[mask == 0] == 0).all() and (film.mean[mask == 1] > 0).any()


def test_wishes_of_earlier_versions_are_refused(box: dmis.Scene) -> None:
    """In place of records without directions."""
    old = type("Old", (FirstRound,), {"wants": dmis.Wants(), "directions": True})
    with pytest.raises(
        ValueError, match=r"must have wants = dmis.Wants\(directions=True\) in place of directions = True"
    ):
        film_of(box, statistic=old)


# Scenes where there is nothing to mix ---------------------------------------------------------------------------------

POINT, SUN = dmis.PointLight((1, -1, 2), (3, 3, 3)), dmis.DistantLight((0, 0.3, 1), (1, 1, 1))


DELTAS = box_scene(dmis.matte(0.6), (POINT, SUN), resolution=(40, 32))
"""A matte floor under lights of a single direction each."""
SKY = dmis.EnvironmentLight(np.random.default_rng(1).random((4, 8, 3)))
MIRROR = box_scene(dmis.mirror(), (SKY,), resolution=(40, 32))
"""A mirror under a sky, which no surface samples."""


@pytest.mark.parametrize("scene", [DELTAS, MIRROR], ids=["deltas", "mirror"])
@pytest.mark.parametrize(
    ("rule", "same"),
    [
        ("thesis", "balance"),
        ("thesis:patch=8,reuse=yes", "balance"),
        ("thesis:combiner=power,sampler=sobol", "pbrt:sampler=sobol"),
        ("second-moment", "balance"),
        ("second-moment:combiner=optimal", "balance:combiner=optimal"),
        ("second-moment:combiner=maximum", "balance:combiner=maximum"),
    ],
)
def test_images_are_those_of_equal_shares(scene: dmis.Scene, rule: str, same: str) -> None:
    """The same bits and rays as `balance` with the settings of the rule; the maps say so, and the provenance, why."""
    stages = set()
    result = dmis.render(scene, rule, 9, seed=2, progress=lambda stage, done, total: stages.add(stage))
    other = dmis.render(scene, same, 9, seed=2)
    np.testing.assert_array_equal(result.image, other.image)
    np.testing.assert_array_equal(result.variance, other.variance)
    assert result.rays == other.rays and result.image.max() > 0
    assert (result.weight == 0.5).all() and (result.samples == 9).all()
    assert stages == {"final"} and result.maps == {} and result.provenance["pilot_rays"] == {}
    assert "no pilot" in result.provenance["nothing_to_mix"] and "nothing_to_mix" not in other.provenance
    shares = [render.provenance["settings"]["compensation"] for render in (result, other)]
    assert result.provenance["rule"] == rule and shares[0] == shares[1]


def test_rules_that_divide_camera_samples_have_a_first_round() -> None:
    """`auto` takes more samples where the image is noisy, whatever the lights."""
    result = dmis.render(DELTAS, "auto", 32, seed=1, sampler="sobol")
    assert np.ptp(result.samples) > 0 and (result.weight == 0.5).all()
    assert not result.provenance["pilot_rays"] and "nothing_to_mix" not in result.provenance
    # the default is to render the pilot; ``shares_only = True`` leaves it out
    result = dmis.render(DELTAS, Own(), 8)
    assert (result.weight == 0.25).all() and result.provenance["pilot_rays"]["camera"] > 0
    rule = Own()
    rule.shares_only = True
    result = dmis.render(DELTAS, rule, 8)
    assert (result.weight == 0.5).all() and result.provenance["pilot_rays"] == {}


class Own(dmis.Rule):
    """A rule of one's own, of which it is not known what it decides."""

    pilot = {0.5: 2}  # noqa: RUF012

    def fit(self, pilot):
        return Fit(0.25)


def test_one_light_with_two_techniques_is_enough() -> None:
    """A lamp beside the others brings the pilot back; one without power does not."""
    lamp, dark = (dmis.QuadLight((-0.5, -0.5, 2), (0, 1, 0), (1, 0, 0), (e, e, e)) for e in (3, 0))
    for light, learned in ((lamp, True), (dark, False)):
        scene = box_scene(dmis.matte(0.6), (POINT, light), resolution=(16, 12))
        assert scene.plan.mixable == learned
        result = dmis.render(scene, "thesis", 8, seed=1)
        assert ("nothing_to_mix" not in result.provenance) == learned == (result.maps != {})
        assert ("nothing to mix" in scene.describe()) != learned
