"""Cells of the sphere in which sampled directions are counted, and over which densities are integrated.

The sphere is cut into rings about an axis, and these into sectors. The edges are quantiles of the angles of some of
the directions, which are left out of the test, so that narrow lobes have cells of their size. The models are the
chi-square tests of Nori (Jakob) and of Mitsuba 3 (`mitsuba.chi2`), whose cells are of equal size.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dmis.base.vectors import Array
from dmis.testing.sphere import angles, sphere_nodes

_PEAK = 20
"""Ratio of the largest density to the median one of some samples, from which on the former is the axis."""


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of the sphere: rings about an axis, cut into sectors.

    Attributes
    ----------
    axis
        Unit vector ``(3,)``.
    theta, phi
        Edges of the rings, from 0 to pi, and of the sectors, from 0 to 2 pi.
    per_cell
        Quadrature nodes along each side of a cell, an even number.
    """

    axis: Array
    theta: Array
    phi: Array
    per_cell: int

    @cached_property
    def _rule(self) -> tuple[Array, Array]:
        return sphere_nodes(self.axis, self.theta, self.phi, self.per_cell)

    @property
    def nodes(self) -> Array:
        """Directions of the quadrature nodes, ``(3, M)`` float32."""
        return self._rule[0]

    def count(self, w: Array) -> Array:
        """Return how many of the directions ``(3, N)`` are in each cell, ``(rings, sectors)``."""
        return np.histogram2d(*angles(w, self.axis), [self.theta, self.phi])[0]

    def integrate(self, values: Array) -> tuple[Array, Array]:
        """Return the integral of each cell of values at the nodes ``(M,)``, and its error, both ``(rings, sectors)``.

        The error is that of a step half a node away from where the nodes see it: half of the difference between each
        node and its neighbours, those of other cells, too. Smooth functions have much smaller errors.
        """
        rings, sectors, k = len(self.theta) - 1, len(self.phi) - 1, self.per_cell
        shape = (rings, sectors, k, k)
        weights = self._rule[1].reshape(shape)
        values = values.astype(float).reshape(shape)
        grid = values.swapaxes(1, 2).reshape(rings * k, sectors * k)
        largest_steps = np.zeros_like(grid)
        for lines, sums in ((grid, largest_steps), (grid.T, largest_steps.T)):
            halves = np.pad(np.abs(np.diff(lines, axis=0)) / 2, ((1, 1), (0, 0)))
            sums += np.maximum(halves[1:], halves[:-1])
        steps = largest_steps.reshape(rings, k, sectors, k).swapaxes(1, 2)
        return (values * weights).sum(axis=(2, 3)), (steps * weights).sum(axis=(2, 3))


def learn_cells(w: Array, density: Array, per_cell: int) -> Cells:
    """Return cells whose edges are quantiles of the directions `w` ``(3, N)`` with their densities ``(N,)``.

    Each has `per_cell` nodes along its sides. The axis is the mean direction, or that of largest density if it has a
    peak.
    """
    if not w.shape[1]:
        w, density = np.array([[0.0], [0.0], [1.0]]), np.zeros(1)
    peak = density.max() > _PEAK * np.median(density)
    axis = w[:, int(density.argmax())].astype(float) if peak else w.astype(float).mean(axis=1)
    axis /= np.linalg.norm(axis)
    angle, azimuth = angles(w, axis)
    inner = np.quantile(angle, np.linspace(0, 1, 17)[1:-1])
    # a narrow lobe falls off over many magnitudes in the outermost ring: cut it further for the quadrature
    outer = np.geomspace(max(inner[-1], 1e-6), np.pi, 17)
    theta = np.unique(np.concatenate([[0.0], inner, outer]))
    # an anisotropic lobe may be a blade, narrow in azimuth, too
    phi = np.unique([0.0, *np.quantile(azimuth, np.linspace(0, 1, 17)[1:-1]), 2 * np.pi])
    return Cells(axis, theta, phi, per_cell)
