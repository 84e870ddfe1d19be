"""Textures of all dialects, and materials and lights without a shape of pbrt-v2, made from parameter lists.

The defaults and the deviations from the textbook are those of pbrt-v2; `dmis.formats.pbrt.read` lists the latter. The
materials and lights of later dialects are in `dmis.formats.pbrt.materials` and `dmis.formats.pbrt.lights`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dmis.base.color import LUMINANCE, Rgb
from dmis.base.vectors import Array, Floats
from dmis.brdf import materials
from dmis.brdf.materials import Material
from dmis.brdf.specular import SpecularTransmission
from dmis.brdf.texture import Image, scale
from dmis.formats.pbrt.parameters import SPECTRUM_TYPES, Parameter, Parameters
from dmis.formats.pbrt.tokens import PbrtError, Token, blame
from dmis.image import read_exr
from dmis.light.delta import DistantLight, PointLight, SpotLight
from dmis.light.environment import EnvironmentLight
from dmis.light.light import Light

Textures = Mapping[tuple[str, str], Any]
"""Textures by their type, "float" or "color", and their name."""
MAX_EXPONENT = 10_000
"""Largest exponent of Blinn's distribution in pbrt-v2."""
BRIGHT_REFLECTANCE = 1.001
"""Reflectance above which a warning names the parameter; it is above 1 because spectra of 1 are rounded."""
DARK_REFLECTANCE = -0.001
"""Reflectance below which a warning names the parameter; it is below 0 because spectra are rounded."""


def unnamed(token: Token, name: str) -> Material:
    """Raise the error that no material has the name `name`."""
    raise token.error(f"there is no material {name!r} here")


@dataclass(frozen=True, eq=False)
class Lookup:
    """Lookup of parameters that may be textures, in several parameter lists; the first list that has one counts.

    In pbrt-v2 a texture in any list counts before a constant in any list.
    """

    lists: tuple[Parameters, ...]
    textures: Textures
    name: Token
    named: Callable[[Token, str], Material] = unnamed

    def has(self, name: str) -> bool:
        """Return whether there is a parameter of this name."""
        return any(name in parameters.items for parameters in self.lists)

    def string(self, name: str, count: int = 1) -> Any:
        """Return the token and the values of a required parameter of `count` strings."""
        for parameters in self.lists:
            parameter = parameters.get(name, "string")
            if parameter is not None:
                if len(parameter.values) != count:
                    got = len(parameter.values)
                    raise parameter.token.error(f"parameter {name!r} must hold {count} strings; got {got}")
                return parameter.token, *map(str, parameter.values)
        raise self.lists[0].missing(name, "string")

    def boolean(self, name: str, default: bool) -> bool:
        """Return the bool `name`."""
        return next((lookup.boolean(name, default) for lookup in self.lists if name in lookup.items), default)

    def integer(self, name: str, default: int) -> int:
        """Return the integer `name`."""
        return next((lookup.integer(name, default) for lookup in self.lists if name in lookup.items), default)

    def _find(self, name: str, *kinds: str) -> Parameter | None:
        candidates = (parameters.get(name, "texture", *kinds) for parameters in self.lists)
        matches = [parameter for parameter in candidates if parameter is not None]
        first = matches[0] if matches else None
        if self.name.source.dialect.name != "v2":
            return first
        return next((parameter for parameter in matches if parameter.kind == "texture"), first)

    def _texture(self, kind: str, parameter: Parameter) -> Any:
        name = str(parameter.values[0])
        if (kind, name) not in self.textures:
            names = ", ".join(repr(n) for k, n in self.textures if k == kind) or "none"
            raise parameter.token.error(f"there is no {kind} texture {name!r} here; there are: {names}")
        return self.textures[kind, name]

    def error(self, name: str, rule: str) -> PbrtError:
        """Return the error that the parameter `name`, which one of the lists has, breaks a rule."""
        token = next(parameters.items[name].token for parameters in self.lists if name in parameters.items)
        return token.error(f"parameter {name!r} {rule}")

    def real(self, name: str, default: float) -> float | Image:
        """Return the float or float texture `name`."""
        parameter = self._find(name, "float")
        if parameter is None:
            return default
        if parameter.kind == "texture":
            return self._texture("float", parameter)
        if len(parameter.values) != 1:
            raise self.error(name, f"must be one number; got {len(parameter.values)}")
        return float(parameter.numbers[0])

    def constant(self, name: str, default: float) -> float:
        """Return the float `name`, which may be a constant texture."""
        value = self.real(name, default)
        if isinstance(value, Image):
            raise self.error(name, "must be constant here; an image texture is not supported")
        return value

    def roughness(self, name: str, default: float) -> float | Image:
        """Return the roughness `name`, raised so that its reciprocal is at most `MAX_EXPONENT`."""
        value, least = self.real(name, default), 1 / MAX_EXPONENT
        if np.min(value.texels if isinstance(value, Image) else value) < 0:
            raise self.error(name, "must not be negative, because its reciprocal is an exponent")
        if isinstance(value, Image):
            return replace(value, texels=np.maximum(value.texels, np.float32(least)))
        return max(value, least)

    def colour(self, name: str, default: float | Rgb) -> Rgb | Image:
        """Return the spectrum or spectrum texture `name`, as linear RGB."""
        parameter = self._find(name, *SPECTRUM_TYPES)
        if parameter is None:
            return default if isinstance(default, tuple) else (default, default, default)
        return self._texture("color", parameter) if parameter.kind == "texture" else parameter.colour()

    def reflectance(self, name: str, default: float) -> Rgb | Image:
        """Return the spectrum or texture `name` with negative components raised to 0; note components above 1."""
        value = self._not_negative(name, default)
        if np.max(value.texels if isinstance(value, Image) else value) > BRIGHT_REFLECTANCE:
            self._owner(name).bright_names.add(name)
        return value

    def _owner(self, name: str) -> Parameters:
        """Return the list that has the spectrum or texture `name` that counts."""
        parameter = self._find(name, *SPECTRUM_TYPES)
        return next(parameters for parameters in self.lists if parameters.items.get(name) is parameter)

    def share(self, name: str, default: float) -> Rgb | Image:
        """Return the spectrum or texture `name` with components clamped to [0, 1]."""
        value = self._not_negative(name, default)
        if isinstance(value, Image):
            return replace(value, texels=np.minimum(value.texels, 1))
        return _rgb(np.minimum(value, 1))

    def albedo(self, name: str, default: float) -> Rgb | Image:
        """Return the reflectance `name` of pbrt-v4, which refuses an rgb outside of [0, 1] and clamps images."""
        parameter = self._find(name, *SPECTRUM_TYPES)
        if parameter is not None and parameter.kind == "rgb":
            if ((parameter.numbers < 0) | (parameter.numbers > 1)).any():
                raise self.error(name, f"must be from 0 to 1 in pbrt-v4; got {parameter.numbers.tolist()}")
        return self.share(name, default)

    def _not_negative(self, name: str, default: float) -> Rgb | Image:
        """Return the spectrum or texture `name` with negative components raised to 0, and note these."""
        value = self.colour(name, default)
        if np.min(value.texels if isinstance(value, Image) else value) < DARK_REFLECTANCE:
            self._owner(name).negative_names.add(name)
        if isinstance(value, Image):
            return replace(value, texels=np.maximum(value.texels, 0))
        return _rgb(np.maximum(value, 0))

    def constant_colour(self, name: str, default: Rgb) -> Rgb:
        """Return the spectrum `name`, which may be a constant texture, as linear RGB."""
        value = self.colour(name, default)
        if isinstance(value, Image):
            raise self.error(name, "must be constant here; an image texture is not supported")
        return value

    def index(self, name: str = "index", default: float = 1.5) -> float:
        """Return the index of refraction `name`, which must be positive."""
        value = self.constant(name, default)
        if not value > 0:
            raise self.error(name, f"must be positive, because it is a ratio of speeds; got {value:g}")
        return value


def make_texture(kind: str, name: Token, parameters: Parameters, textures: Textures) -> Any:
    """Return a texture of class `name` and type `kind`, float or color.

    A constant texture is a number or an RGB triple, any other an image.
    """
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
    """Return the exponent of texels, which only pbrt-v2 has; in v3 and v4 gamma is about files of 8 bits."""
    if name.source.dialect.name == "v2":
        return parameters.number("gamma", 1)
    parameters.fixed({"gamma": False} if name.source.dialect.name == "v3" else {"encoding": "linear"})
    return 1.0


def image(parameters: Parameters, name: str) -> Array:
    """Read the EXR file that the string parameter `name` names, (H, W, 3) float32; alpha is dropped."""
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


def _matte(p: Lookup) -> Material:
    return materials.matte(p.reflectance("Kd", 0.5), float(np.clip(p.constant("sigma", 0), 0, 90)))


def _plastic(p: Lookup) -> Material:
    kd, ks = p.reflectance("Kd", 0.25), p.reflectance("Ks", 0.25)
    return materials.plastic(kd, ks, p.roughness("roughness", 0.1), eta=1 / 1.5)  # pbrt-v2 swaps the two media


def _metal(p: Lookup) -> Material:
    eta, k = p.constant_colour("eta", materials.COPPER_ETA), p.constant_colour("k", materials.COPPER_K)
    return materials.metal(eta, k, p.roughness("roughness", 0.01))


def _shinymetal(p: Lookup) -> Material:
    return materials.shiny_metal(p.share("Ks", 1), p.share("Kr", 1), p.roughness("roughness", 0.1))


def _substrate(p: Lookup) -> Material:
    u, v = p.roughness("uroughness", 0.1), p.roughness("vroughness", 0.1)
    return materials.substrate(p.reflectance("Kd", 0.5), p.reflectance("Ks", 0.5), u, v)


def _uber(p: Lookup) -> Material:
    material = materials.uber(
        p.reflectance("Kd", 0.25),
        p.reflectance("Ks", 0.25),
        p.reflectance("Kr", 0),
        p.reflectance("Kt", 0),
        p.roughness("roughness", 0.1),
        1 / p.index(),  # pbrt-v2 swaps the two media
        p.share("opacity", 1),
    )
    return _unscaled(material)


def _unscaled(material: Material) -> Material:
    """Return the material without the 1/eta^2 of refracted radiance, which pbrt-v2 leaves out."""
    lobes = (replace(lobe, scaled=False) if isinstance(lobe, SpecularTransmission) else lobe for lobe in material.lobes)
    return replace(material, lobes=tuple(lobes))


def _mirror(p: Lookup) -> Material:
    return materials.mirror(p.reflectance("Kr", 0.9))


def _glass(p: Lookup) -> Material:
    return _unscaled(materials.glass(p.reflectance("Kr", 1), p.reflectance("Kt", 1), p.index()))


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


def radiance(parameters: Parameters, name: str = "L") -> Rgb:
    """Return a light's colour `name` times its ``scale``."""
    factor = parameters.get("scale", *SPECTRUM_TYPES)
    return _rgb(np.multiply(parameters.illuminant(name, 1), 1 if factor is None else factor.colour()))


def similarity(matrix: Floats) -> float | None:
    """Return the factor by which a matrix (4, 4) scales all lengths, None if it scales them differently.

    The matrix may also rotate and mirror.
    """
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
    """Return three numbers (3,) as a tuple of Python floats."""
    x, y, z = np.asarray(values, np.float64).tolist()
    return x, y, z
