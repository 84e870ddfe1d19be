"""Rules of examples/literature: formulas on planted moments, statistics against sample tables, and unbiased images."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import LITERATURE, Z_LIMIT, load_literature, registries_kept, results_z, shared_scene

import dmis
from dmis.base.patches import PATCH
from dmis.bench.decide import _records
from dmis.estimator.settings import Settings
from dmis.fit.registry import RULES
from dmis.fit.round import Budget
from dmis.variance.curves import GRID

NAMES = {"hua2025": "hua2025", "grittmann2019": "grittmann2019", "grittmann2022": "grittmann2022",
         "inverse_moments": "inverse-moments"}  # fmt: skip
SHAPE = 12, 16
PATCHES = 3, 4


@pytest.fixture(scope="module")
def modules() -> Iterator[SimpleNamespace]:
    """The modules of the folder, loaded as plug-ins; their rules are registered."""
    with registries_kept():
        yield load_literature()


def test_each_file_has_one_rule_and_says_its_source(modules: SimpleNamespace) -> None:
    others = {"objectives", "simplex", "resampled", "pilot_moments", "patch_size"}
    assert {path.stem for path in LITERATURE.glob("*.py")} == {*NAMES, *others}
    for stem, name in NAMES.items():
        text = (LITERATURE / f"{stem}.py").read_text("utf-8")
        assert name in RULES and text.count("\n") <= 60
        about = str(getattr(modules, stem).__doc__)
        assert "What differs: " in about and "eant for" in about and "(class ``" in about


@pytest.mark.parametrize("name", NAMES.values())
@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_rules_are_unbiased(modules: SimpleNamespace, name: str, integrator: str) -> None:
    """Images have the mean of balance; pilots are apart, so that weights do not depend on the image's samples."""
    scene = shared_scene("cornell", SHAPE[::-1])
    settings = Settings(sampler="independent", integrator=integrator, reuse_pilot=False)
    of_rule = dmis.render(scene, name, 512, seed=1, parallel=1, settings=settings)
    of_balance = dmis.render(scene, "balance", 512, seed=2, parallel=1, settings=settings)
    assert abs(results_z(of_rule, of_balance)) < Z_LIMIT
    assert (np.abs(of_rule.weight - 0.5) > 0.03).any()


def test_moments_of_candidates_are_those_of_tilted_samples(modules: SimpleNamespace) -> None:
    """A tilt 1 / (1 + c) weighs a camera sample as the factor c on the BRDF density does."""
    scene = shared_scene("ten-lights", SHAPE[::-1])
    table = dmis.samples(scene, spp=3, shading_samples=2, sampler="independent")
    lit = table.rows(table.technique >= 0)
    factors, pixels = np.array([0.1, 2.0]), SHAPE[0] * SHAPE[1]
    statistic = modules.hua2025.Candidates(factors, pixels, 2)
    statistic.add(_records(table, None), table.radiance().reshape(-1, 3).T, 3)
    grey = np.stack([lit.radiance(1 / (1 + c)).mean(axis=3).reshape(3, pixels) for c in factors])
    np.testing.assert_allclose(statistic.sums()["m1"], grey.mean(axis=1), rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(statistic.sums()["m2"], np.square(grey).mean(axis=1), rtol=1e-3, atol=1e-6)


def test_moments_of_single_techniques(modules: SimpleNamespace) -> None:
    """Sums of f / p_k over the rows of technique k alone, with S / 2 samples of each."""
    table = dmis.samples(shared_scene("ten-lights", SHAPE[::-1]), spp=3, shading_samples=4, sampler="independent")
    pixels = SHAPE[0] * SHAPE[1]
    statistic = modules.pilot_moments.SingleTechnique(pixels, 4)
    statistic.add(_records(table, None), table.radiance().reshape(-1, 3).T, 3)
    for k, pdf in enumerate((table.p_l, table.p_b)):
        rows = table.technique == k
        alone = np.bincount(table.place()[rows], table.f[rows].mean(axis=1) / pdf[rows] / 2, 3 * pixels)
        np.testing.assert_allclose(statistic.sums()["m1"][k], alone.reshape(3, pixels).mean(axis=0), rtol=1e-3)
        np.testing.assert_allclose(
            statistic.sums()["m2"][k], np.square(alone).reshape(3, pixels).mean(axis=0), rtol=1e-3
        )


def tilts(rule: dmis.Rule, m1: object, m2: object) -> np.ndarray:
    """Return the tilts of patches ``(3, 4)`` that a rule learns from planted sums over their pixels."""
    settings = Settings(sampler="independent", integrator="direct", max_depth=1)
    rounds = rule.rounds(Budget(32, SHAPE, settings, weigh=rule.weigh))
    pilot = next(rounds)
    assert pilot.settings.shading_samples == 2 and pilot.spp == rule.spp  # type: ignore[attr-defined]
    film = SimpleNamespace(sums={"m1": np.asarray(m1), "m2": np.asarray(m2)})
    final = rounds.send(film)  # type: ignore[arg-type]
    assert final.spp == 32 - rule.spp and (final.shares == 0.5).all()  # type: ignore[attr-defined]
    return final.tilt[0, ::PATCH, ::PATCH]  # type: ignore[index]


def test_inverse_moments(modules: SimpleNamespace) -> None:
    """The tile's moments, 3 of light samples and 1 of BRDF samples, give light samples 1/4; bounds and no evidence."""
    rule = modules.inverse_moments.InverseMoments(tile=4)
    light, brdf = np.full(PATCHES, 3.0), np.full(PATCHES, 1.0)
    light[0, 0], brdf[0, 1], light[0, 2] = 0, 0, 1000
    light[1, 0] = brdf[1, 0] = 0
    expected = np.full(PATCHES, 0.25)
    expected[0, :3], expected[1, 0] = [0.05, 0.95, 0.05], 0.5
    np.testing.assert_allclose(tilts(rule, [light, brdf], [light, brdf]), expected, rtol=1e-6)


def test_grittmann2019(modules: SimpleNamespace) -> None:
    """Factors m2 / v are 4 / 3 and 4, so that BRDF samples have three times the weight; at most 100; 1 in the dark."""
    rule = modules.grittmann2019.Grittmann2019()
    pixels = PATCH**2
    m1 = np.stack([np.full(PATCHES, 1.0), np.full(PATCHES, np.sqrt(3))]) * pixels
    m2 = np.full((2, *PATCHES), 4.0) * pixels
    np.testing.assert_allclose(tilts(rule, m1, m2), 0.25, rtol=1e-6)
    m1[1] = 2 * pixels
    np.testing.assert_allclose(tilts(rule, m1, m2), (4 / 3) / (4 / 3 + 100), rtol=1e-6)
    np.testing.assert_allclose(tilts(rule, 0 * m1, 0 * m2), 0.5)


def test_hua2025(modules: SimpleNamespace) -> None:
    """The factor of least second moment over squared mean; its map is smoothed; the balance heuristic in the dark."""
    rule = modules.hua2025.Hua2025(radius=0.01)
    m1, m2 = np.ones((4, *PATCHES)), np.array([4.0, 3.0, 5.0, 5.0])[:, None, None] * np.ones(PATCHES)
    np.testing.assert_allclose(tilts(rule, m1, m2), 1 / 1.1, rtol=1e-6)
    m1[2] = 2  # 5 / 4 is less than 3
    np.testing.assert_allclose(tilts(rule, m1, m2), 1 / 1.5, rtol=1e-6)
    np.testing.assert_allclose(tilts(rule, 0 * m1, 0 * m2), 0.5)
    m1[2, :, :2] = 1
    smoothed = tilts(modules.hua2025.Hua2025(radius=1.0), m1, m2)
    assert smoothed.min() > 1 / 1.5 and smoothed.max() < 1 / 1.1
    assert modules.hua2025.Hua2025(sky=True).factors.max() == 100


def test_grittmann2022(modules: SimpleNamespace) -> None:
    """The share of least moment times cost: light samples cost more rays, so that equal moments give the fewest."""
    rule = modules.grittmann2022.Grittmann2022()
    rays = {"camera": 100, "shadow": 200, "brdf": 0}
    film = SimpleNamespace(rays=rays, shading_samples=4, mean=np.zeros((*SHAPE, 3)))
    values = np.ones((len(GRID) - 2, *PATCHES))
    for sums, share in ((values, GRID[1]), (0 * values, 0.5)):
        film.sums = {"values": sums}
        assert (rule.fit({0.5: film}).weight == share).all()
    values[8] = 0.3
    film.sums = {"values": values}
    assert (rule.fit({0.5: film}).weight == GRID[9]).all()
    x, d = np.ones((2, 1), np.float32), np.array([[0.5], [-0.5]], np.float32)
    np.testing.assert_allclose(modules.grittmann2022.second_moments(x, d)[5], 2.0)
    np.testing.assert_allclose(
        modules.grittmann2022.second_moments(x, d)[0], 1 / (1 - 0.47) + 1 / (1 + 0.47), rtol=1e-5
    )
