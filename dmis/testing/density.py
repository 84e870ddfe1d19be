"""The checks that lobes, lights and techniques share: the integral of a pdf, and samples that follow it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.testing.chi_square import Cells, Density, DensityComparison
from dmis.testing.outcome import Fault
from dmis.testing.statistics import chi2_p, z_limit

_CONSTANT = 0.05
"""Spread of observed / expected counts from cell to cell up to which they are called proportional."""
_NORMALISED = 5e-3
"""Difference of an integral from the right one up to which a pdf is called normalised."""
_LEAST_P = 1e-3
"""Least p-value of samples that are said to follow a density."""
_FEW = 50
"""Least number of accepted samples that are compared with a density."""
_ALIKE = 0.02
"""Part of the directions by which two densities may differ and still are called the same."""


class DensityView:
    """Samples of a function, and their pdf, in one place.

    Attributes
    ----------
    pdf_name
        The pdf in messages.
    title
        Of figures.
    """

    pdf_name = "pdf"
    title = ""

    @property
    def place(self) -> str:
        """The place, for messages."""
        raise NotImplementedError

    @property
    def comparison(self) -> DensityComparison:
        """The samples beside their pdf."""
        raise NotImplementedError

    def pdf(self, w: Array) -> Array:
        """Return the pdf of directions ``(3, M)``, ``(M,)``."""
        raise NotImplementedError

    def laws(self) -> dict[str, Density]:
        """Return densities of any scale that a right `sample` may follow, by name, the likeliest first."""
        return {}

    def integral(self) -> float:
        """Return the integral of the pdf; by cells of its own where those of the samples do not resolve it."""
        if self.comparison.mass_error < _NORMALISED:
            return self.comparison.mass
        nodes = self.comparison.cells.nodes
        axis = nodes[:, int(np.argmax(self.pdf(nodes)))].astype(float)
        rings = np.concatenate([[0.0], np.geomspace(1e-4, np.pi, 48)])
        cells = Cells(axis / np.linalg.norm(axis), rings, np.linspace(0, 2 * np.pi, 13), 24)
        return float(cells.integrate(self.pdf(cells.nodes))[0].sum())

    def figure(self) -> Callable[[], Any]:
        """Return what makes the picture of the comparison."""
        return lambda: self.comparison.figure(f"{self.title}: sample and {self.pdf_name}, {self.place}")


def check_mass(views: Sequence[DensityView], level: float) -> str:
    """Raise a Fault unless each pdf integrates to the share of samples that is accepted; return the integrals."""
    for view in views:
        comparison, pdf = view.comparison, view.pdf_name
        if comparison.mass_agrees(z_limit(level)):
            continue
        integral, accepted = view.integral(), comparison.accepted
        ratio, spread = comparison.ratio
        constant = ratio > 0 and spread < _CONSTANT
        verdict = f"{pdf} is {1 / ratio:.3f} times the density of sample" if constant else _verdict(view, integral)
        raise Fault(
            f"{verdict}: {pdf} integrates to {integral:.4f}, and {accepted:.4f} of the directions of "
            f"sample are accepted ({view.place})",
            view.figure(),
        )
    return f"integrals {', '.join(f'{view.comparison.mass:.3f}' for view in views)}"


def check_chi_square(views: Sequence[DensityView], level: float) -> str:
    """Raise a Fault unless the samples follow each pdf; return the p-values."""
    for view in views:
        comparison = view.comparison
        if comparison.p > level:
            continue
        integral = view.integral()
        ratio, spread = comparison.ratio
        raise Fault(
            f"{_verdict(view, integral)}. The integral of {view.pdf_name} is {integral:.3f}, p = {comparison.p:.1g} "
            f"({view.place}); observed / expected is {ratio:.3f} on average, and varies by {spread:.3f} from cell to "
            f"cell",
            view.figure(),
        )
    return f"p = {', '.join(f'{view.comparison.p:.2g}' for view in views)}"


def _verdict(view: DensityView, integral: float) -> str:
    """Return which function is wrong of samples and a pdf that disagree, or that either may be."""
    comparison, pdf = view.comparison, view.pdf_name
    if min(abs(integral - 1), abs(integral - comparison.accepted)) > _NORMALISED:
        return f"{pdf} is not the density of sample; its integral is wrong: look at {pdf} first"
    observed, expected = comparison.observed.sum(), comparison.expected.sum()
    for name, law in view.laws().items():
        mass, error = comparison.cells.integrate(law(comparison.cells.nodes))
        if not mass.sum():
            continue
        empty = mass == 0
        if comparison.expected[empty].sum() > _ALIKE * expected and not comparison.observed[empty].any():
            return f"{pdf} is not the density of sample: it is not 0 where {name} is 0, so look at {pdf} first"
        scale = observed / mass.sum()
        if observed >= _FEW and chi2_p(comparison.observed, mass * scale, (error * scale) ** 2) > _LEAST_P:
            return f"{pdf} is not the density of sample: sample follows {name}, so look at {pdf} first"
        # half of the sum of |a - b| is the part of the directions in which two densities differ
        difference = np.abs(mass / mass.sum() - comparison.expected / max(expected, 1e-30)).sum() / 2
        if difference < _ALIKE:
            return f"sample does not follow {pdf}, which is {name} with the right integral: look at sample first"
    return f"sample does not follow {pdf}, whose integral is right: either may be wrong"
