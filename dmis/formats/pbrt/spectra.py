"""Spectra of pbrt files as linear RGB, by dialect.

pbrt-v2 and v3 turn every spectrum into RGB without a white balance; v3 integrates over 470 nm in 471 steps. pbrt-v4
keeps spectra until the film converts them; dmis converts them when it reads them. For v4 dmis balances the spectra of
surfaces and metals, so that a constant spectrum stays the same constant, and scales those of lights to luminance 1, as
v4 does before its ``scale``.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from dmis.base.color import LUMINANCE, Rgb, blackbody_to_rgb, spectrum_to_rgb
from dmis.base.vectors import Floats
from dmis.brdf.materials import COPPER_ETA, COPPER_K

_METALS: dict[str, tuple[Rgb, Rgb]] = {
    "Cu": (COPPER_ETA, COPPER_K),
    "Au": ((0.143124, 0.3749396, 1.442507), (3.983175, 2.385725, 1.603214)),
    "Ag": ((0.155265, 0.116723, 0.138381), (4.828343, 3.122246, 2.147050)),
    "Al": ((1.657460, 0.880369, 0.521229), (9.223869, 6.269523, 4.837001)),
}
GLASSES = {"BK7": 1.5168, "BAF10": 1.67, "FK51A": 1.4866, "LASF9": 1.8503, "F5": 1.6727, "F10": 1.7283, "F11": 1.7847}
GLASSES = {f"glass-{name}": index for name, index in GLASSES.items()}
"""Indices of refraction of glasses of v4 at 587.6 nm."""
_WIEN = 2.8977721e6
"""Displacement constant, nm K."""


@cache
def _white() -> Floats:
    """Return the RGB of a constant spectrum before white balance; computed where needed, because it imports SciPy."""
    return np.array(spectrum_to_rgb([555.0], [1.0]))


def luminous(rgb: Rgb) -> Rgb:
    """Return a colour scaled to luminance 1; a ValueError if its luminance is not positive."""
    y = float(LUMINANCE @ np.asarray(rgb))
    if not y > 0:
        raise ValueError(f"the spectrum of a light must have a positive luminance, to which it is scaled; got {y:g}")
    return _times(rgb, 1 / y)


def _times(rgb: Rgb, factor: float | Floats) -> Rgb:
    """Return the product of a colour and a factor, one number or one per channel."""
    r, g, b = (np.asarray(rgb) * factor).tolist()
    return r, g, b


def sampled(dialect: str, wavelengths: npt.ArrayLike, values: npt.ArrayLike) -> Rgb:
    """Return the RGB of a table of a surface or a metal."""
    rgb = spectrum_to_rgb(wavelengths, values)
    if dialect == "v2":
        return rgb
    return _times(rgb, 470 / 471 if dialect == "v3" else 1 / _white())


def blackbody(dialect: str, temperature: float, scale: float = 1.0) -> Rgb:
    """Return the RGB of a black body of value 1 at 555 nm, in v3 at its brightest wavelength; in v4 of luminance 1."""
    if dialect == "v3":
        return blackbody_to_rgb(temperature, scale * 470 / 471, _WIEN / (temperature or 1))
    rgb = blackbody_to_rgb(temperature, scale)
    return luminous(rgb) if dialect == "v4" else rgb


@cache
def v4_names() -> dict[str, Rgb]:
    """Return the spectra of v4 by name."""
    balance = 1 / _white()
    metals = {
        f"metal-{metal}-{what}": _times(value, balance)
        for metal, values in _METALS.items()
        for what, value in zip(("eta", "k"), values, strict=True)
    }
    return metals | {"stdillum-D65": (1.0, 1.0, 1.0)}
