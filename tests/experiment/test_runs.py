"""Runs: their order, errors and times, and the number of samples for a given time."""

import numpy as np
import pytest
from helpers import fresh_python

import dmis
from dmis.experiment.runs import measure


def test_measure(box):
    """`measure` has the errors of separate renders; rules take turns within each seed."""
    reference = dmis.Reference(*(dmis.render(box, "balance", 2, seed=k).image for k in (8, 9)), 64)
    seen = []
    budgets = [("balance", 8), ("thesis:patch=4", 16)]
    runs = measure(box, budgets, [3, 5], reference, progress=lambda *a: seen.append(a))
    assert list(runs) == budgets
    assert seen == [("balance", 1, 4), ("thesis:patch=4", 2, 4), ("balance", 3, 4), ("thesis:patch=4", 4, 4)]
    for (rule, spp), both in runs.items():
        assert [r.seed for r in both] == [3, 5]
        result = dmis.render(box, rule, spp, seed=5)
        first, second = (half.astype(float) for half in (reference.first, reference.second))
        product, r = (result.image - first) * (result.image - second), (first + second) / 2
        d = result.image - r
        assert both[1].mse == pytest.approx(product.mean(), rel=1e-12)
        assert both[1].relmse == pytest.approx((product / (r**2 + 0.01)).mean(), rel=1e-12)
        # the noise of halves of 64 samples, which is more than d^2 here
        noise = ((first - second) ** 2).mean(axis=(0, 1)) / 4 * (1 + 128 / spp)
        assert (noise > (d**2).mean(axis=(0, 1))).all()
        z = d.mean(axis=(0, 1)) / np.sqrt(noise / (24 * 32))
        assert both[1].mean_z == pytest.approx(z[np.abs(z).argmax()], rel=1e-6)
        assert both[1].rays == sum(result.rays.values())
        assert 0 <= both[1].overhead < both[1].seconds and both[1].mse_error > 0
    assert runs["balance", 8][0].mse != runs["balance", 8][1].mse


FIRST = """
import sys, dmis, numpy as np, dmis.experiment.runs as runs
render, sky = runs.render_alone, dmis.EnvironmentLight(np.arange(384).reshape(8, 16, 3) / 384)
def watched(*arguments, **options):
    before = len(sys.modules), len(vars(sky))
    result = render(*arguments, **options)
    print(len(sys.modules) - before[0], len(vars(sky)) - before[1], end=" ")
    return result
runs.render_alone = watched
floor = dmis.Part(dmis.load_scene("cornell").parts[0].mesh, dmis.matte(0.5))
scene = dmis.Scene(dmis.Camera.fit([floor.mesh], resolution=(16, 16)), (floor,), (sky,))
black = np.zeros((16, 16, 3), np.float32)
runs.measure(scene, [("balance", 4), ("second-moment", 16)], 1, dmis.Reference(black, black, 1), parallel=1)
"""


def test_first_renders_pay_no_imports_and_tables(box, tmp_path):
    """A rule's first render in a process imports nothing and makes no table of a sky."""
    assert fresh_python(FIRST).split() == ["0", "0", "0", "0"]
    # a budget that is named twice is rendered once, so that its runs do not count twice
    reference = dmis.make_reference(box, 4, folder=tmp_path)
    assert [len(r) for r in measure(box, [("balance", 2)] * 2, [1], reference).values()] == [1]
