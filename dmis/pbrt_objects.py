"""Textures of all dialects, materials and lights without a shape of pbrt-v2, made from the parameter lists of files.

The defaults and the deviations from the textbook are those of pbrt-v2; `dmis.pbrt` lists the latter. What later
dialects have in their place is in `dmis.pbrt_materials` and `dmis.pbrt_lights`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dmis import material
from dmis.brdf import SpecularTransmission
from dmis.image import read_exr
from dmis.light import DistantLight, EnvironmentLight, Light, PointLight, SpotLight
from dmis.material import Material
from dmis.pbrt_parameters import COLOURS, Parameter, Parameters
from dmis.pbrt_tokens import Floats, PbrtError, Token, blame
from dmis.spectrum import LUMINANCE, Rgb
from dmis.texture import Image, scale
from dmis.vec import Array

Textures = Mapping[tuple[str, str], Any]
"""Values by ("float" or "color", name)."""

MAX_EXPONENT = 10_000
"""Of Blinn's distribution, in pbrt-v2."""


def unnamed(token: Token, name: str) -> Material:
    """Where no material has a name."""
    raise token.error(f"there is no material {name!r} here")


@dataclass(frozen=True, eq=False)
class Lookup:
    """Looks up parameters that may be textures, in one parameter list after the other.

    In pbrt-v2 a texture in any list comes before a constant in any list.
    """

    lists: tuple[Parameters, ...]
    textures: Textures
    name: Token
    named: Callable[[Token, str], Material] = unnamed

    def has(self, name: str) -> bool:
        """Whether there is a parameter of this name."""
        return any(name in one.items for one in self.lists)

    def string(self, name: str, count: int = 1) -> Any:
        """The token and the values of a required parameter of `count` strings."""
        for one in self.lists:
            found = one.get(name, "string")
            if found is not None:
                if len(found.values) != count:
                    raise found.token.error(f"parameter {name!r} must hold {count} strings; got {len(found.values)}")
                return found.token, *map(str, found.values)
        raise self.lists[0].missing(name, "string")

    def boolean(self, name: str, default: bool) -> bool:
        """A bool."""
        return next((one.boolean(name, default) for one in self.lists if name in one.items), default)

    def integer(self, name: str, default: int) -> int:
        """An integer."""
        return next((one.integer(name, default) for one in self.lists if name in one.items), default)

    def _find(self, name: str, *kinds: str) -> Parameter | None:
        found = [p for p in (one.get(name, "texture", *kinds) for one in self.lists) if p is not None]
        first = found[0] if found else None
        if self.name.source.dialect.name != "v2":
            return first
        return next((p for p in found if p.kind == "texture"), first)

    def _texture(self, kind: str, parameter: Parameter) -> Any:
        name = str(parameter.values[0])
        if (kind, name) not in self.textures:
            known = ", ".join(repr(n) for k, n in self.textures if k == kind) or "none"
            raise parameter.token.error(f"there is no {kind} texture {name!r} here; there are: {known}")
        return self.textures[kind, name]

    def error(self, name: str, rule: str) -> PbrtError:
        """The error of a parameter that one of the lists has."""
        token = next(one.items[name].token for one in self.lists if name in one.items)
        return token.error(f"parameter {name!r} {rule}")

    def real(self, name: str, default: float) -> float | Image:
        """A float or a float texture."""
        found = self._find(name, "float")
        if found is None:
            return default
        if found.kind == "texture":
            return self._texture("float", found)
        if len(found.values) != 1:
            raise self.error(name, f"must be one number; got {len(found.values)}")
        return float(found.numbers[0])

    def constant(self, name: str, default: float) -> float:
        """A float, or a texture that is constant."""
        value = self.real(name, default)
        if isinstance(value, Image):
            raise self.error(name, "must be constant here; an image texture is not supported")
        return value

    def roughness(self, name: str, default: float) -> float | Image:
        """A roughness whose reciprocal is at most `MAX_EXPONENT`."""
        value, least = self.real(name, default), 1 / MAX_EXPONENT
        if np.min(value.texels if isinstance(value, Image) else value) < 0:
            raise self.error(name, "must not be negative, because its reciprocal is an exponent")
        if isinstance(value, Image):
            return replace(value, texels=np.maximum(value.texels, np.float32(least)))
        return max(value, least)

    def colour(self, name: str, default: float | Rgb) -> Rgb | Image:
        """A spectrum or a spectrum texture."""
        found = self._find(name, *COLOURS)
        if found is None:
            return default if isinstance(default, tuple) else (default, default, default)
        return self._texture("color", found) if found.kind == "texture" else found.colour()

    def reflectance(self, name: str, default: float) -> Rgb | Image:
        """A spectrum or a spectrum texture, with negative components raised to 0."""
        value = self.colour(name, default)
        if isinstance(value, Image):
            return replace(value, texels=np.maximum(value.texels, 0))
        return _rgb(np.maximum(value, 0))

    def share(self, name: str, default: float) -> Rgb | Image:
        """A reflectance or an opacity, with components above 1 lowered to 1."""
        value = self.reflectance(name, default)
        if isinstance(value, Image):
            return replace(value, texels=np.minimum(value.texels, 1))
        return _rgb(np.minimum(value, 1))

    def constant_colour(self, name: str, default: Rgb) -> Rgb:
        """A spectrum, or a spectrum texture that is constant."""
        value = self.colour(name, default)
        if isinstance(value, Image):
            raise self.error(name, "must be constant here; an image texture is not supported")
        return value

    def index(self, name: str = "index", default: float = 1.5) -> float:
        """An index of refraction."""
        value = self.constant(name, default)
        if not value > 0:
            raise self.error(name, f"must be positive, because it is a ratio of speeds; got {value:g}")
        return value


# Textures ---------------------------------------------------------------------------------------------------------


def make_texture(kind: str, name: Token, parameters: Parameters, textures: Textures) -> Any:
    """A texture of class `name`: a number or RGB triple if it is constant, else an image; `kind` is float or color."""
    look = Lookup((parameters,), textures, name)
    get: Callable[[str, float], Any] = look.real if kind == "float" else look.colour
    if name.name == "constant":
        return get("value", 1.0)
    if name.name == "scale":
        with blame(name):
            if name.source.dialect.name == "v4":
                product = scale(get("tex", 1.0), look.real("scale", 1.0))
            else:
                product = scale(get("tex1", 1.0), get("tex2", 1.0))
        return float(product[0]) if kind == "float" and isinstance(product, tuple) else product
    if name.name == "imagemap":
        return _imagemap(kind, name, parameters)
    raise name.error("a texture must be one of constant, scale, imagemap; others are not supported")


def _imagemap(kind: str, name: Token, parameters: Parameters) -> Image:
    mapping = parameters.string("mapping", "uv")
    if mapping != "uv":
        raise parameters.items["mapping"].token.error(f"mapping must be uv; {mapping!r} is not supported")
    wrap = parameters.string("wrap", "repeat")
    if wrap not in ("repeat", "black", "clamp"):
        raise parameters.items["wrap"].token.error(f"wrap must be repeat, black or clamp; got {wrap!r}")
    size = parameters.number("uscale", 1), parameters.number("vscale", 1)
    offset = parameters.number("udelta", 0), parameters.number("vdelta", 0)
    factor, gamma = parameters.number("scale", 1), _gamma(name, parameters)
    texels = image(parameters, "filename").astype(np.float64)
    if name.source.dialect.t_up:
        texels = texels[::-1]
    v4 = name.source.dialect.name == "v4"
    if kind == "float":
        texels = texels.mean(axis=2, keepdims=True) if v4 else texels @ LUMINANCE[:, None]
    texels = factor * texels
    invert = v4 and parameters.boolean("invert", False)
    if invert or (v4 and kind == "color"):
        texels = np.maximum(1 - texels if invert else texels, 0)
    if gamma != 1:
        if (texels < 0).any():
            raise parameters.items["gamma"].token.error("gamma needs texels that are not negative; the image has some")
        texels = texels**gamma
    with blame(name):
        return Image(texels.astype(np.float32), size, offset, wrap)  # type: ignore[arg-type]


def _gamma(name: Token, parameters: Parameters) -> float:
    """The power of texels: only pbrt-v2 has one; in v3 and v4 the parameters are about files of 8 bits."""
    if name.source.dialect.name == "v2":
        return parameters.number("gamma", 1)
    parameters.fixed({"gamma": False} if name.source.dialect.name == "v3" else {"encoding": "linear"})
    return 1.0


def image(parameters: Parameters, name: str) -> Array:
    """The EXR file that the string `name` names, (H, W, 3) float32; alpha is dropped."""
    file = parameters.string(name)
    token = parameters.items[name].token
    path = token.file(file)
    if path.suffix.lower() != ".exr":
        raise token.error(f"images must be EXR files, so that their values are linear; convert {file!r} to .exr")
    with blame(token):
        layers, _ = read_exr(path)
    rgb = layers.get("RGB")
    if rgb is None:
        rgb = layers["Y"][..., None].repeat(3, axis=2) if "Y" in layers else None
    if rgb is None:
        raise token.error(f"the image needs the channels R, G, B or Y; it has {', '.join(layers)}")
    return rgb


# Materials --------------------------------------------------------------------------------------------------------


def _matte(p: Lookup) -> Material:
    return material.matte(p.reflectance("Kd", 0.5), float(np.clip(p.constant("sigma", 0), 0, 90)))


def _plastic(p: Lookup) -> Material:
    kd, ks = p.reflectance("Kd", 0.25), p.reflectance("Ks", 0.25)
    return material.plastic(kd, ks, p.roughness("roughness", 0.1), eta=1 / 1.5)  # pbrt-v2 swaps the two media


def _metal(p: Lookup) -> Material:
    eta, k = p.constant_colour("eta", material.COPPER_ETA), p.constant_colour("k", material.COPPER_K)
    return material.metal(eta, k, p.roughness("roughness", 0.01))


def _shinymetal(p: Lookup) -> Material:
    return material.shiny_metal(p.share("Ks", 1), p.share("Kr", 1), p.roughness("roughness", 0.1))


def _substrate(p: Lookup) -> Material:
    u, v = p.roughness("uroughness", 0.1), p.roughness("vroughness", 0.1)
    return material.substrate(p.reflectance("Kd", 0.5), p.reflectance("Ks", 0.5), u, v)


def _uber(p: Lookup) -> Material:
    made = material.uber(
        p.reflectance("Kd", 0.25),
        p.reflectance("Ks", 0.25),
        p.reflectance("Kr", 0),
        p.reflectance("Kt", 0),
        p.roughness("roughness", 0.1),
        1 / p.index(),  # pbrt-v2 swaps the two media
        p.share("opacity", 1),
    )
    return _unscaled(made)


def _unscaled(made: Material) -> Material:
    """The material without the 1/eta^2 of refracted radiance, which pbrt-v2 leaves out."""
    lobes = (replace(lobe, scaled=False) if isinstance(lobe, SpecularTransmission) else lobe for lobe in made.lobes)
    return replace(made, lobes=tuple(lobes))


def _mirror(p: Lookup) -> Material:
    return material.mirror(p.reflectance("Kr", 0.9))


def _glass(p: Lookup) -> Material:
    return _unscaled(material.glass(p.reflectance("Kr", 1), p.reflectance("Kt", 1), p.index()))


V2_MATERIALS: dict[str, Callable[[Lookup], Material]] = {
    "matte": _matte,
    "plastic": _plastic,
    "metal": _metal,
    "shinymetal": _shinymetal,
    "substrate": _substrate,
    "uber": _uber,
    "mirror": _mirror,
    "glass": _glass,
}


# Lights -----------------------------------------------------------------------------------------------------------


def radiance(parameters: Parameters, name: str = "L") -> Rgb:
    """A light's colour `name` times its ``scale``."""
    factor = parameters.get("scale", *COLOURS)
    return _rgb(np.multiply(parameters.illuminant(name, 1), 1 if factor is None else factor.colour()))


def similarity(matrix: Floats) -> float | None:
    """The factor of a matrix (4, 4) that scales all lengths alike (it may turn and mirror); None for any other."""
    square = matrix[:3, :3].T @ matrix[:3, :3]
    factor = np.trace(square) / 3
    return float(np.sqrt(factor)) if np.allclose(square, factor * np.eye(3), atol=1e-4 * factor) else None


def _point(parameters: Parameters, to_world: Floats) -> Light:
    position = to_world[:3, 3] + parameters.point("from", (0, 0, 0))  # added in world space by pbrt-v2
    return PointLight(_rgb(position), radiance(parameters, "I"))


def _spot(parameters: Parameters, to_world: Floats) -> Light:
    if similarity(to_world) is None:
        raise ValueError("a spot light must not be stretched, because its cone is round; scale all axes alike")
    start, end = parameters.point("from", (0, 0, 0)), parameters.point("to", (0, 0, 1))
    outer = parameters.number("coneangle", 30)
    inner = min(abs(outer - parameters.number("conedeltaangle", 5)), outer)  # only its cosine counts
    direction = to_world[:3, :3] @ (end - start)
    position = to_world[:3, :3] @ start + to_world[:3, 3]
    return SpotLight(_rgb(position), _rgb(direction), radiance(parameters, "I"), outer, inner)


def _distant(parameters: Parameters, to_world: Floats) -> Light:
    start, end = parameters.point("from", (0, 0, 0)), parameters.point("to", (0, 0, 1))
    return DistantLight(_rgb(to_world[:3, :3] @ (start - end)), radiance(parameters))


def _infinite(parameters: Parameters, to_world: Floats) -> Light:
    factor = similarity(to_world)
    if factor is None:
        raise ValueError("an infinite light must not be stretched, because it is all directions; scale all axes alike")
    texels = image(parameters, "mapname") if "mapname" in parameters.items else np.ones((1, 1, 3))
    return EnvironmentLight(texels, to_world[:3, :3] / factor, radiance(parameters))


V2_LIGHTS: dict[str, Callable[[Parameters, Floats], Light]] = {
    "point": _point,
    "spot": _spot,
    "distant": _distant,
    "infinite": _infinite,
}


def _rgb(values: Any) -> Rgb:
    x, y, z = np.asarray(values, np.float64).tolist()
    return x, y, z
