"""Shading points outside of any scene, and the check of what the methods of a lobe return there."""

from __future__ import annotations

from typing import Any

import numpy as np

from dmis.base.validate import check_shape
from dmis.brdf.cosines import Directions
from dmis.brdf.lobe import Lobe
from dmis.brdf.materials import Material
from dmis.geometry.mesh import Mesh
from dmis.scene.groups import Part, batch_key, bind_lobes, make_group
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
        **bind_lobes(group, None, uv),
    )


def check_lobe_form(lobe: Lobe) -> None:
    """Raise a ValueError if a method of a lobe returns values of the wrong shape for four points, or for one."""
    name = type(lobe).__name__
    colours = ("(3, N)", "(3, 1)", "(1, N)", "(1, 1)")
    for n in (4, 1):
        points = surface(Material((lobe,)), (0.6, 0, 0.8), n)
        with np.errstate(all="ignore"):  # shapes count here, values do not
            if lobe.delta:
                wi, factor = points.delta[0].scatter(points)
                check_shape(f"{name}.scatter(surface), directions", wi, n, "(3, N)")
                check_shape(f"{name}.scatter(surface), factors", factor, n, *colours)
                continue
            points = points.beyond() if lobe.transmissive else points
            wi = points.sample(np.array([[0.1, 0.4, 0.6, 0.9], [0.7, 0.2, 0.8, 0.3]], np.float32)[:, :n])
            check_shape(f"{name}.sample(surface, u)", wi, n, "(3, N)")
            directions = Directions(points, wi)
            check_shape(f"{name}.pdf(directions)", points.pdf(directions), n, "(N,)")
            check_shape(f"{name}.eval(directions)", points.eval(directions), n, *colours)
