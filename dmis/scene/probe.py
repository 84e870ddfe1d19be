"""Shading points outside of any scene, and the check of what the methods of a lobe return there."""

from __future__ import annotations

from typing import Any

import numpy as np

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
    """Raise a ValueError if a method of a lobe that is not shipped returns wrong values for four points, or for one."""
    for n in (4, 1):
        points = surface(Material((lobe,)), (0.6, 0, 0.8), n)
        with np.errstate(all="ignore"):  # a value may be one that does not count
            if lobe.delta:
                points.delta[0].scatter(points)
                continue
            points = points.beyond() if lobe.transmissive else points
            wi = points.sample(np.array([[0.1, 0.4, 0.6, 0.9], [0.7, 0.2, 0.8, 0.3]], np.float32)[:, :n])
            directions = Directions(points, wi)
            points.pdf(directions)
            points.eval(directions)
