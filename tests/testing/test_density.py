"""The statistics under the checks: levels, quadrature, and right densities that are hard."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dmis.base.vectors import normalise
from dmis.samplers.warp import square_to_sphere
from dmis.testing.density import Cells, DensityView
from dmis.testing.outcome import Fault, Outcome, require, run_checks
from dmis.testing.sphere import columns, uniforms
from dmis.testing.statistics import FALSE_ALARM, chi2_p, level, z_limit


def test_levels_and_integrals() -> None:
    """So many independent tests fail with the probability of a false alarm."""
    assert 1 - (1 - level(20)) ** 20 == pytest.approx(FALSE_ALARM, rel=1e-9)
    assert z_limit(0.05) == pytest.approx(1.959964, abs=1e-6)
    # the integral of the cosine over a hemisphere, pi, and of a step that falls between nodes
    cells = Cells(square_to_sphere(uniforms(1000)), np.ones(1000))
    for values, exact in ((np.maximum(cells.nodes[2], 0), np.pi), (cells.nodes[2] > 0.99, 0.02 * np.pi)):
        integral, variance = (part.sum() for part in cells.integrate(values))
        assert abs(integral - exact) < 4 * np.sqrt(variance) < 0.5 * exact


def test_p_values_are_uniform() -> None:
    """Of counts that follow their expectations, small ones pooled."""
    rng = np.random.default_rng(1)
    expected = np.geomspace(0.1, 200, 40)
    p = np.array([chi2_p(rng.poisson(expected), expected) for _ in range(2000)])
    for limit in (0.5, 0.1, 0.01):
        assert abs((p < limit).mean() - limit) < 5 * math.sqrt(limit / 2000) + 0.005
    assert chi2_p(np.array([9, 4, 90, 3]), np.array([3, 4.5, 99, 4])) == chi2_p(
        np.array([16, 90]), np.array([11.5, 99])
    )
    with pytest.raises(ValueError, match="needs two cells that expect 5 or more"):
        chi2_p(np.ones(3), np.ones(3))


@pytest.mark.parametrize("cos", [0.0, 0.95])
def test_a_density_with_an_edge_passes(cos: float) -> None:
    """Uniform directions in a tilted cap, whose edge cuts cells; a density that is 7 % too large fails."""
    axis = normalise(columns((0.3, -0.4, 0.5)))[:, 0]
    w = square_to_sphere(uniforms(2**20, 7))
    w = w[:, axis @ w > cos][:, : 2**14]
    right = 1 / (2 * np.pi * (1 - cos))
    for seed in range(8):
        shuffled = np.random.default_rng(seed).permutation(w, axis=1)
        view = DensityView(shuffled, lambda d: (axis @ d > cos) * right, np.ones(2**14, bool))
        assert view.p > 1e-4 and view.mass == pytest.approx(1, abs=0.01)
    wrong = DensityView(w, lambda d: (axis @ d > cos) * (1.07 * right), np.ones(2**14, bool))
    assert wrong.p < 1e-4 and wrong.mass == pytest.approx(1.07, abs=0.01)


def test_faults_of_densities_are_described() -> None:
    """Their share is what the integral of the pdf lacks to 1."""
    w = square_to_sphere(uniforms(2**14, 4))
    views = [
        DensityView(w, lambda d, factor=factor: (d[2] > 0) * (factor * 0.25 / np.pi), accepted)
        for factor, accepted in ((1.0, w[2] > 0), (2.0, w[2] > 0), (1.0, w[2] > -2))
    ]
    assert [view.p > 1e-4 for view in views] == [True, False, False]
    assert views[0].describe().startswith("it integrates to 0.5000, 0.5043 of the directions of sample are accepted")
    # Uniform directions without a cap about +y
    w = square_to_sphere(uniforms(2**16, 3))
    w = w[:, w[1] < 0.8]
    text = DensityView(w, lambda d: np.full(d.shape[1], 0.25 / np.pi), np.ones(w.shape[1], bool)).describe()
    wi = [float(x) for x in text[text.index("(") + 1 : text.index(")")].split(", ")]
    assert wi[1] > 0.8 and ": 0 directions" in text


def test_require_lists_what_failed() -> None:
    def fail() -> str:
        raise Fault("pdf is wrong")

    outcomes = run_checks("Mine", [("a", lambda: "fine"), ("b", fail), ("c", lambda: str(1 / 0))])
    assert outcomes[0] == Outcome("Mine: a", True, "fine")
    with pytest.raises(AssertionError, match=r"2 of 3 checks failed\nMine: b: pdf is wrong\nMine: c: .*Zero") as error:
        require(outcomes)
    assert "(test_density.py, line " in str(error.value)
    assert len(run_checks("Mine", ((fail(), fail) for _ in range(2)))) == 1
    with pytest.raises(AssertionError, match="nothing was checked"):
        require([])
