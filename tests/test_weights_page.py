"""Rows of the tables of docs/what-weights-save.md, from planted scores and patches."""

import numpy as np
import pytest
import weights_page
from weight_bounds import BOUNDS

from dmis.experiment.bench.data import GRID, HALF, Truth
from dmis.experiment.bench.judge import Score
from tests.test_weight_bounds import planted


def of(small: list[float], large: list[float]) -> tuple[Score, Score]:
    """Return the scores of a rule at both sizes, of these absolute errors by seed and without a block."""
    noise = np.random.default_rng(len(small)).normal(1, 1e-4, (12, 1))
    rows = [np.array(errors)[:, None] * np.ones(6) for errors in (small, large)]
    return Score("a", {"tt": rows[0]}), Score("a", {"full-tt": rows[1] * noise}, True)


def test_orders_that_change() -> None:
    """Rules whose order is sure at both sizes and not the same are told; unsure ones do not count."""
    rules = {
        "balance": of([1.0] * 4, [1.0] * 12),
        "better now": of([1.1] * 4, [0.9] * 12),
        "always better": of([0.7] * 4, [0.7] * 12),
        "unsure": of([0.5, 1.5, 0.6, 1.9], [0.95] * 12),
    }
    small, large = ({name: sizes[k] for name, sizes in rules.items()} for k in range(2))
    head, row = weights_page.page_orders(large, small, ["tt"])
    assert row == ["tt", 3, 1] and len(head) == 3


def test_best_tilts_count_patches_by_weight() -> None:
    """The error of the best tilt of each patch, without each group of blocks."""
    t = GRID[:, None].astype(float)
    curves = np.concatenate([1 + (t - 0.5) ** 2, 2 + 0 * t], axis=1)[..., None].repeat(6, axis=1)
    curves[3, ::2] = 0.5
    weight = np.array([[1.0], [3.0]] * 6)
    truth = Truth(np.broadcast_to(curves, (2, 2, *curves.shape)), curves[0], curves, (48, 4), weight, 12)
    ratios = weights_page.best_tilts(truth, 0)
    assert ratios.shape == (12,)
    expected = [
        (curves.min(axis=0) * part.weight).sum() / (curves[HALF] * part.weight).sum() for part in truth.leave_one_out()
    ]
    np.testing.assert_allclose(ratios, expected)


def test_rows_of_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each scene has a row per size, the part of camera samples first; CSV rows have both measures."""
    data = planted()
    data.position[:] = 3 * (data.terms[:, :, 0, HALF] + data.terms[:, :, 1, HALF])
    monkeypatch.setattr(weights_page, "read_bounds", lambda name, size: data)
    found = {("tt", size): weights_page.bounds_of("tt", size) for size in ("full", "quarter")}
    assert found["tt", "quarter"][0] == (375, 208)
    head, row, absolute, relative = weights_page.page_bounds(found, ["tt"])
    assert row[:3] == ["tt", "1500x833", "0.75 (0.75)"] and absolute[3:] == row[3:] == relative[3:]
    assert len(row) == len(head) == len(absolute) == len(BOUNDS) + 2
    cells = list(weights_page.bound_rows(found))
    assert len(cells) == 2 * 2 * (1 + len(BOUNDS)) and cells[0] == [
        "tt",
        1500,
        833,
        "absolute",
        "camera samples",
        "0.7500",
        "0.0000",
    ]
