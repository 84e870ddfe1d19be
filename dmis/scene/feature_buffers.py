"""Feature buffers: what camera rays hit first, for filters that should not blur over edges, and for rules.

Rays at fixed places give shading normals, albedos, and materials or depths. These are free of the noise that statistics
of shading samples have (`dmis.filter.joint` compares them), as in the cross-bilateral filters of images (Eisemann and
Durand 2004, Petschnigg et al. 2004; for path tracing Dammertz et al. 2010). They do not depend on shadows, on lights,
or on reflections in mirrors.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dmis.base.patches import PATCH, patch_mean
from dmis.base.vectors import Array, columns
from dmis.scene.camera import Camera
from dmis.scene.groups import NO_GROUP
from dmis.scene.scene import Scene
from dmis.scene.shading_points import interpolate

FEATURE_SCALES = {"normal": 1.0, "albedo": 1.0, "material": 0.5}
"""Differences between features that count as much as one standard deviation in space: of unit normals (1 is 60
degrees), of reflectances, of shares of materials. Generous for the first two: narrower ones cost more in noise than
they saved in the scenes that come with the library, and albedo scales a curve without moving its minimum.
"""
BLOCK_SIDE = PATCH // 2
"""Side in pixels of the blocks through whose centres rays go: four rays for each patch of `PATCH` pixels."""
RAYS = 4
"""Rays on a side of a pixel of which its layers are means."""
SURFACE_LAYERS = ("albedo", "normal", "depth", "position", "uv", "part")
"""Layers of what pixels show, see `render_surface_layers`."""
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
    hits = _first_hits(scene.in_float32[0], BLOCK_SIDE)

    def mean(image: Array) -> Array:
        return patch_mean(image.astype(np.float32, copy=False), PATCH // BLOCK_SIDE).astype(np.float32)

    material = hits["material"]
    shares = [mean(material == number) for number in np.unique(material)]
    features = {"normal": mean(hits["normal"]), "albedo": mean(hits["albedo"]), "material": np.concatenate(shares)}
    return features, material.size


def render_pixel_features(scene: Scene) -> tuple[dict[str, Array], int]:
    """Return feature buffers of the pixels, and the number of rays traced for them: one through each pixel's centre.

    A pixel at an edge has the features of the surface at its centre, not a mean over both sides.

    Returns
    -------
    features
        ``(C, H, W)`` float32: ``normal`` (3), ``albedo`` (3) as in `render_feature_buffers`; ``depth`` (1), the
        distance along the ray in the units of `scene`, infinite where nothing is seen. A surface that neither reflects
        nor emits is nothing.
    rays
        Number of rays.
    """
    hits = _first_hits(scene.in_float32[0], 1)
    _, length, _ = scene.units
    hits["depth"] *= np.float32(length)
    return {name: hits[name] for name in ("normal", "albedo", "depth")}, hits["depth"].size


def render_surface_layers(scene: Scene, names: Sequence[str]) -> dict[str, Array]:
    """Return what the pixels show, by names of `SURFACE_LAYERS`, ``(H, W, C)`` or ``(H, W)`` float32.

    ``albedo`` (at most 1) and ``normal`` are means over `RAYS` squared rays; what neither reflects nor emits is
    nothing. Others are of the ray through the pixel's centre. Where it meets nothing, ``depth``, the distance along it,
    is infinite, ``part`` is -1, and ``position`` and ``uv`` are 0.
    """
    inner, (origin, length, _) = scene.in_float32[0], scene.units
    layers: dict[str, Array] = {}
    if {"albedo", "normal"} & {*names}:
        places = (np.arange(RAYS) + 0.5) / RAYS - 0.5
        hits = [_first_hits(inner, 1, (x, y)) for y in places for x in places]
        layers["normal"] = np.mean([hit["normal"] for hit in hits], axis=0)
        # nominal reflectances of lobes, such as 0.04 of glass and the 1 that it transmits, may add up to more
        layers["albedo"] = np.mean([np.minimum(hit["albedo"], 1) for hit in hits], axis=0)
    if {*names} - {"albedo", "normal"}:
        width, height = scene.camera.resolution
        grid = np.meshgrid(_centres(width, 1), _centres(height, 1))
        start, direction = _rays(inner.camera, *(a.reshape(-1) for a in grid))
        hit = inner.intersector.closest(start, direction)
        met = hit.prim >= 0
        depth = np.where(met, hit.distance, np.inf)
        place = (start + direction * np.where(met, depth, 0)) * length + origin[:, None]
        ends = np.cumsum([part.mesh.triangles for part in inner.parts])
        uv = interpolate(columns(inner.surfaces.uv, hit.prim), hit.u, hit.v)
        part = np.where(met, np.searchsorted(ends, hit.prim, "right"), -1)
        of_centres = {"depth": depth * length, "position": place * met, "uv": uv * met, "part": part}
        layers |= {name: values.reshape(-1, *grid[0].shape) for name, values in of_centres.items()}
    images = {name: np.moveaxis(layers[name], 0, -1).astype(np.float32) for name in names}
    return {name: image[..., 0] if image.shape[-1] == 1 else image for name, image in images.items()}


def _first_hits(scene: Scene, side: int, shift: tuple[float, float] = (0.0, 0.0)) -> dict[str, Array]:
    """Return features ``(C, rows, columns)`` of what rays through the centres of blocks of `side` pixels hit.

    Rays are shifted by `shift` pixels.

    ``material`` (1) is a number, of nothing -1.
    """
    plan = scene.plan
    width, height = scene.camera.resolution
    grid = np.meshgrid(_centres(width, side), _centres(height, side))
    x, y = (a.reshape(-1) + np.float32(by) for a, by in zip(grid, shift, strict=True))
    normal = np.zeros((3, len(x)), np.float32)
    albedo = np.zeros((3, len(x)), np.float32)
    depth = np.full(len(x), np.inf, np.float32)
    material = np.full(len(x), -1)
    for k in range(0, len(x), RAYS_PER_BATCH):
        origin, direction = _rays(scene.camera, x[k : k + RAYS_PER_BATCH], y[k : k + RAYS_PER_BATCH])
        hits = scene.intersector.closest(origin, direction)
        group_of = plan.face_group.take(hits.prim)
        for number, group in enumerate(plan.groups):
            index = np.flatnonzero(group_of == number)
            if len(index):
                points, _ = scene.surfaces.shading_points(group, hits, index, direction)
                lobes = (*points.reflection, *points.transmission, *points.delta)
                normal[:, k + index] = points.n
                albedo[:, k + index] = sum(lobe.albedo() for lobe in lobes)
                depth[k + index] = hits.distance.take(index)
                material[k + index] = number + (NO_GROUP + 1) * plan.face_row.take(hits.prim.take(index))
    features = {"normal": normal, "albedo": albedo, "depth": depth, "material": material}
    return {name: values.reshape(-1, *grid[0].shape) for name, values in features.items()}


def _centres(size: int, side: int) -> Array:
    """Return raster coordinates of the centres of blocks of `side` pixels; the last one may be smaller."""
    edges = np.arange(0, size, side, dtype=np.float32)
    return (edges + np.minimum(edges + side, size)) / 2


def _rays(camera: Camera, x: Array, y: Array) -> tuple[Array, Array]:
    """Return origins and unit directions of rays through raster points, from the middle of a lens, ``(3, N)`` each."""
    if camera.is_pinhole:
        return np.repeat(camera.origin, len(x), axis=1), camera.rays(x, y)
    return camera.lens_rays(x, y)
