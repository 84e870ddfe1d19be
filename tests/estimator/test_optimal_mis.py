"""The optimal combiner: exact where it must be, the balance heuristic where it cannot be fitted."""

import numpy as np
import pytest
import trimesh
from helpers import Z_LIMIT, image_tile, pixel_shares, z_score

import dmis
from dmis.base.vectors import Array
from dmis.estimator.optimal_mis import MIN_SAMPLES_TO_FIT, Optimal
from dmis.estimator.records import Record
from dmis.fit.round import Round
from dmis.geometry.shapes import quad
from dmis.pipeline.tile import render_tile

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


@pytest.mark.parametrize("w, missed", [(0.5, 0.0), (0.5, 0.3), (0.25, 0.3)])
def test_consistent(w: float, missed: float) -> None:
    """With many samples the mean is the integral, misses or not, and the spread is below that of balance."""
    optimal = Optimal(pixel_shares(w), np.full(PIXELS, 4000))
    plain = add_samples(optimal, lambda x: x + 0.25, w, 4000, missed=missed)
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
    rng = np.random.default_rng(1)
    optimal = Optimal(pixel_shares(0.5), np.full(1, 64))
    first = np.tile(np.array([1, 0], np.int8), 32)
    index = [np.flatnonzero(first == 1 - side) for side in (0, 1)]
    records = [Record(side, (0,), 0, index[side], rng.random((3, 32)), np.ones((2, 32))) for side in (0, 1)]
    optimal.add(records, np.zeros(64, int), first, 1)
    assert not optimal.correction().any()


def test_renders(box: dmis.Scene) -> None:
    """Less error than balance with the same samples, and hardly any bias."""
    reference = np.mean([dmis.render(box, "balance", 512, seed=s).image for s in range(100, 104)], axis=0)
    errors, means = {}, {}
    for combiner in ("balance", "optimal"):
        images = [dmis.render(box, f"balance:combiner={combiner}", 64, seed=s).image for s in range(6)]
        errors[combiner] = np.mean([dmis.mse(image, reference) for image in images])
        means[combiner] = np.mean(images)
    assert errors["optimal"] < errors["balance"]
    assert means["optimal"] == pytest.approx(reference.mean(), rel=0.01)


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
    """The mean of ``(p_l - p_b) / p_w`` is 0, as optimal weights need, if what a technique rejects counts as missed.

    On a coarse ball with smooth normals many directions below the shading normal's horizon are above the surface.
    """
    ball = trimesh.creation.icosphere(1)
    part = dmis.Part(dmis.Mesh(ball.vertices, ball.faces, ball.vertices), dmis.plastic(0.3, 0.5, 0.3))
    camera = dmis.Camera.look_at((0, -6, 2), (0, 0, 0), fov=30, resolution=(16, 16))
    scene = dmis.Scene(camera, (part,), (dmis.EnvironmentLight(np.ones((1, 1, 3))),), "coarse ball")
    scene.prepare()
    round_ = Round(64, pixel_shares(0.5), dmis.Settings(), Control)
    tiles = [image_tile(scene, seed, round_) for seed in range(40)]
    assert abs(z_score([render_tile(scene, tile).sums["control"].mean() for tile in tiles], 0.0)) < Z_LIMIT


def test_lights_that_hide_part_of_themselves() -> None:
    """BRDF sampling cannot find a point of a light that its own triangles hide: optimal weights need to know."""
    vertices = np.concatenate([[(-h, -h, z), (-h, h, z), (h, h, z), (h, -h, z)] for z, h in ((2.0, 0.7), (2.3, 0.7))])
    faces = np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)])
    light = dmis.MeshLight(vertices, faces, (5.0, 4.0, 3.0))
    assert not light.flat
    floor = dmis.Part(quad((-4, -4, 0), (8, 0, 0), (0, 8, 0)), dmis.matte(0.6))
    camera = dmis.Camera.look_at((0, -3, 2), (0, 0, 0), fov=40, resolution=(16, 16))
    scene = dmis.Scene(camera, (floor, dmis.light_part(light)), (light,))
    rules = "balance", "balance:combiner=optimal"
    means = ([dmis.render(scene, rule, 64, seed=k).image.mean(dtype=float) for k in range(12)] for rule in rules)
    assert abs(z_score(*means)) < Z_LIMIT
