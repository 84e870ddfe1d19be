"""One parameter of a directive: its type, name and values, and the colour of a spectrum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dmis.base.color import Rgb, read_spd, spectrum_to_rgb, xyz_to_rgb
from dmis.base.vectors import Floats
from dmis.formats.pbrt.spectra import SPECTRA, luminous
from dmis.formats.pbrt.tokens import PbrtError, Token, blame

SPECTRUM_TYPES = ("color", "rgb", "xyz", "blackbody", "spectrum")
"""Types of parameters whose values are spectra."""


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
        spectra = SPECTRA[self.token.dialect]
        luminance = light and self.kind == "spectrum" and self.token.dialect == "v4"
        sampled = spectrum_to_rgb if luminance else spectra.sampled
        with blame(self.token):
            if isinstance(self.values, tuple):
                (name,), named = self.values, spectra.named()
                if named and "." not in name:
                    rgb = self.token.find("spectrum of the name", name, named)
                else:
                    rgb = sampled(*read_spd(self.token.file(name)))
            elif self.kind == "spectrum":
                rgb = sampled(self.values[::2], self.values[1::2])
            elif self.kind == "blackbody":
                rgb = spectra.blackbody(*self.values.tolist())
            else:
                rgb = xyz_to_rgb(self.values) if self.kind == "xyz" else self.values.tolist()
            r, g, b = luminous(rgb) if luminance else rgb
        return r, g, b


def rgb(values: Any) -> Rgb:
    """Return three numbers (3,) as a tuple of Python floats."""
    x, y, z = np.asarray(values, np.float64).tolist()
    return x, y, z
