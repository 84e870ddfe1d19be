"""Shading points outside of any scene, and the check of what the methods of a lobe return there."""

from __future__ import annotations

from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.brdf.cosines import Directions
from dmis.brdf.lobe import Lobe
from dmis.brdf.materials import Material
from dmis.geometry.mesh import Mesh
from dmis.scene.groups import Part, batch_key, make_group
from dmis.scene.shading_points import ShadingPoints

_TRIANGLE = Mesh(np.eye(3), np.array([[0, 1, 2]]))


def surface(
    material: Material, wo: Any, count: int = 1, n: Any = (0, 0, 1), dpdu: Any = (1, 0, 0), outside: bool = True
) -> ShadingPoints:
    """Return `count` points at the origin, all seen from `wo`.

    Parameters
    ----------
    material
        Its lobes are bound as a scene binds them; images at the middle of the texture.
    wo, n, dpdu
        Unit vectors ``(3,)``: to the viewer, the normal, the tangent.
    outside
        Whether the viewer is on the outer side.
    """
    group = make_group(batch_key(Part(_TRIANGLE, material)), [(material, None)])
    uv = np.full((2, count), 0.5, np.float32)
    normal, wo, dpdu = (np.repeat(np.array(v, np.float32).reshape(3, 1), count, axis=1) for v in (n, wo, dpdu))
    return ShadingPoints(
        p=np.zeros((3, count), np.float32),
        ng=normal,
        n=normal,
        wo=wo,
        cos_o=(normal * wo).sum(axis=0),
        outside=np.full(count, outside),
        dpdu=dpdu,
        epsilon=np.float32(0),
        reflection=tuple(group.bind(lobe, None, uv) for lobe in group.reflection),
        transmission=tuple(group.bind(lobe, None, uv) for lobe in group.transmission),
        delta=tuple(group.bind(lobe, None, uv) for lobe in group.delta),
    )


def check_lobe_form(lobe: Lobe) -> None:
    """Raise a ValueError if a method of a lobe returns values of the wrong shape for four points."""
    points = surface(Material((lobe,)), (0.6, 0, 0.8), 4)
    u = np.array([[0.1, 0.4, 0.6, 0.9], [0.7, 0.2, 0.8, 0.3]], np.float32)
    with np.errstate(all="ignore"):
        if lobe.delta:
            wi, factor = points.delta[0].scatter(points)
            _check_shape(lobe, "scatter(surface), directions", wi, "(3, N)")
            _check_shape(lobe, "scatter(surface), factors", factor, "(1, 1)", "(1, N)", "(3, 1)", "(3, N)")
            return
        points = points.beyond() if lobe.transmissive else points
        wi = points.sample(u)
        _check_shape(lobe, "sample(surface, u)", wi, "(3, N)")
        directions = Directions(points, wi)
        _check_shape(lobe, "pdf(directions)", points.pdf(directions), "(N,)")
        _check_shape(lobe, "eval(directions)", points.eval(directions), "(1, 1)", "(1, N)", "(3, 1)", "(3, N)")


def _check_shape(lobe: Lobe, call: str, values: Array, *allowed: str) -> None:
    """Raise a ValueError unless values have one of the shapes, in which N is 4."""
    if str(np.shape(values)) not in [shape.replace("N", "4") for shape in allowed]:
        raise ValueError(
            f"{type(lobe).__name__}.{call} must be of shape {', '.join(allowed[:-1])}{' or ' * (len(allowed) > 1)}"
            f"{allowed[-1]}; got shape {np.shape(values)} for N = 4"
        )
