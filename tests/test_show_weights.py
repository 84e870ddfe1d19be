"""Rows of the tables of bounds and scores, from planted scores and patches."""

from pathlib import Path

import measure_weights
import numpy as np
import pytest
import show_weights
from rows import write_rows
from weight_bounds import BOUNDS

from dmis.bench.data import HALF
from dmis.bench.judge import Score
from tests.test_weight_bounds import planted


def of(small: list[float], large: list[float]) -> tuple[Score, Score]:
    """Return the scores of a rule at both sizes, of these absolute errors by seed and without a block."""
    noise = np.random.default_rng(len(small)).normal(1, 1e-4, (12, 1))
    rows = [np.array(errors)[:, None] * np.ones(6) for errors in (small, large)]
    return Score("a", {"tt": rows[0]}), Score("a", {"tt": rows[1] * noise}, True)


def test_orders_that_change() -> None:
    """Rules whose order is sure at both sizes and not the same are told; unsure ones do not count."""
    rules = {
        "balance": of([1.0] * 4, [1.0] * 12),
        "better now": of([1.1] * 4, [0.9] * 12),
        "always better": of([0.7] * 4, [0.7] * 12),
        "unsure": of([0.5, 1.5, 0.6, 1.9], [0.95] * 12),
    }
    small, large = ({name: sizes[k] for name, sizes in rules.items()} for k in range(2))
    assert show_weights.order_rows(large, small) == [["tt", "3", "1"]]


@pytest.fixture
def fresh():
    """Tables are read anew, before and after a test."""
    caches = show_weights.scores, show_weights.bounds, show_weights.validated
    for cache in caches:
        cache.cache_clear()
    yield
    for cache in caches:
        cache.cache_clear()


def test_rows_of_bounds(monkeypatch: pytest.MonkeyPatch, tmp_path, fresh) -> None:
    """Each scene has a row per size, the part of camera samples first; at equal samples cost does not count."""
    data = planted()
    data.position[:] = 3 * (data.terms[:, :, 0, HALF] + data.terms[:, :, 1, HALF])
    data.cost[HALF] *= 2
    monkeypatch.setattr(measure_weights, "read_bounds", lambda name, size: data)
    monkeypatch.setattr(show_weights, "BOUNDS_CSV", tmp_path / "bounds.csv")
    rows = [row for size in ("full", "quarter") for row in measure_weights.bound_rows("tt", size)]
    write_rows(show_weights.BOUNDS_CSV, rows, show_weights.BOUND_FIELDS)
    assert len(rows) == (3 + 2) * (1 + len(BOUNDS)) and tuple(BOUNDS) == show_weights.KINDS[1:]
    assert (rows[0]["width"], rows[-1]["width"]) == (1500, 375)
    row, absolute, relative = show_weights.bound_rows()
    assert row[:3] == ["tt", "1500x833", "0.75 (0.75)"] and absolute[3:] == row[3:] == relative[3:]
    tilt = show_weights.KINDS.index("tilt per patch")
    equal = show_weights.bounds("tt", "full", "absolute, equal samples")[0, tilt]
    np.testing.assert_allclose(show_weights.bounds("tt", "full", "absolute")[0, tilt], equal)  # tilts cost nothing


def test_pairs_in_the_predicted_order(monkeypatch: pytest.MonkeyPatch, tmp_path, fresh) -> None:
    """Pairs whose intervals overlap do not count; a pair in the other order is told, by measure."""
    monkeypatch.setattr(show_weights, "VALIDATED_CSV", tmp_path / "validated.csv")
    cells = [("balance", 1, 1, 1, 1), ("thesis", 0.8, 0.8, 0.8, 1.2), ("random", 2, 2, 1.01, 2.5)]
    rows = [dict(zip(show_weights.VALIDATED_FIELDS, ("tt", *line, 0.01, 0.01), strict=True)) for line in cells]
    write_rows(show_weights.VALIDATED_CSV, rows, show_weights.VALIDATED_FIELDS)
    pairs, agreeing = show_weights.ordered_pairs(["tt"], ["balance", "thesis", "random"])
    assert pairs.tolist() == [2, 3] and agreeing.tolist() == [2, 2]
    assert show_weights.validated_rows() == [["tt", "1.00", "0.67–1.00", "1.98, 0.80"]]


def test_rules_of_papers_link_to_the_files_that_register_them() -> None:
    folder = Path(measure_weights.__file__).parents[1] / "docs"
    for link, rule, *_ in show_weights.literature_rows():
        path = folder / link.partition("](")[2].rstrip(")")
        assert f'register_rule("{rule.strip("`")}"' in path.read_text("utf-8"), rule
