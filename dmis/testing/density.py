"""Samples of a function beside their density, at one place.

Samples are compared with their pdf by Pearson's chi-square test in `dmis.testing.cells`. The expected count of a cell
is its quadrature of the pdf. Directions that are not accepted, such as those below the horizon, are a cell of their
own, which expects what the integral of the pdf lacks to 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dmis.base.vectors import Array
from dmis.light.light_sample import LightSample
from dmis.testing.cells import Cells, learn_cells
from dmis.testing.statistics import chi2_p

QUADRATURE = 1e-3
"""Error of an integral over all cells that is allowed beside the estimated one: the horizon cuts cells."""


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
    sample, hit
        Of lights and techniques: the light samples of `wi`, and the function that returns those of any directions.
    pdf_name
        The pdf in messages.
    nodes
        Quadrature nodes along each side of a cell, an even number.
    """

    wi: Array
    pdf: Callable[[Array], Array]
    accepted: Array
    place: str = ""
    value: Callable[[Array], Array] | None = None
    sample: LightSample | None = None
    hit: Callable[[Array], LightSample] | None = None
    pdf_name: str = "pdf"
    nodes: int = 16

    def finer(self) -> DensityView:
        """Return the same view with four times the nodes, for what looks wrong by the coarse ones."""
        return replace(self, nodes=2 * self.nodes)

    @cached_property
    def cells(self) -> Cells:
        """Cells that the first directions give."""
        some = np.ascontiguousarray(self.wi[:, : self._learn][:, self.accepted[: self._learn]])
        return learn_cells(some, self.pdf(some), self.nodes)

    @property
    def _learn(self) -> int:
        """Number of directions that place the cells and are left out of the test."""
        return self.wi.shape[1] // 8

    @property
    def count(self) -> int:
        """Number of directions that are counted, accepted or not."""
        return self.wi.shape[1] - self._learn

    @cached_property
    def observed(self) -> Array:
        """Counts of the accepted ones, ``(rings, sectors)``."""
        return self.cells.count(self.wi[:, self._learn :][:, self.accepted[self._learn :]])

    @cached_property
    def expected(self) -> tuple[Array, Array]:
        """Counts that the pdf expects and their errors, from the quadrature, both ``(rings, sectors)``."""
        integrals, error = self.cells.integrate(self.pdf(self.cells.nodes))
        return integrals * self.count, error * self.count

    @property
    def mass(self) -> float:
        """Integral of the pdf."""
        return float(self.expected[0].sum() / self.count)

    @property
    def mass_error(self) -> float:
        """Error of `mass`."""
        return float(np.sqrt((self.expected[1] ** 2).sum()) / self.count) + QUADRATURE

    @property
    def share(self) -> float:
        """Share of the directions that are accepted."""
        return float(self.observed.sum() / self.count)

    def mass_agrees(self, limit: float) -> bool:
        """Return whether the integral is the accepted share, within `limit` standard errors of the latter."""
        mass = min(max(self.mass, 0.0), 1.0)
        variance = max(self.share * (1 - self.share), mass * (1 - mass))
        return abs(self.mass - self.share) <= limit * np.sqrt(variance / self.count) + 3 * self.mass_error

    @cached_property
    def p(self) -> float:
        """p-value of the chi-square test; 1 where nothing is expected and nothing observed."""
        expected, error = self.expected
        observed = np.append(self.observed, self.count - self.observed.sum())
        lacking = max(1 - self.mass, 0) * self.count
        if max(observed[:-1].sum(), expected.sum()) < 50:
            return 1.0
        return chi2_p(observed, np.append(expected, lacking), np.append(error, self.mass_error * self.count) ** 2)

    @cached_property
    def integral(self) -> Integral:
        """Integral of `value` over the cells of the samples."""
        assert self.value is not None
        cells = self.cells
        values, pdf = self.value(cells.nodes).astype(float), self.pdf(cells.nodes)
        sums = np.array([[cell_sums.sum() for cell_sums in cells.integrate(channel)] for channel in values])
        largest = values.max(axis=0)
        ratio = np.divide(largest**2, pdf, out=np.zeros_like(largest), where=pdf > 0)
        missed, square = (float(cells.integrate(part)[0].sum()) for part in (largest * (pdf <= 0), ratio))
        return Integral(sums[:, 0], sums[:, 1], missed, square)

    def worst(self) -> str:
        """Return the direction around which the counts of a cell are least expected, and these."""
        expected, error = self.expected
        deviation = np.abs(self.observed - expected) / np.sqrt(np.maximum(expected + error**2, 1))
        k = int(deviation.argmax())
        wi = self.cells.nodes.reshape(3, deviation.size, -1)[:, k].mean(axis=1)
        counts = f"{self.observed.flat[k]:.0f} directions, {expected.flat[k]:.0f} expected"
        return f"most around wi = ({', '.join(f'{x:.2f}' for x in wi)}): {counts}"


@dataclass(frozen=True, eq=False)
class Integral:
    """A quadrature over directions.

    Attributes
    ----------
    value, error
        The integral of each channel, and the quadrature's error, ``(C,)``.
    missed
        The part of the largest channel's integral where the pdf is 0.
    square
        The integral of (largest channel)^2 / pdf, the second moment of the samples.
    """

    value: Array
    error: Array
    missed: float
    square: float
