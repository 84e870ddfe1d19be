"""Parameters of a directive: their values by type, and a record of the parameters that were read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dmis.base.color import Rgb, read_spd, spectrum_to_rgb, xyz_to_rgb
from dmis.base.vectors import Floats
from dmis.formats.pbrt.spectra import SPECTRA, luminous
from dmis.formats.pbrt.tokens import PbrtError, Token, blame

SPECTRUM_TYPES = ("color", "rgb", "xyz", "blackbody", "spectrum")
"""Types of parameters whose values are spectra."""


@dataclass(frozen=True, eq=False)
class Parameter:
    """A parameter as written; its values are numbers ``(n,)`` or strings, depending on its type."""

    kind: str
    name: str
    values: Floats | tuple[str, ...]
    token: Token

    @property
    def numbers(self) -> Floats:
        """Values of a parameter whose type is numeric."""
        assert isinstance(self.values, np.ndarray)
        return self.values

    def colour(self) -> Rgb:
        """Return the linear RGB of a spectrum, of any of `SPECTRUM_TYPES`: a surface's or, before v4, a light's."""
        spectra = SPECTRA[self.token.source.dialect.name]
        with blame(self.token):
            if isinstance(self.values, tuple):
                if self.values[0] in spectra.named():
                    return spectra.named()[self.values[0]]
                return spectra.sampled(*read_spd(self._file(self.values[0])))
            if self.kind == "spectrum":
                return spectra.sampled(self.values[::2], self.values[1::2])
            if self.kind == "blackbody":
                return spectra.blackbody(*self.values.tolist())
            if self.kind == "xyz":
                return xyz_to_rgb(self.values)
        r, g, b = self.values.tolist()
        return r, g, b

    def illuminant(self) -> Rgb:
        """Return the linear RGB of a light's spectrum; in v4 all but those of type rgb are scaled to luminance 1."""
        spectra = SPECTRA[self.token.source.dialect.name]
        if self.token.source.dialect.name != "v4" or self.kind != "spectrum":
            return self.colour()
        with blame(self.token):
            if isinstance(self.values, tuple):
                if self.values[0] in spectra.named():
                    return luminous(spectra.named()[self.values[0]])
                return luminous(spectrum_to_rgb(*read_spd(self._file(self.values[0]))))
            return luminous(spectrum_to_rgb(self.values[::2], self.values[1::2]))

    def _file(self, name: str) -> Path:
        names = SPECTRA[self.token.source.dialect.name].named()
        if names and "." not in name:
            raise self.token.error(
                f"there is no spectrum of the name {name!r} here, write it as rgb; there are {', '.join(names)}"
            )
        return self.token.file(name)


@dataclass(eq=False)
class Parameters:
    """The parameters of a directive, and the names of those that were read.

    Methods take a name and the default of an absent parameter, and raise `PbrtError` if the parameter has another type
    or not one value.
    """

    directive: Token
    items: dict[str, Parameter]
    read_names: set[str] = field(default_factory=set)
    bright_names: set[str] = field(default_factory=set)
    """Names of reflectances above 1."""
    negative_names: set[str] = field(default_factory=set)
    """Names of reflectances below 0."""

    def get(self, name: str, *kinds: str) -> Parameter | None:
        """Return the parameter `name`, which must be of one of the types `kinds`; None if it is absent."""
        self.read_names.add(name)
        parameter = self.items.get(name)
        if parameter is not None and parameter.kind not in kinds:
            got = parameter.kind
            raise parameter.token.error(f"parameter {name!r} must be of type {' or '.join(kinds)}; got {got}")
        return parameter

    def number(self, name: str, default: float) -> float:
        """Return the ``float`` called `name`."""
        parameter = self.get(name, "float")
        return default if parameter is None else float(_single(parameter, 1)[0])

    def integer(self, name: str, default: int) -> int:
        """Return the ``integer`` called `name`."""
        parameter = self.get(name, "integer")
        return default if parameter is None else int(_single(parameter, 1)[0])

    def string(self, name: str, default: str | None = None) -> str:
        """Return the ``string`` called `name`, which is required if there is no default."""
        parameter = self.get(name, "string")
        if parameter is None:
            if default is None:
                raise self.missing(name, "string")
            return default
        if len(parameter.values) != 1:
            raise parameter.token.error(f"parameter {name!r} must be one string; got {len(parameter.values)}")
        return str(parameter.values[0])

    def boolean(self, name: str, default: bool) -> bool:
        """Return the ``bool`` called `name`."""
        parameter = self.get(name, "bool")
        return default if parameter is None else parameter.values == ("true",)

    def point(self, name: str, default: tuple[float, float, float]) -> Floats:
        """Return the ``point`` called `name`, (3,)."""
        parameter = self.get(name, "point")
        return np.array(default) if parameter is None else _single(parameter, 3)

    def colour(self, name: str, default: float) -> Rgb:
        """Return the spectrum called `name`, of any type of spectrum, as linear RGB."""
        parameter = self.get(name, *SPECTRUM_TYPES)
        return (default, default, default) if parameter is None else parameter.colour()

    def illuminant(self, name: str, default: float) -> Rgb:
        """Return the spectrum of a light called `name`, of any type of spectrum, as linear RGB."""
        parameter = self.get(name, *SPECTRUM_TYPES)
        return (default, default, default) if parameter is None else parameter.illuminant()

    def table(self, name: str, kind: str | tuple[str, ...], columns: int) -> Floats | None:
        """Return the numbers of the parameter `name` in rows, (n, columns); None if it is absent."""
        parameter = self.get(name, *((kind,) if isinstance(kind, str) else kind))
        if parameter is None:
            return None
        if len(parameter.numbers) % columns or not len(parameter.numbers):
            rule = f"a positive multiple of {columns}" if columns > 1 else "one or more"
            raise parameter.token.error(f"parameter {name!r} must hold {rule} numbers; got {len(parameter.numbers)}")
        return parameter.numbers.reshape(-1, columns)

    def indices(self, count: int) -> npt.NDArray[np.int32]:
        """Return the triangles ``integer indices`` (n, 3) into `count` vertices."""
        table = self.table("indices", "integer", 3)
        if table is None:
            raise self.missing("indices", "integer")
        if table.min() < 0 or table.max() >= count:
            bad = int(table[(table < 0) | (table >= count)][0])
            raise self.items["indices"].token.error(f"indices must be from 0 to {count - 1}, the last point; got {bad}")
        return table.astype(np.int32)

    def missing(self, name: str, kind: str) -> PbrtError:
        """Return the error that a required parameter is absent."""
        return self.directive.error(f'needs the parameter "{kind} {name}", which is missing')

    def fixed(self, values: Mapping[str, Any]) -> None:
        """Raise a `PbrtError` if one of these parameters has another value; infinity means that it must be absent."""
        for name, value in values.items():
            kind = "bool" if isinstance(value, bool) else "string" if isinstance(value, str) else "float"
            parameter = self.get(name, kind)
            if parameter is None:
                continue
            if value == float("inf"):
                raise parameter.token.error(f"parameter {name!r} changes the image and is not supported; remove it")
            got = parameter.values[0] == "true" if kind == "bool" else parameter.values[0]
            if len(parameter.values) != 1 or got != value:
                raise parameter.token.error(f"parameter {name!r} must be {value}, because another makes another image")

    def refuse(self, name: str, reason: str) -> None:
        """Raise a `PbrtError` with `reason` if there is a parameter `name`."""
        self.read_names.add(name)
        if name in self.items:
            raise self.items[name].token.error(reason)

    def unused(self) -> list[str]:
        """Return the names of the parameters that were not read."""
        return [name for name in self.items if name not in self.read_names]


def _single(parameter: Parameter, width: int) -> Floats:
    """Return the numbers of a parameter that must hold a single value of `width` numbers."""
    if len(parameter.values) != width:
        expected = "one number" if width == 1 else f"{width} numbers"
        raise parameter.token.error(f"parameter {parameter.name!r} must be {expected}; got {len(parameter.values)}")
    return parameter.numbers
