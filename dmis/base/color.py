"""Conversion of spectra to linear RGB by the CIE 1931 standard observer; luminance; files of measured spectra.

``XYZ = sum(v xyzbar) / sum(ybar)`` over whole nanometres from 360 to 830, with the table between its wavelengths taken
linearly and beyond its ends as constant, then to RGB with the Rec. 709 primaries. There is no white balance: a
constant 1 becomes (1.20489, 0.94823, 0.90927), because the white of these primaries is D65. Results are not clamped:
a saturated spectrum may have a negative component. These are the conventions of pbrt-v2, whose scenes give metals as
``.spd`` files.

The observer's table has steps of 5 nm and is interpolated by a cubic spline, which is within 1e-5 of the table in
steps of 1 nm.
"""

from __future__ import annotations

import os
import re
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from dmis.base.vectors import Array, Floats

Rgb = tuple[float, float, float]
LUMINANCE = np.array([0.212671, 0.715160, 0.072169])
"""Weights of linear red, green and blue in luminance."""
_XYZ_TO_RGB = np.array(
    [[3.240479, -1.537150, -0.498535], [-0.969256, 1.875991, 0.041556], [0.055648, -0.204043, 1.057311]]
)


def xyz_to_rgb(xyz: npt.ArrayLike) -> Rgb:
    """Return linear RGB of a CIE colour (3,)."""
    r, g, b = (_XYZ_TO_RGB @ np.asarray(xyz, np.float64)).tolist()
    return r, g, b


def spectrum_to_rgb(wavelengths: npt.ArrayLike, values: npt.ArrayLike) -> Rgb:
    """Return linear RGB of a tabulated spectrum.

    Parameters
    ----------
    wavelengths
        (N,) in nanometres, in any order, all different.
    values
        (N,) values there, linear in between, constant outside.
    """
    w, v = np.asarray(wavelengths, np.float64), np.asarray(values, np.float64)
    if w.ndim != 1 or w.shape != v.shape or w.size == 0:
        raise ValueError(f"a spectrum needs as many wavelengths as values, at least one; got {w.shape} and {v.shape}")
    if not (np.isfinite(w).all() and np.isfinite(v).all()):
        raise ValueError("a spectrum must be finite; got nan or infinity")
    order = np.argsort(w)
    w, v = w[order], v[order]
    if (np.diff(w) == 0).any():
        twice = w[:-1][np.diff(w) == 0][0]
        raise ValueError(f"a spectrum must have one value per wavelength; got two at {twice:g} nm")
    nanometres, observer = _observer()
    return xyz_to_rgb(observer.T @ np.interp(nanometres, w, v))


def blackbody_to_rgb(temperature: float, scale: float = 1.0, at: float = 555.0) -> Rgb:
    """Return the RGB of a black body of `temperature` kelvin (Planck's law), which is `scale` `at` nm, 0 at 0 K."""
    if not (np.isfinite(temperature) and temperature >= 0):
        raise ValueError(f"the temperature of a black body must be finite and at least 0 K; got {temperature}")
    if temperature == 0:
        return 0.0, 0.0, 0.0
    nanometres, observer = _observer()
    c2 = 1.4388e7 / temperature  # second radiation constant in nm K
    with np.errstate(over="ignore", invalid="ignore"):  # exponents are subtracted first: alone they overflow at 35 K
        ratio = np.exp(c2 / at - c2 / nanometres) * np.expm1(-c2 / at) / np.expm1(-c2 / nanometres)
        rgb = xyz_to_rgb(observer.T @ (scale * ratio * (at / nanometres) ** 5))
    if not np.isfinite(rgb).all():
        raise ValueError(f"a black body this cold has no visible light to scale to 1 at {at:g} nm; got {temperature} K")
    return rgb


def read_spd(path: str | os.PathLike[str]) -> tuple[Floats, Floats]:
    """Read wavelengths and values ``(N,)`` from a text file of pairs ``wavelength value``; ``#`` begins a comment.

    A FileNotFoundError if there is no such file, a ValueError if it holds anything but an even number of numbers.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"spectrum file {path} does not exist or is not a file")
    words = re.sub("#.*", "", path.read_text(encoding="utf-8", errors="replace")).split()
    try:
        numbers = np.array(words, np.float64)
    except ValueError as error:
        raise ValueError(f"{path}: a spectrum must be pairs of numbers: {error}") from None
    if not words or len(words) % 2:
        raise ValueError(f"{path}: a spectrum is pairs of wavelength and value; got {len(words)} numbers")
    return numbers[::2], numbers[1::2]


@cache
def _observer() -> tuple[Floats, Floats]:
    """Return wavelengths 360, 361, ... 830 nm, and the matching functions there ``(471, 3)`` over the sum of y-bar."""
    from scipy.interpolate import CubicSpline  # imported where used: few scenes have spectra

    table = np.loadtxt(Path(__file__).with_name("cie1931.csv"), delimiter=",")
    nanometres = np.arange(360.0, 831.0)
    observer = CubicSpline(table[:, 0], table[:, 1:])(nanometres)
    return nanometres, observer / observer[:, 1].sum()


def luminance(rgb: Array) -> Array:
    """Return the luminance of linear RGB in the last axis.

    For variances per channel the result is an upper bound of the variance of luminance. The two are equal if the
    channels are perfectly correlated and equally large.
    """
    return rgb @ LUMINANCE
