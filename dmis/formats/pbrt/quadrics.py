"""Tessellation of the spheres, cylinders and disks of a pbrt file by their error in pixels of the camera.

Between two points of a circle of radius r that are x radians apart, a chord is off by the sagitta r x^2 / 8. Seen from
the pinhole at distance d this is r x^2 / (8 d p) pixels, where p is the side of a pixel at distance 1 (in the corner of
the image, where it is smallest). So there must be

    n(x) = sqrt(r / (8 d(x) p e))

lines per radian for an error of e pixels, within bounds. Lines are dense where the quadric is near: the integral of n
is bounded for every distance, so that the ground of a huge sphere costs some 10^5 triangles. The distance counts in all
directions, also behind the camera, since a plane mirror makes the way only longer.

A shadow or a curved mirror can magnify the error of a shape that is small in the image, so there is a least number of
lines, too: an even share of `TRIANGLE_BUDGET` for each quadric.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dmis.base.vectors import Floats, distinct
from dmis.geometry.shapes import Quadric
from dmis.scene.camera import Camera

TRIANGLE_BUDGET = 2**21
"""Most triangles of all quadrics of a scene, unless the least number of lines makes more: some 0.7 GB."""
TARGET_ERROR = 1 / 32
"""Error of quadrics in pixels, if `TRIANGLE_BUDGET` allows it."""
VISIBLE_ERROR = 1 / 4
"""Error of quadrics in pixels from which on a warning names it."""
SEGMENTS = 16, 128, 256
"""Least number of lines around a full circle; largest number in the even grid of a sphere; largest number in the even
grid of a cylinder or disk, whose cells are in one row."""
MIN_DISTANCE = 1e-9
"""Least distance from the pinhole, in radii: a surface may go through it."""
LAMP_SEGMENTS = 256
"""Lines around a full circle of the finest sphere that emits."""
FAR_BEHIND = 1e6
"""Distance behind an orthographic camera, in units of camera space, from which a pinhole sees nearly the same."""
_OFFSETS = np.concatenate([[0], np.geomspace(MIN_DISTANCE, np.pi, 48)])
"""Radians from the point nearest to the camera, in geometric steps of 1.6."""


@dataclass(frozen=True, eq=False)
class Lines:
    """Choice of the lines u or v of a quadric, from 0 to 1.

    Attributes
    ----------
    samples
        Places from 0 to 1, (A,).
    square
        Error in pixels between neighbouring lines at each sample, over the square of their distance, (A,).
    least, most
        Bounds of the number of intervals, if they are even.
    """

    samples: Floats
    square: Floats
    least: int
    most: float

    def sums(self, error: float) -> tuple[Floats, float]:
        """Return the number of intervals up to each sample for an error in pixels, (A,), and the largest error."""
        density = np.clip(np.sqrt(self.square / error), self.least, self.most)
        steps = (density[1:] + density[:-1]) / 2 * np.diff(self.samples)
        return np.concatenate([[0], np.cumsum(steps)]), float((self.square / density**2).max())

    def place(self, error: float) -> Floats:
        """Return the lines for an error in pixels; they are even where the least number is enough."""
        if self.square.max() <= error * self.least**2:
            return np.linspace(0, 1, self.least + 1)
        sums, _ = self.sums(error)
        return np.interp(np.linspace(0, sums[-1], int(np.ceil(sums[-1])) + 1), sums, self.samples)


def choose_grids(
    quadrics: Sequence[tuple[Quadric, Floats, bool]], camera: Camera, most: int
) -> list[tuple[Floats, Floats, float]]:
    """Return lines u (A,) and v (B,) of quadrics, given with matrices (4, 4) to world space; their errors in pixels.

    The third entry of a quadric says whether it is a lamp that is sampled as a sphere. Its triangles must stay inside
    the sphere, by more than the rounding of distances to its rim, or they occlude its light samples: no lines are
    closer than those of `LAMP_SEGMENTS`.

    All have the error `TARGET_ERROR`, or the least one whose triangles fit in `TRIANGLE_BUDGET` and in `most`.
    """
    if camera.projection == "orthographic":  # a pinhole far behind it
        back, half = np.eye(4), np.tan(np.radians(camera.fov) / 2) / FAR_BEHIND
        back[2, 3] = -FAR_BEHIND
        fov = float(np.degrees(2 * np.arctan(half)))
        camera = replace(camera, to_world=camera.to_world @ back, fov=fov, projection="perspective")
    budget = max(min(TRIANGLE_BUDGET, most), 1)
    axes = [
        _axes(quadric, np.linalg.inv(np.asarray(camera.to_world, float)) @ matrix, camera, budget / len(quadrics), lamp)
        for quadric, matrix, lamp in quadrics
    ]
    limit = max(budget, sum(2.0 * u.least * v.least for u, v in axes))
    error = TARGET_ERROR
    while (total := sum(2 * u.sums(error)[0][-1] * v.sums(error)[0][-1] for u, v in axes)) > limit:
        error *= max(1.1, total / limit)
    return [(u.place(error), v.place(error), max(u.sums(error)[1], v.sums(error)[1])) for u, v in axes]


def _axes(quadric: Quadric, to_camera: Floats, camera: Camera, share: float, lamp: bool) -> tuple[Lines, Lines]:
    """Return the lines u and v of a quadric, whose least grid has at most `share` triangles, within `SEGMENTS`."""
    least, round_most, straight_most = SEGMENTS
    segments = np.clip(share**0.5, least, round_most) if quadric.arc else np.clip(share / 2, least, straight_most)
    turn, (even_u, even_v) = np.radians(quadric.phimax), quadric.lines(int(segments))
    finest = [len(lines) - 1 if lamp else np.inf for lines in quadric.lines(LAMP_SEGMENTS)]
    linear = to_camera[:3, :3]
    stretches = np.linalg.svd(linear, compute_uv=False)
    width, height = camera.frame or camera.resolution
    corner = 1 + (camera.pixel / 2) ** 2 * (width**2 + height**2)
    # Perspective makes things 1 / cos^2 as large in the corner, and a matrix makes the sagitta longer, the distance
    # shorter at most in the ratio of its stretches. A grid along two axes has half of the error along each.
    scale = corner * stretches[0] / stretches[-1] / (8 * camera.pixel) * (2 if quadric.arc else 1)
    u, v, near_u, near_v = _nearness(quadric, np.asarray(-np.linalg.solve(linear, to_camera[:3, 3]), np.float64))
    return (
        Lines(u, near_u * scale * turn**2, len(even_u) - 1, finest[0]),
        Lines(v, near_v * scale * quadric.arc**2, len(even_v) - 1, finest[1]),
    )


def _nearness(quadric: Quadric, eye: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return samples of u (A,) and v (B,), and there the largest r / d with the radius r of the line's circle."""
    turn, axial = np.radians(quadric.phimax), float(np.hypot(eye[0], eye[1]))
    if quadric.arc:
        nearest, offsets = (quadric.start - np.arctan2(axial, eye[2])) / quadric.arc, _OFFSETS / quadric.arc
    else:  # the foot of the perpendicular
        (near, _, low), (far, _, high) = quadric.at(np.zeros((1, 2)), np.array([[0.0, 1.0]]))[0][0]
        along = far - near, high - low
        nearest = ((axial - near) * along[0] + (eye[2] - low) * along[1]) / (along[0] ** 2 + along[1] ** 2)
        offsets = np.linspace(0, 1, 17) * max(1.0, abs(nearest))
    v = distinct(np.clip([nearest - offsets, nearest + offsets], 0, 1))
    radius, _, height = quadric.at(np.zeros((1, len(v))), v[None])[0][0].T
    # The nearest azimuth is reached from both ends of the sweep.
    azimuth = np.arctan2(eye[1], eye[0])
    nearby = [azimuth + 2 * np.pi * k + sign * _OFFSETS for k in (-1, 0, 1) for sign in (-1, 1)]
    phi = distinct(np.clip(nearby, 0, turn))
    # d^2 = (rho - r)^2 + (z - h)^2 + 4 rho r sin^2(x / 2) from (rho, z) to a circle, at x radians of azimuth
    straight = (axial - radius) ** 2 + (eye[2] - height) ** 2
    square = straight + 4 * axial * radius * np.sin((phi - azimuth)[:, None] / 2) ** 2
    distance, closest = (np.maximum(np.sqrt(d), MIN_DISTANCE * quadric.radius) for d in (square, straight))
    return phi / turn, v, (radius / distance).max(axis=1), quadric.radius / closest
