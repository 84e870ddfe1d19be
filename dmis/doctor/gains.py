"""What a right table tells of noise: fireflies, and what other shares of samples would save."""

from __future__ import annotations

import numpy as np

from dmis.doctor.table import Table

PATCH = 8
"""Side of the patches of pixels whose shares could differ."""
FEW = 0.001
"""Share of the camera samples that count as fireflies, those of the largest squares."""


def firefly_share(table: Table) -> float:
    """Return the part of the sum of squared estimates that the largest `FEW` of the camera samples have."""
    estimates = np.bincount(table.sample, table.f / (table.a_l + table.a_b)) ** 2
    few = max(1, round(FEW * len(estimates)))
    return float(np.partition(estimates, -few)[-few:].sum() / max(estimates.sum(), 1e-30))


def savings(table: Table) -> float:
    """Return what the best share of each patch would save of the second moment of estimates, judged on other samples.

    The second moment with share t is the sum of ``f^2 / ((t a_l + (1 - t) a_b) (a_l + a_b))``; t is chosen by every
    other camera sample and judged by the rest.
    """
    patch = np.zeros(len(table), np.int64)
    if table.shape is not None:
        row, column = np.divmod(table.pixel, table.shape[1])
        patch += row // PATCH * (table.shape[1] // PATCH + 1) + column // PATCH
    patches = int(patch.max()) + 1
    square = table.f.astype(float) ** 2 / (table.a_l + table.a_b)
    half = patch + patches * (table.sample % 2)
    shares = np.linspace(0.1, 0.9, 9)  # 1/2 stands for the numbers of samples of the table
    moments = [np.bincount(half, square / (t * table.a_l + (1 - t) * table.a_b), 2 * patches) for t in shares]
    chosen, judged = np.reshape(moments, (len(shares), 2, patches)).swapaxes(0, 1)
    best = judged[chosen.argmin(axis=0), np.arange(patches)].sum()
    return float(1 - best / max(judged[len(shares) // 2].sum(), 1e-30))
