"""Parameters of a directive: their values by type, and which of them were asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dmis.pbrt_spectra import SPECTRA, luminous
from dmis.pbrt_tokens import Floats, PbrtError, Token, blame
from dmis.spectrum import Rgb, read_spd, spectrum_to_rgb, xyz_to_rgb

COLOURS = ("color", "rgb", "xyz", "blackbody", "spectrum")
"""Types of parameters that are spectra."""


@dataclass(frozen=True, eq=False)
class Parameter:
    """A parameter as written: its values are numbers ``(n,)`` or strings, as its type asks."""

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
        """Linear RGB of a parameter of one of the types `COLOURS`, of a surface or, before v4, of a light."""
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
        """Linear RGB of a light: in v4 every spectrum but rgb is brought to luminance 1."""
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
        known = SPECTRA[self.token.source.dialect.name].named()
        if known and "." not in name:
            raise self.token.error(
                f"there is no spectrum of the name {name!r} here, write it as rgb; there are {', '.join(known)}"
            )
        return self.token.file(name)


@dataclass(eq=False)
class Parameters:
    """The parameters of a directive; remembers which were asked for.

    Every method takes the name and what it is when absent, and raises `PbrtError` if the parameter is of another type
    or does not have one value.
    """

    directive: Token
    items: dict[str, Parameter]
    asked: set[str] = field(default_factory=set)

    def get(self, name: str, *kinds: str) -> Parameter | None:
        """The parameter `name` if it is there, of one of the types `kinds`."""
        self.asked.add(name)
        found = self.items.get(name)
        if found is not None and found.kind not in kinds:
            raise found.token.error(f"parameter {name!r} must be of type {' or '.join(kinds)}; got {found.kind}")
        return found

    def number(self, name: str, default: float) -> float:
        """A ``float``."""
        found = self.get(name, "float")
        return default if found is None else float(_one(found, 1)[0])

    def integer(self, name: str, default: int) -> int:
        """An ``integer``."""
        found = self.get(name, "integer")
        return default if found is None else int(_one(found, 1)[0])

    def string(self, name: str, default: str | None = None) -> str:
        """A ``string``; required if there is no default."""
        found = self.get(name, "string")
        if found is None:
            if default is None:
                raise self.missing(name, "string")
            return default
        if len(found.values) != 1:
            raise found.token.error(f"parameter {name!r} must be one string; got {len(found.values)}")
        return str(found.values[0])

    def boolean(self, name: str, default: bool) -> bool:
        """A ``bool``."""
        found = self.get(name, "bool")
        return default if found is None else found.values == ("true",)

    def point(self, name: str, default: tuple[float, float, float]) -> Floats:
        """A ``point``, (3,)."""
        found = self.get(name, "point")
        return np.array(default) if found is None else _one(found, 3)

    def colour(self, name: str, default: float) -> Rgb:
        """A spectrum of any type, as linear RGB."""
        found = self.get(name, *COLOURS)
        return (default, default, default) if found is None else found.colour()

    def illuminant(self, name: str, default: float) -> Rgb:
        """The colour of a light of any type of spectrum, as linear RGB."""
        found = self.get(name, *COLOURS)
        return (default, default, default) if found is None else found.illuminant()

    def table(self, name: str, kind: str | tuple[str, ...], columns: int) -> Floats | None:
        """Numbers in rows of `columns`, (n, columns)."""
        found = self.get(name, *((kind,) if isinstance(kind, str) else kind))
        if found is None:
            return None
        if len(found.numbers) % columns or not len(found.numbers):
            rule = f"a positive multiple of {columns}" if columns > 1 else "one or more"
            raise found.token.error(f"parameter {name!r} must hold {rule} numbers; got {len(found.numbers)}")
        return found.numbers.reshape(-1, columns)

    def indices(self, count: int) -> npt.NDArray[np.int32]:
        """The triangles ``integer indices`` (n, 3) into `count` vertices."""
        table = self.table("indices", "integer", 3)
        if table is None:
            raise self.missing("indices", "integer")
        if table.min() < 0 or table.max() >= count:
            bad = int(table[(table < 0) | (table >= count)][0])
            raise self.items["indices"].token.error(f"indices must be from 0 to {count - 1}, the last point; got {bad}")
        return table.astype(np.int32)

    def missing(self, name: str, kind: str) -> PbrtError:
        """The error of a required parameter that is absent."""
        return self.directive.error(f'needs the parameter "{kind} {name}", which is missing')

    def fixed(self, values: Mapping[str, Any]) -> None:
        """Raise if one of these parameters is there and has another value; infinity stands for none at all."""
        for name, value in values.items():
            kind = "bool" if isinstance(value, bool) else "string" if isinstance(value, str) else "float"
            found = self.get(name, kind)
            if found is None:
                continue
            if value == float("inf"):
                raise found.token.error(f"parameter {name!r} changes the image and is not supported; remove it")
            got = found.values[0] == "true" if kind == "bool" else found.values[0]
            if len(found.values) != 1 or got != value:
                raise found.token.error(f"parameter {name!r} must be {value}, because another makes another image")

    def refuse(self, name: str, reason: str) -> None:
        """Raise if there is a parameter `name`."""
        self.asked.add(name)
        if name in self.items:
            raise self.items[name].token.error(reason)

    def unused(self) -> list[str]:
        """Names of parameters that nobody asked for."""
        return [name for name in self.items if name not in self.asked]


def _one(parameter: Parameter, width: int) -> Floats:
    """The values of a parameter that must hold one of its type."""
    if len(parameter.values) != width:
        wanted = "one number" if width == 1 else f"{width} numbers"
        raise parameter.token.error(f"parameter {parameter.name!r} must be {wanted}; got {len(parameter.values)}")
    return parameter.numbers
