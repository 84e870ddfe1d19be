"""Samples beside their density: counts in cells of the sphere, and means over samples, against integrals.

The cells are rings about an axis, cut into sectors. Their edges are quantiles of an eighth of the samples, which the
tests leave out, so that narrow lobes have cells of their size. Random nodes in each cell give integrals over it, and an
upper bound of their variance. The models are the chi-square tests of Nori (Jakob) and of Mitsuba 3 (`mitsuba.chi2`),
whose cells are of equal size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dmis.base.vectors import Array
from dmis.testing.outcome import Fault
from dmis.testing.sphere import angles, directions
from dmis.testing.statistics import chi2_p, z_limit

COUNT = 2**16
"""Sampled directions of a view."""
ROUNDING = 1e-3
"""Error of integrals that is allowed beside that of the nodes: pdfs are float32."""
_SIDE = 16
"""Strata along each side of a cell, with a node in each."""
_PEAK = 20
"""Ratio of the largest density to the median one of some samples, from which on the former is the axis."""


class Cells:
    """Cells of the sphere: rings about an axis, cut into sectors.

    Parameters
    ----------
    w, density
        Directions ``(3, N)``, whose quantiles are the edges, and their densities ``(N,)``. The axis is the mean
        direction, or that of largest density if it has a peak.

    Attributes
    ----------
    nodes
        Random directions, the same number in each cell, ``(3, M)`` float32.
    """

    def __init__(self, w: Array, density: Array) -> None:
        if not w.shape[1]:
            w, density = np.array([[0.0], [0.0], [1.0]]), np.zeros(1)
        peak = density.max() > _PEAK * np.median(density)
        axis = w[:, int(density.argmax())].astype(float) if peak else w.astype(float).mean(axis=1)
        self._axis = axis / np.linalg.norm(axis)
        angle, azimuth = angles(w, self._axis)
        quantiles = np.linspace(0, 1, 17)[1:-1]
        inner = np.quantile(angle, quantiles)
        # a narrow lobe falls off over many magnitudes in the outermost ring
        outer = np.geomspace(max(inner[-1], 1e-6), np.pi, 17)
        self._theta = np.unique(np.concatenate([[0.0], inner, outer]))
        # an anisotropic lobe may be narrow in azimuth, too
        self._phi = np.unique([0.0, *np.quantile(azimuth, quantiles), 2 * np.pi])
        # sin^2(theta / 2) and phi are uniform in solid angle
        square = np.sin(self._theta / 2) ** 2
        self._shape = len(square) - 1, _SIDE, len(self._phi) - 1, _SIDE
        grid = self._shape[0] * _SIDE, self._shape[2] * _SIDE
        row, column = (np.indices(grid) + np.random.default_rng(2).random((2, *grid))) / _SIDE
        theta = 2 * np.arcsin(np.sqrt(np.interp(row, np.arange(len(square)), square)))
        phi = np.interp(column, np.arange(len(self._phi)), self._phi)
        self.nodes = directions(theta.ravel(), phi.ravel(), self._axis)
        # cos a - cos b = 2 (sin^2(b / 2) - sin^2(a / 2))
        self._solid_angles = 2 * np.outer(np.diff(square), np.diff(self._phi)).ravel()

    def count(self, w: Array) -> Array:
        """Return how many of the directions ``(3, N)`` are in each cell, ``(cells,)``."""
        return np.histogram2d(*angles(w, self._axis), [self._theta, self._phi])[0].ravel()

    def mean(self, values: Array) -> Array:
        """Return the mean over each cell of values at the nodes ``(..., M)``, ``(..., cells)``."""
        means = values.reshape(*values.shape[:-1], *self._shape).mean(axis=(-3, -1))
        return means.reshape(*values.shape[:-1], -1)

    def integrate(self, values: Array) -> tuple[Array, Array]:
        """Return the integral over each cell of values at the nodes ``(..., M)``, and its variance, ``(..., cells)``.

        The variance is an upper bound: that within strata, from the differences of neighbours.
        """
        values = values.astype(float)
        grid = values.reshape(*values.shape[:-1], self._shape[0] * _SIDE, self._shape[2] * _SIDE)
        # I = A mean(f),  V(I) = A^2 V(f) / n,  V(f) <= sum (f_i - f_j)^2 / 2 over the neighbours j
        squares = np.zeros_like(grid)
        for sums, lines in ((squares, grid), (squares.swapaxes(-2, -1), grid.swapaxes(-2, -1))):
            steps = np.diff(lines) ** 2 / 2
            sums[..., 1:] += steps
            sums[..., :-1] += steps
        variance = self._solid_angles**2 * self.mean(squares.reshape(values.shape)) / _SIDE**2
        return self._solid_angles * self.mean(values), variance


@dataclass(frozen=True, eq=False)
class DensityView:
    """Sampled directions of a lobe, light or technique at one place, and their density.

    Attributes
    ----------
    wi
        Sampled unit directions, ``(3, N)``.
    pdf
        Function of directions ``(3, M)``: their densities per solid angle, ``(M,)``; 0 where they are not accepted.
    accepted
        Which samples count, ``(N,)`` bool: those on the side of the lobe, or that meet the light's bright side.
    place
        For messages, such as ``wo at 35°``.
    value
        The function that is integrated, ``(3, M) -> (3, M)``: f cos of a lobe, the radiance of a light.
    """

    wi: Array
    pdf: Callable[[Array], Array]
    accepted: Array
    place: str = ""
    value: Callable[[Array], Array] | None = None

    @cached_property
    def cells(self) -> Cells:
        """Cells that the first eighth of the directions gives."""
        first = self.wi.shape[1] // 8
        some = np.ascontiguousarray(self.wi[:, :first][:, self.accepted[:first]])
        return Cells(some, self.pdf(some))

    @cached_property
    def counts(self) -> tuple[Array, Array, Array]:
        """Counts of directions by cell, counts expected from the pdf, and their variances, ``(cells + 1,)`` each.

        The last cell is that of directions that are not accepted, such as those below the horizon. It expects what the
        integral of the pdf lacks to 1, or exceeds it by.
        """
        first = self.wi.shape[1] // 8
        observed = self.cells.count(self.wi[:, first:][:, self.accepted[first:]])
        count = self.wi.shape[1] - first
        integral, variance = self.cells.integrate(self.pdf(self.cells.nodes))
        expected = count * np.append(integral, abs(1 - integral.sum()))
        variance = count**2 * np.append(variance, variance.sum() + ROUNDING**2)
        return np.append(observed, count - observed.sum()), expected, variance

    @property
    def mass(self) -> float:
        """Integral of the pdf."""
        return float(self.counts[1][:-1].sum() / self.counts[0].sum())

    @cached_property
    def p(self) -> float:
        """p-value of the chi-square test; 1 where nothing is expected and nothing observed."""
        observed, expected, variance = self.counts
        if max(observed[:-1].sum(), expected[:-1].sum()) < 50:
            return 1.0
        return chi2_p(observed, expected, variance)

    def describe(self) -> str:
        """Return integral, accepted share and p-value, and the direction around which a count is least expected."""
        observed, expected, variance = self.counts
        k = int((np.abs(observed - expected) / np.sqrt(np.maximum(expected + variance, 1)))[:-1].argmax())
        wi = self.cells.mean(self.cells.nodes)[:, k]
        return (
            f"it integrates to {self.mass:.4f}, {1 - observed[-1] / observed.sum():.4f} of the directions of sample "
            f"are accepted, and the chi-square test has p = {self.p:.1g}; most around wi = "
            f"({', '.join(f'{x:.2f}' for x in wi)}): {observed[k]:.0f} directions, {expected[k]:.0f} expected"
        )

    @cached_property
    def integral(self) -> tuple[Array, Array]:
        """Integral of each channel of `value`, and its standard error, both ``(3,)``."""
        assert self.value is not None
        integral, variance = (part.sum(axis=1) for part in self.cells.integrate(self.value(self.cells.nodes)))
        return integral, np.sqrt(variance) + ROUNDING * integral

    @cached_property
    def mean(self) -> tuple[Array, float]:
        """Mean of each channel of value / pdf over the samples, ``(3,)``, and its standard error.

        The error is that of the nodes' second moment, because few samples may not know their own.
        """
        assert self.value is not None
        square = _ratio(self.value(self.cells.nodes).max(axis=0) ** 2, self.pdf(self.cells.nodes))
        # V = integral of f^2 / p - I^2
        variance = self.cells.integrate(square)[0].sum() - self.integral[0].max() ** 2
        mean = _ratio(self.value(self.wi), self.accepted * self.pdf(self.wi)).mean(axis=1)
        return mean, float(np.sqrt(max(variance, 0) / self.wi.shape[1]))


def _ratio(value: Array, pdf: Array) -> Array:
    """Return value / pdf, float64; 0 where the pdf is 0."""
    return np.divide(value, pdf, out=np.zeros(value.shape), where=pdf > 0)


Views = Sequence[DensityView]


def check_pdf(views: Views, level: float, pdf: str = "pdf") -> str:
    """Raise a Fault unless the samples follow each pdf, which integrates to the share of those accepted."""
    for view in views:
        if not view.p > level:
            raise Fault(f"{pdf} is not the density of sample: {view.describe()} ({view.place})")
    return f"p = {', '.join(f'{view.p:.2g}' for view in views)}"


def check_integral(views: Views, level: float, value: str, pdf: str = "pdf") -> str:
    """Raise a Fault unless the mean of value / pdf over samples is the integral of `value`; return the integrals."""
    for view in views:
        (integral, error), (mean, deviation) = view.integral, view.mean
        if not (np.abs(mean - integral) <= z_limit(level) * np.hypot(error, deviation)).all():
            k = int(np.abs(mean - integral).argmax())
            raise Fault(
                f"the mean of {value} / {pdf} over samples is {mean[k]:.4g} ± {deviation:.1g}, but the integral of "
                f"{value} is {integral[k]:.4g}: {pdf} is wrong, or 0 where {value} is not ({view.place})"
            )
    return f"integrals {', '.join(f'{view.integral[0].max():.3f}' for view in views)}"
