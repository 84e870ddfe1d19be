"""Which heuristic combines the final samples: curves of several from one pilot, and the choice between them."""

from dataclasses import replace

import numpy as np
import pytest
from planted import pilot

import dmis
from dmis.base.patches import PATCH
from dmis.base.vectors import Array
from dmis.fit.choose_heuristic import choose
from dmis.fit.registry import make_rule
from dmis.fit.rule import Pilot
from dmis.pipeline.job import Job
from dmis.pipeline.render import render_job
from dmis.pipeline.tile import Tile
from dmis.testing.scenes import box_scene
from dmis.variance.curves import GRID
from dmis.variance.moments import Moments

AREA = np.full((8, 12), 256.0)


def planted(gain: Array | float, noise: float = 0.0) -> tuple[Array, Array]:
    """Variance and cost with two heuristics, of which the second has less variance by the share `gain`."""
    rng = np.random.default_rng(3)
    first = np.linspace(1, 3, AREA.size).reshape(AREA.shape)
    variance = np.stack([first, first * (1 - gain)]) * (1 + noise * rng.normal(size=(2, *AREA.shape)))
    return variance, np.full(variance.shape, 2.0)


@pytest.mark.parametrize("gain, chosen", [(0.1, 1), (0.0, 0), (-0.1, 0)])
def test_planted_gain(gain: float, chosen: int) -> None:
    """The better one, under noise as large as the gain in each patch; the first if both are the same."""
    assert choose(*planted(gain), AREA) == chosen
    if gain:
        assert choose(*planted(gain, noise=0.1), AREA) == chosen


def test_gain_of_few_patches_is_not_sure() -> None:
    """However large: it may be a few rare samples."""
    gain = np.zeros(AREA.shape)
    gain[0, :2] = 0.8
    assert choose(*planted(gain), AREA) == 0
    gain[:, :2] = 0.8
    assert choose(*planted(gain), AREA) == 1


def test_cost_counts_as_much_as_variance() -> None:
    """A tenth more variance for a fifth less cost is a gain, for a twentieth less is none; so in any units of cost."""
    variance, cost = planted(-0.1)
    for less, chosen in ((0.2, 1), (0.05, 0)):
        cheaper = cost * np.array([1, 1 - less])[:, None, None]
        for unit in (1e-3, 1.0, 1e3):
            assert choose(variance, cheaper * unit, AREA) == chosen


def test_camera_samples_need_not_be_alike() -> None:
    """Half the variance for twice the cost is the same."""
    variance, cost = planted(0.0)
    scale = np.array([1, 0.5])[:, None, None]
    assert choose(variance * scale, cost / scale, AREA) == 0
    variance[1] *= 0.95
    assert choose(variance * scale, cost / scale, AREA) == 1


def test_patches_at_the_border_count_less() -> None:
    """By their area."""
    variance, cost = planted(0.1)
    area = AREA.copy()
    variance[1, :, -1] = 4 * variance[0, :, -1]
    assert choose(variance, cost, area) == 0
    area[:, -1] /= 256
    assert choose(variance, cost, area) == 1


def test_a_rule_takes_the_curves_of_its_choice() -> None:
    """Planted: the second combiner's curves have their minimum elsewhere, and half the variance."""
    learned = make_rule("second-moment")
    size, wide = 128, len(GRID)
    curve = np.stack([(GRID - 0.27) ** 2 + 0.2, 0.5 * (GRID - 0.73) ** 2 + 0.1])
    curve = curve[..., None, None] * np.ones((size // PATCH, size // PATCH))
    half = curve[..., wide // 2 : wide // 2 + 1, :, :]
    sums = {"curve": curve, "square": curve**2, "cross": curve * half, "pattern": np.zeros(curve.shape)}
    sums["position"] = np.zeros(curve.shape[-2:])
    moments = Moments(6, np.ones((size, size, 3)), np.ones((size, size, 3)))
    features = {"normal": np.zeros((3, size // PATCH, size // PATCH))}
    found = Pilot(moments, {"camera": 100}, {name: a * PATCH**2 for name, a in sums.items()}, features=features)
    fit = learned.fit({0.5: found})
    assert fit.combiner == "power" and np.all(fit.weight == np.float32(0.73))


def test_several_combiners_in_one_statistic() -> None:
    """The curves of each are those that it has alone."""
    both = pilot(500, 3, seed=5, combiner="balance+power").sums()
    for k, name in enumerate(("balance", "power")):
        alone = pilot(500, 3, seed=5, combiner=name).sums()
        for of in ("curve", "square", "cross", "pattern"):
            np.testing.assert_array_equal(both[of][k], alone[of])
        np.testing.assert_allclose(both["position"], alone["position"], rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("k, name", [(0, "balance"), (1, "power")])
def test_the_chosen_one_is_used(k: int, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the final pass alone, and told; the image is that of the rule with this combiner alone."""
    monkeypatch.setattr("dmis.fit.second_moment.choose", lambda *_: k)
    scene, rule = box_scene(), make_rule("second-moment")
    tiles: list[Tile] = []
    chosen = render_job(Job.of(scene, rule, 16, 1, dmis.Settings()), observer=tiles.extend)
    pilot_tiles, final_tiles = ({t.settings.combiner for t in tiles if t.pass_ == p} for p in (0, 1))
    assert pilot_tiles == {"balance"} and final_tiles == {name} and chosen.provenance["combiner"] == name
    alone = dmis.render(scene, replace(rule, combiner=name), 16, seed=1)
    np.testing.assert_array_equal(chosen.image, alone.image)


@pytest.mark.parametrize(
    "rule, message",
    [
        (
            "second-moment:combiner=balance+optimal",
            "must be heuristics: balance, power, maximum or cutoff; got 'optimal'",
        ),
        ("second-moment:combiner=power+frozen", "must be heuristics"),
        ("second-moment:combiner=power+power", "must differ; got power, power"),
        ("second-moment:combiner=balance+", "combiner must be"),
        ("second-moment:combiner=balance+best", "combiner must be"),
        ("kl:combiner=balance+power", "needs variances"),
    ],
)
def test_what_cannot_be_chosen_from(rule: str, message: str) -> None:
    """Said before anything is rendered."""
    with pytest.raises(ValueError, match=message):
        make_rule(rule)
