"""Lights: plain data with ``sample`` and ``hit``, for batches of receiving points.

``sample(p, u)`` picks directions towards the light, ``hit(p, wi)`` tells what given directions would meet; both return
the same `Seen`, so an estimator treats a light sample and a BRDF sample alike, and pays for a shadow ray only where
`Seen.emits`. Visibility is never tested here. pdfs are per solid angle and belong to ``sample``.

Area lights emit on one side only, as in pbrt: along the normal. Their pdf is positive on both sides, since sampling
does not know which side the receiver is on.

Point, spot and distant lights are deltas: they have no pdf, take no part in MIS, and ``sample`` ignores `u`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from dmis.intersect import Intersector
from dmis.vec import TINY, Array, Index, dot, frame, take
from dmis.warp import TWO_PI, cone_pdf, square_to_cone, square_to_disk, square_to_triangle, to_world

Rgb = tuple[float, float, float]
FAR = np.float32(1e30)


@dataclass(eq=False)
class Seen:
    """What a batch of N directions sees of one light.

    Attributes
    ----------
    wi
        Unit directions towards the light, ``(3, N)``.
    distance
        To the light, ``(N,)``; `FAR` if it is infinitely far away.
    radiance
        ``(3, 1)`` or ``(3, N)``, as if every entry was emitted towards the receiver.
    pdf
        Density of the light's own sampling at wi, ``(N,)``; 0 where wi misses the light. 1 for delta lights.
    emits
        ``(N,)`` bool: wi meets the light's bright side.
    """

    wi: Array
    distance: Array
    radiance: Array
    pdf: Array
    emits: Array

    def radiance_at(self, index: Index | None) -> Array:
        """Radiance along the directions `index`, ``(3, 1)`` or ``(3, K)``."""
        return take(self.radiance, index)


class _SeenSky(Seen):
    """What is seen of an environment; its map is looked up only for the directions that turn out to matter."""

    def __init__(self, light: EnvironmentLight, wi: Array, s: Array, t: Array, pdf: Array) -> None:
        self.wi, self.pdf, self.emits = wi, pdf, pdf > 0
        self.distance = np.full(wi.shape[1], FAR)
        self._light, self._s, self._t = light, s, t

    def radiance_at(self, index: Index | None) -> Array:
        return self._light.lookup(take(self._s, index), take(self._t, index))

    @cached_property
    def radiance(self) -> Array:  # type: ignore[override]
        return self.radiance_at(None)


def _rgb(name: str, value: Rgb) -> Array:
    out = np.asarray(value, np.float32).reshape(-1)
    if out.shape == (1,):
        out = np.repeat(out, 3)
    if out.shape != (3,) or not np.isfinite(out).all() or (out < 0).any():
        raise ValueError(f"{name} must be three finite non-negative numbers (linear RGB); got {value}")
    return out[:, None]


def _point(name: str, value: Rgb) -> Array:
    out = np.asarray(value, np.float64).reshape(-1)
    if out.shape != (3,) or not np.isfinite(out).all():
        raise ValueError(f"{name} must be three finite numbers; got {value}")
    return out.astype(np.float32)[:, None]


def _direction(name: str, value: Rgb) -> Array:
    out = np.asarray(value, np.float64).reshape(-1)
    length = np.linalg.norm(out) if out.shape == (3,) else 0.0
    if not (np.isfinite(length) and length > 0):
        raise ValueError(f"{name} must be a finite vector of non-zero length; got {value}")
    return (out / length).astype(np.float32)[:, None]


def _positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise ValueError(f"{name} must be positive and finite; got {value}")


@dataclass(frozen=True, eq=False)
class DiskLight:
    """A disk that emits along `normal`; sampled uniformly in area."""

    centre: Rgb
    normal: Rgb
    radius: float
    radiance: Rgb
    delta: ClassVar[bool] = False

    def __post_init__(self) -> None:
        _positive("radius", self.radius)
        _ = self._data

    @cached_property
    def _data(self) -> tuple[Array, Array, Array, Array, Array]:
        normal = _direction("normal", self.normal)
        s, t = (a * np.float32(self.radius) for a in frame(normal))
        return _point("centre", self.centre), normal, s, t, _rgb("radiance", self.radiance)

    def sample(self, p: Array, u: Array) -> Seen:
        """Directions from the points `p` ``(3, N)`` to points on the disk, `u` ``(2, N)``."""
        centre, normal, s, t, radiance = self._data
        x, y = square_to_disk(u)
        return _aim(centre - p + s * x + t * y, normal, np.pi * self.radius**2, radiance)

    def hit(self, p: Array, wi: Array) -> Seen:
        """What unit directions `wi` ``(3, N)`` from `p` see of the disk."""
        centre, normal, _, _, radiance = self._data
        distance, cos, q = _meet(p - centre, wi, normal)
        inside = (distance > 0) & (dot(q, q) < np.float32(self.radius**2))
        return _met(wi, distance, cos, inside, np.pi * self.radius**2, radiance)


@dataclass(frozen=True, eq=False)
class QuadLight:
    """A parallelogram ``corner + a edge_u + b edge_v`` that emits along ``edge_u x edge_v``."""

    corner: Rgb
    edge_u: Rgb
    edge_v: Rgb
    radiance: Rgb
    delta: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if self._data[4] == 0:
            raise ValueError(f"edge_u and edge_v must not be parallel; got {self.edge_u} and {self.edge_v}")

    @cached_property
    def _data(self) -> tuple[Array, Array, Array, Array, float, Array]:
        u, v = np.asarray(self.edge_u, float), np.asarray(self.edge_v, float)
        cross = np.cross(u, v)
        area = float(np.linalg.norm(cross))
        normal = (cross / max(area, 1e-300)).astype(np.float32)[:, None]
        corner, edges = _point("corner", self.corner), [_point("edge", e) for e in (self.edge_u, self.edge_v)]
        return corner, edges[0], edges[1], normal, area, _rgb("radiance", self.radiance)

    @cached_property
    def _dual(self) -> tuple[Array, Array]:
        """Vectors whose dot products with a point of the plane are its coordinates along the edges."""
        edges = np.array([self.edge_u, self.edge_v], float)
        a, b = np.linalg.solve(edges @ edges.T, edges).astype(np.float32)
        return a[:, None], b[:, None]

    def sample(self, p: Array, u: Array) -> Seen:
        """Directions from the points `p` ``(3, N)`` to points on the quad, `u` ``(2, N)``."""
        corner, edge_u, edge_v, normal, area, radiance = self._data
        return _aim(corner - p + edge_u * u[0] + edge_v * u[1], normal, area, radiance)

    def hit(self, p: Array, wi: Array) -> Seen:
        """What unit directions `wi` ``(3, N)`` from `p` see of the quad."""
        corner, _, _, normal, area, radiance = self._data
        distance, cos, q = _meet(p - corner, wi, normal)
        a, b = dot(self._dual[0], q), dot(self._dual[1], q)
        inside = (distance > 0) & (a >= 0) & (a <= 1) & (b >= 0) & (b <= 1)
        return _met(wi, distance, cos, inside, area, radiance)


@dataclass(frozen=True, eq=False)
class SphereLight:
    """A sphere that emits outwards; sampled uniformly in the cone it subtends. Receivers inside it see nothing."""

    centre: Rgb
    radius: float
    radiance: Rgb
    delta: ClassVar[bool] = False

    def __post_init__(self) -> None:
        _positive("radius", self.radius)
        _ = self._data

    @cached_property
    def _data(self) -> tuple[Array, Array]:
        return _point("centre", self.centre), _rgb("radiance", self.radiance)

    def sample(self, p: Array, u: Array) -> Seen:
        """Directions from the points `p` ``(3, N)`` in the cone of the sphere, `u` ``(2, N)``."""
        to, distance2, one_minus_cos, outside = self._cone(p)
        axis = to * (1 / np.sqrt(distance2))
        wi = to_world(square_to_cone(u, one_minus_cos), axis)
        return self._seen(wi, to, distance2, one_minus_cos, outside, outside)

    def hit(self, p: Array, wi: Array) -> Seen:
        """What unit directions `wi` ``(3, N)`` from `p` see of the sphere."""
        to, distance2, one_minus_cos, outside = self._cone(p)
        along = dot(to, wi)
        across = to - wi * along  # |to|^2 - along^2 would cancel for a far light
        inside = outside & (along > 0) & (dot(across, across) < np.float32(self.radius**2))
        return self._seen(wi, to, distance2, one_minus_cos, inside, outside)

    def _cone(self, p: Array) -> tuple[Array, Array, Array, Array]:
        to = self._data[0] - p
        distance2 = np.maximum(dot(to, to), TINY)
        sin2 = np.float32(self.radius**2) / distance2
        one_minus_cos = sin2 / (1 + np.sqrt(np.maximum(1 - sin2, 0)))
        return to, distance2, one_minus_cos, sin2 < 1

    def _seen(self, wi: Array, to: Array, distance2: Array, cone: Array, met: Array, outside: Array) -> Seen:
        along = dot(to, wi)
        across = to - wi * along
        chord2 = np.maximum(np.float32(self.radius**2) - dot(across, across), 0)
        return Seen(wi, along - np.sqrt(chord2), self._data[1], cone_pdf(cone) * met, met)


@dataclass(frozen=True, eq=False)
class MeshLight:
    """Triangles that emit along their winding's normal; sampled uniformly in area.

    Directions are tested against the light's own triangles by an Embree scene of their own.
    """

    vertices: Array
    faces: Array
    radiance: Rgb
    delta: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if not self._data[4] > 0:
            raise ValueError("a mesh light must have a positive area; all its triangles are degenerate")

    @cached_property
    def _data(self) -> tuple[Array, Array, Array, Array, float, Array]:
        triangles = np.asarray(self.vertices, float)[np.asarray(self.faces)]
        corner, edge_u = triangles[:, 0], triangles[:, 1] - triangles[:, 0]
        edge_v = triangles[:, 2] - triangles[:, 0]
        cross = np.cross(edge_u, edge_v)
        twice = np.linalg.norm(cross, axis=1)
        normal = cross / np.maximum(twice, 1e-300)[:, None]
        rows = np.concatenate([corner, edge_u, edge_v, normal], axis=1).T.astype(np.float32)
        cdf = np.cumsum(twice)
        area = float(cdf[-1] / 2)
        return rows, normal, cdf / max(cdf[-1], 1e-300), twice, area, _rgb("radiance", self.radiance)

    @cached_property
    def _intersector(self) -> Intersector:
        return Intersector(self.vertices, self.faces)

    def __getstate__(self) -> dict[str, object]:
        return {k: v for k, v in self.__dict__.items() if k != "_intersector"}

    def sample(self, p: Array, u: Array) -> Seen:
        """Directions from the points `p` ``(3, N)`` to points on the triangles, `u` ``(2, N)``."""
        rows, _, cdf, _, area, radiance = self._data
        index = np.minimum(np.searchsorted(cdf, u[0], side="right"), len(cdf) - 1)
        low = np.where(index > 0, cdf.take(index - 1), 0)
        within = ((u[0] - low) / np.maximum(cdf.take(index) - low, 1e-30)).astype(np.float32)
        a, b = square_to_triangle(np.stack([np.clip(within, 0, 1), u[1]]))
        chosen = rows.take(index, axis=1)
        return _aim(chosen[:3] - p + chosen[3:6] * a + chosen[6:9] * b, chosen[9:], area, radiance)

    def hit(self, p: Array, wi: Array) -> Seen:
        """What unit directions `wi` ``(3, N)`` from `p` see of the triangles: the nearest one."""
        rows, _, _, _, area, radiance = self._data
        hits = self._intersector.closest(p, wi)
        met = hits.prim >= 0
        chosen = rows.take(np.maximum(hits.prim, 0), axis=1)
        return _met(wi, hits.distance, dot(chosen[9:], wi), met, area, radiance)


@dataclass(frozen=True, eq=False)
class EnvironmentLight:
    """Light from infinitely far away, from a latitude-longitude map.

    Parameters
    ----------
    texels
        ``(H, W, 3)`` linear radiance; row 0 is +z, column 0 begins at azimuth 0 (the +x axis), bilinear in between.
    to_world
        3x3 rotation from the map's frame to the world.
    scale
        RGB factor.

    Notes
    -----
    Directions are sampled from a piecewise-constant density over texels, proportional to the mean luminance of the
    bilinear interpolant in the texel (its 1/8, 3/4, 1/8 stencil in both directions) times sin(theta): it is positive
    wherever the radiance is. ``p(wi) = p(u, v) / (2 pi^2 sin theta)``.
    """

    texels: Array
    to_world: Array | None = None
    scale: Rgb = (1.0, 1.0, 1.0)
    delta: ClassVar[bool] = False

    def __post_init__(self) -> None:
        texels = np.asarray(self.texels, np.float32)
        if texels.ndim != 3 or texels.shape[2] != 3 or texels.size == 0:
            raise ValueError(f"texels must have shape (H, W, 3); got {texels.shape}")
        if not np.isfinite(texels).all() or (texels < 0).any():
            raise ValueError("texels must be finite and not negative, because they are radiance")
        _ = self._data, self._distribution, self._guide

    @cached_property
    def _data(self) -> tuple[Array, Array]:
        """Texels ``(3, H * W)``, scaled; rotation from the map to the world."""
        texels = np.asarray(self.texels, np.float32) * _rgb("scale", self.scale)[:, 0]
        rotation = np.eye(3) if self.to_world is None else np.asarray(self.to_world, float)
        if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4):
            raise ValueError(f"to_world must be a 3x3 rotation (or reflection); got {rotation.tolist()}")
        return np.ascontiguousarray(texels.reshape(-1, 3).T), rotation.astype(np.float32)

    @cached_property
    def _distribution(self) -> tuple[Array, Array]:
        """Cumulative probability over texels in row order ``(H * W,)`` float64; texel densities over (u, v)."""
        height, width, _ = self.texels.shape
        luminance = np.array([0.212671, 0.715160, 0.072169]) @ self._data[0].astype(float)
        luminance = luminance.reshape(height, width)
        around = np.pad(luminance, ((0, 0), (1, 1)), mode="wrap")
        luminance = (around[:, :-2] + 6 * around[:, 1:-1] + around[:, 2:]) / 8
        around = np.pad(luminance, ((1, 1), (0, 0)), mode="wrap")
        luminance = (around[:-2] + 6 * around[1:-1] + around[2:]) / 8
        weight = luminance * np.sin((np.arange(height) + 0.5) * np.pi / height)[:, None]
        total = weight.sum()
        if not total > 0:
            weight, total = np.ones_like(weight), float(weight.size)
        return np.cumsum(weight.reshape(-1) / total), (weight / total * weight.size).astype(np.float32).reshape(-1)

    def sample(self, p: Array, u: Array) -> Seen:
        """Directions towards bright texels, `u` ``(2, N)``; `p` only matters for its shape."""
        height, width, _ = self.texels.shape
        cdf, density = self._distribution
        u0 = u[0].astype(np.float64)
        texel = self._texel(u0)
        low = np.where(texel > 0, cdf.take(texel - 1), 0)
        within = np.clip((u0 - low) / np.maximum(cdf.take(texel) - low, 1e-300), 0, 1).astype(np.float32)
        row = texel // width
        s = ((texel - row * width).astype(np.float32) + within) * np.float32(1 / width)
        t = (row.astype(np.float32) + u[1]) * np.float32(1 / height)
        phi, theta = TWO_PI * s, np.float32(np.pi) * t
        sin = np.sin(theta)
        local = np.stack([sin * np.cos(phi), sin * np.sin(phi), np.cos(theta)])
        pdf = density.take(texel) / (np.float32(2 * np.pi**2) * np.maximum(sin, np.float32(1e-9)))
        return _SeenSky(self, self._data[1] @ local, s, t, pdf)

    @cached_property
    def _guide(self) -> np.ndarray:
        """Where the search for u may begin: the texel of ``k / n`` for k = 0 ... n - 1, with n texels."""
        cdf = self._distribution[0]
        return np.minimum(np.searchsorted(cdf, np.arange(len(cdf)) / len(cdf), side="right"), len(cdf) - 1)

    def _texel(self, u: Array) -> np.ndarray:
        """The first texel whose cumulative probability exceeds `u` ``(N,)``: what a binary search would find.

        A guide table (Chen and Asau 1974) is within a texel or two of it most of the time, at a fraction of the cost.
        """
        cdf = self._distribution[0]
        last = len(cdf) - 1
        texel = self._guide.take((u * len(cdf)).astype(np.int64))
        behind = np.flatnonzero(cdf.take(texel) <= u)
        for _ in range(3):
            texel[behind] = np.minimum(texel[behind] + 1, last)
            behind = behind[cdf.take(texel.take(behind)) <= u.take(behind)]
        texel[behind] = np.searchsorted(cdf, u.take(behind), side="right")
        return np.minimum(texel, last)

    def hit(self, p: Array, wi: Array) -> Seen:
        """What unit directions `wi` ``(3, N)`` see of the sky: every one sees something."""
        height, width, _ = self.texels.shape
        s, t, sin = self._coordinates(wi)
        column = np.minimum((s * width).astype(np.int32), width - 1)
        row = np.minimum((t * height).astype(np.int32), height - 1)
        density = self._distribution[1].take(row * width + column)
        pdf = density / (np.float32(2 * np.pi**2) * np.maximum(sin, np.float32(1e-9)))
        return _SeenSky(self, wi, s, t, pdf)

    def radiance(self, wi: Array) -> Array:
        """Radiance ``(3, N)`` from unit directions `wi` ``(3, N)``."""
        s, t, _ = self._coordinates(wi)
        return self.lookup(s, t)

    def _coordinates(self, wi: Array) -> tuple[Array, Array, Array]:
        """Map coordinates s, t in [0, 1) and sin(theta)."""
        x, y, z = self._data[1].T @ wi
        sin = np.sqrt(x * x + y * y)
        s = np.arctan2(y, x) / TWO_PI
        s = s - np.floor(s)
        return s, np.arctan2(sin, z) / np.float32(np.pi), sin

    def lookup(self, s: Array, t: Array) -> Array:
        """Bilinear radiance ``(3, N)`` at map coordinates `s`, `t` in [0, 1], each ``(N,)``."""
        height, width, _ = self.texels.shape
        texels = self._data[0]
        x, y = s * width - np.float32(0.5), t * height - np.float32(0.5)
        j, i = np.floor(x), np.floor(y)
        fx, fy = x - j, y - i
        j0, i0 = j.astype(np.int32), i.astype(np.int32)
        j1, i1 = j0 + 1, i0 + 1
        j0, j1 = j0 + width * (j0 < 0), j1 - width * (j1 >= width)
        i0, i1 = (i0 + height * (i0 < 0)) * width, (i1 - height * (i1 >= height)) * width
        gx, gy = 1 - fx, 1 - fy
        out = texels.take(i0 + j0, axis=1) * (gx * gy)
        out += texels.take(i0 + j1, axis=1) * (fx * gy)
        out += texels.take(i1 + j0, axis=1) * (gx * fy)
        out += texels.take(i1 + j1, axis=1) * (fx * fy)
        return out


@dataclass(frozen=True, eq=False)
class PointLight:
    """A point that emits `intensity` (power per solid angle) equally in all directions."""

    position: Rgb
    intensity: Rgb
    delta: ClassVar[bool] = True

    def __post_init__(self) -> None:
        _ = self._data

    @cached_property
    def _data(self) -> tuple[Array, Array]:
        return _point("position", self.position), _rgb("intensity", self.intensity)

    def sample(self, p: Array, u: Array | None = None) -> Seen:
        """The direction of the light from the points `p` ``(3, N)``."""
        position, intensity = self._data
        to = position - p
        inverse2 = 1 / np.maximum(dot(to, to), TINY)
        inverse = np.sqrt(inverse2)
        one = np.ones_like(inverse)
        return Seen(to * inverse, 1 / inverse, intensity * inverse2, one, one > 0)


@dataclass(frozen=True, eq=False)
class SpotLight:
    """A point light that shines along `direction`, full inside `inner`, dark outside `outer` (half angles, degrees).

    In between the falloff is ``d^4``, d linear in the cosine, as in pbrt.
    """

    position: Rgb
    direction: Rgb
    intensity: Rgb
    outer: float = 30.0
    inner: float = 25.0
    delta: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not 0 <= self.inner <= self.outer <= 180:
            raise ValueError(f"need 0 <= inner <= outer <= 180 degrees; got inner {self.inner}, outer {self.outer}")
        _ = self._data

    @cached_property
    def _data(self) -> tuple[Array, Array, Array, np.float32, np.float32]:
        outer, inner = (np.float32(np.cos(np.radians(a))) for a in (self.outer, self.inner))
        direction = _direction("direction", self.direction)
        return _point("position", self.position), direction, _rgb("intensity", self.intensity), outer, inner

    def sample(self, p: Array, u: Array | None = None) -> Seen:
        """The direction of the light from the points `p` ``(3, N)``."""
        position, direction, intensity, outer, inner = self._data
        to = position - p
        inverse2 = 1 / np.maximum(dot(to, to), TINY)
        inverse = np.sqrt(inverse2)
        cos = -dot(direction, to) * inverse
        d = np.clip((cos - outer) / max(inner - outer, np.float32(1e-12)), 0, 1)
        radiance = intensity * (inverse2 * (d * d) ** 2)
        return Seen(to * inverse, 1 / inverse, radiance, np.ones_like(inverse), cos > outer)


@dataclass(frozen=True, eq=False)
class DistantLight:
    """Parallel light from one direction; `direction` points towards the light."""

    direction: Rgb
    radiance: Rgb
    delta: ClassVar[bool] = True

    def __post_init__(self) -> None:
        _ = self._data

    @cached_property
    def _data(self) -> tuple[Array, Array]:
        return _direction("direction", self.direction), _rgb("radiance", self.radiance)

    def sample(self, p: Array, u: Array | None = None) -> Seen:
        """The direction of the light, the same ``(3, 1)`` for all points `p` ``(3, N)``."""
        direction, radiance = self._data
        one = np.ones(p.shape[1], np.float32)
        return Seen(np.repeat(direction, p.shape[1], axis=1), one * FAR, radiance, one, one > 0)


AreaLight = DiskLight | QuadLight | SphereLight | MeshLight
DeltaLight = PointLight | SpotLight | DistantLight
Light = AreaLight | EnvironmentLight | DeltaLight


def _aim(to: Array, normal: Array, area: float, radiance: Array) -> Seen:
    """What is seen of a flat light along `to`, a point on it minus the receiver; density ``d^2 / (area |cos|)``."""
    distance2 = np.maximum(dot(to, to), TINY)
    inverse = 1 / np.sqrt(distance2)
    cos = -dot(normal, to) * inverse
    pdf = distance2 / (np.float32(area) * np.maximum(np.abs(cos), np.float32(1e-12)))
    return Seen(to * inverse, distance2 * inverse, radiance, pdf, cos > 0)


def _meet(p: Array, wi: Array, normal: Array) -> tuple[Array, Array, Array]:
    """Where rays from `p` (relative to a point of the plane) meet a plane: distance, normal . wi, relative point."""
    cos = dot(normal, wi)
    cos = np.copysign(np.maximum(np.abs(cos), np.float32(1e-12)), cos)
    distance = dot(normal, p) / -cos
    return distance, cos, wi * distance + p


def _met(wi: Array, distance: Array, cos: Array, met: Array, area: float, radiance: Array) -> Seen:
    """What is seen of a flat light that is met (or not) at `distance`; `cos` = normal . wi."""
    pdf = distance * distance / (np.float32(area) * np.maximum(np.abs(cos), np.float32(1e-12))) * met
    return Seen(wi, distance, radiance, pdf, met & (cos < 0))
