"""Lobes and lights that are written outside the package, against shipped ones; errors and warnings about them."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest
from helpers import Z_LIMIT, z_score
from own_lights import HalfSky, Panel

import dmis
from dmis.base.vectors import Array, dot
from dmis.brdf.lobe import CosineLobe, Directions, Lambert, Lobe
from dmis.brdf.specular import SpecularReflection
from dmis.brdf.texture import Image
from dmis.light.light import AreaLight, DeltaLight, InfiniteLight
from dmis.light.light_sample import LightSample
from dmis.scene.groups import Part, light_part
from dmis.scene.scene import SceneWarning
from dmis.testing.scenes import FLOOR, box_scene
from dmis.testing.sphere import uniforms


@dataclass(frozen=True, eq=False)
class Candle(DeltaLight):
    """A point light at (0, 0, 2) of intensity 4."""

    def sample(self, p: Array, u: Array | None = None) -> LightSample:
        to = np.array([[0], [0], [2]], np.float32) - p
        distance = np.sqrt(dot(to, to))
        one = np.ones_like(distance)
        return LightSample(to / distance, distance, np.repeat((4 / distance**2)[None], 3, axis=0), one, one > 0)


@dataclass(frozen=True, eq=False)
class Paper(CosineLobe):
    """Diffuse transmission: light from the other side leaves with the same radiance in all directions."""

    share: Any
    colours: ClassVar[tuple[str, ...]] = ("share",)
    transmissive: ClassVar[bool] = True

    def eval(self, directions: Directions) -> Array:
        return self.share * (directions.above / np.float32(np.pi))


@dataclass(frozen=True, eq=False)
class Paint(CosineLobe):
    """Lambert's lobe, with another name for its colour."""

    tint: Any
    colours: ClassVar[tuple[str, ...]] = ("tint",)

    def eval(self, directions: Directions) -> Array:
        return self.tint * np.float32(1 / np.pi)


@pytest.mark.parametrize("rule", ["fixed:0", "fixed:1", "balance"])
def test_infinite_light_against_a_map(rule: str) -> None:
    """The map is 2 for azimuths within 90 degrees of +x, else 1, up to its texels' edges."""
    texels = np.ones((2, 256, 3), np.float32)
    texels[:, :64] = texels[:, 192:] = 2
    own, shipped = (box_scene(lights=(light,)) for light in (HalfSky(), dmis.EnvironmentLight(texels)))
    settings = dmis.Settings(integrator="direct")

    def images(scene: dmis.Scene, first: int) -> Array:
        seeds = range(first, first + 16)
        return np.array([dmis.render(scene, rule, 16, seed=s, settings=settings).image.mean() for s in seeds])

    assert abs(z_score(images(own, 0), images(shipped, 100))) < Z_LIMIT


@pytest.mark.parametrize("rule", ["fixed:0", "fixed:1", "balance"])
def test_transmissive_lobe_under_an_even_sky(rule: str) -> None:
    """Paper of transmittance t under an even sky of radiance 1 lets t through, with all techniques."""
    sky = dmis.EnvironmentLight(np.ones((4, 8, 3)))
    scene = box_scene(dmis.Material((Paper((0.6, 0.3, 0.1)),)), (sky,), fov=10.0)
    settings = dmis.Settings(integrator="direct")
    images = [dmis.render(scene, rule, 16, seed=s, settings=settings).image.mean(axis=(0, 1)) for s in range(16)]
    for values, share in zip(np.array(images).T, (0.6, 0.3, 0.1), strict=True):
        if rule == "fixed:0":  # BRDF samples of an even sky weigh the transmittance exactly: no noise but rounding
            np.testing.assert_allclose(values, share, rtol=1e-5)
        else:
            assert abs(z_score(values, share)) < Z_LIMIT


def test_rescaled_where_needed() -> None:
    """A light that cannot be rescaled will do in ordinary units, and not a million away from the origin."""
    lamp = Panel()
    ordinary = box_scene(lights=(lamp,), extra=(light_part(lamp),))
    assert dmis.render(ordinary, "balance", 2).image.max() > 0
    shift = np.eye(4)
    shift[0, 3] = 1e6
    far = replace(ordinary, parts=(Part(FLOOR.transformed(shift), dmis.matte()),), lights=(lamp,))
    with pytest.raises(ValueError, match=r"Panel has no method rescaled\(origin, length, gain\)"):
        dmis.render(far, "balance", 2)
    # a textured lobe with a colour of its own name has the image of Lambert's lobe, bit for bit
    texels = uniforms(8 * 8).reshape(8, 8, 2)[..., :1] * np.float32([0.9, 0.5, 0.2])
    floor = replace(FLOOR, uv=[[0, 0], [1, 0], [1, 1], [0, 1]])
    lamp = dmis.QuadLight((-0.5, -0.5, 2), (0, 1, 0), (1, 0, 0), (5, 4, 3))
    camera = box_scene().camera
    own, shipped = (
        dmis.render(dmis.Scene(camera, (Part(floor, dmis.Material((lobe(Image(texels)),))),), (lamp,)), "balance", 4)
        for lobe in (Paint, Lambert)
    )
    assert np.ptp(shipped.image) > 0.01
    np.testing.assert_array_equal(own.image, shipped.image)


def mine(base: type, **methods: Any) -> Any:
    """Return an object of a class like `base`, a lobe or a light, but for some methods."""
    own = type("Mine", (base,), methods)
    return own(0.5) if hasattr(base, "albedo") else own()


def returns(value: Any) -> Callable[..., Any]:
    return lambda self, *arguments: value


def changed(base: type, method: str, change: Callable[[Any], Any]) -> Any:
    """Return an object like those of `base`, whose `method` returns what `change` makes of its result."""
    original = getattr(base, method)
    return mine(base, **{method: lambda self, *arguments: change(original(self, *arguments))})


def render_with(own: Any) -> None:
    """Render a floor with a lobe, or under a light, which the camera sees."""
    if isinstance(own, Lobe):
        scene = box_scene(dmis.Material((own,)))
    else:
        scene = box_scene(lights=(own,), extra=(light_part(own),) if isinstance(own, Panel) else (), fov=100.0)
    dmis.render(scene, "balance", 1, parallel=1)


FLOAT = "an array of float"
FORM = r"must be of shape \(3, N\)"
SAMPLE = r"must return a LightSample .* got"


@pytest.mark.parametrize(
    ("own", "message"),
    [
        # a method that is missing
        (mine(Paint, eval=Lobe.eval), r"eval\(directions\).*Return the BSDF without the cosine"),
        (mine(HalfSky, sample=InfiniteLight.sample), r"sample\(p, u\)"),
        (mine(Panel, brightness=AreaLight.brightness), r"brightness\(length\)"),
        # one that returns the wrong form
        (mine(Panel, brightness=returns(-1.0)), r"brightness\(length\) must be a number of at least 0.*; got -1"),
        (mine(Lambert, eval=returns(np.float32(0.3))), rf"eval must be {FLOAT} of shape \(3, N\) or .*; got float32"),
        (mine(Lambert, pdf=returns(np.ones(4))), r"pdf must be of shape \(N,\); got shape \(4,\) for N = "),
        (mine(SpecularReflection, scatter=returns((np.ones((3, 4)), 0.9))), r"scatter, factors, must be .*; got float"),
        (mine(Panel, emission=returns(8.0)), rf"emission must be {FLOAT} of shape \(3, 1\) or .*; got float"),
        (mine(HalfSky, radiance=returns(np.ones(3))), r"radiance must be .* got shape \(3,\)"),
        (changed(Panel, "sample", lambda s: s.wi), rf"sample {SAMPLE} ndarray"),
        (
            changed(Panel, "sample", lambda s: replace(s, emits=s.emits.astype(np.float32))),
            r"sample: emits must be bool .*; got float32",
        ),
        (
            changed(Panel, "hit", lambda s: replace(s, radiance=np.ones(3))),
            r"hit: radiance must be of shape \(3, 1\) or \(3, N\); got shape \(3,\)",
        ),
        (changed(Candle, "sample", lambda s: replace(s, wi=s.wi.T)), rf"sample: wi {FORM}; got shape"),
    ],
)
def test_a_render_names_what_a_lobe_or_light_of_ones_own_lacks(own: Any, message: str) -> None:
    """A method, or the form of what one returns, which else ends in a TypeError of the estimator."""
    lacks = "must define the method " if " must " not in message else ""
    with pytest.raises(ValueError, match=rf"^Mine.{lacks}{message}"):
        render_with(own)


@pytest.mark.parametrize("lights", [(), (dmis.PointLight((0, 0, 1), (0, 0, 0)),)])
def test_a_scene_without_light_warns_and_says_so(lights: tuple[dmis.PointLight, ...]) -> None:
    scene = box_scene(lights=lights)
    assert "no light emits: images are black" in scene.describe()
    with pytest.warns(SceneWarning, match=rf"none of its {len(lights)} lights emits.*Add one"):
        assert not dmis.render(scene, "balance", 2).image.any()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        dmis.render(box_scene(), "balance", 2)
    assert "images are black" not in box_scene().describe()
