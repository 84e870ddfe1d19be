"""Selection of one of many lights: a composite that is sampled, and met by rays, as a single light is.

The density of a light sample is that of the piece times the probability of its selection, ``p_l = P(piece) p(wi)``,
and a BRDF sample that meets any piece looks the same product up. So for the estimator there is one light, with one
light sample and one BRDF sample, in place of n of each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dmis.base.vectors import Array, Index
from dmis.light.light import SampledLight
from dmis.light.light_sample import LightSample
from dmis.light.pieces import Pieces
from dmis.light.tree import TreeSelection


class FixedSelection:
    """Selection of pieces with the same probabilities everywhere, in proportion to `weights` ``(F,)``."""

    def __init__(self, weights: Array) -> None:
        self._edges = np.concatenate([[0.0], np.cumsum(weights / weights.sum())])
        self._share = np.diff(self._edges)

    def select(self, p: Array, ng: Array | None, u: Array) -> tuple[Index, Array, Array]:
        """Select a piece for each of the points, here by the inverse of the cumulative shares.

        Parameters
        ----------
        p, ng
            Receiving points and unit normals, ``(3, N)``; no normals: light from both sides counts.
        u
            Uniform numbers, ``(N,)`` float64.

        Returns
        -------
        piece
            Numbers of the pieces, ``(N,)``.
        probability
            Their probabilities, ``(N,)``; 0 where no piece can give light.
        rest
            Uniform numbers again, ``(N,)``: where `u` is in the interval that stands for the piece.
        """
        piece = np.minimum(np.searchsorted(self._edges[1:], u, side="right"), len(self._share) - 1)
        share = self._share.take(piece)
        return piece, share, (u - self._edges.take(piece)) / np.maximum(share, 1e-300)

    def probability(self, p: Array, ng: Array | None, piece: Index) -> Array:
        """Return the probabilities of given pieces ``(N,)`` for the points `p`, ``(N,)``."""
        return self._share.take(piece)


SELECTIONS: dict[str, Callable[[Pieces], FixedSelection | TreeSelection]] = {
    "even": lambda pieces: FixedSelection(pieces.area / np.bincount(pieces.light, pieces.area).take(pieces.light)),
    "power": lambda pieces: FixedSelection(pieces.intensity * (1 + pieces.two_sided)),
    "tree": TreeSelection,
}
"""Selections by the name of their option: all lights equal, by area within each; by power; by nodes of a tree."""


def select_lights(name: str, lights: Sequence[Pieces]) -> SelectedLights:
    """Return the light that stands for several, of these pieces, with a selection by its name in `SELECTIONS`."""
    pieces = Pieces.joined(lights)
    return SelectedLights(pieces, SELECTIONS[name](pieces))


@dataclass(frozen=True, eq=False)
class SelectedLights(SampledLight):
    """Many lights as one: each light sample is of the piece that a selection picks, a ray may meet any.

    Attributes
    ----------
    pieces
        What the lights consist of.
    selection
        Probabilities of the pieces.
    ng
        Unit normals of the receiving points, ``(3, N)``, set by `seen_from`; None: unknown.
    """

    pieces: Pieces
    selection: FixedSelection | TreeSelection
    ng: Array | None = None
    needs_normals: ClassVar[bool] = True

    def seen_from(self, ng: Array) -> SelectedLights:
        """Return the light for points of unit normals `ng` ``(3, N)``."""
        return replace(self, ng=ng)

    def sample(self, p: Array, u: Array) -> LightSample:
        """Sample directions from the points `p` ``(3, N)``, `u` ``(2, N)``: the first number selects the piece."""
        # float32 numbers are 2^-24 apart, wider than the shares of many pieces: the second number fills the gaps
        first = u[0].astype(np.float64) + u[1].astype(np.float64) * 2.0**-24
        piece, probability, rest = self.selection.select(p, self.ng, first)
        within = np.stack([np.clip(rest, 0, 1 - 2.0**-24).astype(np.float32), u[1]])
        light_sample = self.pieces.sample(piece, p, within)
        light_sample.pdf *= probability.astype(np.float32)
        light_sample.emits &= probability > 0
        return light_sample

    def hit(self, p: Array, wi: Array) -> LightSample:
        """Return what unit directions `wi` ``(3, N)`` from `p` see: the nearest piece."""
        light_sample, index, piece = self.pieces.hit(p, wi)
        ng = None if self.ng is None else self.ng[:, index]
        light_sample.pdf[index] *= self.selection.probability(p[:, index], ng, piece).astype(np.float32)
        return light_sample
