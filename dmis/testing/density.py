"""The checks that lobes, lights and techniques share: the integral of a pdf, and samples that follow it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.testing.chi_square import Cells, DensityComparison
from dmis.testing.outcome import Fault
from dmis.testing.statistics import z_limit

_CONSTANT = 0.05
"""Spread of observed / expected counts from cell to cell up to which they are called proportional."""
_NORMALISED = 5e-3
"""Difference of an integral from the right one up to which a pdf is called normalised."""


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
        if accepted and spread < _CONSTANT:
            verdict = f"{pdf} is {1 / ratio:.3f} times the density of sample"
        elif abs(integral - 1) < _NORMALISED:
            verdict = f"sample does not follow {pdf}, or picks the wrong side"
        else:
            verdict = f"{pdf} is not the density of sample"
        raise Fault(
            f"{verdict}: {pdf} integrates to {integral:.4f}, and {accepted:.4f} of the directions of sample are "
            f"accepted ({view.place})",
            view.figure(),
        )
    return f"integrals {', '.join(f'{view.comparison.mass:.3f}' for view in views)}"


def check_chi_square(views: Sequence[DensityView], level: float) -> str:
    """Raise a Fault unless the samples follow each pdf; return the p-values."""
    for view in views:
        comparison, pdf = view.comparison, view.pdf_name
        if comparison.p > level:
            continue
        integral = view.integral()
        if min(abs(integral - 1), abs(integral - comparison.accepted)) < _NORMALISED:
            verdict = f"sample does not follow {pdf}, whose integral is right ({integral:.3f}): look at sample first"
        else:
            verdict = f"{pdf} is not the density of sample; its integral is wrong ({integral:.3f}): look at it first"
        ratio, spread = comparison.ratio
        raise Fault(
            f"{verdict}. p = {comparison.p:.1g} ({view.place}); observed / expected is {ratio:.3f} on average, and "
            f"varies by {spread:.3f} from cell to cell",
            view.figure(),
        )
    return f"p = {', '.join(f'{view.comparison.p:.2g}' for view in views)}"
