"""The optimal combiner: exact where it must be, the balance heuristic where it cannot be fitted; unbiased in stages."""

from dataclasses import dataclass

import numpy as np
import pytest
import trimesh
from helpers import Z_LIMIT, pixel_shares

import dmis
from dmis.base.vectors import Array
from dmis.estimator.allocation import allocate
from dmis.estimator.optimal_mis import MIN_SAMPLES_TO_FIT, STAGES, Optimal, Progressive, slot
from dmis.estimator.records import Record
from dmis.fit.round import Fit
from dmis.geometry.shapes import quad
from dmis.pipeline.tile import Tile, render_tile
from dmis.testing.statistics import z_score

PIXELS = 50


def add_samples(optimal: Optimal, f, w: float, n: int, seed: int = 1, missed: float = 0.0) -> Array:
    """n samples per pixel of p_l = 2 x, p_b = 2 (1 - x), `w` of the first; the plain estimate that they give.

    A share `missed` of either technique's samples meets no light.
    """
    rng = np.random.default_rng(seed)
    plain = np.zeros(PIXELS)
    light = round(w * n)
    pixel = np.tile(np.arange(PIXELS), n)
    first = np.repeat(np.arange(n) < light, PIXELS).astype(np.int8)
    records = []
    for side, chosen in ((0, first == 1), (1, first == 0)):
        index = np.flatnonzero(chosen)
        index = index[rng.random(len(index)) >= missed]
        x = np.sqrt(rng.random(len(index)))
        x = x if side == 0 else 1 - x
        pdf = (1 - missed) * np.stack([2 * x, 2 * (1 - x)])
        value = f(x) / (w * pdf[0] + (1 - w) * pdf[1])
        plain += np.bincount(pixel[index], value, PIXELS) / n
        records.append(Record(side, (0,), 0, index, np.repeat(value[None], 3, axis=0), pdf))
    optimal.add(records, pixel, first, 1)
    return plain


@pytest.mark.parametrize("w", [0.25, 0.5, 0.75])
def test_exact_for_combinations_of_the_densities(w: float) -> None:
    """``f = 3 p_l + 5 p_b`` has the integral 8 for any samples, and no variance."""
    optimal = Optimal(pixel_shares(w), np.full(PIXELS, 64))
    plain = add_samples(optimal, lambda x: 3 * 2 * x + 5 * 2 * (1 - x), w, 64)
    answer = plain + optimal.correction()
    np.testing.assert_allclose(answer, 8, rtol=1e-6)
    assert np.ptp(plain) > 0.05


@pytest.mark.parametrize("missed", [0.0, 0.3])
def test_consistent(missed: float) -> None:
    """With many samples the mean is the integral, misses or not, and the spread is below that of balance."""
    optimal = Optimal(pixel_shares(0.5), np.full(PIXELS, 4000))
    plain = add_samples(optimal, lambda x: x + 0.25, 0.5, 4000, missed=missed)
    answer = (plain + optimal.correction())[0]
    assert answer.mean() == pytest.approx(0.75, abs=4 * answer.std() / np.sqrt(PIXELS) + 1e-3)
    assert answer.std() < plain.std()


@pytest.mark.parametrize("w, n", [(0.0, 64), (1.0, 64), (0.5, 2 * MIN_SAMPLES_TO_FIT - 2), (0.1, 40)])
def test_balance_where_the_fit_is_not_possible(w: float, n: int) -> None:
    """A technique without samples, or with too few: no correction."""
    optimal = Optimal(pixel_shares(w), np.full(PIXELS, n))
    add_samples(optimal, lambda x: x + 0.25, w, n)
    assert not optimal.correction().any()


def test_identical_densities() -> None:
    """A singular fit is no fit."""
    rng = np.random.default_rng(1)
    optimal = Optimal(pixel_shares(0.5), np.full(1, 64))
    first = np.tile(np.array([1, 0], np.int8), 32)
    index = [np.flatnonzero(first == 1 - side) for side in (0, 1)]
    records = [Record(side, (0,), 0, index[side], rng.random((3, 32)), np.ones((2, 32))) for side in (0, 1)]
    optimal.add(records, np.zeros(64, int), first, 1)
    assert not optimal.correction().any()


def test_renders(box: dmis.Scene) -> None:
    """Less error than balance with the same samples, hardly any bias, and the same for any number of threads."""
    reference = np.mean([dmis.render(box, "balance", 512, seed=s).image for s in range(100, 104)], axis=0)
    errors, means = {}, {}
    for combiner in ("balance", "optimal"):
        images = [dmis.render(box, f"balance:combiner={combiner}", 64, seed=s).image for s in range(6)]
        errors[combiner] = np.mean([dmis.mse(image, reference) for image in images])
        means[combiner] = np.mean(images)
    assert errors["optimal"] < errors["balance"]
    assert means["optimal"] == pytest.approx(reference.mean(), rel=0.01)
    one, two = (
        dmis.render(box, "second-moment:reuse=no,combiner=optimal", 64, seed=1, parallel=n).image for n in (1, 2)
    )
    assert np.array_equal(one, two)


# Progressive --------------------------------------------------------------------------------------------------------


def staged(kind: type[Optimal], f, w: float, spp: int, missed: float, pixels: int = 40_000) -> tuple[Array, Array]:
    """The plain and the combined estimates of pixels with two shading samples for each camera sample."""
    rng = np.random.default_rng(round(100 * w))
    collector = kind(pixel_shares(w), np.full(pixels, 2 * spp))
    pixel, number = np.tile(np.arange(pixels), spp), np.repeat(np.arange(spp), pixels)
    place = slot(pixel, number, spp, pixels, collector.stages)
    shares = pixel_shares(np.full(collector.stages * pixels, w))
    offset = rng.random((1, collector.stages * pixels))
    first = np.asarray(allocate(shares, 2, place, number, offset, None).first)
    plain, records = np.zeros(pixels), []
    for side, count in enumerate((first, 2 - first)):
        for turn in range(2):
            index = np.flatnonzero(count > turn)
            index = index[rng.random(len(index)) >= missed]
            x = np.sqrt(rng.random(len(index)))
            x = x if side == 0 else 1 - x
            pdf = (1 - missed) * np.stack([2 * x, 2 * (1 - x)])
            value = f(x) / (w * pdf[0] + (1 - w) * pdf[1])
            plain += np.bincount(pixel[index], value, pixels) / (2 * spp)
            records.append(Record(side, (0,), turn, index, np.repeat(value[None], 3, axis=0), pdf))
    collector.add(records, place, first, 2)
    return plain, plain + collector.correction()[0]


@pytest.mark.parametrize("w, missed", [(0.5, 0.0), (0.3, 0.0), (0.3, 0.4)])
def test_progressive_is_unbiased(w: float, missed: float) -> None:
    """The mean of 40000 pixels with 32 camera samples is the integral of x^4, 1/5; that of the direct form is not.

    The direct form is 0.6 to 0.9 % too low, 15 standard errors (with misses its bias happens to cancel). Both have less
    variance than balance.
    """
    z, variance = {}, {}
    for kind in (Optimal, Progressive):
        plain, combined = staged(kind, lambda x: x**4, w, 32, missed)
        z[kind], variance[kind] = z_score(combined, 0.2), combined.var() / plain.var()
    assert abs(z[Progressive]) < Z_LIMIT
    assert missed or z[Optimal] < -2 * Z_LIMIT
    assert variance[Optimal] < variance[Progressive] < 0.95


def test_progressive_is_exact_after_the_first_fit() -> None:
    """For a combination of the densities, the first stages' noise is all that is left.

    Fitted from the second stage on, 1/16 of the samples at 128 of each technique: 1/16 of the variance.
    """
    plain, combined = staged(Progressive, lambda x: 3 * 2 * x + 5 * 2 * (1 - x), 0.5, 128, 0.0, pixels=4000)
    assert combined.var() == pytest.approx(plain.var() / STAGES, rel=0.1)


def test_progressive_without_enough_samples() -> None:
    """Fewer than 8 of each technique before the last stage: no correction."""
    plain, combined = staged(Progressive, lambda x: x, 0.5, MIN_SAMPLES_TO_FIT, 0.0, pixels=100)
    np.testing.assert_array_equal(combined, plain)


@pytest.mark.parametrize(
    "rule", ["fixed:w=0.3,combiner=optimal-progressive", "second-moment:reuse=no,combiner=optimal-progressive"]
)
def test_progressive_renders(box: dmis.Scene, rule: str) -> None:
    """The mean of balance, by a z-test over seeds; threads do not matter."""
    images = [dmis.render(box, rule, 64, seed=s, parallel=1).image for s in range(16)]
    balanced = [dmis.render(box, "balance", 128, seed=s, parallel=1).image.mean() for s in range(100, 116)]
    assert abs(z_score([image.mean() for image in images], balanced)) < Z_LIMIT
    assert np.array_equal(images[1], dmis.render(box, rule, 64, seed=1, parallel=2).image)


@pytest.mark.parametrize("rule", ["balance:combiner=optimal-progressive,sampler=sobol", "thesis:combiner=optimal-p"])
def test_progressive_names_and_samplers(box: dmis.Scene, rule: str) -> None:
    """Structured samples are not independent of the fit to earlier ones; and names are whole."""
    with pytest.raises(ValueError, match=r"sampler independent|combiner must be"):
        dmis.render(box, rule, 16)


class Control:
    """A statistic: mean of ``(p_l - p_b) / p_w`` over all shading samples, at w = 1/2, of each pixel."""

    def __init__(self, pixels: int, shading_samples: int) -> None:
        self._sums, self._n = np.zeros(pixels), 0

    def add(self, records: list[Record], radiance: Array, count: int) -> None:
        """As many samples of either technique, so misses cancel but for those that are records."""
        pixels = len(self._sums)
        self._n += count
        for record in records:
            at = np.arange(radiance.shape[1])[record.sample if record.sample is not None else slice(None)] % pixels
            light, brdf = record.pdf.astype(float)
            missed = 2.0 if record.technique_index == 0 else -2.0
            self._sums += np.bincount(at, 2 * (light - brdf) / (light + brdf) - missed, pixels)

    def sums(self) -> dict[str, Array]:
        """See `dmis.estimator.records.Statistic`."""
        return {"control": self._sums / self._n}


def test_rejected_directions_count_as_missed() -> None:
    """The mean of ``(p_l - p_b) / p_w`` is 0, which controls rest on, if what a technique rejects counts as missed.

    On a coarse ball with smooth normals many directions below the shading normal's horizon are above the surface.
    """
    ball = trimesh.creation.icosphere(1)
    part = dmis.Part(dmis.Mesh(ball.vertices, ball.faces, ball.vertices), dmis.plastic(0.3, 0.5, 0.3))
    camera = dmis.Camera.look_at((0, -6, 2), (0, 0, 0), fov=30, resolution=(16, 16))
    scene = dmis.Scene(camera, (part,), (dmis.EnvironmentLight(np.ones((1, 1, 3))),), "coarse ball")
    scene.prepare()
    tiles = [Tile(s, 0, 0, (0, 16), (0, 16), 64, pixel_shares(0.5), dmis.Settings(), Control) for s in range(40)]
    assert abs(z_score([render_tile(scene, tile).sums["control"].mean() for tile in tiles], 0.0)) < Z_LIMIT


def test_lights_that_hide_part_of_themselves() -> None:
    """A point of a light that its own triangles hide is one that BRDF sampling cannot find: what combines by densities
    must know, even where nothing arrives."""
    vertices = np.concatenate([[(-h, -h, z), (-h, h, z), (h, h, z), (h, -h, z)] for z, h in ((2.0, 0.7), (2.3, 0.7))])
    faces = np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)])
    light = dmis.MeshLight(vertices, faces, (5.0, 4.0, 3.0))
    assert not light.flat
    floor = dmis.Part(quad((-4, -4, 0), (8, 0, 0), (0, 8, 0)), dmis.matte(0.6))
    camera = dmis.Camera.look_at((0, -3, 2), (0, 0, 0), fov=40, resolution=(16, 16))
    scene = dmis.Scene(camera, (floor, dmis.light_part(light)), (light,))
    means = {
        rule: [dmis.render(scene, rule, 64, seed=k).image.mean(dtype=float) for k in range(12)]
        for rule in ("balance", "balance:combiner=optimal-progressive", "second-moment:combiner=controlled,guard=1e9")
    }
    expected, *others = means.values()
    for found in others:
        error = np.hypot(np.std(found, ddof=1), np.std(expected, ddof=1)) / np.sqrt(12)
        assert abs(np.mean(found) - np.mean(expected)) < 4 * error


@pytest.mark.parametrize("w", [0.0, 1.0])
def test_frozen_weights_are_never_at_the_ends(box: dmis.Scene, w: float) -> None:
    """Frozen, a technique counts with its part of f at any share: with none of the samples that part would be lost."""
    found, expected = (dmis.render(box, rule, 256, seed=3) for rule in (Given(w, "frozen"), "balance"))
    assert (found.weight > 0).all() and (found.weight < 1).all()
    z = (found.image.mean() - expected.image.mean()) / np.sqrt((found.variance + expected.variance).sum())
    assert abs(z) * found.image.size / np.sqrt(3) < 4


@dataclass(frozen=True)
class Given(dmis.Rule):
    """A rule of one's own that has no pilot."""

    w: float
    combiner: str

    @property
    def settings(self) -> dict:
        return {"combiner": self.combiner}

    def fit(self, pilot: dict) -> Fit:
        return Fit(self.w)
