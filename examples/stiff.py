"""
Stiff scenes with known answers: what tests, the table and the picture of docs/stability.md share.

A stiff problem here is one where the scales of the two techniques differ by many orders of magnitude. Every scene is
one point of a floor, seen by a camera of hardly any width and lit by one light, and differs from a tame one in one
number, or two. What the point reflects is known from a closed form, or from quadrature in float64 that shares no code
with the renderer. Everything is turned by an angle that is no symmetry of anything.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import product
from pathlib import Path

import numpy as np

import dmis
from dmis.fit.fixed import Fixed

RESOLUTION = (8, 8)
KD, KS = 0.5, 0.4
EDGE = 8.0
"""Of the floor: the size of the scene, by which all distances are meant."""
LIFT = 1e-6 * EDGE * np.sqrt(2)
"""How far from the surface rays begin, see `dmis.scene.rescale.ray_offsets`: what is nearer to it may as well be on
it."""
ULP = 6e-8
"""Relative rounding of float32."""
TURN = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))[0]
TURN *= np.sign(np.linalg.det(TURN))


@dataclass(frozen=True)
class Place:
    """Where the scene is: lengths times `scale`, then turned, then moved by `offset` along all axes."""

    scale: float = 1.0
    offset: float = 0.0
    turn: bool = True

    def vector(self, v) -> np.ndarray:
        """Vectors ``(..., 3)`` of the scene's own frame, in the world."""
        return self.scale * np.asarray(v, float) @ (TURN.T if self.turn else np.eye(3))

    def point(self, p) -> np.ndarray:
        """Points alike."""
        return self.vector(p) + self.offset


@dataclass(frozen=True)
class Case:
    """A stiff scene.

    Attributes
    ----------
    axis, value
        What is stiff, and how much; `other` is the second number of those that have two.
    solve
        Gives `truth`, the radiance that the camera should see, the same in all pixels and channels.
    rounding
        The relative error that float32 may make of it, by what is said in docs/stability.md; from 1 on, all is lost.
    settings
        Of the estimator, where they are not the usual ones.
    refused
        Whether dmis says that the scene is too extreme, instead of an image.
    """

    axis: str
    value: float
    make: Callable[[], dmis.Scene]
    solve: Callable[[], float]
    rounding: float
    other: float | None = None
    settings: dmis.Settings = field(default_factory=dmis.Settings)
    refused: bool = False

    @cached_property
    def truth(self) -> float:
        """By closed form or quadrature."""
        return self.solve()

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.axis} {self.value:g}" + ("" if self.other is None else f", {self.other:g}")


def direction(angle: float) -> np.ndarray:
    """The unit vector at `angle` (radians) from the normal, towards +x."""
    return np.array([np.sin(angle), 0.0, np.cos(angle)])


def grazing(elevation: float) -> np.ndarray:
    """The unit vector at `elevation` (radians) above the floor, towards +x."""
    return np.array([np.cos(elevation), 0.0, np.sin(elevation)])


def floor(place: Place) -> dmis.Mesh:
    """A square of two triangles about the point that is seen, which is on no edge."""
    corners = np.array([[-0.5, -0.45, 0], [0.5, -0.45, 0], [0.5, 0.55, 0], [-0.5, 0.55, 0]]) * EDGE
    return dmis.Mesh(place.point(corners), np.array([[0, 1, 2], [0, 2, 3]]))


def scene(
    light: dmis.light.light.Light,
    material: dmis.Material,
    wo: np.ndarray,
    place: Place = Place(),
    mesh: dmis.Mesh | None = None,
    resolution: tuple[int, int] = RESOLUTION,
) -> dmis.Scene:
    """The point seen along `wo` (towards the camera, in the scene's own frame) from the distance 1."""
    up = place.vector((0.0, 1.0, 0.0)) / place.scale
    camera = dmis.Camera.look_at(place.point(wo), place.point(np.zeros(3)), up, fov=1e-6, resolution=resolution)
    return dmis.Scene(camera, (dmis.Part(mesh or floor(place), material),), (light,), "stiff")


# What a floor reflects of a light that is a cone of directions ------------------------------------------------------


def torrance_sparrow(exponent: float, wo: np.ndarray, wi: np.ndarray) -> np.ndarray:
    """The glossy lobe times cos_i in float64; `wi` ``(..., 3)``, the normal is z. The half vector's slope, in place of
    its cosine, so that nothing cancels.
    """
    h = wo + wi
    slope2 = (h[..., 0] ** 2 + h[..., 1] ** 2) / h[..., 2] ** 2
    cos_h, cos_i, cos_o = 1 / np.sqrt(1 + slope2), np.maximum(wi[..., 2], 0), wo[2]
    cos_d = np.sqrt((h * h).sum(axis=-1)) / 2
    spread = (exponent + 2) / (2 * np.pi) * np.exp(-0.5 * exponent * np.log1p(slope2))
    return spread * np.minimum(1, 2 * cos_h * np.minimum(cos_i, cos_o) / cos_d) / (4 * cos_o)


def gauss(edges: np.ndarray, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on every interval between the edges."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    half = np.diff(edges)[:, None] / 2
    return (edges[:-1, None] + half * (1 + x)).ravel(), (half * w).ravel()


def graded(low: float, high: float, finest: float) -> np.ndarray:
    """Edges from `low` to `high` that become dense at both ends, down to `finest`."""
    half = (high - low) / 2
    steps = np.geomspace(min(finest, half / 4), half, 40)
    return np.concatenate([[low], low + steps, high - steps[-2::-1], [high]])


def about(axis: np.ndarray, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Unit vectors at the angle `theta` from `axis`, `phi` from the plane of incidence."""
    across = np.array([axis[2], 0.0, -axis[0]])
    ring = np.cos(phi)[..., None] * across + np.sin(phi)[..., None] * np.array([0.0, 1.0, 0.0])
    return np.cos(theta)[..., None] * axis + np.sin(theta)[..., None] * ring


def cone_truth(exponent: float, angle: float, tilt: float, half: float) -> float:
    """Radiance reflected of a cone of radiance 1 and half angle `half`, whose axis is at `tilt` from the normal.

    The view is at `angle` on the other side. All of the cone must be above the horizon. Polar coordinates about the
    cone's axis where it is the smaller, else about the mirror direction, with the cone's boundary in closed form.
    """
    wo = direction(-angle)
    matte = KD * np.sin(half) ** 2 * np.cos(tilt)
    width, between = 1 / np.sqrt(exponent), abs(tilt - angle)
    if half < width:
        theta, weight = gauss(np.linspace(0, half, 9), 12)
        phi, turn = gauss(np.linspace(0, 2 * np.pi, 9), 12)
        wi = about(direction(tilt), theta[:, None], phi)
        values = torrance_sparrow(exponent, wo, wi) @ turn
        return matte + KS * float((values * np.sin(theta)) @ weight)
    finest = 1e-3 * min(width, max(between, 1e-12))
    edges = graded(abs(half - between), half + between, 1e-9 * (half + between))
    if between < half:
        edges = np.concatenate([graded(0, half - between, finest)[:-1], edges])
    theta, weight = gauss(edges, 12)
    sines = np.sin(theta) * np.sin(max(between, 1e-300))
    share = np.sin((half + theta - between) / 2) * np.sin((half - theta + between) / 2) / sines
    limit = np.where(theta <= half - between, np.pi, 2 * np.arcsin(np.sqrt(np.clip(share, 0, 1))))
    x, turn = gauss(np.linspace(-1, 1, 9), 8)
    side = 0.0 if tilt >= angle else np.pi
    wi = about(direction(angle), theta[:, None], side + limit[:, None] * x)
    values = torrance_sparrow(exponent, wo, wi) @ turn
    return matte + KS * float((values * limit * np.sin(theta)) @ weight)


# The family ---------------------------------------------------------------------------------------------------------


def glossy(exponent: float) -> dmis.Material:
    """Matte under a glossy lobe, white enough that both matter."""
    return dmis.torrance_sparrow(KD, KS, exponent)


def under_sphere(
    axis: str,
    value: float,
    other: float | None = None,
    *,
    exponent: float = 100.0,
    radius: float = 0.5,
    gap: float = 2.0,
    angle: float = 0.5,
    radiance: float = 1.0,
    place: Place = Place(),
    stretch: float = 1.0,
    settings: dmis.Settings | None = None,
) -> Case:
    """A glossy floor under a sphere of `radius`, whose nearest point is `gap` away.

    It is off the mirror direction by half of the smaller of its own angle and the lobe's; overhead if it is too wide
    to be there without a part of it being below the horizon. The floor's triangles are `stretch` times as long as wide.
    """
    distance = gap + radius
    # 1 - sin^2 = gap (gap + 2 radius) / distance^2, without cancellation
    half = float(np.arctan2(radius, np.sqrt(gap * (gap + 2 * radius))))
    tilt = angle + 0.5 * min(half, 1 / np.sqrt(exponent)) if half < 0.9 else 0.0

    def solve() -> float:
        return radiance * cone_truth(exponent, angle, tilt, half)

    def make() -> dmis.Scene:
        centre = tuple(place.point(distance * direction(tilt)))
        light = dmis.SphereLight(centre, radius * place.scale, (radiance,) * 3)
        mesh = floor(place) if stretch == 1 else slivers(stretch, place)
        return scene(light, glossy(exponent), direction(-angle), place, mesh)

    # directions are off by an ulp or two, by which the lobe is divided; the receiver is nearer than it should be
    rounding = 3 * ULP * (1 + np.sqrt(exponent)) + 3 * LIFT / gap + stretch * ULP
    rounding += np.inf if ULP * radius > gap or radiance < 1e-42 else 0  # the floor is in the light; no digit is left
    return Case(axis, value, make, solve, rounding, other, settings or dmis.Settings())


def under_disk(axis: str, height: float) -> Case:
    """A matte floor under a disk of radius 0.1 at some height: ``kd r^2 / (r^2 + h^2)``."""
    place, radius = Place(), 0.1

    def make() -> dmis.Scene:
        centre, normal = tuple(place.point((0, 0, height))), tuple(place.vector((0, 0, -1)))
        return scene(dmis.DiskLight(centre, normal, radius, (1, 1, 1)), dmis.matte(KD), direction(-0.5), place)

    rounding = 3 * ULP + 3 * LIFT * height / (radius**2 + height**2) if height > LIFT else np.inf
    truth = KD * radius**2 / (radius**2 + height**2)
    return Case(axis, height, make, lambda: truth, rounding)


def beside_wall(axis: str, distance: float) -> Case:
    """A matte floor beside a luminous wall that stands on it, 1 high, from y = 0 to y = 1, at some distance along x.

    The form factor of a rectangle at right angles, one corner of which is nearest (Siegel and Howell, configuration 4).
    """
    place = Place()
    across = np.hypot(1.0, distance)
    factor = (np.arctan2(1, distance) - distance / across * np.arctan2(1, across)) / (2 * np.pi)

    def make() -> dmis.Scene:
        corner = tuple(place.point((distance, 0, 0)))
        up, along = tuple(place.vector((0, 0, 1))), tuple(place.vector((0, 1, 0)))
        light = dmis.QuadLight(corner, up, along, (1, 1, 1))
        return scene(light, dmis.matte(KD), direction(-0.5), place)

    return Case(axis, distance, make, lambda: KD * float(factor), 3 * ULP + 3 * LIFT / distance)


SKY = (32, 64)
"""Rows and columns of the sky."""
SUN = (5, 5)
"""Row and column of its sun: in the mirror direction, more or less."""
_ANGLE, _AZIMUTH = 0.5, 2 * np.pi * (SUN[1] + 0.5) / SKY[1] + 0.02
SKY_WO = np.array([-np.cos(_AZIMUTH) * np.sin(_ANGLE), -np.sin(_AZIMUTH) * np.sin(_ANGLE), np.cos(_ANGLE)])


@cache
def sky_truth(exponent: float) -> tuple[float, float]:
    """What a floor reflects of a sky of radiance 1, and of a sun of radiance 1 in a black one: a bilinear hat."""

    def reflected(theta: np.ndarray, phi: np.ndarray, hat: bool) -> float:
        (t, weight), (p, turn) = gauss(theta, 12), gauss(phi, 12)
        s, c = np.sin(t)[:, None], np.cos(t)[:, None]
        wi = np.stack(np.broadcast_arrays(s * np.cos(p), s * np.sin(p), c), axis=-1)
        f = (KD / np.pi * wi[..., 2] + KS * torrance_sparrow(exponent, SKY_WO, wi)) * s
        if hat:
            row, column = t / np.pi * SKY[0] - 0.5 - SUN[0], p / (2 * np.pi) * SKY[1] - 0.5 - SUN[1]
            f *= (1 - np.abs(row))[:, None] * (1 - np.abs(column))
        return float(weight @ f @ turn)

    around = np.array([-0.5, 0.5, 1.5])
    even = reflected(np.linspace(0, np.pi / 2, 65), np.linspace(0, 2 * np.pi, 65), False)
    sun = reflected((SUN[0] + around) * np.pi / SKY[0], (SUN[1] + around) * 2 * np.pi / SKY[1], True)
    return even, sun


def under_sky(axis: str, contrast: float, exponent: float = 20.0) -> Case:
    """A glossy floor under a sky of radiance 1 with one texel of radiance `contrast`, in the mirror direction."""
    place = Place()

    def solve() -> float:
        even, sun = sky_truth(exponent)
        return even + (contrast - 1) * sun

    def make() -> dmis.Scene:
        texels = np.ones((*SKY, 3), np.float32)
        texels[SUN] = contrast
        return scene(dmis.EnvironmentLight(texels, place.vector(np.eye(3)).T), glossy(exponent), SKY_WO, place)

    return Case(axis, contrast, make, solve, 100 * ULP)


def seen_grazing(axis: str, elevation: float, turn: bool) -> Case:
    """A matte floor under a sphere, seen at grazing angles: what it reflects does not depend on them."""
    place, half, tilt = Place(turn=turn), 0.2, 0.3

    def make() -> dmis.Scene:
        light = dmis.SphereLight(tuple(place.point(3 * direction(tilt))), 3 * np.sin(half), (1, 1, 1))
        return scene(light, dmis.matte(KD), grazing(elevation), place)

    rounding = 3 * LIFT + 4 * ULP / elevation if turn else 3 * LIFT
    return Case(axis, elevation, make, lambda: KD * np.sin(half) ** 2 * np.cos(tilt), rounding)


def lit_grazing(axis: str, elevation: float, turn: bool) -> Case:
    """A matte floor lit at grazing angles by a sphere whose own angle is half the elevation; radiance to match."""
    place, half = Place(turn=turn), 0.5 * elevation

    def make() -> dmis.Scene:
        light = dmis.SphereLight(tuple(place.point(3 * grazing(elevation))), 3 * np.sin(half), (1, 1, 1))
        return scene(light, dmis.matte(KD), direction(-0.5), place)

    rounding = 3 * ULP + LIFT / (3 * elevation) * 1.5
    return Case(axis, elevation, make, lambda: KD * np.sin(half) ** 2 * np.sin(elevation), rounding)


BESIDE = 0.5
"""Distance of the point that is seen from where a sphere of radius 1 rests on the ground."""


def beside_ball(axis: str, extent: float) -> Case:
    """A matte ground of +-`extent` under an even sky, beside a black sphere of radius 1 that rests on it.

    Where the point sees the sphere it does not see the sky. With D^2 = 1 + x^2 the sphere is all above the horizon, and
    its form factor is cos sin^2 = (1 / D) (1 / D^2).
    """
    place = Place()
    factor = (1 + BESIDE**2) ** -1.5

    def make() -> dmis.Scene:
        seen = np.array([BESIDE, 0.0, 0.0])
        corners = np.array([[-1, -0.9, 0], [1, -0.9, 0], [1, 1.1, 0], [-1, 1.1, 0]]) * extent
        ground = dmis.Mesh(place.point(corners), np.array([[0, 1, 2], [0, 2, 3]]))
        ball = dmis.geometry.shapes.sphere().transformed(
            dmis.geometry.transforms.translate(place.point((0.0, 0.0, 1.0)))
        )
        light = dmis.EnvironmentLight(np.ones((8, 16, 3), np.float32), place.vector(np.eye(3)).T)
        eye, up = place.point(seen + direction(1.2)), place.vector((0.0, 1.0, 0.0))
        camera = dmis.Camera.look_at(eye, place.point(seen), up, fov=1e-6, resolution=RESOLUTION)
        parts = (dmis.Part(ground, dmis.matte(KD)), dmis.Part(ball, dmis.matte(0.0)))
        return dmis.Scene(camera, parts, (light,), "stiff")

    # The mesh of the sphere is inscribed: radii are short by 1e-4 at most, F by twice that. Rays begin at most 3e-4
    # above the ground, and dF / dh = (3 / D^2 - 1) / D^3 = 1.
    rounding = (2e-4 * factor + 3e-4) / (1 - factor)
    return Case(axis, extent, make, lambda: KD * (1 - factor), rounding)


def slivers(aspect: float, place: Place) -> dmis.Mesh:
    """The floor cut into triangles `aspect` times as long as wide where they are seen, and triangles of no area."""
    width = EDGE / aspect
    y = np.concatenate([[-0.45 * EDGE], 0.31 * width + width * np.arange(-8, 9), [0.55 * EDGE]])
    corners = np.array([[x, v, 0] for v in y for x in (-0.5 * EDGE, 0.5 * EDGE)])
    k = 2 * np.arange(len(y) - 1)
    faces = np.concatenate([np.stack([k, k + 1, k + 3], 1), np.stack([k, k + 3, k + 2], 1), np.stack([k, k, k + 1], 1)])
    flat = np.stack([k, k + 2, k + 2], 1)
    return dmis.Mesh(place.point(corners), np.concatenate([faces, flat]))


def furnace(axis: str, albedo: float, exponent: float | None = None) -> Case:
    """A matte floor of some albedo under an even sky of radiance 1."""
    place = Place()

    def make() -> dmis.Scene:
        light = dmis.EnvironmentLight(np.ones((8, 16, 3), np.float32), place.vector(np.eye(3)).T)
        return scene(light, dmis.matte(albedo), direction(-0.5), place)

    return Case(axis, albedo, make, lambda: albedo, 10 * ULP)


SIZES = tuple(10.0**k for k in range(-6, 7))
ROUGHNESS = tuple(10.0**k for k in range(-8, 1))


def family() -> Iterator[Case]:
    """All cases, axis by axis."""
    for radius, roughness in product(SIZES, ROUGHNESS):
        yield under_sphere(
            "light radius, roughness", radius * EDGE, roughness, radius=radius * EDGE, exponent=1 / roughness
        )
    for k in range(7):
        yield under_sphere("light distance", EDGE * 10.0**k, radius=0.5, gap=EDGE * 10.0**k)
    for k in range(-14, 15, 2):
        case = under_sphere("light radius", 10.0**k * EDGE, radius=10.0**k * EDGE)
        yield replace(case, refused=not -13 < k < 12)
    for k in range(-45, 41, 5):
        yield replace(under_sphere("radiance", 10.0**k, radiance=10.0**k), refused=k > 38)
    for k in range(9):
        yield under_sky("sun's contrast", 10.0**k)
    for k in range(1, 8):
        yield seen_grazing("grazing view", 10.0**-k, False)
        yield seen_grazing("grazing view, turned", 10.0**-k, True)
        yield lit_grazing("grazing light", 10.0**-k, False)
        yield lit_grazing("grazing light, turned", 10.0**-k, True)
    for k in range(7):
        yield under_disk("light in contact, facing", 10.0**-k)
        yield beside_wall("light in contact, at right angles", 10.0**-k)
    for k in range(8):
        yield beside_ball("ground under a sphere of radius 1", 10.0**k)
    for k in range(2, 8):
        yield under_sphere("slivers", 10.0**k, stretch=10.0**k)
    for k in range(11):
        place = Place(offset=EDGE * 10.0**k)
        yield replace(under_sphere("offset", EDGE * 10.0**k, place=place), refused=k > 9)
    for k in range(-18, 19, 3):
        yield replace(under_sphere("scale", 10.0**k, place=Place(scale=10.0**k)), refused=k > 17)
    for albedo in (0.0, 1e-30, 1e-6, 0.5, 1.0, 1.001):
        yield replace(furnace("albedo", albedo), refused=albedo > 1)
    for name in ("light", "brdf"):
        same = dmis.Settings(techniques=(name, name))
        yield replace(under_sphere(f"identical techniques, {name}", 0.0, settings=same), other=None)


# How it is measured -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Found:
    """What a rule makes of a case: mean and standard error over the pixels, relative to the truth; or why not."""

    mean: float
    error: float
    samples: int
    refused: str = ""

    def z(self, rounding: float) -> float:
        """Deviation beyond what rounding explains, in standard errors.

        A BRDF sample that meets a small light is as large as a light sample and may be as rare as once in all of them,
        when the standard error knows nothing of it: so it is not taken to be below that of ten in all samples.
        """
        excess = max(abs(self.mean - 1) - rounding, 0)
        return excess / max(self.error, np.sqrt(10) / self.samples)


def measure(case: Case, rule: str, spp: int, seed: int = 1) -> Found:
    """Render; refused if that is an error with a message. Rules of given weights take the case's techniques."""
    made = dmis.make_rule(rule)
    if isinstance(made, Fixed) and case.settings.techniques != dmis.Settings().techniques:
        made = replace(made, techniques=case.settings.techniques)
    try:
        image = dmis.render(case.make(), made, spp, seed=seed, settings=case.settings, parallel=1).image
    except ValueError as error:
        return Found(np.nan, np.nan, 1, str(error))
    means = image.astype(float).mean(axis=2)
    if case.truth == 0:
        return Found(1 + float(np.abs(means).max()), 0.0, means.size * spp)
    means /= case.truth
    return Found(float(means.mean()), float(means.std(ddof=1) / np.sqrt(means.size)), means.size * spp)


def chosen(every: int) -> list[Case]:
    """One of so many cases of the family."""
    return list(family())[::every]


def survey(spp: int, every: int, size: tuple[int, int]) -> dict[str, np.ndarray]:
    """The balance heuristic on `chosen` cases, ``(mean, error, samples)``; and the image of each scene that comes with
    dmis, if the size is not 0.
    """
    found = [measure(case, "balance", spp) for case in chosen(every)]
    out = {"family": np.array([(f.mean, f.error, f.samples) for f in found])}
    for name in dmis.SHIPPED if all(size) else ():
        out[name] = dmis.render(dmis.load_scene(name, resolution=size), "balance", 16, seed=1).image
    return out


def both(spp: int, every: int = 1, size: tuple[int, int] = (0, 0)) -> tuple[dict[str, np.ndarray], ...]:
    """The same samples in float32, and in float64 (see float64.py), in a process of its own."""
    folder = Path(__file__).resolve().parent
    with tempfile.NamedTemporaryFile(suffix=".npz") as file:
        numbers = [str(n) for n in (spp, every, *size)]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        command = [sys.executable, folder / "float64.py", folder / "stiff.py", file.name, *numbers]
        with subprocess.Popen(command, env=environment) as wide:
            single = survey(spp, every, size)
        if wide.returncode:
            raise ChildProcessError(f"float64.py ended with {wide.returncode}")
        with np.load(file.name) as double:
            return single, dict(double)


def rounding_errors(single: np.ndarray, double: np.ndarray) -> np.ndarray:
    """What rounding does to the mean of each case, relative: the difference of the two renderers, or what the mean is
    off by beyond its noise, which is in both where positions are. Not less than an ulp; 1 where all is lost.
    """
    noise = 4 * np.maximum(single[:, 1], np.sqrt(10) / single[:, 2])
    difference = np.abs(single[:, 0] - double[:, 0])
    return np.clip(np.maximum(difference, np.abs(single[:, 0] - 1) - noise), ULP, 1)


if __name__ == "__main__":
    numbers = [int(n) for n in sys.argv[2:]]
    np.savez(sys.argv[1], **survey(numbers[0], numbers[1], (numbers[2], numbers[3])))
