"""Checks of a lobe that is a Dirac delta: directions and factors of `scatter`."""

from __future__ import annotations

import numpy as np

from dmis.base.vectors import Array, dot
from dmis.brdf.materials import Material
from dmis.scene.probe import check_lobe_form, surface
from dmis.scene.shading_points import ShadingPoints
from dmis.testing.density_checks import check_unit, check_values
from dmis.testing.outcome import Fault, Outcome, run_checks
from dmis.testing.sphere import polar

_ANGLES = (0.0, 35.0, 70.0, 85.0, 89.9, 89.9999, 90.0)


def check_delta_lobe(material: Material, name: str) -> list[Outcome]:
    """Check the directions and factors of the only lobe of `material`, a Dirac delta."""

    def scatter() -> str:
        check_lobe_form(material.lobes[0])
        largest = 0.0
        for outside in (True, False):
            for degrees in _ANGLES:
                points = surface(material, polar(degrees) * [1, 1, degrees < 90], 4, outside=outside)
                wi, factor = points.delta[0].scatter(points)
                largest = max(largest, _check_scattered(points, wi, factor, f"wo at {degrees:g}°"))
        return f"factors of at most {largest:.3f}"

    return run_checks(name, [("scatter: directions and factors", scatter)])


def _check_scattered(points: ShadingPoints, wi: Array, factor: Array, place: str) -> float:
    """Return the largest share of light; raise a Fault if directions or factors are wrong."""
    lobe = points.delta[0]
    check_values("scatter: wi", wi, place, signed=True)
    check_values("scatter: factor", factor, place)
    lit = np.broadcast_to(factor, (3, 4)).any(axis=0)
    check_unit("scatter", wi[:, lit], place)
    cos = dot(points.n, wi)[lit] * (-1 if lobe.transmissive else 1)
    if (cos < -1e-4).any():
        word = "transmissive = True, but wi is on wo's side" if lobe.transmissive else "wi is below the surface"
        raise Fault(f"scatter: wrong side of the surface: {word} ({place})")
    eta = lobe.eta_scale() if points.outside.all() else 1 / lobe.eta_scale()
    if (share := float(np.max(factor) * eta**2)) > 1 + 1e-4:
        raise Fault(f"scatter returns a factor of {share:.4f} of the light ({place}); at most 1 is allowed")
    return share
