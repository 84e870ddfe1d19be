"""Renders in replicates: an unbiased error estimate, its price, and what does not go with it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from helpers import Z_LIMIT

import dmis
from dmis.base.vectors import Array
from dmis.fit.fixed import Fixed
from dmis.fit.registry import make_rule
from dmis.fit.rounds import Rounds
from dmis.pipeline import tile as tiles
from dmis.testing.statistics import z_score
from dmis.variance.replicates import replicate_seed

SEEDS = 24


def renders(scene: dmis.Scene, rule: str, spp: int, replicates: int, sampler: str = "sobol") -> list[dmis.Result]:
    """Return renders of several seeds."""
    options = {"sampler": sampler, "replicates": replicates}
    return [dmis.render(scene, rule, spp, seed=seed, **options) for seed in range(SEEDS)]


def mean_variances(results: Sequence[dmis.Result]) -> Array:
    """Return the estimated and the measured variance of an image, ``(2, blocks)``, in blocks of 8x8 pixels."""
    estimated = np.mean([result.variance for result in results], axis=0)
    measured = np.var([result.image for result in results], axis=0, ddof=1)
    height, width, _ = measured.shape
    return np.array([a.reshape(height // 8, 8, width // 8, 8, 3).sum(axis=(1, 3, 4)) for a in (estimated, measured)])


def ratio_and_error(variances: Array) -> tuple[float, float]:
    """Return the estimated variance over the measured one, and the standard error of it: the jackknife over blocks."""
    sums = variances.reshape(2, -1)
    without = sums.sum(axis=1, keepdims=True) - sums
    ratios = without[0] / without[1]
    error = np.sqrt((len(ratios) - 1) * np.var(ratios))
    return float(np.divide(*sums.sum(axis=1))), float(error)


@pytest.mark.parametrize("rule, spp", [("balance", 16), ("auto", 64), ("second-moment", 22)])
@pytest.mark.parametrize("replicates", [2, 4])
def test_deviation_is_calibrated(box: dmis.Scene, rule: str, spp: int, replicates: int) -> None:
    """The mean squared deviation is the variance over seeds, within the error of the comparison."""
    ratio, error = ratio_and_error(mean_variances(renders(box, rule, spp, replicates)))
    assert abs(ratio - 1) < 4 * error and error < 0.1


def test_stratified_points_are_calibrated(box: dmis.Scene) -> None:
    """Of any points that depend on each other; the sample variance of these is more than twice too large."""
    ratio, error = ratio_and_error(mean_variances(renders(box, "balance", 16, 2, "stratified")))
    assert abs(ratio - 1) < 4 * error and error < 0.1
    assert ratio_and_error(mean_variances(renders(box, "balance", 16, 1, "stratified")))[0] > 1.3


def test_sub_blocks_are_not_calibrated(box: dmis.Scene) -> None:
    """What replicates are for: the test above can fail."""
    ratio, error = ratio_and_error(mean_variances(renders(box, "balance", 32, 1)))
    assert ratio - 1 > 4 * error


def test_price(box: dmis.Scene) -> None:
    """In mean squared error R^(a - 1), for errors that fall as n^-a with a between 1 and 2."""
    one, two, four = (mean_variances(renders(box, "balance", 64, replicates))[1].sum() for replicates in (1, 2, 4))
    assert 1.05 < two / one < 2 and 1.2 < four / one < 4 and two < four


@pytest.mark.parametrize("rule", ["balance", "fixed:0.3"])
def test_a_replicate_is_a_render_with_another_seed(box: dmis.Scene, rule: str) -> None:
    """So it begins with the points of longer ones; the deviation is from the spread."""
    result = dmis.render(box, rule, 32, seed=5, sampler="sobol", replicates=4)
    parts = [dmis.render(box, rule, 8, seed=replicate_seed(5, r), sampler="sobol").image for r in range(4)]
    np.testing.assert_allclose(result.image, np.mean(parts, axis=0), rtol=1e-6)
    np.testing.assert_allclose(result.deviation, np.std(parts, axis=0, ddof=1) / 2, rtol=1e-4, atol=1e-7)
    assert (result.samples == 32).all() and result.deviation_of == "replicates"


def test_images_do_not_depend_on_tiles(box: dmis.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    images = []
    for side in (32, 8):
        monkeypatch.setattr(tiles, "MIN_SIDE", side)
        monkeypatch.setattr(tiles, "MAX_SIDE", side)
        images.append(dmis.render(box, "balance", 16, seed=1, sampler="sobol", replicates=2))
    np.testing.assert_allclose(images[0].image, images[1].image, rtol=1e-5)
    np.testing.assert_allclose(images[0].deviation, images[1].deviation, rtol=1e-3, atol=1e-6)


def test_executors_and_checkpoints(box: dmis.Scene, tmp_path: Path) -> None:
    """The same bits with threads, with processes, and after an interruption in the second replicate."""
    options = {"seed": 2, "sampler": "sobol", "replicates": 2}
    one = dmis.render(box, "auto", 64, parallel=1, **options)
    finals = []

    def stop(stage: str, done: int, total: int) -> None:
        finals.append(stage)
        if finals.count("final") == 2:
            raise InterruptedError

    file = tmp_path / "checkpoint"
    with pytest.raises(InterruptedError):
        dmis.render(box, "auto", 64, parallel=1, checkpoint=file, progress=stop, **options)
    others = [dmis.render(box, "auto", 64, parallel=p, **options) for p in (2, dmis.Processes(2))]
    for other in (*others, dmis.render(box, "auto", 64, checkpoint=file, **options)):
        for name in ("image", "deviation", "samples"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.fixture(scope="module")
def converged_means(box: dmis.Scene) -> list[float]:
    """Means of the box by the balance heuristic with many samples."""
    return [dmis.render(box, "balance", 256, seed=s, sampler="sobol").image.mean() for s in range(100, 108)]


@pytest.mark.parametrize("replicates", [2, 4])
def test_rounds_keep_mean_and_budget(box: dmis.Scene, converged_means: list[float], replicates: int) -> None:
    """Of all replicates together, whose numbers of samples are equal powers of two."""
    results = renders(box, "auto", 64, replicates)
    assert abs(z_score([result.image.mean() for result in results], converged_means)) < Z_LIMIT
    n = results[0].samples.astype(int)
    assert ((n & (n - 1)) == 0).all() and n.min() >= replicates and np.ptp(n) > 0
    plain = dmis.render(box, "auto", 64, sampler="sobol")
    cost, plain_cost = (np.mean([result.samples * result.shading_samples]) for result in (results[0], plain))
    assert cost == pytest.approx(plain_cost, rel=0.1)


def test_first_round_of_replicates() -> None:
    """Two camera samples or more in each replicate; with a budget of less than twice that, equal numbers."""
    auto = make_rule("auto")
    assert [auto.adapted(128, "sobol", r).pilot[0.5] for r in (1, 2, 4)] == [16, 16, 16]
    assert [auto.adapted(32, "sobol", r).pilot[0.5] for r in (1, 2, 4)] == [8, 8, 16]
    assert isinstance(auto.adapted(31, "sobol", 4), Fixed) and isinstance(auto.adapted(31, "sobol", 2), Rounds)


@pytest.mark.parametrize(
    "options, message",
    [
        (
            {"sampler": "independent"},
            "replicates must be 1 with sampler independent, where the variance",
        ),
        ({"spp": 63}, r"must be divisible by 2 for replicates=2; got 63. Use spp 62 or 64"),
        ({"spp": 128, "rule": "second-moment", "replicates": 4}, "takes 6 for its pilot. Use spp 126 or 130"),
        ({"rule": "auto:spp=4"}, r"must have a multiple of 4 camera samples for replicates=2; got 2. Use spp=8"),
        ({"replicates": 3}, "replicates must be 1, 2 or 4"),
        ({"replicates": 0}, "replicates must be"),
        ({"replicates": 8}, "replicates must be"),
        ({"preset": "thesis", "sampler": "lowdiscrepancy"}, "preset thesis has replicates 1; got 2"),
    ],
)
def test_what_does_not_go(box: dmis.Scene, options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        dmis.render(box, **{"rule": "balance", "spp": 64, "sampler": "sobol", "replicates": 2, **options})


def test_a_rule_may_bring_the_sampler(box: dmis.Scene) -> None:
    result = dmis.render(box, "balance:sampler=sobol", 8, replicates=2)
    assert result.deviation_of == "replicates"
