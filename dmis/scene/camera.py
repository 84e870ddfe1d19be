"""Cameras: pixels and uniform numbers to rays, through a pinhole, a thin lens, in parallel, or in all directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from dmis.base.validate import FARTHEST, direction, number, one_of, pair, whole
from dmis.base.vectors import TINY, Array, dot, normalise
from dmis.base.window import Window, check_size, window_area
from dmis.geometry import transforms
from dmis.geometry.mesh import Mesh
from dmis.samplers.pixel_filter import PixelFilter
from dmis.samplers.warp import square_to_disk

POSITION_ERROR = 2.0**-18
"""Share of the largest coordinate by which positions may be off, many times that of float32."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera with a pinhole or a thin lens, or one of another projection.

    Parameters
    ----------
    to_world
        4x4 matrix from camera space (x right in the image, y up, z forward) to world space. Its determinant may
        have either sign: pbrt's cameras are left-handed.
    fov
        Full angle in degrees across the shorter side of the image, in (0, 180).
    resolution
        ``(width, height)`` in pixels.
    corner, frame
        For a part of a larger image (`crop` makes one): column and row of its top left pixel there, and the larger
        image's ``(width, height)``, across whose shorter side `fov` is meant. None: this is the whole.
    filter
        Pixel filter, see `dmis.samplers.pixel_filter`; None: a box of one pixel.
    projection
        ``perspective``; ``orthographic``, whose shorter side shows ``2 tan(fov / 2)`` units of camera space; or
        ``spherical``, all directions: rows are polar angles from the top, columns azimuths from x over z.
    lens_radius
        Of a thin lens, in units of camera space; 0 is a pinhole. A spherical camera has none.
    focal_distance
        Depth along z, in units of camera space, at which a lens is sharp.
    """

    to_world: Array
    fov: float
    resolution: tuple[int, int]
    corner: tuple[int, int] = (0, 0)
    frame: tuple[int, int] | None = None
    filter: PixelFilter | None = None
    projection: Literal["perspective", "orthographic", "spherical"] = "perspective"
    lens_radius: float = 0.0
    focal_distance: float = 1.0

    def __post_init__(self) -> None:
        matrix = np.asarray(self.to_world, float)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or np.linalg.det(matrix[:3, :3]) == 0:
            raise ValueError(f"to_world must be a finite invertible 4x4 matrix; got {matrix.tolist()}")
        if np.abs(matrix[:3]).max() > FARTHEST:
            raise ValueError(f"to_world must not have elements above {FARTHEST:g}, in float32; got {matrix.tolist()}")
        if not 0 < self.fov < 180:
            raise ValueError(
                f"fov must be between 0 and 180 degrees, because a pinhole sees less than half; got {self.fov}"
            )
        one_of("projection", self.projection, ("perspective", "orthographic", "spherical"))
        number("lens_radius", self.lens_radius, 0, FARTHEST)
        number("focal_distance", self.focal_distance, 1 / FARTHEST, FARTHEST)
        if self.lens_radius and self.projection == "spherical":
            raise ValueError(f"lens_radius must be 0 for a spherical camera; got {self.lens_radius}")
        for name in ("resolution", "corner") if self.frame is None else ("resolution", "corner", "frame"):
            object.__setattr__(self, name, pair(name, getattr(self, name), whole))
        width, height = self.resolution
        check_size(width, height)
        left, top = self.corner
        wide, high = self.frame or self.resolution
        if not (0 <= left <= wide - width and 0 <= top <= high - height):
            raise ValueError(
                f"a crop must lie inside its frame of {wide}x{high}; got {width}x{height} at column {left}, row {top}"
            )

    def crop(self, window: Sequence[int] = (), *columns: Any, **old: Any) -> Camera:
        """Return a camera of a window ``(x0, y0, x1, y1)`` of this one's image; the last two are excluded.

        A ValueError if it is another notation, such as rows and columns, empty, or not inside of the image.
        """
        rows, of_columns = window_area((window, columns) if columns else old or window, self.resolution)
        corner = self.corner[0] + of_columns.start, self.corner[1] + rows.start
        resolution = of_columns.stop - of_columns.start, rows.stop - rows.start
        return replace(self, resolution=resolution, corner=corner, frame=self.frame or self.resolution)

    @property
    def window(self) -> Window:
        """The window of the larger image that this one shows, or of the whole."""
        (x0, y0), (width, height) = self.corner, self.resolution
        return x0, y0, x0 + width, y0 + height

    @property
    def uncropped(self) -> Camera:
        """The camera of the larger image that this one shows a part of; itself, if it shows the whole."""
        return self if self.frame is None else replace(self, resolution=self.frame, corner=(0, 0), frame=None)

    @classmethod
    def look_at(
        cls,
        eye: tuple[float, float, float],
        target: tuple[float, float, float],
        up: tuple[float, float, float] = (0.0, 0.0, 1.0),
        fov: float = 45.0,
        resolution: tuple[int, int] = (640, 480),
    ) -> Camera:
        """Return a right-handed camera at `eye` that looks at `target` (what a photograph would show)."""
        left, upwards, forward = transforms.look_at(eye, target, up)[:3, :3]
        matrix = np.eye(4)
        matrix[:3] = np.stack([-left, upwards, forward, eye], axis=1)
        return cls(matrix, fov, resolution)

    @classmethod
    def fit(
        cls,
        meshes: Sequence[Mesh],
        up: tuple[float, float, float] = (0.0, 0.0, 1.0),
        fov: float = 40.0,
        resolution: tuple[int, int] = (640, 480),
    ) -> Camera:
        """Return a camera that looks down at all of `meshes` from an oblique angle, to their front and right.

        The axis `up` points up in the image. The meshes are in its middle and fill 0.9 of its shorter side.
        """
        points = np.concatenate([mesh.vertices[np.unique(mesh.faces)] for mesh in meshes])
        centre = (points.min(axis=0) + points.max(axis=0)) / 2
        axis = direction("up", up)
        side = np.cross(axis, (0, 0, 1) if abs(axis[2]) < 0.9 else (0, -1, 0))
        away = direction("away", 0.45 * side + 0.48 * axis + 0.75 * np.cross(side, axis))
        right = direction("right", np.cross(axis, away))
        across = np.stack([right, np.cross(away, right)])
        for _ in range(4):  # perspective moves the middle
            places = across @ (points - centre).T
            nearer = (points - centre) @ away
            distance = (np.abs(places).max(axis=0) / (0.9 * np.tan(np.radians(fov / 2))) + nearer).max()
            seen = places / (distance - nearer)
            centre = centre + distance / 2 * (seen.max(axis=1) + seen.min(axis=1)) @ across
        return cls.look_at(tuple((centre + distance * away).tolist()), tuple(centre.tolist()), up, fov, resolution)

    @cached_property
    def origin(self) -> Array:
        """The pinhole, ``(3, 1)`` float32."""
        return np.asarray(self.to_world, float)[:3, 3:].astype(np.float32)

    @cached_property
    def _affine(self) -> tuple[Array, Array, Array]:
        """Direction of pixel coordinates (x, y) as ``a + b x + c y``, if the camera is a pinhole."""
        if not self.is_pinhole:
            raise ValueError("rays needs a pinhole; lens_rays returns origins and directions of any camera")
        width, height = self.frame or self.resolution
        right, up, forward = np.asarray(self.to_world, float)[:3, :3].T
        b = right * self.pixel
        c = -up * self.pixel
        a = forward - b * (width / 2 - self.corner[0]) - c * (height / 2 - self.corner[1])
        return a, b, c

    @cached_property
    def is_pinhole(self) -> bool:
        """Whether it is a perspective one without a lens, whose rays are those of `rays`."""
        return self.lens_radius == 0 and self.projection == "perspective"

    @property
    def pixel(self) -> float:
        """Side of a pixel at distance 1, in camera space; of an orthographic camera at any, of a spherical at least."""
        width, height = self.frame or self.resolution
        if self.projection == "spherical":
            return float(min(2 * np.pi / width, np.pi / height))
        return float(2 * np.tan(np.radians(self.fov) / 2) / min(width, height))

    def raster(self, points: Array) -> tuple[Array, Array, Array, float]:
        """Return raster coordinates x and y and depth of the points ``(N, 3)``, each ``(N,)``; and how much
        longer than in the world a length may be there. Behind the camera x and y mean nothing."""
        width, height = self.frame or self.resolution
        matrix = np.linalg.inv(np.asarray(self.to_world, float)[:3, :3])
        right, up, depth = matrix @ (np.asarray(points, float) - np.asarray(self.to_world, float)[:3, 3]).T
        with np.errstate(divide="ignore", invalid="ignore"):  # at the camera itself x and y mean nothing either
            x = width / 2 - self.corner[0] + right / (depth * self.pixel)
            y = height / 2 - self.corner[1] - up / (depth * self.pixel)
        return x, y, depth, float(np.linalg.norm(matrix, 2))

    def covered_pixels(self, meshes: Sequence[Mesh]) -> np.ndarray | None:
        """Return the pixels that triangles of `meshes` may cover, ``(H, W)`` bool; None if that is all of them.

        Only what is provable counts. A pixel is left out if it lies outside the bounds of every triangle in the image,
        with room for the pixel filter and for the rounding of float32 positions and directions. A triangle that reaches
        behind the camera covers everything, and so it is for any camera but a pinhole.
        """
        if not self.is_pinhole:
            return None
        width, height = self.resolution
        size = np.array([[width], [height]])
        reach = 0.0 if self.filter is None else max(self.filter.radius)
        begins = np.zeros((height + 1, width + 1), np.int32)  # its sums over rows and columns count rectangles
        for mesh in meshes:
            error = POSITION_ERROR * max(np.abs(mesh.vertices).max(), np.abs(self.origin).max())
            x, y, depth, scale = self.raster(mesh.vertices)
            near = error * scale  # of camera space, where lengths may differ from the world's
            ahead = depth > -near
            faces = mesh.faces if ahead.all() else mesh.faces[ahead[mesh.faces].any(axis=1)]
            if (depth <= near)[faces].any():
                return None
            places, corners = np.stack([x, y]), faces.T  # a minimum over the last axis of 3 is slow
            margin = 1 + reach + near / (depth * self.pixel)
            # rectangles outside of the image have no extent
            left, top = np.floor(np.clip((places - margin)[:, corners].min(axis=1), 0, size)).astype(np.int64)
            right, bottom = np.ceil(np.clip((places + margin)[:, corners].max(axis=1), 0, size)).astype(np.int64)
            for row, column, step in ((top, left, 1), (top, right, -1), (bottom, left, -1), (bottom, right, 1)):
                np.add.at(begins.reshape(-1), row * (width + 1) + column, np.int32(step))  # in one axis: fast
        covered = begins.cumsum(axis=0).cumsum(axis=1)[:-1, :-1] > 0
        return None if covered.all() else covered

    def rays(self, x: Array, y: Array) -> Array:
        """Return unit directions ``(3, N)`` through raster points (x, y), ``(N,)``; (0, 0) is the top left corner."""
        a, b, c = (v.astype(np.float32)[:, None] for v in self._affine)
        out = x * b
        out += y * c
        out += a
        out *= 1 / np.sqrt(np.maximum(dot(out, out), TINY))
        return out

    def lens_rays(self, x: Array, y: Array, u: Array | None = None) -> tuple[Array, Array]:
        """Return origins and unit directions of rays through raster points (x, y), ``(3, N)`` each, of any camera.

        Uniform numbers `u` ``(2, N)`` place the origins on the lens; None: in its middle.
        """
        axes = np.asarray(self.to_world, float)[:3, :3].astype(np.float32)
        width, height = self.frame or self.resolution
        left, top = self.corner
        origin = np.repeat(self.origin, len(x), axis=1)
        if self.projection == "spherical":
            phi = (x + left) * np.float32(2 * np.pi / width)
            theta = (y + top) * np.float32(np.pi / height)
            along = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)])
            return origin, normalise(axes @ along)
        side = np.float32(self.pixel)
        place = np.stack([(x + np.float32(left - width / 2)) * side, (np.float32(height / 2 - top) - y) * side])
        if self.projection == "orthographic":
            origin += axes[:, :2] @ place
            place = np.zeros_like(place)
        if u is not None:
            offset = square_to_disk(u) * np.float32(self.lens_radius)
            origin += axes[:, :2] @ offset
            place -= offset * np.float32(1 / self.focal_distance)
        return origin, normalise(axes[:, :2] @ place + axes[:, 2:])
