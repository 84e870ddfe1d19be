"""Footprints: by how much texture coordinates change from a pixel of the camera to the next."""

from __future__ import annotations

import numpy as np

from dmis.base.vectors import TINY, Array, dot
from dmis.scene.camera import Camera

_LEAST_COSINE = np.float32(1e-6)
"""Smallest cosine between a ray and a plane, along which a footprint has no end."""


def texture_steps(camera: Camera, p: Array, ng: Array, dpdu: Array, dpdv: Array) -> tuple[Array, Array]:
    """Return the changes of (u, v) by `Camera.texture_filter` pixels along x and along y, ``(2, N)`` each.

    Parameters
    ----------
    camera
        With a projection that is not spherical. The rays of a lens are taken as those through its middle.
    p, ng, dpdu, dpdv
        Points that the camera sees, unit normals of their triangles, and tangents, ``(3, N)`` each.
    """
    axes = np.asarray(camera.to_world, float)[:3, :3]
    depth = np.ones(p.shape[1], np.float32)
    along: Array = axes[:, 2:].astype(np.float32)
    if camera.projection == "perspective":
        along = p - camera.origin
        depth = np.linalg.inv(axes)[2].astype(np.float32) @ along
        along = along / depth  # to the plane at depth 1
    cosine = dot(ng, along)
    along = along / np.copysign(np.maximum(np.abs(cosine), _LEAST_COSINE), cosine)
    gradients = []
    for across, of in ((np.cross(dpdv, ng, axis=0), dpdu), (np.cross(ng, dpdu, axis=0), dpdv)):
        slope = dot(across, of)
        gradients.append(across / np.copysign(np.maximum(np.abs(slope), TINY), slope))
    pixel = camera.pixel * camera.texture_filter
    steps = (axes[:, :2] * (pixel, -pixel)).astype(np.float32)
    moves = (depth * (step[:, None] - along * dot(ng, step[:, None])) for step in steps.T)
    x, y = (np.stack([dot(gradient, move) for gradient in gradients]) for move in moves)
    return x, y
