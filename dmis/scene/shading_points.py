"""Surface points: what a batch of hits looks like to lobes, lights and shadow rays."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from functools import cache, cached_property
from operator import is_
from typing import Any

import numpy as np

from dmis.base.selection import Selection, compose, take
from dmis.base.vectors import Array, dot, frame, normalise
from dmis.brdf.cosines import Pair
from dmis.brdf.lobe import DeltaLobe, Lobe


class Surface:
    """N points on surfaces that share the same kinds of lobes, seen from ``wo``.

    A subset (`take`) gathers an attribute when it is first read: most directions miss the light or face away, and
    the few points that remain rarely need everything.

    Attributes
    ----------
    p
        Positions, pushed off the surface towards wo: where rays that leave on wo's side begin, ``(3, N)``.
    ng, n
        Unit geometric and shading normals, both on wo's side, ``(3, N)``; the same array on flat surfaces.
    wo
        Unit directions to the viewer, ``(3, N)``.
    cos_o
        ``n . wo``, ``(N,)``.
    glossy, through, delta
        Lobes with their parameters bound to these points: those that reflect, those of what comes through (they belong
        to the points seen from `beyond`), and those that are Dirac deltas.
    outside
        Whether wo is on the side that the mesh's winding calls outside, ``(N,)`` bool; read where light is refracted.
    dpdu
        ``(3, N)`` or ``(3, 1)``; read by anisotropic lobes only, None where there are none.
    epsilon
        By how much p is pushed off, ``(N,)`` or one number, see `dmis.scene.scene.Scene.epsilon`.
    """

    p: Array
    ng: Array
    n: Array
    wo: Array
    cos_o: Array
    outside: Array
    dpdu: Array | None
    epsilon: Array | np.float32
    glossy: tuple[Lobe, ...]
    through: tuple[Lobe, ...]
    delta: tuple[DeltaLobe, ...]

    def __init__(self, **attributes: Any) -> None:
        self.__dict__.update(attributes)
        self._parent: Surface | None = None
        self._index: Selection | None = None

    def take(self, index: Selection | None) -> Surface:
        """The points `index`; None means all of them."""
        if index is None:
            return self
        part = Surface()
        part._parent, part._index = self._parent or self, compose(self._index, index)
        return part

    def __getattr__(self, name: str) -> Any:
        """Gather an attribute of a subset the first time that it is read."""
        if name.startswith("_") or self._parent is None:
            raise AttributeError(name)
        if name == "ng" and self._parent.ng is self._parent.n:
            value = self.n
        else:
            value = _gather(getattr(self._parent, name), self._index)
        self.__dict__[name] = value
        return value

    def beyond(self) -> Surface:
        """The same points on the side that wo is not on, where light comes from that passes a rough surface.

        Normals and p are turned to that side, so that ``n . wo`` is negative; the glossy lobes are those of `through`.
        """
        n = -self.n
        return Surface(
            p=self.p - self.ng * (2 * self.epsilon),
            ng=n if self.ng is self.n else -self.ng,
            n=n,
            wo=self.wo,
            cos_o=-self.cos_o,
            outside=self.outside,
            dpdu=self.dpdu,
            epsilon=self.epsilon,
            glossy=self.through,
            through=(),
            delta=(),
        )

    @cached_property
    def tangents(self) -> tuple[Array, Array]:
        """Unit tangents along and across dp/du; any frame where there is none, or it is along n. Each ``(3, N)``."""
        if self.dpdu is None:
            return frame(self.n)
        s = self.dpdu - self.n * dot(self.n, self.dpdu)
        along = np.flatnonzero(dot(s, s) <= np.float32(1e-8) * dot(self.dpdu, self.dpdu))
        if len(along):
            s[:, along] = frame(self.n[:, along])[0]
        s = normalise(s)
        x, y, z = self.n
        t = np.stack([y * s[2] - z * s[1], z * s[0] - x * s[2], x * s[1] - y * s[0]])
        return s, t

    def faces(self, pair: Pair) -> np.ndarray:
        """Whether the pair's wi is on wo's side of the triangles, ``(N,)`` bool."""
        return pair.above if self.ng is self.n else dot(self.ng, pair.wi) > 0

    # The BRDF as a whole: the sum of its lobes, sampled by picking one of them uniformly ------------------------------

    def eval(self, pair: Pair) -> Array:
        """BRDF without the cosine, ``(1, N)``, ``(3, 1)`` or ``(3, N)``; delta lobes excluded."""
        total = self.glossy[0].eval(pair)
        for lobe in self.glossy[1:]:
            total = total + lobe.eval(pair)
        return total

    def pdf(self, pair: Pair) -> Array:
        """Density of `sample` at the pair's wi, ``(N,)``."""
        total = self.glossy[0].pdf(pair)
        for lobe in self.glossy[1:]:
            total = total + lobe.pdf(pair)
        return total * np.float32(1 / len(self.glossy)) if len(self.glossy) > 1 else total

    def sample(self, u: Array) -> Array:
        """Directions ``(3, N)``; ``u[0]`` first picks the lobe and is then stretched back to [0, 1)."""
        count = len(self.glossy)
        if count == 1:
            return self.glossy[0].sample(self, u)
        wi = np.empty_like(self.wo)
        scaled = u[0] * count
        chosen = np.minimum(scaled.astype(np.int8), count - 1)
        stretched = np.stack([np.minimum(scaled - chosen, np.float32(1 - 2**-24)), u[1]])
        for k in range(count):
            index = np.flatnonzero(chosen == k)
            part = self.take(index)
            directions = part._lobe(k).sample(part, stretched.take(index, axis=1))
            for row, values in zip(wi, directions, strict=True):
                row[index] = values
        return wi

    def _lobe(self, k: int) -> Lobe:
        """One of the glossy lobes, without gathering the parameters of the others."""
        if self._parent is None or "glossy" in self.__dict__:
            return self.glossy[k]
        lobe: Lobe = _gather(self._parent.glossy[k], self._index)
        return lobe


def _gather(value: Any, index: Selection | None) -> Any:
    """The points `index` of an array, or of all arrays in a lobe or a tuple of lobes; constants stay as they are."""
    if isinstance(value, np.ndarray):
        return take(value, index)
    if isinstance(value, tuple):
        items = tuple(_gather(item, index) for item in value)
        return value if all(map(is_, items, value)) else items
    changes: dict[str, Any] = {}
    for name in _names(value.__class__):
        old = getattr(value, name)
        if (new := _gather(old, index)) is not old:
            changes[name] = new
    return replace(value, **changes) if changes else value


@cache
def _names(kind: type) -> tuple[str, ...]:
    """Fields of a dataclass; none of what is not one."""
    return tuple(f.name for f in fields(kind)) if is_dataclass(kind) else ()
