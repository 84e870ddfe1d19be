"""Tessellation of the spheres, cylinders and disks of a pbrt file by their error in pixels of the camera.

Between two points of a circle of radius r that are x radians apart, a chord is off by the sagitta r x^2 / 8. Seen from
the pinhole at distance d this is r x^2 / (8 d p) pixels, where p is the side of a pixel at distance 1 (in the corner of
the image, where it is smallest). So there must be

    n(x) = sqrt(r / (8 d(x) p e))

lines per radian for an error of e pixels. Lines are dense where the quadric is near: the integral of n is bounded for
every distance, so that the ground of a huge sphere costs some 10^5 triangles. The distance counts in all directions,
also behind the camera, since a plane mirror makes the way only longer.

A shadow or a curved mirror can magnify the error of a shape that is small in the image, so there is a least number of
lines, too: an even share of `TRIANGLE_BUDGET` for each quadric.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dmis.base.vectors import Floats
from dmis.geometry.shapes import Quadric
from dmis.scene.camera import Camera

TRIANGLE_BUDGET = 2**21
"""Triangles of all quadrics of a scene, unless `MAX_ERROR` needs more: some 0.7 GB."""
TARGET_ERROR = 1 / 32
"""Error of quadrics in pixels, if `TRIANGLE_BUDGET` allows it."""
MAX_ERROR = 1 / 4
"""Error of quadrics in pixels from which on more triangles than `TRIANGLE_BUDGET` are spent."""
SEGMENTS = 16, 128, 256
"""Least number of lines around a full circle; largest number in the even grid of a sphere; largest number in the even
grid of a cylinder or disk, whose cells are in one row."""
MIN_DISTANCE = 1e-9
"""Least distance from the pinhole, in radii: a surface may go through it."""
LAMP_SEGMENTS = 256
"""Lines around a full circle of the finest sphere that emits."""
_OFFSETS = np.concatenate([[0], np.geomspace(MIN_DISTANCE, np.pi, 48)])
"""Radians from the point nearest to the camera, in geometric steps of 1.6."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Lines u (A,) and v (B,) of a tessellation, with its largest error in pixels and in radii."""

    u: Floats
    v: Floats
    pixels: float
    radii: float

    @property
    def triangles(self) -> int:
        """Number of triangles; those at poles have no area and are dropped."""
        return 2 * (len(self.u) - 1) * (len(self.v) - 1)


def choose_grids(quadrics: Sequence[tuple[Quadric, Floats, bool]], camera: Camera, most: int) -> list[Grid]:
    """Return the grids of quadrics, given with their matrices (4, 4) to world space, of the least error in pixels.

    The third entry of a quadric says whether it is a lamp that is sampled as a sphere. Its triangles must stay inside
    the sphere, by more than the rounding of distances to its rim, or they occlude its light samples: no lines are
    closer than those of `LAMP_SEGMENTS`.

    All have the error `TARGET_ERROR` if the grids fit in `TRIANGLE_BUDGET`, else a larger one that fits, up to
    `MAX_ERROR`. Beyond it more triangles are spent, up to `most`, and then the error grows again.
    """
    if not quadrics:
        return []
    budget = max(min(TRIANGLE_BUDGET, most), 1)
    views = [_View(quadric, matrix, camera, budget / len(quadrics), lamp) for quadric, matrix, lamp in quadrics]
    least = sum(view.grid(np.inf).triangles for view in views)
    error, limit = TARGET_ERROR, max(budget, least)
    while True:
        grids = [view.grid(error) for view in views]
        total = sum(grid.triangles for grid in grids)
        if total <= limit:
            return grids
        if error < MAX_ERROR:
            error = min(error * max(1.1, total / limit), MAX_ERROR)
        elif limit < most:
            limit = most
        else:
            error *= max(1.1, total / limit)


class _View:
    """A quadric seen by a camera, with its coarsest grid: an even one of `share` triangles, within `SEGMENTS`."""

    def __init__(self, quadric: Quadric, matrix: Floats, camera: Camera, share: float, lamp: bool) -> None:
        least, round_most, straight_most = SEGMENTS
        segments = np.clip(share**0.5, least, round_most) if quadric.arc else np.clip(share / 2, least, straight_most)
        self.lamp = quadric.lines(LAMP_SEGMENTS) if lamp else None
        self.quadric, self.even = quadric, quadric.lines(int(segments))
        to_camera = np.linalg.inv(np.asarray(camera.to_world, float)) @ matrix
        linear: Floats = to_camera[:3, :3]
        eye = np.asarray(-np.linalg.solve(linear, to_camera[:3, 3]), np.float64)
        stretches = np.linalg.svd(linear, compute_uv=False)
        width, height = camera.frame or camera.resolution
        corner = 1 + (camera.pixel / 2) ** 2 * (width**2 + height**2)
        # Perspective makes things 1 / cos^2 as large in the corner, and a matrix makes the sagitta longer, the distance
        # shorter at most in the ratio of its stretches.
        self.scale = corner * stretches[0] / stretches[-1] / (8 * camera.pixel)
        self.u, self.v, self.near_u, self.near_v = self._nearness(eye)

    def _nearness(self, eye: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return samples of u (A,) and v (B,), and there the largest r / d with the radius r of the line's circle."""
        quadric, turn = self.quadric, np.radians(self.quadric.phimax)
        axial = float(np.hypot(eye[0], eye[1]))
        (near, _, low), (far, _, high) = quadric.at(np.zeros((1, 2)), np.array([[0.0, 1.0]]))[0][0]
        if quadric.arc:
            nearest, offsets = (quadric.start - np.arctan2(axial, eye[2])) / quadric.arc, _OFFSETS / quadric.arc
        else:  # the foot of the perpendicular
            along = far - near, high - low
            nearest = ((axial - near) * along[0] + (eye[2] - low) * along[1]) / (along[0] ** 2 + along[1] ** 2)
            offsets = np.linspace(0, 1, 17) * max(1.0, abs(nearest))
        v = np.unique(np.clip([nearest - offsets, nearest + offsets], 0, 1))
        circles = quadric.at(np.zeros((1, len(v))), v[None])[0][0]
        radius, height = circles[:, 0], circles[:, 2]
        # The nearest azimuth is reached from both ends of the sweep.
        azimuth = np.arctan2(eye[1], eye[0])
        angles = [azimuth + 2 * np.pi * k + sign * _OFFSETS for k in (-1, 0, 1) for sign in (-1, 1)]
        phi = np.unique(np.clip(angles, 0, turn))
        # d^2 = (rho - r)^2 + (z - h)^2 + 4 rho r sin^2(x / 2) from (rho, z) to a circle, at x radians of azimuth
        least = MIN_DISTANCE * quadric.radius
        straight = (axial - radius) ** 2 + (eye[2] - height) ** 2
        distance = np.sqrt(straight + 4 * axial * radius * np.sin((phi - azimuth)[:, None] / 2) ** 2)
        near_u = (radius / np.maximum(distance, least)).max(axis=1)
        return phi / turn, v, near_u, quadric.radius / np.maximum(np.sqrt(straight), least)

    def grid(self, error: float) -> Grid:
        """Return the grid of `error` pixels, or the even grid if its error is less, or the lamp's if it is coarser."""
        turn, arc = np.radians(self.quadric.phimax), self.quadric.arc
        square_u, square_v = self.near_u * self.scale * turn**2, self.near_v * self.scale * arc**2
        share = error / 2 if arc else error  # of the errors along u and along v
        u, pixels = _place_lines(self.u, square_u, share, self.even[0])
        v, more = _place_lines(self.v, square_v, share, self.even[1])
        if self.lamp is not None and (_are_closer(u, self.lamp[0]) or _are_closer(v, self.lamp[1])):
            u, v = self.lamp
            pixels, more = float(square_u.max() * u[1] ** 2), float(square_v.max() * v[1] ** 2)
        radii = 1 - np.cos(turn * np.diff(u).max() / 2) * np.cos(arc * np.diff(v).max() / 2)
        return Grid(u, v, pixels + more, float(radii))


def _are_closer(lines: Floats, even: Floats) -> bool:
    """Return whether some lines are closer than those of an even grid."""
    return bool(np.diff(lines).min() < 0.999 * even[1])


def _place_lines(samples: Floats, square: Floats, error: float, even: Floats) -> tuple[Floats, float]:
    """Return lines from 0 to 1 with at most `error` pixels between neighbours, the `even` ones if possible; the error.

    The error between lines of distance x is `square` (A,) times x^2 at the samples (A,).
    """
    step = 1 / (len(even) - 1)
    largest = float(square.max()) * step**2
    if largest <= error:
        return even, largest
    density = np.maximum(np.sqrt(square / error), 1 / step)
    sums = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(samples))])
    return np.interp(np.linspace(0, sums[-1], int(np.ceil(sums[-1])) + 1), sums, samples), error
