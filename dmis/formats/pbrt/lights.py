"""Lights of pbrt files, by dialect: a table of functions for lights without a shape, and the emission of area lights.

The lights of pbrt-v2, which v3 shares, are in `dmis.formats.pbrt.objects`.

pbrt-v4 brings a light to luminance 1 (one of type rgb: its white), and then has ``scale`` and, in place of the light's
own strength, ``power`` (lumens) or ``illuminance`` (lux).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from dmis.base.color import Rgb
from dmis.base.vectors import Floats
from dmis.formats.pbrt.objects import V2_LIGHTS, radiance, similarity
from dmis.formats.pbrt.parameters import Parameters
from dmis.formats.pbrt.tokens import Token, blame
from dmis.light.delta import DistantLight, PointLight, SpotLight
from dmis.light.environment import EnvironmentLight
from dmis.light.light import Light


def make_light(name: Token, parameters: Parameters, to_world: Floats) -> Light:
    """Return the light `name` of a ``LightSource`` line; `to_world` (4, 4) is the current transform."""
    table = LIGHTS[name.source.dialect.name]
    if name.name not in table:
        raise name.error(f"a light must be one of {', '.join(table)}; others are not supported")
    with blame(name):
        return table[name.name](parameters, to_world)


def emitted(parameters: Parameters, name: str, strength: str, per_unit: float) -> Rgb:
    """Return the intensity or radiance of a light of pbrt-v4, whose colour is the parameter `name`.

    `strength` names the parameter of its total power or illuminance, which is `per_unit` for a light of colour 1.
    """
    factor = parameters.number("scale", 1)
    total = parameters.number(strength, -1)
    if total > 0:
        factor *= total / per_unit
    r, g, b = (factor * np.asarray(parameters.illuminant(name, 1))).tolist()
    return r, g, b


def emission(parameters: Parameters, areas: Callable[[], Floats]) -> Rgb:
    """Return the radiance of an ``AreaLightSource``; `areas` (N,) are those of its shapes, each a light in v4."""
    if parameters.directive.source.dialect.name == "v2":
        return radiance(parameters)
    if parameters.boolean("twosided", False):
        raise parameters.items["twosided"].token.error(
            "twosided must be false, because lights shine on one side here; repeat the light's Shape lines after "
            "ReverseOrientation, so that the copies shine on the other side"
        )
    if parameters.directive.source.dialect.name == "v3":
        return radiance(parameters)
    parameters.refuse("filename", "an image that emits is not supported")
    power = parameters.get("power", "float")
    if power is None or parameters.number("power", -1) <= 0:
        return emitted(parameters, "L", "power", 1)
    size = areas()
    if not np.allclose(size, size[0], rtol=1e-4):
        raise power.token.error(
            "power is that of every triangle, so they must have one area, else their radiance differs; use L instead"
        )
    return emitted(parameters, "L", "power", np.pi * float(size[0]))


def _placing(parameters: Parameters) -> Parameters:
    """Return the parameters of a light's position and direction, which all dialects share."""
    items = {name: item for name, item in parameters.items.items() if name not in ("I", "L", "scale")}
    return Parameters(parameters.directive, items, parameters.read_names)


def _point(parameters: Parameters, to_world: Floats) -> Light:
    x, y, z = (to_world[:3, :3] @ parameters.point("from", (0, 0, 0)) + to_world[:3, 3]).tolist()
    return PointLight((x, y, z), emitted(parameters, "I", "power", 4 * np.pi))


def _spot(parameters: Parameters, to_world: Floats) -> Light:
    outer = parameters.number("coneangle", 30)
    inner = outer - parameters.number("conedeltaangle", 5)
    if inner != outer:
        token = parameters.items.get("conedeltaangle")
        raise (token.token if token else parameters.directive).error(
            "conedeltaangle must be 0 in v4 (its default is 5), because the falloff of its spot is not supported"
        )
    spot = V2_LIGHTS["spot"](_placing(parameters), to_world)
    assert isinstance(spot, SpotLight)
    intensity = emitted(parameters, "I", "power", 2 * np.pi * (1 - np.cos(np.radians(outer))))
    return SpotLight(spot.position, spot.direction, intensity, outer, inner)


def _distant(parameters: Parameters, to_world: Floats) -> Light:
    light = V2_LIGHTS["distant"](_placing(parameters), to_world)
    assert isinstance(light, DistantLight)
    return DistantLight(light.direction, emitted(parameters, "L", "illuminance", 1))


def _infinite(parameters: Parameters, to_world: Floats) -> Light:
    factor = similarity(to_world)
    if factor is None:
        raise ValueError("an infinite light must not be stretched, because it is all directions; scale all axes alike")
    parameters.refuse("filename", "maps of v4 are squares of equal area, which are not supported; only L is")
    parameters.refuse("portal", "portals are not supported; remove the parameter")
    rgb = emitted(parameters, "L", "illuminance", np.pi)
    return EnvironmentLight(np.ones((1, 1, 3)), to_world[:3, :3] / factor, rgb)


LIGHTS: Mapping[str, Mapping[str, Callable[[Parameters, Floats], Light]]] = {
    "v2": V2_LIGHTS,
    "v3": V2_LIGHTS,
    "v4": {"point": _point, "spot": _spot, "distant": _distant, "infinite": _infinite},
}
"""By the names of the dialect and the light."""
