"""Chi-square test of sampled directions against their density, and the integral of the density.

The sphere is cut into cells, rings about an axis cut into sectors, in which the samples are counted. The expected
count of a cell is its quadrature of the pdf. Directions that are not accepted, such as those below the horizon, are a
cell of their own, which expects what the integral of the pdf lacks to 1. The edges are quantiles of the angles of some
of the directions, which are left out of the test, so that narrow lobes have cells of their size.

The model are the chi-square tests of Nori (Jakob) and of Mitsuba 3 (`mitsuba.chi2`), whose cells are of equal size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.testing.sphere import angles, sphere_nodes
from dmis.testing.statistics import chi2_p

Density = Callable[[Array], Array]
"""Function of directions ``(3, M)`` that returns their densities per solid angle, ``(M,)``."""
QUADRATURE = 1e-3
"""Error of an integral over all cells that is allowed beside the estimated one: the horizon cuts cells."""
_SUSPICIOUS = 1e-3
"""p-value below which the quadrature is repeated with more nodes, before it is believed."""
_FINE = 32
"""Nodes along each side of a cell of that quadrature."""
_PEAK = 20
"""Ratio of the largest density to the median one of some samples, from which on the former is the axis."""
_LEARN = 8
"""One of so many directions places the rings and is left out of the test."""


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
    per_cell: int = 16

    @cached_property
    def _rule(self) -> tuple[Array, Array]:
        return sphere_nodes(self.axis, self.theta, self.phi, self.per_cell)

    @property
    def nodes(self) -> Array:
        """Directions of the quadrature nodes, ``(3, M)`` float32."""
        return self._rule[0]

    def finer(self) -> Cells:
        """Return the same cells with many more nodes."""
        return Cells(self.axis, self.theta, self.phi, _FINE)

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
            step = np.abs(np.diff(lines, axis=0)) / 2
            largest = np.zeros_like(lines)
            largest[1:] = step
            np.maximum(largest[:-1], step, out=largest[:-1])
            sums += largest
        steps = largest_steps.reshape(rings, k, sectors, k).swapaxes(1, 2)
        return (values * weights).sum(axis=(2, 3)), (steps * weights).sum(axis=(2, 3))


def learn_cells(w: Array, axis: Array) -> Cells:
    """Return cells about `axis` ``(3,)`` whose edges are quantiles of the directions `w` ``(3, N)``."""
    axis = np.asarray(axis, float)
    angle, azimuth = angles(w, axis)
    inner = np.quantile(angle, np.linspace(0, 1, 17)[1:-1])
    # a narrow lobe falls off over many magnitudes in the outermost ring: cut it further for the quadrature
    outer = np.geomspace(max(inner[-1], 1e-6), np.pi, 17)
    theta = np.unique(np.concatenate([[0.0], inner, outer]))
    # an anisotropic lobe may be a blade, narrow in azimuth, too
    phi = np.unique([0.0, *np.quantile(azimuth, np.linspace(0, 1, 17)[1:-1]), 2 * np.pi])
    return Cells(axis, theta, phi)


@dataclass(frozen=True, eq=False)
class DensityComparison:
    """Sampled directions beside their density.

    Attributes
    ----------
    cells
        The cells of the sphere.
    observed, expected
        Counts of accepted directions, ``(rings, sectors)``.
    error
        Of `expected`, from the quadrature, ``(rings, sectors)``.
    count
        Number of all directions, accepted or not.
    """

    cells: Cells
    observed: Array
    expected: Array
    error: Array
    count: int

    @property
    def mass(self) -> float:
        """Integral of the density."""
        return float(self.expected.sum() / self.count)

    @property
    def mass_error(self) -> float:
        """Error of `mass`, from the quadrature."""
        return float(np.sqrt((self.error**2).sum()) / self.count) + QUADRATURE

    @property
    def accepted(self) -> float:
        """Share of the directions that are accepted."""
        return float(self.observed.sum() / self.count)

    def mass_agrees(self, limit: float) -> bool:
        """Return whether the integral is the accepted share, within `limit` standard errors of the latter."""
        mass = min(max(self.mass, 0.0), 1.0)
        share = max(self.accepted * (1 - self.accepted), mass * (1 - mass))
        return abs(self.mass - self.accepted) <= limit * np.sqrt(share / self.count) + 3 * self.mass_error

    @cached_property
    def p(self) -> float:
        """p-value of the chi-square test; 1 where nothing is expected and nothing observed."""
        lacking, error = max(1 - self.mass, 0) * self.count, self.mass_error * self.count
        observed = np.append(self.observed, self.count - self.observed.sum())
        variance = np.append(self.error**2, error**2)
        expected = np.append(self.expected, lacking)
        if max(observed[:-1].sum(), expected[:-1].sum()) < 50:
            return 1.0
        return chi2_p(observed, expected, variance)

    @property
    def ratio(self) -> tuple[float, float]:
        """Ratio of observed to expected counts over all cells, and its spread between cells beyond their noise."""
        some = self.expected >= 5
        observed, expected = self.observed[some], self.expected[some]
        ratio = observed.sum() / max(expected.sum(), 1e-30)
        excess = ((observed - ratio * expected) ** 2).sum() - (ratio * expected).sum()
        return float(ratio), float(np.sqrt(max(excess, 0) / max((expected**2).sum(), 1e-30)))

    def figure(self, title: str) -> Any:
        """Return a figure of observed and expected counts and their difference in standard deviations.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        """
        from dmis import plot

        figure, axes = plot.canvas(1, 3, 13, 4.2)
        deviation = np.sqrt(np.maximum(self.expected + self.error**2, 1))
        most = max(self.observed.max(), self.expected.max())
        maps = (
            ("directions of sample in each cell", self.observed, {"vmin": 0, "vmax": most}),
            ("expected by pdf", self.expected, {"vmin": 0, "vmax": most}),
            (
                "difference / standard deviation",
                (self.observed - self.expected) / deviation,
                {"vmin": -6, "vmax": 6, "cmap": "RdBu_r"},
            ),
        )
        rings = int(np.flatnonzero((self.observed + self.expected).any(axis=1)).max(initial=0)) + 1
        for axis, (name, values, options) in zip(axes[0], maps, strict=True):
            drawn = axis.pcolormesh(np.degrees(self.cells.phi), np.arange(rings + 1), values[:rings], **options)
            axis.invert_yaxis()
            axis.set_title(name, fontsize="medium")
            axis.set_xlabel("azimuth about the axis (degrees)", fontsize="small")
            rows = np.arange(0, rings + 1, 2)
            edges = np.degrees(self.cells.theta[rows])
            axis.set_yticks(rows, labels=[f"{edge:.3g}°" for edge in edges], fontsize="x-small")
            figure.colorbar(drawn, ax=axis)
        axes[0, 0].set_ylabel("angle from the axis (edges of rings)", fontsize="small")
        figure.suptitle(title, parse_math=False)
        return figure


def compare_directions(
    w: Array,
    pdf: Density,
    axis: Array | None = None,
    accepted: Array | None = None,
    cells: Cells | None = None,
) -> DensityComparison:
    """Compare directions with their density.

    A comparison that looks bad is repeated with more quadrature nodes.

    Parameters
    ----------
    w
        Sampled unit directions, ``(3, N)``.
    pdf
        Their density; 0 where directions are not accepted.
    axis
        Of the rings, ``(3,)``. Default: the mean direction, or that of largest density if there is a peak.
    accepted
        Which directions are accepted, ``(N,)`` bool. Default: all.
    cells
        Default: those that an eighth of the directions gives.

    Returns
    -------
    DensityComparison
        Its `DensityComparison.p` is the p-value of the chi-square test.
    """
    ok = np.ones(w.shape[1], bool) if accepted is None else accepted
    if cells is None:
        learn = w.shape[1] // _LEARN
        some = w[:, :learn][:, ok[:learn]]
        w, ok = w[:, learn:], ok[learn:]
        if not some.shape[1]:
            some = np.array([[0.0], [0.0], [1.0]], np.float32)
        if axis is None:
            density = pdf(np.ascontiguousarray(some))
            peak = density.max() > _PEAK * np.median(density)
            axis = some[:, int(density.argmax())].astype(float) if peak else some.astype(float).mean(axis=1)
        cells = learn_cells(some, axis / np.linalg.norm(axis))
    observed, count = cells.count(w[:, ok]), w.shape[1]
    mass, error = cells.integrate(pdf(cells.nodes))
    coarse = DensityComparison(cells, observed, mass * count, error * count, count)
    if coarse.p > _SUSPICIOUS and coarse.mass_agrees(3):
        return coarse
    mass, error = integrate_finely(cells, pdf)
    return DensityComparison(cells, observed, mass * count, error * count, count)


def integrate_finely(cells: Cells, function: Density) -> tuple[Array, Array]:
    """Return the integrals of `Cells.integrate` by many more nodes; their error includes what the nodes change."""
    fine = cells.finer()
    value, error = fine.integrate(function(fine.nodes))
    return value, np.maximum(error, np.abs(value - cells.integrate(function(cells.nodes))[0]))
