"""Parameters of a directive: their values by type, as colours, and as textures; and which of them were read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from dmis.base.color import Rgb, read_spd, spectrum_to_rgb, xyz_to_rgb
from dmis.base.vectors import Floats
from dmis.brdf.texture import Image
from dmis.formats.pbrt.tokens import PbrtError, Token, blame, either

SPECTRUM_TYPES = ("color", "rgb", "xyz", "blackbody", "spectrum")
"""Types of parameters whose values are spectra."""
Textures = Mapping[tuple[str, str], Any]
"""Textures by their type, "float" or "color", and their name."""
BRIGHT = "reflectance above 1, which adds light, taken as it is, as pbrt does"
NEGATIVE = "reflectance below 0, taken as 0, as pbrt does"
UNDEFINED = "texture that is not defined, its parameter's default taken, as pbrt does"
DISPERSION = "index of refraction that differs with the wavelength, the one of yellow light taken"
UNAPPLIED = "not applied, so that the image differs by it from pbrt's"
"""What warnings say of a parameter."""
BRIGHT_REFLECTANCE = 1.001
"""Reflectance above which a warning names the parameter; it is above 1 because spectra of 1 are rounded."""
DARK_REFLECTANCE = -0.001
"""Reflectance below which a warning names the parameter; it is below 0 because spectra are rounded."""


@dataclass(frozen=True, eq=False)
class Parameter:
    """A parameter as written; its values are numbers ``(n,)`` or strings, depending on its type.

    `token` is its declaration, for errors, and `directive` is the line that it stands in.
    """

    kind: str
    name: str
    values: Floats | tuple[str, ...]
    token: Token
    directive: Token

    @property
    def numbers(self) -> Floats:
        """Values of a parameter whose type is numeric."""
        assert isinstance(self.values, np.ndarray)
        return self.values

    def error(self, rule: str) -> PbrtError:
        """Return the error that the parameter breaks a rule: "must be positive; got 0"."""
        return self.token.error(f"parameter {self.name!r} {rule}")

    def single(self, count: int = 1) -> Sequence[Any]:
        """Return the values of a parameter that must hold `count` of them."""
        if len(self.values) != count:
            what = ("string" if isinstance(self.values, tuple) else "number") + "s" * (count > 1)
            raise self.error(f"must be {'one' if count == 1 else count} {what}; got {len(self.values)}")
        return self.values if isinstance(self.values, tuple) else self.values.tolist()

    def colour(self, light: bool = False) -> Rgb:
        """Return the linear RGB of a spectrum, of any of `SPECTRUM_TYPES`, of a surface or a `light`.

        In v4 a light's spectrum is brought to luminance 1, unless it is of type rgb.
        """
        with blame(self.token):
            if self.kind in ("spectrum", "blackbody"):
                r, g, b = self._of_spectrum(light)
            else:
                r, g, b = xyz_to_rgb(self.values) if self.kind == "xyz" else self.numbers.tolist()
        return r, g, b

    def _of_spectrum(self, light: bool) -> Rgb:
        """Return the linear RGB of a value of the types spectrum and blackbody."""
        from dmis.formats.pbrt.spectra import blackbody, luminous, sampled, v4_names

        dialect = self.token.dialect
        if self.kind == "blackbody":
            return blackbody(dialect, *self.numbers.tolist())
        luminance = light and dialect == "v4"
        if not isinstance(self.values, tuple):
            table = self.values[::2], self.values[1::2]
        elif dialect == "v4" and "." not in self.values[0]:
            rgb = self.token.find("spectrum of the name", self.values[0], v4_names())
            return luminous(rgb) if luminance else rgb
        else:
            table = read_spd(self.token.file(self.values[0]))
        return luminous(spectrum_to_rgb(*table)) if luminance else sampled(dialect, *table)


@dataclass(eq=False)
class ParameterSet:
    """The parameters of a directive, and the names of those that were read.

    Methods take a name and the default of an absent parameter, and raise `PbrtError` if the parameter has another type
    or not one value.

    Attributes
    ----------
    directive
        The directive, for errors about what is absent.
    items
        The parameters by name.
    textures
        Textures that values may name.
    read_names
        Names of the parameters that were read, absent ones too.
    findings
        Parameters of which a warning must say something, with what it says.
    """

    directive: Token
    items: Mapping[str, Parameter]
    textures: Textures = field(default_factory=dict)
    read_names: set[str] = field(default_factory=set)
    findings: list[tuple[str, Parameter]] = field(default_factory=list)

    @property
    def dialect(self) -> str:
        """Name of the dialect of the file."""
        return self.directive.dialect

    def get(self, name: str, *kinds: str) -> Parameter | None:
        """Return the parameter `name`, which must be of one of the types `kinds`; None if it is absent."""
        self.read_names.add(name)
        parameter = self.items.get(name)
        if parameter is not None and parameter.kind not in kinds:
            raise parameter.error(f"must be of type {either(kinds)}; got {parameter.kind}")
        return parameter

    def number(self, name: str, default: float) -> float:
        """Return the ``float`` called `name`."""
        parameter = self.get(name, "float")
        return default if parameter is None else float(parameter.single()[0])

    def integer(self, name: str, default: int) -> int:
        """Return the ``integer`` called `name`."""
        parameter = self.get(name, "integer")
        return default if parameter is None else int(parameter.single()[0])

    def boolean(self, name: str, default: bool) -> bool:
        """Return the ``bool`` called `name`."""
        parameter = self.get(name, "bool")
        return default if parameter is None else parameter.values == ("true",)

    def string(self, name: str, default: str | None = None, allowed: Sequence[str] = ()) -> str:
        """Return the ``string`` called `name`, one of those `allowed`, if any; it is required without a default."""
        parameter = self.get(name, "string") if default is not None else self.required(name, "string")
        if parameter is None:
            return str(default)
        (value,) = parameter.single()
        if allowed and value not in allowed:
            raise parameter.token.error(f"{name} must be {either(allowed)}; got {value!r}")
        return str(value)

    def required(self, name: str, kind: str) -> Parameter:
        """Return the parameter `name` of type `kind`, which must be there."""
        parameter = self.get(name, kind)
        if parameter is None:
            raise self.directive.error(f'needs the parameter "{kind} {name}", which is missing')
        return parameter

    def point(self, name: str, default: tuple[float, float, float]) -> Floats:
        """Return the ``point`` called `name`, (3,)."""
        parameter = self.get(name, "point")
        return np.array(default if parameter is None else parameter.single(3))

    def table(self, name: str, columns: int, *kinds: str, rows: int | None = None) -> Floats | None:
        """Return the numbers of the parameter `name` in rows, (n, columns); None if it is absent.

        With `rows` there must be one for each of as many points.
        """
        parameter = self.get(name, *kinds)
        if parameter is None:
            return None
        if len(parameter.numbers) % columns or not len(parameter.numbers):
            raise parameter.error(f"must hold a positive multiple of {columns} numbers; got {len(parameter.numbers)}")
        table = parameter.numbers.reshape(-1, columns)
        if rows not in (None, len(table)):
            raise parameter.token.error(f"each of the {rows} points needs one {name}; got {len(table)}")
        return table

    def required_table(self, name: str, kind: str, columns: int) -> Floats:
        """Return the numbers of a parameter that must be there in rows, (n, columns)."""
        self.required(name, kind)
        return np.asarray(self.table(name, columns, kind))

    def indices(self, count: int, corners: int = 3) -> npt.NDArray[np.int32]:
        """Return the polygons ``integer indices`` (n, corners) into `count` points."""
        table = self.required_table("indices", "integer", corners)
        if table.min() < 0 or table.max() >= count:
            bad = int(table[(table < 0) | (table >= count)][0])
            raise self.items["indices"].token.error(f"indices must be from 0 to {count - 1}, the last point; got {bad}")
        return table.astype(np.int32)

    def light(self, name: str, default: float = 1.0) -> Rgb:
        """Return the spectrum of a light called `name`, of any type of spectrum, as linear RGB."""
        parameter = self.get(name, *SPECTRUM_TYPES)
        return (default, default, default) if parameter is None else parameter.colour(light=True)

    def real(self, name: str, default: float | Image) -> float | Image:
        """Return the float or float texture `name`."""
        parameter = self.get(name, "texture", "float")
        if parameter is None:
            return default
        if parameter.kind == "texture":
            return self._texture("float", parameter, default)
        return float(parameter.single()[0])

    def colour(self, name: str, default: float | Rgb) -> Rgb | Image:
        """Return the spectrum or spectrum texture `name`, as linear RGB."""
        parameter = self.get(name, "texture", *SPECTRUM_TYPES)
        default = default if isinstance(default, tuple) else (default, default, default)
        if parameter is None:
            return default
        return self._texture("color", parameter, default) if parameter.kind == "texture" else parameter.colour()

    def _texture(self, kind: str, parameter: Parameter, default: Any) -> Any:
        """Return the texture that a parameter names; the default if none is defined, which is no error in v2 and v3."""
        (name,) = parameter.single()
        if self.dialect != "v4" and (kind, name) not in self.textures:
            self.findings.append((UNDEFINED, parameter))
            return default
        named = {name: texture for (type_, name), texture in self.textures.items() if type_ == kind}
        return parameter.token.find(f"{kind} texture", name, named)

    def constant(self, name: str, default: Any) -> Any:
        """Return the float, or with an RGB default the spectrum `name` as linear RGB; it may be a constant texture."""
        value = self.colour(name, default) if isinstance(default, tuple) else self.real(name, default)
        if isinstance(value, Image):
            raise self.items[name].error("must be constant here; an image texture is not supported")
        return value

    def reflectance(self, name: str, default: float, most: float = np.inf) -> Rgb | Image:
        """Return the spectrum or texture `name` with components brought to [0, `most`].

        Components below 0 are noted for a warning, and without `most` those above 1.
        """
        value = self.colour(name, default)
        texels = value.texels if isinstance(value, Image) else np.asarray(value)
        if texels.max() > BRIGHT_REFLECTANCE and most == np.inf:
            self.findings.append((BRIGHT, self.items[name]))
        if texels.min() < DARK_REFLECTANCE:
            self.findings.append((NEGATIVE, self.items[name]))
        clipped = np.clip(texels, 0, most)
        return replace(value, texels=clipped) if isinstance(value, Image) else rgb(clipped)

    def albedo(self, name: str, default: float) -> Rgb | Image:
        """Return the reflectance `name` of pbrt-v4, which refuses an rgb outside of [0, 1] and clamps images."""
        parameter = self.get(name, "texture", *SPECTRUM_TYPES)
        if parameter is not None and parameter.kind == "rgb":
            if ((parameter.numbers < 0) | (parameter.numbers > 1)).any():
                raise parameter.error(f"must be from 0 to 1 in pbrt-v4; got {parameter.numbers.tolist()}")
        return self.reflectance(name, default, 1)

    def index(self, name: str = "index", default: float = 1.5) -> float:
        """Return the index of refraction `name`, which must be positive."""
        parameter = self.items.get(name)
        if parameter is not None and parameter.kind == "spectrum" and self.dialect == "v4":
            from dmis.formats.pbrt.spectra import GLASSES

            self.read_names.add(name)
            self.findings.append((DISPERSION, parameter))
            return float(parameter.token.find("glass of the name", parameter.single()[0], GLASSES))
        value = self.constant(name, default)
        if not value > 0:
            raise self.items[name].error(f"must be positive, because it is a ratio of speeds; got {value:g}")
        return value

    def request(self, name: str, default: int) -> int:
        """Return the positive integer `name`, which changes no image: the default if it is absent or something else."""
        parameter = self.items.get(name)
        if parameter is None or parameter.kind != "integer" or len(parameter.values) != 1 or parameter.numbers[0] < 1:
            return default
        self.read_names.add(name)
        return int(parameter.numbers[0])

    def require(self, values: Mapping[str, Any]) -> None:
        """Raise a `PbrtError` if one of these parameters has another value."""
        for name, value in values.items():
            read: Any = {bool: self.boolean, str: self.string, float: self.number}[type(value)]
            if read(name, value) != value:
                raise self.items[name].error(f"must be {value}, because another makes another image")

    def note_unapplied(self, defaults: Mapping[str, Any]) -> None:
        """Note those of the parameters with `defaults` that have another value; None means that each is another."""
        for name, default in defaults.items():
            self.read_names.add(name)
            if name in self.items and list(self.items[name].values) != default:
                self.findings.append((UNAPPLIED, self.items[name]))

    def refuse(self, reason: str, *names: str) -> None:
        """Raise a `PbrtError` with `reason` if there is a parameter of one of the `names`."""
        for name in names:
            self.read_names.add(name)
            if name in self.items:
                raise self.items[name].token.error(reason)


def rgb(values: Any) -> Rgb:
    """Return three numbers (3,) as a tuple of Python floats."""
    x, y, z = np.asarray(values, np.float64).tolist()
    return x, y, z
