"""Which heuristic combines the final samples: curves of several from one pilot, and the choice between them."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import box_scene
from test_curves import pilot

import dmis
from dmis.choice import SIDE, choose
from dmis.curves import GRID
from dmis.rules import make_rule
from dmis.tile import BASE
from dmis.vec import Array

SHAPE = 128, 192
COST = 1 + 0.2 * GRID.astype(float)


def planted(gain: Array | float, noise: float = 0.0) -> dict[str, Array]:
    """Sums of two heuristics, of which the second has less variance by `gain` of that at w = 1/2, in base patches."""
    rng = np.random.default_rng(3)
    rows, columns = (n // BASE for n in SHAPE)
    first = np.broadcast_to((GRID[:, None, None] - 0.3) ** 2 + 1.0, (len(GRID), rows, columns))
    curve = np.stack([first, first - gain]) * (1 + noise * rng.normal(size=(2, 1, rows, columns)))
    return {"curve": BASE**2 * curve, "position": np.full((rows, columns), 0.1 * BASE**2)}


@pytest.mark.parametrize("counts", [False, True])
@pytest.mark.parametrize("gain, chosen", [(0.1, 1), (0.0, 0), (-0.1, 0)])
def test_planted_gain(gain: float, chosen: int, counts: bool) -> None:
    """The better one, under noise of several times the gain in each patch; the first if both are the same."""
    assert choose(planted(gain), SHAPE, COST, 1.5, counts) == chosen
    if gain:
        assert choose(planted(gain, noise=0.3), SHAPE, COST, 1.5, counts) == chosen


def test_gain_of_few_patches_is_not_sure() -> None:
    """However large: it may be a few rare samples."""
    gain = np.zeros(tuple(n // BASE for n in SHAPE))
    gain[: SIDE // BASE, : 2 * SIDE // BASE] = 0.5
    assert choose(planted(gain), SHAPE, COST, 1.5, False) == 0
    assert choose(planted(gain), SHAPE, COST, 0.5, False) == 1


def test_cost_of_the_weights_counts() -> None:
    """Of two with the same least variance, the one that has it at the cheaper weight."""
    sums = planted(0.0)
    sums["curve"][1] = sums["curve"][0, ::-1]  # least at w = 0.73, the first one at 0.27
    assert choose(sums, SHAPE, np.ones(len(GRID)), 1.5, False) == 0
    assert choose(sums, SHAPE, 1 + GRID.astype(float), 1.5, False) == 0
    assert choose(sums, SHAPE, 2 - GRID.astype(float), 1.5, False) == 1


def test_curves_of_classes_add_up() -> None:
    """Of paths with weights of their own for later surfaces."""
    sums = planted(0.1)
    apart = {**sums, "curve": np.stack([sums["curve"], 0 * sums["curve"]], axis=1)}
    assert choose(apart, SHAPE, COST, 1.5, False) == 1


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
    monkeypatch.setattr("dmis.learned.choose", lambda *_: k)
    scene, rule = box_scene(), make_rule("second-moment")
    chosen = dmis.render(scene, rule, 16, seed=1)
    pilot_tiles, final_tiles = ({t.settings.combiner for t in chosen.tiles if t.pass_ == p} for p in (0, 1))
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
        ("auto:combiner=power+frozen", "must be heuristics"),
        ("auto:combiner=power+power", "must differ; got power, power"),
        ("auto:combiner=balance+", "combiner must be"),
        ("auto:combiner=balance+best", "combiner must be"),
        ("kl:combiner=balance+power", "needs variances"),
    ],
)
def test_what_cannot_be_chosen_from(rule: str, message: str) -> None:
    """Said before anything is rendered."""
    with pytest.raises(ValueError, match=message):
        make_rule(rule)
