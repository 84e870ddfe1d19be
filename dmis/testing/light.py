"""Checks of a light: `sample` against the pdf of `hit`, its visible surface, irradiance, finite values, and renders.

A light is seen from receivers: an infinite one from the origin, an area light from two points before the bright side
of its mesh and from one behind it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dmis.base.vectors import Array, dot, frame, normalise
from dmis.brdf.materials import Material, matte
from dmis.formats.load_scene import light_part
from dmis.geometry.mesh import Mesh
from dmis.geometry.shapes import quad
from dmis.intersect import Intersector
from dmis.light.light import AreaLight, InfiniteLight, Light, check_light_form
from dmis.light.light_sample import LightSample
from dmis.samplers.warp import square_to_sphere
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.scene import Scene
from dmis.testing.chi_square import DensityComparison, compare_directions, integrate_finely
from dmis.testing.density import DensityView, check_chi_square, check_mass
from dmis.testing.outcome import Fault, Outcome, run_checks
from dmis.testing.scenes import compare_means
from dmis.testing.sphere import columns, uniforms, unit
from dmis.testing.statistics import level, z_limit

COUNT = 2**16
LEVEL = level(16)
"""Of each test: chi-square, integral and irradiance for up to three receivers, and renders."""
LIMIT = z_limit(LEVEL)
_OUTLINE = 0.97
"""Share of directions in which the mesh and `hit` must agree: at outlines, and of a tessellated sphere, they do not."""
_ROUNDED = 0.995
"""Share of sampled directions in which `hit` must agree with `sample`: rounding decides at outlines."""


def check_light(light: Light, name: str = "") -> list[Outcome]:
    """Check a light by what `dmis.light.light` promises.

    Parameters
    ----------
    light
        An area light with a mesh, an infinite light, or a Dirac delta.
    name
        For messages. Default: that of the class.

    Returns
    -------
    list of Outcome
        One for each check. A right light fails any of them with a probability of 1e-4; a pdf that is 7 % off fails.
    """
    name = name or type(light).__name__
    form = run_checks(name, [("methods and forms of light samples", lambda: _check_form(light))])
    if not form[0].passed:
        return form
    if light.delta:
        return form + run_checks(name, [("values are finite", lambda: _check_finite(light))])
    views = [LightView(light, p, side, seed) for seed, (p, side) in enumerate(receivers(light), 1)]
    bright = [view for view in views if view.bright]
    checks: list[tuple[str, Callable[[], Outcome | str]]] = [
        ("values are finite and not negative", lambda: _check_finite(light)),
        ("hit has bright side, outline and distance of mesh", lambda: _check_mesh(views)),
        ("sample and hit agree", lambda: _check_hit(views)),
        ("pdf of hit integrates to its accepted mass", lambda: check_mass(bright, LEVEL)),
        ("sample follows the pdf of hit (chi-square)", lambda: check_chi_square(bright, LEVEL)),
        ("samples have the integral of the radiance of hit", lambda: _check_irradiance(bright)),
        ("hit has the radiance of emission or radiance, at most brightness", lambda: _check_radiance(bright)),
        ("renders by fixed:0, fixed:1 and balance agree", lambda: _check_renders(light)),
    ]
    return form + run_checks(name, checks)


def receivers(light: Any) -> list[tuple[Array, bool]]:
    """Return points ``(3,)`` from which a light is looked at, and whether they see its bright side."""
    if light.infinite:
        return [(np.zeros(3), True)]
    mesh = light.mesh()
    centre, normal, size = placement(mesh)
    s, t = (a[:, 0].astype(float) for a in frame(normal.astype(np.float32)[:, None]))
    return [
        (centre + size * (1.1 * normal + 0.2 * s + 0.1 * t), True),
        (centre + size * (0.5 * normal - 0.6 * s + 0.3 * t), True),
        (centre - size * (1.3 * normal + 0.3 * s - 0.2 * t), False),
    ]


def placement(mesh: Mesh) -> tuple[Array, Array, float]:
    """Return the middle of the largest triangle of a mesh, its normal, both ``(3,)``, and the mesh's diagonal."""
    corners = np.asarray(mesh.vertices, float)[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    k = int(np.linalg.norm(cross, axis=1).argmax())
    low, high = mesh.bounds
    return corners[k].mean(axis=0), unit(*cross[k]), float(np.linalg.norm(np.subtract(high, low)))


@dataclass(frozen=True, eq=False)
class LightView(DensityView):
    """A light seen from one receiver: samples and quadrature, computed once for all checks.

    Attributes
    ----------
    p
        The receiver, ``(3,)``.
    bright
        Whether it is before the bright side.
    seed
        Of the samples.
    """

    light: Any
    p: Array
    bright: bool = True
    seed: int = 1
    pdf_name = "the pdf of hit"

    @property
    def title(self) -> str:  # type: ignore[override]
        """The light, for figures."""
        return type(self.light).__name__

    @property
    def place(self) -> str:
        """The receiver, for messages."""
        return f"seen from ({', '.join(f'{x:.3g}' for x in self.p)})"

    def points(self, count: int) -> Array:
        """Return the receiver ``(3, count)``."""
        return columns(self.p, count)

    @cached_property
    def sample(self) -> LightSample:
        """Light samples, ``COUNT``, independent of those of other receivers."""
        return self.light.sample(self.points(COUNT), uniforms(COUNT, self.seed))

    @cached_property
    def again(self) -> LightSample:
        """What `hit` says of their directions."""
        return self.hit(self.sample.wi)

    def hit(self, w: Array) -> LightSample:
        """Return the light samples of directions ``(3, M)``."""
        return self.light.hit(self.points(w.shape[1]), w)

    def pdf(self, w: Array) -> Array:
        """Return the density of directions ``(3, M)`` that meet the bright side, else 0."""
        hit = self.hit(w)
        return np.where(hit.emits, hit.pdf, 0)

    def radiance(self, w: Array) -> Array:
        """Return the largest channel of the radiance from directions ``(3, M)``, 0 where they miss the bright side."""
        hit = self.hit(w)
        return np.where(hit.emits, np.broadcast_to(hit.radiance, w.shape).max(axis=0), 0)

    @cached_property
    def comparison(self) -> DensityComparison:
        """Samples that meet the bright side, against the pdf of `hit`."""
        return compare_directions(self.sample.wi, self.pdf, accepted=self.sample.emits)


def _check_form(light: Light) -> str:
    """Return a message if a light's methods return the right forms; raise a Fault if they do not."""
    try:
        check_light_form(light)
    except ValueError as error:
        raise Fault(str(error)) from error
    if not light.delta and not light.infinite and light.mesh() is None:
        raise Fault("mesh() must return the visible surface, a dmis.Mesh: the camera sees it, and the check needs it")
    return "methods and shapes are right"


def _check_finite(light: Any) -> str:
    """Raise a Fault if a value is not finite or is negative: at corners of u, on the light, and far away."""
    edge = np.float32(1 - 2**-24)
    u = np.array([[0, 0, edge, edge, 0.5, 0.5], [0, edge, 0, edge, 0, edge]], np.float32)
    mesh = None if light.delta else light.mesh()
    points = {"at the origin": np.zeros(3), "1000 away": np.array([600.0, 0.0, 800.0])}
    if mesh is not None:
        centre, normal, size = placement(mesh)
        s = frame(normal.astype(np.float32)[:, None])[0][:, 0]
        points = {"on the light": centre, "in its plane": centre + 2 * size * s, "far": centre + 1e3 * size * normal}
    w = np.concatenate([square_to_sphere(uniforms(256)), columns((0, 0, 1)), columns((1, 0, 0))], axis=1)
    for place, p in points.items():
        sample = light.sample(columns(p, 6)) if light.delta else light.sample(columns(p, 6), u)
        _check_fields("sample", sample, place)
        if not light.delta:
            _check_fields("hit", light.hit(columns(p, w.shape[1]), w), place)
    return f"receivers {', '.join(points)}"


def _check_fields(function: str, sample: LightSample, place: str) -> None:
    """Raise a Fault if a field of a light sample has a value that no renderer can use."""
    for field in ("wi", "distance", "radiance", "pdf"):
        values = np.asarray(getattr(sample, field))
        bad = ~np.isfinite(values) if field in ("wi", "distance") else ~(values >= 0)
        if bad.any():
            raise Fault(f"{function}: {field} is {values[bad][0]:g} for a receiver {place}")
    length = np.sqrt(dot(sample.wi, sample.wi))[sample.emits]
    if len(length) and not np.abs(length - 1).max() < 1e-4:
        raise Fault(
            f"{function}: wi must be unit directions; got a length of {length.max():.5g} for a receiver {place}"
        )


def _check_mesh(views: list[LightView]) -> str:
    """Raise a Fault if `hit` sees another surface than the light's mesh."""
    light = views[0].light
    if light.infinite:
        return "infinite lights have none"
    mesh = light.mesh()
    caster = Intersector(mesh.vertices, mesh.faces)
    corners = np.asarray(mesh.vertices, float)[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = corners.mean(axis=(0, 1))
    for view in views:
        towards = unit(*(middle - view.p))
        size = np.linalg.norm(corners.reshape(-1, 3) - middle, axis=1).max()
        spread = np.clip(size / np.linalg.norm(middle - view.p), 0.02, 2)
        w = normalise((towards[:, None] + spread * (2 * _cube(4096) - 1)).astype(np.float32))
        hits, hit = caster.closest(view.points(4096), w), view.hit(w)
        meets = hits.prim >= 0
        faces = (normals[np.maximum(hits.prim, 0)] * w.T).sum(axis=1) < 0
        emits: Array = np.logical_and(meets, faces)
        if (hit.emits == emits).mean() < _OUTLINE:
            if (hit.emits == (meets & ~faces)).mean() >= _OUTLINE and emits.any() | hit.emits.any():
                raise Fault(
                    f"hit: emits is True on the wrong side: the normals of mesh(), by the winding of its triangles, "
                    f"point to the other one ({view.place})"
                )
            raise Fault(
                f"hit: emits is True in {hit.emits.mean():.1%} of directions about the light, of which "
                f"{emits.mean():.1%} meet the bright side of mesh() ({view.place})"
            )
        both = meets & hit.emits
        close = np.isclose(hit.distance[both], hits.distance[both], rtol=0.02)
        if both.any() and close.mean() < _OUTLINE:
            k = np.flatnonzero(both)[int(np.argmin(close))]
            raise Fault(
                f"hit: distance is {hit.distance[k]:.5g}, but mesh() is {hits.distance[k]:.5g} away ({view.place})"
            )
    return f"{len(views)} receivers"


def _cube(count: int) -> Array:
    return np.random.default_rng(6).random((3, count))


def _check_hit(views: list[LightView]) -> str:
    """Raise a Fault if `hit` says something else of sampled directions than `sample` does."""
    light_hides = bool(views[0].light.hides_itself())  # then `sample` may pick a point that another one hides
    for view in views:
        sample, again = view.sample, view.again
        if np.abs(dot(sample.wi, sample.wi) - 1).max() > 1e-4:
            raise Fault(f"sample: wi must be unit directions ({view.place})")
        shape = sample.wi.shape
        same = (sample.emits == again.emits) | (light_hides & ~sample.emits)
        if (share := same.mean()) < _ROUNDED:
            raise Fault(
                f"sample and hit disagree: emits is the same in {share:.1%} of sampled directions ({view.place}): "
                f"sample says that {sample.emits.mean():.1%} emit, hit {again.emits.mean():.1%}"
            )
        both: Array = np.logical_and(sample.emits, again.emits)
        values: dict[str, tuple[Any, Any, float]] = {
            "pdf": (sample.pdf, again.pdf, 2e-3),
            "distance": (np.broadcast_to(sample.distance, COUNT), np.broadcast_to(again.distance, COUNT), 1e-2),
            "radiance": (np.broadcast_to(sample.radiance, shape), np.broadcast_to(again.radiance, shape), 2e-3),
        }
        for field, (a, b, tolerance) in values.items():
            atol = 1e-3 * np.abs(b).max() if field == "radiance" else 0
            close: Array = np.all(np.atleast_2d(np.isclose(a, b, rtol=tolerance, atol=atol)), axis=0)
            if both.any() and close[both].mean() < _ROUNDED:
                k = np.flatnonzero(both & ~close)[0]
                guilty = _guilty(view) if field == "pdf" else "sample and hit disagree"
                raise Fault(
                    f"{guilty}: {field} of sample is {a[..., k].max():.5g}, of hit {b[..., k].max():.5g} in "
                    f"{1 - close[both].mean():.0%} of sampled directions ({view.place})"
                )
    return f"{COUNT} directions"


def _guilty(view: LightView) -> str:
    """Return which of two functions whose pdf differs is wrong: `hit` if its pdf is not the density of the samples."""
    right = view.comparison.mass_agrees(LIMIT) and view.comparison.p > LEVEL
    return "sample: its pdf is not that of hit, which is right" if right else "hit: its pdf is not that of sample"


def _check_irradiance(views: list[LightView]) -> str:
    """Raise a Fault if the radiance of the samples over their pdf is not the integral of the radiance of `hit`."""
    means = []
    for view in views:
        sample = view.sample
        ok = sample.emits & (sample.pdf > 0)
        value = np.where(ok, np.broadcast_to(sample.radiance, sample.wi.shape).max(axis=0), 0).astype(float)
        value = np.divide(value, sample.pdf, out=np.zeros_like(value), where=ok)
        cells, mean, deviation = view.comparison.cells, value.mean(), value.std() / np.sqrt(COUNT)
        integral, error = (part.sum() for part in cells.integrate(view.radiance(cells.nodes)))
        if abs(mean - integral) > LIMIT * deviation + 3 * error + 2e-3 * integral:
            integral, error = (part.sum() for part in integrate_finely(cells, view.radiance))
        if abs(mean - integral) > LIMIT * deviation + 3 * error + 2e-3 * integral:
            raise Fault(
                f"sample: radiance / pdf has the mean {mean:.5g} ± {deviation:.1g}, but the radiance of hit integrates "
                f"to {integral:.5g} ({view.place})"
            )
        means.append(mean)
    return f"{', '.join(f'{mean:.4g}' for mean in means)}"


def _check_radiance(views: list[LightView]) -> str:
    """Raise a Fault if camera rays would see another radiance than `hit` reports, or more than `brightness`."""
    for view in views:
        light, hit = view.light, view.again
        ok = hit.emits
        if not ok.any():
            continue
        function = "radiance" if light.infinite else "emission"
        p = view.points(COUNT) + hit.wi * hit.distance
        seen = light.radiance(hit.wi) if light.infinite else light.emission(p)
        seen, said = (np.broadcast_to(a, hit.wi.shape)[:, ok] for a in (seen, hit.radiance))
        close = np.isclose(seen, said, rtol=5e-3, atol=1e-3 * np.abs(said).max()).all(axis=0)
        if close.mean() < _ROUNDED:
            k = int(np.argmin(close))
            raise Fault(
                f"{function}() returns {seen[:, k].max():.5g} where the radiance of hit is {said[:, k].max():.5g}: the "
                f"camera sees another light than the surfaces ({view.place})"
            )
        most, brightness = float(said.max()), light.brightness(1.0)
        if type(light).brightness is not Light.brightness and most > brightness * (1 + 1e-4):
            raise Fault(f"brightness() returns {brightness:.5g}, but the radiance of hit is up to {most:.5g}")
    return f"{len(views)} receivers"


def _check_renders(light: Any) -> str:
    """Raise a Fault if light sampling, BRDF sampling and both have different means on a floor below the light."""
    if not light.has_power():
        return "the light has no power: nothing to render"
    rules = (("BRDF samples (fixed:0)", "fixed:0"), ("light samples (fixed:1)", "fixed:1"), ("both", "balance"))
    return compare_means(
        light_scene(light),
        rules,
        LIMIT,
        lambda name: "sample or hit: BRDF samples need hit alone, without its pdf, and the others disagree with them",
    )


def light_scene(light: AreaLight | InfiniteLight, material: Material | None = None) -> Scene:
    """Return a scene of a floor that faces a light, which is out of view."""
    centre, normal, size = np.zeros(3), np.array([0.0, 0.0, -1.0]), 1.0
    parts: tuple[Part, ...] = ()
    if not light.infinite:
        mesh = light.mesh()
        assert mesh is not None
        centre, normal, size = placement(mesh)
        if light.hides_itself():
            parts = (light_part(light),)  # type: ignore[arg-type]
    s, t = (a[:, 0].astype(float) for a in frame(-normal.astype(np.float32)[:, None]))
    middle = centre + size * normal
    # s x t points to the light
    floor = quad(middle - 4 * size * (s + t), 8 * size * s, 8 * size * t)
    # the camera is beside the light's column, on the bright side of the floor
    eye = middle + size * (1.5 * s - 0.6 * normal)
    camera = Camera.look_at(tuple(eye), tuple(middle), tuple(t), fov=30, resolution=(16, 16))
    return Scene(camera, (Part(floor, material or matte(0.5)), *parts), (light,))
