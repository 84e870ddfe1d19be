"""Feature buffers: what camera rays hit in each patch, for filters that should not blur over the edges of objects.

A few camera rays per patch, at fixed places, give the mean shading normal, the mean albedo and the share of each
material. They are free of the noise that statistics of shading samples have (`dmis.filter.joint` compares them), as in
the cross-bilateral filters of images (Eisemann and Durand 2004, Petschnigg et al. 2004; for path tracing Dammertz et
al. 2010). They do not depend on shadows, on lights, or on reflections in mirrors.
"""

from __future__ import annotations

import numpy as np

from dmis.base.patches import PATCH, patch_mean
from dmis.base.vectors import Array
from dmis.scene.groups import NO_GROUP
from dmis.scene.scene import Scene

FEATURE_SCALES = {"normal": 1.0, "albedo": 1.0, "material": 0.5}
"""Differences between features that count as much as one standard deviation in space: of unit normals (1 is 60
degrees), of reflectances, of shares of materials. Generous for the first two: narrower ones cost more in noise than
they saved in the scenes that come with the library, and albedo scales a curve without moving its minimum.
"""
BLOCK_SIDE = PATCH // 2
"""Side in pixels of the blocks through whose centres rays go: four rays for each patch of `PATCH` pixels."""
RAYS_PER_BATCH = 2**15
"""Rays per batch."""


def render_feature_buffers(scene: Scene) -> tuple[dict[str, Array], int]:
    """Return feature buffers of the patches of `PATCH` pixels, and the number of rays traced for them.

    Returns
    -------
    features
        Means over rays, ``(C, rows, columns)`` float32: ``normal`` (3), the shading normal on the camera's side, 0
        where nothing is seen; ``albedo`` (3), the sum of the lobes' nominal reflectances; ``material``, shares of the
        materials that are seen, "nothing" being one.
    rays
        Number of rays.
    """
    width, height = scene.camera.resolution
    columns, rows = _centres(width), _centres(height)
    y, x = (a.reshape(-1) for a in np.meshgrid(rows, columns, indexing="ij"))
    normal, colour = np.empty((2, 3, len(x)), np.float32)
    material = np.empty((1, len(x)), np.int32)
    for k in range(0, len(x), RAYS_PER_BATCH):
        part = slice(k, k + RAYS_PER_BATCH)
        normal[:, part], colour[:, part], material[:, part] = _look(scene, x[part], y[part])
    kinds = (material == number for number in np.unique(material))

    def mean(values: Array) -> Array:
        image = values.astype(np.float32, copy=False).reshape(-1, len(rows), len(columns))
        return patch_mean(image, PATCH // BLOCK_SIDE).astype(np.float32)

    return {"normal": mean(normal), "albedo": mean(colour), "material": np.concatenate([*map(mean, kinds)])}, len(x)


def _centres(size: int) -> Array:
    """Return raster coordinates of the centres of blocks of `BLOCK_SIDE` pixels; the last one may be smaller."""
    edges = np.arange(0, size, BLOCK_SIDE, dtype=np.float32)
    return (edges + np.minimum(edges + BLOCK_SIDE, size)) / 2


def _look(scene: Scene, x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return normals ``(3, N)``, albedos ``(3, N)`` and material numbers ``(N,)``, -1 for nothing, at raster points."""
    plan = scene.plan
    if scene.camera.is_pinhole:
        origin, direction = np.repeat(scene.camera.origin, len(x), axis=1), scene.camera.rays(x, y)
    else:
        origin, direction = scene.camera.lens_rays(x, y)
    hits = scene.intersector.closest(origin, direction)
    group_of = plan.face_group.take(hits.prim)
    normal, colour = np.zeros((2, *direction.shape), np.float32)
    material = np.full(len(x), -1)
    for number, group in enumerate(plan.groups):
        index = np.flatnonzero(group_of == number)
        if len(index):
            surface, _ = scene.shading_points(group, hits, index, direction)
            normal[:, index] = surface.n
            lobes = (*surface.reflection, *surface.transmission, *surface.delta)
            colour[:, index] = sum(lobe.albedo() for lobe in lobes)
            material[index] = number + (NO_GROUP + 1) * plan.face_row.take(hits.prim.take(index))
    return normal, colour, material
