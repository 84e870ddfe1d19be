"""Bodies of a mesh, whose sizes say whether rays begin too far off their surfaces (`dmis.scene.doubts`)."""

from __future__ import annotations

import numpy as np

from dmis.base.vectors import Floats
from dmis.geometry.mesh import Mesh

JOINED_RATIO = 250
"""Ratio of the sizes of triangles from which a mesh may be several bodies, such as a ground and what stands on it."""


def bodies(mesh: Mesh) -> Floats:
    """Return the bounds of the bodies that a mesh consists of, least and largest coordinates ``(B, 2, 3)``.

    A mesh whose triangles are alike is one body. Where some are `JOINED_RATIO` times as large as others, as in a file
    that joins a ground with what stands on it, triangles that share corners are a body.
    """
    smallest, largest = mesh.edges
    if not largest > JOINED_RATIO * smallest:
        return np.array(mesh.bounds)[None]
    from trimesh.graph import connected_component_labels  # only such meshes need it

    corner = np.unique(mesh.vertices, axis=0, return_inverse=True)[1].ravel()[mesh.faces]
    label = connected_component_labels(np.concatenate([corner[:, :2], corner[:, 1:]]))[corner[:, 0]]
    order = np.argsort(label, kind="stable")
    triangles, first = mesh.vertices[mesh.faces[order]], np.unique(label[order], return_index=True)[1]
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    return np.stack([np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)], axis=1)
