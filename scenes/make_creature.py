"""Model the creature of the clay and gold scenes and write it as a Loop subdivision cage.

What: an original, horned, kangaroo-like dragon, about 400 units long from the tip of its tail to its muzzle, that
stands on the floor z = -140 and looks along +y.  The result is `geometry/creature.pbrt`: one closed triangle mesh of
about 5,000 vertices, to be refined three times by Loop subdivision.

How:
  1. anatomy    - the body is a list of parts (bones, muscles, horns, claws, ...).  A part is a tube with varying
                  radius along a spline, or an ellipsoid; parts are joined (or carved) one after another by a smooth
                  minimum, which yields one scalar field that is negative inside and close to a distance near zero.
  2. dense mesh - marching tetrahedra on a regular grid; the vertices are then put onto the zero set by Newton steps.
  3. sizing     - the turning rate of the normals gives every place a wanted edge length: small in the face, the hands
                  and the feet, large on tail and belly; one factor is solved for such that the count is as wanted.
  4. remeshing  - edge splits, collapses and flips, and relaxation within the surface, until the edges are of the
                  wanted lengths and the valences near six.  All steps are data parallel (independent sets of edges).
  5. fitting    - a Loop surface lies inside its cage, so the cage is grown until its limit points are on the zero set.

Why: the usual test creature may not be redistributed.  This one is made from nothing but the numbers below.

Run `python scenes/make_creature.py`; it needs numpy and scipy, takes about one minute and always writes the same file.
"""

from __future__ import annotations

import time
from itertools import permutations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

OUTPUT = Path(__file__).resolve().parent / "geometry" / "creature.pbrt"
FLOOR = -140.0
SINK = 1.0  # how deep the soles reach into the floor
GRID_STEP = 1.4  # of the dense mesh
FAR = 9.0  # value of the field far from all parts
TARGET_TRIANGLES = 13000
EDGE_RANGE = (1.3, 7.5)  # shortest and longest wanted edge


# ---------------------------------------------------------------------------------------------------------------------
# Parts: tubes and ellipsoids
# ---------------------------------------------------------------------------------------------------------------------


class Part(NamedTuple):
    """Balls of varying radius along a polyline, seen through a linear map (to flatten them)."""

    points: np.ndarray  # (n, 3) polyline in mapped space
    radii: np.ndarray  # (n,) radius at each point, in mapped space
    mapping: np.ndarray  # (3, 3) world -> mapped space
    blend: float  # width of the smooth join with all that came before
    carve: bool  # remove rather than add
    low: np.ndarray  # box outside of which the part has no influence
    high: np.ndarray


def unit(vector):
    vector = np.asarray(vector, float)
    return vector / np.linalg.norm(vector)


def spline(values, steps):
    """Catmull-Rom interpolation of the rows of `values`, `steps` pieces per span."""
    values = np.asarray(values, float)
    if len(values) < 3:
        t = np.linspace(0.0, 1.0, steps + 1)[:, None]
        return values[0] * (1 - t) + values[-1] * t
    padded = np.vstack([2 * values[0] - values[1], values, 2 * values[-1] - values[-2]])
    t = (np.arange(steps) / steps)[:, None]
    pieces = []
    for a, b, c, d in zip(padded, padded[1:], padded[2:], padded[3:]):
        pieces.append(b + t * ((c - a) / 2 + t * ((a - 2.5 * b + 2 * c - d / 2) + t * ((3 * (b - c) + d - a) / 2))))
    return np.vstack([*pieces, values[-1:]])


def make_part(points, radii, mapping, blend, carve):
    inverse = np.linalg.inv(mapping)
    reach = np.outer(radii, np.linalg.norm(inverse, axis=1)) + blend + 2.5 * GRID_STEP
    centres = points @ inverse.T
    return Part(points, radii, mapping, blend, carve, (centres - reach).min(0), (centres + reach).max(0))


def tube(points, radii, blend=3.0, carve=False, flat=None, steps=6):
    """A spline tube; flat = (direction, factor) squeezes its section along one direction."""
    path = spline(np.column_stack([points, radii]), steps)
    mapping = np.eye(3)
    if flat is not None:
        direction = unit(flat[0])
        mapping += (1.0 / flat[1] - 1.0) * np.outer(direction, direction)
    return make_part(path[:, :3] @ mapping.T, np.maximum(path[:, 3], 0.05), mapping, blend, carve)


def ball(centre, radii, axes=None, blend=3.0, carve=False):
    """An ellipsoid; the rows of `axes` are the directions of its three radii."""
    axes = np.eye(3) if axes is None else np.asarray(axes, float)
    mapping = axes / np.asarray(radii, float)[:, None]
    return make_part((mapping @ np.asarray(centre, float))[None], np.ones(1), mapping, blend, carve)


def muscle(start, end, bulge, radius, ends=0.45, blend=2.5, peak=0.45):
    """A spindle from origin to insertion whose belly is pushed out by the vector `bulge`."""
    start, end, bulge = (np.asarray(x, float) for x in (start, end, bulge))
    places = np.array([0.0, 0.5 * peak, peak, 0.5 + 0.5 * peak, 1.0])[:, None]
    lift = np.array([0.0, 0.75, 1.0, 0.7, 0.0])[:, None]
    thickness = radius * np.array([ends, 0.5 + 0.5 * ends + 0.2, 1.0, 0.5 + 0.5 * ends + 0.08, ends])
    return tube(start + places * (end - start) + lift * bulge, thickness, blend, steps=4)


def nearest_pieces(part, q):
    """Which pieces of the polyline can be the nearest one of any of the points q."""
    if len(part.points) == 1:
        return np.zeros(0, int)
    centre = q.mean(0)
    spread = np.sqrt(((q - centre) ** 2).sum(1).max())
    a, b = part.points[:-1], part.points[1:]
    away = np.sqrt(((0.5 * (a + b) - centre) ** 2).sum(1))
    half = 0.5 * np.sqrt(((b - a) ** 2).sum(1))
    ra, rb = part.radii[:-1], part.radii[1:]
    return np.flatnonzero(away - half - np.maximum(ra, rb) - spread <= (away + spread - 0.5 * (ra + rb)).min())


def part_distance(part, p):
    """Approximate signed distance of the points p to one part."""
    q = p @ part.mapping.T
    if len(part.points) == 1:
        away = q - part.points[0]
        best = np.sqrt((away**2).sum(1)) - part.radii[0]
    else:
        piece = nearest_pieces(part, q)
        a, ra = part.points[piece], part.radii[piece]
        axis, rise = part.points[piece + 1] - a, part.radii[piece + 1] - ra
        square = np.maximum((axis**2).sum(1), 1e-12)
        centre = a.mean(0)  # differences from here keep the products accurate
        qc, ac = q - centre, a - centre
        dot = qc @ axis.T - (ac * axis).sum(1)
        t = np.clip(dot / square, 0.0, 1.0)
        squared = (qc**2).sum(1)[:, None] - 2.0 * qc @ ac.T + (ac**2).sum(1) + t * (t * square - 2.0 * dot)
        distance = np.sqrt(np.maximum(squared, 0.0)) - (ra + t * rise)
        winner = np.argmin(distance, axis=1)
        row = np.arange(len(q))
        best = distance[row, winner]
        away = q - a[winner] - t[row, winner][:, None] * axis[winner]
    length = np.sqrt((away**2).sum(1)) + 1e-9
    return best * length / (np.sqrt(((away @ part.mapping) ** 2).sum(1)) + 1e-9)


def join(parts, p):
    """Join the parts one after another at the points p."""
    value = np.full(len(p), FAR)
    for part in parts:
        near = np.flatnonzero(((p > part.low) & (p < part.high)).all(axis=1))
        if len(near) == 0:
            continue
        distance = part_distance(part, p[near])
        before = -value[near] if part.carve else value[near]
        overlap = np.maximum(part.blend - np.abs(before - distance), 0.0) / part.blend
        joined = np.minimum(before, distance) - overlap**3 * (part.blend / 6.0)
        value[near] = -joined if part.carve else joined
    return value


def field(parts, p, block=14.0):
    """The scalar field of the joined parts at the points p (negative inside), by blocks of neighbouring points."""
    cell = np.floor(p / block).astype(np.int64) @ np.array([1 << 40, 1 << 20, 1])
    order = np.argsort(cell, kind="stable")
    borders = np.flatnonzero(np.diff(cell[order])) + 1
    lows, highs = np.array([part.low for part in parts]), np.array([part.high for part in parts])
    value = np.empty(len(p))
    for chosen in np.split(order, borders):
        q = p[chosen]
        here = np.flatnonzero((lows < q.max(0)).all(axis=1) & (highs > q.min(0)).all(axis=1))
        value[chosen] = join([parts[i] for i in here], q)
    return value


def value_and_gradient(parts, p, step=0.04):
    """The field and its gradient from four samples at the corners of a tetrahedron."""
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float)
    samples = field(parts, (p + step * corners[:, None]).reshape(-1, 3)).reshape(4, -1)
    return samples.mean(0), samples.T @ corners / (4.0 * step)


def newton(parts, p, rounds=2, longest=0.5):
    """Newton steps along the gradient onto the zero set; also returns the last unit gradients."""
    slope = np.zeros_like(p)
    for _ in range(rounds):
        value, slope = value_and_gradient(parts, p)
        step = -(value / np.maximum((slope**2).sum(1), 0.05))[:, None] * slope
        size = np.linalg.norm(step, axis=1, keepdims=True)
        p = p + step * np.minimum(1.0, longest / np.maximum(size, 1e-12))
    return p, normalise(slope)


def march(parts, start, direction, longest=80.0):
    """Where a ray that starts inside leaves the body."""
    start, direction = np.asarray(start, float), unit(direction)
    t = np.arange(0.0, longest, 0.25)
    values = field(parts, start + t[:, None] * direction)
    return start + t[np.argmax(values > 0.0)] * direction


# ---------------------------------------------------------------------------------------------------------------------
# Anatomy (x to the creature's right, y forward, z up)
# ---------------------------------------------------------------------------------------------------------------------

SPINE = unit([0.0, 0.82, 0.57])  # direction of the trunk
DORSAL = unit([0.0, -0.57, 0.82])
TRUNK = np.array([[1.0, 0.0, 0.0], SPINE, DORSAL])
CHEST = np.array([0.0, 36.0, -22.0])
CHEST_RADII = np.array([24.0, 33.0, 25.0])

TAIL = np.array(
    [
        [0, -22, -62, 20],
        [0, -48, -70, 18.5],
        [3, -80, -88, 15.5],
        [11, -114, -104, 12.5],
        [22, -148, -111, 10],
        [26, -181, -104, 8],
        [17, -210, -88, 6.3],
        [0, -228, -68, 4.8],
        [-14, -232, -46, 3.4],
        [-16, -222, -28, 2.0],
    ],
    float,
)


def trunk_point(side, angle, along, scale=1.0):
    """A point on the rib cage: angle 0 is the back, 90 the flank and 180 the breast bone."""
    s = np.sqrt(max(0.0, 1.0 - (along / CHEST_RADII[1]) ** 2)) * scale
    a = np.radians(angle)
    return (
        CHEST
        + side * np.sin(a) * CHEST_RADII[0] * s * TRUNK[0]
        + along * SPINE
        + np.cos(a) * CHEST_RADII[2] * s * DORSAL
    )


def trunk():
    parts = [
        ball(CHEST, CHEST_RADII, TRUNK, blend=1.0),
        ball([0, 2, -47], [19, 32, 20], TRUNK, blend=10.0),
        ball([0, -26, -60], [23, 27, 20], [[1, 0, 0], unit([0, 0.95, 0.32]), unit([0, -0.32, 0.95])], blend=10.0),
        tube(TAIL[:, :3], TAIL[:, 3], blend=10.0, steps=10),
        tube([[0, 44, -12], [0, 66, 2], [1, 84, 8], [3, 99, 9]], [20, 17, 14, 12], blend=8.0),
    ]
    parts.append(tube([[0, 54, -22], [1, 72, -12], [2, 90, -2]], [11, 10, 9], blend=5.0))
    parts += [ball([side * 9, 66, -17], [9, 9, 9], blend=5.0) for side in (-1, 1)]
    for side in (-1, 1):
        # Long back muscles beside the spine, running out into the tail.
        parts.append(
            tube(
                [
                    [side * 7, 66, 14],
                    [side * 9, 46, 3],
                    [side * 9, 20, -14],
                    [side * 9, -4, -29],
                    [side * 9, -28, -42],
                    [side * 7.5 + 1, -56, -60],
                    [side * 6 + 3, -84, -79],
                ],
                [5, 6, 6.5, 7, 7.5, 6, 4],
                blend=3.5,
            )
        )
        # Ribs, slanting backwards as they go down.
        for i, along in enumerate((12, 4, -4, -12, -20)):
            angles = (58, 76, 94, 112, 126 - 3 * i)
            path = [trunk_point(side, angle, along - 0.10 * (angle - 58), 0.985) for angle in angles]
            parts.append(tube(path, [1.0, 2.2, 2.5, 2.3, 1.2], blend=2.6, steps=4))
        # Belly: a row of paired plates and the oblique muscle of the flank.
        for y, z in ((36, -24), (26, -31), (16, -37), (6, -43)):
            foot = march(parts, [side * 5.5, y, z], -DORSAL)
            parts.append(ball(foot + 2.6 * DORSAL, [6.6, 5.4, 4.4], TRUNK, blend=2.0))
        parts.append(
            muscle(trunk_point(side, 100, -22), [side * 17, -14, -58], [side * 2.5, 0, -1], 8.5, blend=3.5, ends=0.5)
        )
        # Broad back muscle from the loin to the arm pit, shoulder blade, hood muscle of the neck, breast.
        parts.append(
            muscle([side * 10, -4, -32], [side * 25, 50, -16], [side * 8, -3, 2], 10.0, ends=0.4, blend=3.0, peak=0.6)
        )
        parts.append(
            muscle([side * 11, 24, -3], [side * 24, 50, -9], [side * 2, -1, 0], 6.2, ends=0.6, blend=3.5, peak=0.55)
        )
        parts.append(
            muscle([side * 6, 86, 15], [side * 23, 55, -6], [side * 0, -2, 1], 5.5, ends=0.5, blend=4.5, peak=0.6)
        )
        parts.append(
            muscle([side * 5, 58, -34], [side * 28, 57, -15], [side * 1, 9, -2], 11.0, ends=0.6, blend=2.6, peak=0.4)
        )
        # Cords of the neck.
        parts.append(
            muscle([side * 13, 95, 4], [side * 6, 68, -18], [side * 2.5, 2, 1], 5.0, ends=0.7, blend=2.6, peak=0.5)
        )
        # Ridges along both sides of the tail.
        ridge = TAIL[1:8].copy()
        ridge[:, 0] += side * 0.62 * ridge[:, 3]
        ridge[:, 2] += 0.1 * ridge[:, 3]
        parts.append(tube(ridge[:, :3], 0.45 * ridge[:, 3], blend=3.0, steps=8))
    return parts


def digit(joints, radii, claw, blend=2.2):
    """A finger or toe: bones along `joints`, thickened at the knuckles, with a curved claw along the points `claw`."""
    joints = np.asarray(joints, float)
    parts = [tube(joints, radii, blend, steps=5)]
    for joint, radius in zip(joints[1:-1], radii[1:-1]):
        parts.append(ball(joint + [0, 0, 0.22 * radius], [1.06 * radius] * 3, blend=blend))
    end = radii[-1]
    parts.append(tube(claw, [0.84 * end, 0.74 * end, 0.52 * end, 0.33 * end], blend=0.9, steps=5))
    return parts


def leg(side, hip, knee, ankle, foot, heading):
    """Hind leg: foot is the ball of the foot, `heading` the direction of the middle toe in degrees from +y to +x."""
    hip, knee, ankle, foot = (np.asarray(x, float) for x in (hip, knee, ankle, foot))
    out = np.array([side, 0.0, 0.0])
    thigh, shank = unit(knee - hip), unit(ankle - knee)
    front = unit(np.cross(np.cross(thigh, shank), thigh)) * -1.0  # the side of the thigh that faces away from the bend
    calf_back = unit(np.cross(np.cross(shank, thigh), shank)) * -1.0
    parts = [
        tube([hip, 0.5 * (hip + knee) + 1.5 * out, knee], [20, 16.5, 9.5], blend=6.0),
        tube([knee, knee + 0.35 * (ankle - knee), ankle], [9.5, 9.5, 6.0], blend=4.0),
        tube([ankle, 0.5 * (ankle + foot), foot], [6.8, 6.4, 7.4], blend=3.0),
        # Thigh: buttock, outer and front muscles, hamstring.
        ball(hip + [side * 4, -9, 1], [15, 20, 17], blend=4.0),
        muscle(hip + 6 * out + [0, 4, 12], knee + 2 * out + [0, 0, 4], 4 * front + 5 * out, 10.5, blend=2.6, peak=0.5),
        muscle(hip + 8 * out + [0, -4, 4], knee + 4 * out + [0, -4, -2], 5 * out, 11.0, ends=0.35, blend=2.4, peak=0.4),
        muscle(hip + [side * 4, -22, -2], knee + 2 * out + 12 * shank, -5 * front + 2 * out, 9.5, blend=2.8, peak=0.4),
        # Knee cap, calf in two heads, shin, tendon of the heel.
        ball(knee + 4.5 * front + 3.0 * unit(thigh), [6.5, 6.0, 6.5], blend=3.0),
        muscle(
            knee + 3 * out + 3 * calf_back,
            ankle - 8 * shank + 2.0 * calf_back,
            5 * calf_back + 3.5 * out,
            8.5,
            ends=0.4,
            blend=2.4,
            peak=0.36,
        ),
        muscle(
            knee - 3 * out + 3 * calf_back,
            ankle - 8 * shank + 2.0 * calf_back,
            5 * calf_back - 3 * out,
            8.0,
            ends=0.4,
            blend=2.4,
            peak=0.36,
        ),
        muscle(
            knee + 1 * out - 3 * calf_back,
            ankle - 3.5 * calf_back,
            -3.5 * calf_back + 1.5 * out,
            5.5,
            ends=0.5,
            blend=2.2,
            peak=0.3,
        ),
        tube(
            [ankle - 20 * shank + 5 * calf_back, ankle - 8 * shank + 4.5 * calf_back, ankle + 4.5 * calf_back],
            [3.2, 2.4, 3.6],
            blend=2.4,
        ),
        ball(ankle + 2.0 * out, [6.2, 5.0, 5.0], blend=2.0),
    ]
    heel = ankle + 4.0 * calf_back + [0, -1, 0]
    parts.append(tube([heel, heel + [0, -6, 1.5], heel + [0, -11, 6.0]], [3.6, 2.6, 1.0], blend=2.0))
    sole = FLOOR - SINK
    for turn, length, size in ((-36, 28, 0.92), (0, 33, 1.0), (36, 28, 0.92)):
        angle = np.radians(heading + turn)
        ahead = np.array([np.sin(angle), np.cos(angle), 0.0])
        r = 6.3 * size
        joints = [
            foot + [0, 0, 0.5],
            foot * [1, 1, 0] + 0.42 * length * ahead + [0, 0, sole + 1.7 * r],
            foot * [1, 1, 0] + 0.78 * length * ahead + [0, 0, sole + 1.3 * r],
            foot * [1, 1, 0] + 1.0 * length * ahead + [0, 0, sole + 0.86 * r],
        ]
        tip = joints[-1]
        claw = [
            tip + [0, 0, 0.8],
            tip + 5.0 * ahead + [0, 0, 1.6],
            tip + 9.5 * ahead + [0, 0, -0.2],
            tip * [1, 1, 0] + 13.0 * ahead + [0, 0, sole + 1.2],
        ]
        parts += digit(joints, [6.8 * size, r, 0.88 * r, 0.80 * r], claw)
        # Pads under the toe.
        parts.append(
            ball(
                foot * [1, 1, 0] + 0.80 * length * ahead + [0, 0, sole + 0.62 * r],
                [0.85 * r, 0.95 * r, 0.62 * r],
                blend=1.6,
            )
        )
        # Tendon on the top of the foot.
        parts.append(
            tube(
                [
                    0.55 * ankle + 0.45 * foot + 4.2 * ahead + [0, 0, 2.5],
                    joints[0] + 2.0 * ahead + [0, 0, 5.2],
                    joints[1] + [0, 0, 2.6],
                ],
                [1.0, 1.7, 1.0],
                blend=1.6,
                steps=4,
            )
        )
    parts.append(ball([foot[0], foot[1] - 1, sole + 4.6], [8.5, 9.0, 4.6], blend=3.0))
    return parts


def arm(side, shoulder, elbow, wrist, pointing, palm):
    """Fore limb: the hand goes along `pointing` and its palm faces `palm`."""
    shoulder, elbow, wrist = (np.asarray(x, float) for x in (shoulder, elbow, wrist))
    out = np.array([side, 0.0, 0.0])
    upper, fore = unit(elbow - shoulder), unit(wrist - elbow)
    inner = unit(fore - (fore @ upper) * upper)  # the side of the biceps
    ahead = unit(pointing)
    palm = unit(np.asarray(palm) - (np.asarray(palm) @ ahead) * ahead)
    across = np.cross(ahead, palm) * side
    across *= np.sign(across @ np.array([-side, 0.4, 0.0])) or 1.0  # towards the thumb
    swing = unit(np.cross(fore, upper))
    parts = [
        tube([shoulder, elbow], [9.0, 6.5], blend=4.0),
        tube([elbow, wrist], [6.5, 4.6], blend=3.0),
        # Shoulder cap in three heads, biceps, triceps.
        muscle(shoulder + [-12 * side, 6, 2], shoulder + 23 * upper + 3 * inner, 3 * out + [0, 5, 2], 7.2, blend=2.4),
        muscle(shoulder + [-11 * side, -3, 6], shoulder + 26 * upper + 2 * out, 5 * out + [0, 0, 2], 7.8, blend=2.4),
        muscle(
            shoulder + [-11 * side, -11, 2], shoulder + 23 * upper - 2 * inner, 3 * out - [0, 5, -1], 7.0, blend=2.4
        ),
        muscle(shoulder + 8 * upper + 2 * inner, elbow + 5 * fore + inner, 5.0 * inner, 6.6, blend=2.0, peak=0.5),
        muscle(
            shoulder + 6 * upper - 4 * inner, elbow - 3.5 * inner, -4.5 * inner + 1.5 * out, 7.0, blend=2.2, peak=0.45
        ),
        ball(elbow - 3.6 * inner + 1.0 * upper, [3.8, 3.8, 3.8], blend=2.4),
        # Fore arm: the two bundles of the flexors and extensors.
        muscle(
            elbow - 8 * upper + 3 * out, wrist - 3 * fore, 3.2 * swing + 2.4 * out, 6.0, ends=0.42, blend=2.0, peak=0.34
        ),
        muscle(
            elbow - 1 * upper - 2 * out,
            wrist - 3 * fore,
            -3.2 * swing - 1.5 * out,
            6.0,
            ends=0.42,
            blend=2.0,
            peak=0.34,
        ),
        muscle(elbow + 2 * fore - 2 * inner, wrist - 5 * fore, -3.0 * inner, 4.6, ends=0.45, blend=2.0, peak=0.34),
        ball(wrist, [5.0, 5.0, 5.0], blend=2.0),
        # A spur at the elbow.
        tube(
            [elbow - 5.0 * inner, elbow - 9.5 * inner + 2.5 * upper, elbow - 14.0 * inner + 1.0 * upper],
            [3.2, 2.4, 1.0],
            blend=1.8,
        ),
    ]
    hand = wrist + 8.0 * ahead
    parts.append(ball(hand, [8.0, 6.6, 4.2], [ahead, across, palm], blend=3.0))
    parts.append(
        ball(wrist + 5.0 * ahead + 4.0 * across + 2.2 * palm, [5.6, 3.6, 3.2], [ahead, across, palm], blend=2.0)
    )
    for place, spread, length in ((5.5, 0.44, 15.5), (0.0, 0.02, 18.0), (-5.3, -0.42, 15.0)):
        along = unit(ahead + spread * across - 0.12 * palm)
        base = wrist + 12.0 * ahead + place * across
        first = base + 0.52 * length * along
        bent = unit(along + 0.55 * palm)
        second = first + 0.45 * length * bent
        hook = unit(along + 1.5 * palm)
        claw = [
            second,
            second + 3.6 * unit(bent - 0.25 * palm),
            second + 7.2 * unit(bent + 0.3 * palm),
            second + 8.0 * hook + 2.4 * bent,
        ]
        parts += digit([base - 4.0 * along, first, second], [3.0, 2.5, 2.2], claw, blend=2.0)
    along = unit(0.55 * ahead + 0.9 * across + 0.35 * palm)
    base = wrist + 4.5 * ahead + 4.0 * across + 1.8 * palm
    first = base + 8.0 * along
    bent = unit(along + 0.5 * ahead + 0.3 * palm)
    second = first + 5.5 * bent
    claw = [second, second + 3.4 * bent, second + 6.6 * unit(bent + 0.4 * palm), second + 8.8 * unit(bent + 0.9 * palm)]
    parts += digit([base, first, second], [3.5, 2.9, 2.4], claw, blend=1.4)
    return parts


HEAD_ORIGIN = np.array([3.0, 100.0, 10.0])
HEAD_FORWARD = unit([0.30, 0.90, -0.30])
HEAD_RIGHT = unit(np.cross(HEAD_FORWARD, [-0.10, 0.0, 1.0]))
HEAD_UP = np.cross(HEAD_RIGHT, HEAD_FORWARD)
HEAD = np.array([HEAD_FORWARD, HEAD_RIGHT, HEAD_UP])


def head():
    """The head in its own frame: (forward, right, up) from the joint with the neck."""

    def at(*points):
        return HEAD_ORIGIN + np.asarray(points, float) @ HEAD

    def lump(centre, radii, blend=2.0, carve=False):
        return ball(at(centre)[0], radii, HEAD, blend, carve)

    parts = [
        lump([4, 0, 2], [18, 14, 12.5], 4.0),
        tube(at([8, 0, 0], [24, 0, -2], [40, 0, -3.5]), [11.5, 8.6, 6.6], 4.0),
        lump([42.5, 0, -1.2], [5.0, 6.4, 4.6], 2.0),
        tube(at([16, 0, 8.5], [30, 0, 4.8], [41, 0, 2.6]), [2.4, 2.4, 1.8], 2.2),
        # Lower jaw and chin.
        tube(at([2, 0, -9], [16, 0, -14.0], [28, 0, -17.0], [34, 0, -18.5]), [9, 7.0, 5.4, 4.6], 3.0),
        tube(at([34, 0, -20], [34, 0, -24.5], [30.5, 0, -29]), [2.9, 2.2, 1.0], 1.6),
    ]
    for s in (-1, 1):
        parts += [
            tube(
                at([-2, 11 * s, -7], [13, 9.0 * s, -13.0], [26, 6.2 * s, -16.4], [34, 2.6 * s, -18.0]),
                [5, 4.6, 4.0, 3.6],
                2.4,
            ),
            lump([3, 12.2 * s, -6], [9, 4.8, 8.5], 2.0),
            lump([13, 9.6 * s, -5.5], [8.5, 4.4, 6.0], 3.0),
        ]
    parts += [
        # The open mouth, and the tongue in it.
        *(
            tube(at([20 - 0.02 * w * w, w, -10.6], [54, w, -13.6]), [2.0, 3.6], 2.0, carve=True, steps=2)
            for w in (-12, -9, -6, -3, 0, 3, 6, 9, 12)
        ),
        tube(at([20, 0, -14.5], [27, 0, -13.2], [33.5, 0, -13.8]), [3.6, 3.4, 2.4], 1.0, flat=(HEAD_UP, 0.5)),
    ]
    for s in (-1, 1):
        parts += [
            # Eye socket, eye, brow, lids, cheek bone.
            lump([16.4, 13.8 * s, 4.0], [6.4, 4.4, 4.6], 2.6, carve=True),
            tube(
                at([25, 4.5 * s, 5.0], [19, 9.4 * s, 8.6], [11, 12.7 * s, 9.6], [2, 13.8 * s, 8.6]),
                [1.6, 2.9, 3.3, 2.6],
                4.8,
            ),
            lump([15.6, 11.0 * s, 4.0], [4.5, 4.0, 4.0], 0.8),
            tube(at([22, 8.8 * s, 1.2], [16, 13.0 * s, -1.4], [8.5, 14.2 * s, 0.8]), [1.2, 1.7, 1.2], 2.6),
            tube(at([25, 8.4 * s, -1.5], [14, 13.0 * s, -2.6], [3, 14.8 * s, -1.0]), [1.6, 2.8, 2.4], 2.0),
            # Lips, nostrils, folds on the muzzle.
            tube(
                at([43, 3.4 * s, -6.8], [37, 6.0 * s, -7.0], [26, 8.4 * s, -7.2], [15, 11.2 * s, -7.0]),
                [1.4, 1.8, 1.9, 1.4],
                1.2,
            ),
            tube(at([44.5, 4.2 * s, 1.6], [41, 5.4 * s, 2.0], [38.5, 5.2 * s, 0.2]), [1.3, 1.7, 1.0], 1.2),
            lump([46.2, 3.9 * s, -0.4], [2.0, 1.5, 1.5], 1.0, carve=True),
            tube(at([22, 6.6 * s, 4.4], [28, 7.2 * s, 1.2], [33, 7.0 * s, -2.2]), [0.8, 1.4, 0.7], 1.6),
            # Fangs.
            tube(at([41.0, 4.3 * s, -6.5], [42.3, 4.7 * s, -10.3], [41.6, 4.6 * s, -14.0]), [2.0, 1.6, 0.8], 1.0),
            tube(at([33.0, 6.6 * s, -7.0], [33.4, 6.9 * s, -9.2], [32.8, 6.8 * s, -11.4]), [1.6, 1.3, 0.8], 1.0),
            tube(at([34.0, 3.6 * s, -16.5], [34.2, 4.0 * s, -14.6], [34.2, 4.0 * s, -12.6]), [1.6, 1.3, 0.8], 1.0),
            # Horns and the spines of the cheek.
            tube(
                at(
                    [0, 8.0 * s, 10],
                    [-10, 11.5 * s, 16.5],
                    [-23, 16.0 * s, 18.0],
                    [-36, 18.5 * s, 14.0],
                    [-46, 17.5 * s, 13.5],
                ),
                [5.4, 4.6, 3.8, 2.7, 1.1],
                3.5,
                steps=8,
            ),
            tube(at([2, 13.5 * s, -9], [-5, 18.0 * s, -12], [-13, 21.5 * s, -12.5]), [3.2, 2.4, 1.0], 1.8),
        ]
        # Temple, and the ear: a leaf with a hollow on its front.
        root, tip = np.array([-5, 14 * s, 3.0]), np.array([-21, 33 * s, 9.0])
        facing = unit([0.75, 0.25 * s, 0.55])
        facing = unit(facing - (facing @ unit(tip - root)) * unit(tip - root))
        path = [root, root + 0.35 * (tip - root) + [1, 0, 1.5], root + 0.7 * (tip - root) + [0.5, 0, 1.0], tip]
        parts.append(lump([-4, 12.0 * s, 7.0], [7.0, 4.5, 5.0], 3.0))
        parts.append(tube(at(*path), [3.2, 6.2, 4.5, 0.9], 1.8, flat=(facing @ HEAD, 0.44), steps=8))
        cup = [p + 2.3 * facing for p in (path[0] + 0.24 * (tip - root), path[1], path[2] + 0.02 * (tip - root))]
        parts.append(tube(at(*cup), [1.6, 4.2, 2.2], 1.6, carve=True, flat=(facing @ HEAD, 0.55), steps=8))
    return parts


def dorsal_spines(body):
    """A comb of backward swept fins on neck and back, and beads on the tail, set onto the surface of the body."""
    neck = np.array([[2, 93, 10], [1, 82, 8], [0, 68, 3], [0, 52, -8], [0, 34, -22], [0, 14, -38], [0, -8, -50]], float)
    line = spline(np.vstack([neck, TAIL[1:, :3]]), 40)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    parts = []
    place, total = 3.0, length[-1]
    while place < total - 34.0:
        s = place / total
        point = np.array([np.interp(place, length, line[:, i]) for i in range(3)])
        behind = unit([np.interp(place + 2, length, line[:, i]) - point[i] for i in range(3)])
        up = unit(np.array([0, 0, 1.0]) - behind[2] * behind)
        if behind[2] > 0.3:  # at the raised end of the tail the comb stays on the outside
            up = unit(np.array([0, -1.0, 0.35]) - (np.array([0, -1.0, 0.35]) @ behind) * behind)
        foot = march(body, point, up)
        aside = np.cross(up, behind)
        if s < 0.42:
            size = 0.4 + 0.95 * np.sin(np.pi * (0.22 + 1.5 * s))
            base = foot - 1.6 * size * up
            path = [
                base - 1.5 * size * behind,
                base + 4.6 * size * up + 1.2 * size * behind,
                base + 9.6 * size * up + 6.2 * size * behind,
            ]
            radii = [4.2 * size, 3.0 * size, 1.2 * size]
            parts.append(tube(path, radii, blend=2.0 * size, flat=(aside, 0.62)))
            place += 10.5 * size + 2.0
        else:
            size = 1.3 - 0.75 * s
            parts.append(ball(foot, [2.7 * size, 4.6 * size, 3.4 * size], [aside, behind, up], blend=2.2))
            place += 9.4 * size + 2.0
    return parts


def creature():
    """All parts: (body, fins)."""
    body = trunk()
    body += leg(1, hip=[18, -24, -64], knee=[37, 7, -90], ankle=[32, -37, -110], foot=[36, 0, -132.5], heading=10)
    body += leg(
        -1, hip=[-18, -26, -64], knee=[-37, 24, -86], ankle=[-32, -10, -111], foot=[-36, 27, -132.5], heading=-6
    )
    body += arm(1, [28, 56, -13], [46, 40, -42], [45, 74, -60], pointing=[0.05, 0.85, -0.35], palm=[-0.5, -0.2, -0.8])
    body += arm(-1, [-27, 57, -17], [-48, 50, -42], [-43, 86, -52], pointing=[0.1, 0.9, 0.1], palm=[0.45, 0.1, -0.9])
    body += head()
    return body, dorsal_spines(body)


# ---------------------------------------------------------------------------------------------------------------------
# Dense mesh: marching tetrahedra
# ---------------------------------------------------------------------------------------------------------------------


def sample_grid(parts, step, block=12):
    """Sample the field on a regular grid that holds all parts, block by block with only the parts that reach there."""
    low = np.min([part.low for part in parts if not part.carve], axis=0) - step
    high = np.max([part.high for part in parts if not part.carve], axis=0) + step
    count = np.ceil((high - low) / step).astype(int) + 1
    values = np.full(count, FAR)
    for i in range(0, count[0], block):
        for j in range(0, count[1], block):
            for k in range(0, count[2], block):
                size = np.minimum(block, count - (i, j, k))
                a = low + step * np.array([i, j, k])
                b = a + step * (size - 1)
                here = [part for part in parts if (part.low <= b).all() and (part.high >= a).all()]
                if here:
                    index = np.indices(size).reshape(3, -1).T
                    values[i : i + size[0], j : j + size[1], k : k + size[2]] = join(here, a + step * index).reshape(
                        size
                    )
    return low, values


def marching_tetrahedra(values):
    """Isosurface of a grid: every cell is cut into the six tetrahedra of its main diagonal."""
    values = np.where(values == 0.0, 1e-9, values)
    nx, ny, nz = values.shape
    stride = np.array([ny * nz, nz, 1])
    inside = values < 0.0
    corner_sum = sum(
        inside[i : nx - 1 + i, j : ny - 1 + j, k : nz - 1 + k].astype(np.int8)
        for i in (0, 1)
        for j in (0, 1)
        for k in (0, 1)
    )
    cells = np.argwhere((corner_sum > 0) & (corner_sum < 8)) @ stride
    flat = values.ravel()
    triangles = []
    for order in permutations(range(3)):
        tetra = np.zeros((len(cells), 4), np.int64)
        tetra[:, 0] = cells
        for i, axis in enumerate(order):
            tetra[:, i + 1] = tetra[:, i] + stride[axis]
        neg = flat[tetra] < 0.0
        ranked = np.take_along_axis(tetra, np.argsort(~neg, axis=1, kind="stable"), axis=1)  # inside corners first
        number = neg.sum(axis=1)
        for count, patterns in (
            (1, [((0, 1), (0, 2), (0, 3))]),
            (2, [((0, 2), (0, 3), (1, 3)), ((0, 2), (1, 3), (1, 2))]),
            (3, [((0, 3), (1, 3), (2, 3))]),
        ):
            r = ranked[number == count]
            places = np.stack(np.unravel_index(r, values.shape), axis=-1).astype(float)
            outward = places[:, count:].mean(1) - places[:, :count].mean(1)
            for pattern in patterns:
                ends = np.stack([r[:, list(pair)] for pair in pattern], axis=1)
                middle = np.stack([places[:, list(pair)].mean(1) for pair in pattern], axis=1)
                normal = np.cross(middle[:, 1] - middle[:, 0], middle[:, 2] - middle[:, 0])
                wrong = (normal * outward).sum(1) < 0.0
                ends[wrong] = ends[wrong][:, ::-1]
                triangles.append(ends)
    ends = np.sort(np.concatenate(triangles), axis=2)
    keys, faces = np.unique(ends[..., 0] * values.size + ends[..., 1], return_inverse=True)
    a, b = keys // values.size, keys % values.size
    t = np.clip(flat[a] / (flat[a] - flat[b]), 0.05, 0.95)[:, None]
    coordinates = [np.stack(np.unravel_index(x, values.shape), axis=1) for x in (a, b)]
    return coordinates[0] * (1 - t) + coordinates[1] * t, faces.reshape(-1, 3)


# ---------------------------------------------------------------------------------------------------------------------
# Remeshing
# ---------------------------------------------------------------------------------------------------------------------


class Surface(NamedTuple):
    """The dense mesh as a cloud of points with normals: quick to project onto."""

    tree: cKDTree
    points: np.ndarray
    normals: np.ndarray
    size: np.ndarray  # wanted edge length


def look_up(surface, p, count=8):
    """Gap to, normal of, and wanted edge length on the surface near the points p (weighted means of neighbours)."""
    distance, near = surface.tree.query(p, k=count)
    weight = np.exp(-(distance**2 - distance[:, :1] ** 2) / (0.6 * GRID_STEP) ** 2)
    weight /= weight.sum(axis=1, keepdims=True)
    normal = surface.normals[near]
    gap = (weight * ((p[:, None] - surface.points[near]) * normal).sum(2)).sum(1)
    return gap, normalise((weight[..., None] * normal).sum(1)), (weight * surface.size[near]).sum(1)


def project(surface, p, rounds=2):
    for _ in range(rounds):
        gap, normal, _ = look_up(surface, p)
        p = p - gap[:, None] * normal
    return p


class Edges(NamedTuple):
    ends: np.ndarray  # (m, 2) vertices, smaller first
    faces: np.ndarray  # (m, 2) the faces on both sides
    opposite: np.ndarray  # (m, 2) the third corners of these faces


def edges_of(faces):
    """All edges of a closed triangle mesh, in a fixed order."""
    start = faces.ravel()
    end = np.roll(faces, -1, axis=1).ravel()
    third = np.roll(faces, -2, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    order = np.argsort(low * (faces.max() + 1) + high, kind="stable")
    pairs = order.reshape(-1, 2)
    ends = np.stack([low[pairs[:, 0]], high[pairs[:, 0]]], axis=1)
    if not ((low[pairs[:, 1]] == ends[:, 0]) & (high[pairs[:, 1]] == ends[:, 1])).all():
        raise ValueError("the mesh is not a closed manifold")
    return Edges(ends, pairs // 3, third[pairs])


def face_normals(vertices, faces):
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def normalise(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


def compact(vertices, faces):
    used, inverse = np.unique(faces, return_inverse=True)
    return vertices[used], inverse.reshape(-1, 3)


def lengths(vertices, ends):
    return np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1)


def local_minimum(score, edges, count, rings=1):
    """Which edges have the smallest score (all different) of all edges within `rings` steps of their ends."""
    a, b = edges.ends.T
    least = np.full(count, np.inf)
    np.minimum.at(least, a, score)
    np.minimum.at(least, b, score)
    for _ in range(rings):
        wider = least.copy()
        np.minimum.at(wider, a, least[b])
        np.minimum.at(wider, b, least[a])
        least = wider
    return np.isfinite(score) & (score == least[a]) & (score == least[b])


def ranked(values, allowed):
    """Replace values by their ranks, so that no two are the same; infinity where not allowed."""
    score = np.full(len(values), np.inf)
    chosen = np.flatnonzero(allowed)
    score[chosen[np.argsort(values[chosen], kind="stable")]] = np.arange(len(chosen))
    return score


def collapse_short(surface, vertices, faces, factor=0.8, passes=100, thin=False):
    """Collapse edges shorter than factor * wanted length; sets of edges far enough from one another at once.

    The vertex that remains goes to the middle of the edge and onto the zero set; with `thin` (for a dense mesh) it
    stays at one of the ends, which is faster.
    """
    vertices = vertices.copy()
    _, normals, size = look_up(surface, vertices)
    banned = np.zeros(0, np.int64)
    for _ in range(passes):
        edges = edges_of(faces)
        count = len(vertices)
        a, b = edges.ends.T
        ratio = lengths(vertices, edges.ends) / (0.5 * (size[a] + size[b]))
        key = a.astype(np.int64) * count + b
        allowed = (ratio < factor) & ~np.isin(key, banned)
        valence = np.bincount(faces.ravel(), minlength=count)
        if not thin:  # vertices with three neighbours, and the shortest edges of slivers, go first
            span = lengths(vertices, edges.ends)
            shortest = np.full(len(faces), np.inf)
            np.minimum.at(shortest, edges.faces.ravel(), np.repeat(span, 2))
            sliver = corner_angles(vertices, faces) < np.radians(14.0)
            first = (sliver[edges.faces] & (shortest[edges.faces] == span[:, None])).any(axis=1) & (ratio < 1.2)
            first |= (np.minimum(valence[a], valence[b]) == 3) & (ratio < 1.5)
            allowed |= first & ~np.isin(key, banned)
            ratio = np.where(first, 0.05 * ratio, ratio)
        least = np.where(thin | (np.minimum(valence[a], valence[b]) == 3), 3, 4)
        allowed &= (valence[edges.opposite].min(axis=1) > least) & (valence[a] + valence[b] < 14)
        score = ranked(ratio, allowed)
        chosen = np.flatnonzero(local_minimum(score, edges, count))
        if len(chosen) == 0:
            break
        # The two ends may share no other neighbours than the opposite corners.
        ones = np.ones(len(a))
        adjacency = sparse.csr_matrix((np.r_[ones, ones], (np.r_[a, b], np.r_[b, a])), shape=(count, count))
        common = np.asarray(adjacency[a[chosen]].multiply(adjacency[b[chosen]]).sum(axis=1)).ravel()
        bad = common != 2
        # No face may turn over.
        target = np.arange(count)
        target[b[chosen]] = a[chosen]
        moved = vertices.copy()
        if not thin:
            moved[a[chosen]] = project(surface, 0.5 * (vertices[a[chosen]] + vertices[b[chosen]]), 2)
        moved[b[chosen]] = moved[a[chosen]]
        owner = np.full(count, -1)
        owner[a[chosen]] = owner[b[chosen]] = np.arange(len(chosen))
        merged = target[faces]
        alive = (merged[:, 0] != merged[:, 1]) & (merged[:, 1] != merged[:, 2]) & (merged[:, 2] != merged[:, 0])
        touched = np.flatnonzero(alive & (owner[faces].max(axis=1) >= 0))
        before, after = (normalise(face_normals(x, faces[touched])) for x in (vertices, moved))
        # Nor may the mesh cut off a tip: faces have to agree with the surface normals at their (old) corners.
        mean_normal = normals[faces[touched]].mean(1)
        agree_before, agree_after = (before * mean_normal).sum(1), (after * mean_normal).sum(1)
        if thin:
            limit = 0.55
        else:  # far too short edges have to go in any case
            limit = np.where(ratio[chosen][owner[faces[touched]].max(axis=1)] < 0.45, 0.05, 0.4)
        turned = (agree_after < limit) & (agree_after < agree_before + 0.05)
        turned |= ((before * after).sum(1) < 0.3) & (agree_after < np.minimum(limit + 0.2, 0.7))
        if not thin:  # specks much smaller than wanted go whatever the normals say
            turned &= (span / size[edges.ends].mean(1))[chosen][owner[faces[touched]].max(axis=1)] > 0.3
        turned = touched[turned]
        bad[owner[faces[turned]].max(axis=1)] = True
        banned = np.union1d(banned, key[chosen[bad]])
        good = chosen[~bad]
        if len(good) == 0:
            continue
        vertices[a[good]] = moved[a[good]]
        _, normals[a[good]], size[a[good]] = look_up(surface, vertices[a[good]])
        target = np.arange(count)
        target[b[good]] = a[good]
        faces = target[faces]
        faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    return compact(vertices, faces)


def split_long(surface, vertices, faces, factor=1.35, passes=20):
    """Split edges longer than factor * wanted length, at most one per face at once."""
    for _ in range(passes):
        edges = edges_of(faces)
        size = look_up(surface, vertices)[2]
        ratio = lengths(vertices, edges.ends) / size[edges.ends].mean(1)
        score = ranked(-ratio, ratio > factor)
        best = np.full(len(faces), np.inf)
        np.minimum.at(best, edges.faces.ravel(), np.repeat(score, 2))
        chosen = np.flatnonzero(
            np.isfinite(score) & (score == best[edges.faces[:, 0]]) & (score == best[edges.faces[:, 1]])
        )
        if len(chosen) == 0:
            break
        new = len(vertices) + np.arange(len(chosen))
        vertices = np.vstack([vertices, project(surface, vertices[edges.ends[chosen]].mean(1), 2)])
        added, dropped = [], []
        for i in (0, 1):
            face, third = edges.faces[chosen, i], edges.opposite[chosen, i]
            turn = np.argmax(faces[face] == third[:, None], axis=1)[:, None]
            corner = np.take_along_axis(faces[face], (turn + np.arange(3)) % 3, axis=1)  # third, start, end
            added += [np.stack([corner[:, 0], corner[:, 1], new], 1), np.stack([corner[:, 0], new, corner[:, 2]], 1)]
            dropped.append(face)
        keep = np.ones(len(faces), bool)
        keep[np.concatenate(dropped)] = False
        faces = np.vstack([faces[keep], *added])
    return vertices, faces


def corner_angles(vertices, faces):
    """Smallest angle of every face, in radians."""
    p = vertices[faces]
    angles = []
    for i in range(3):
        u, v = p[:, (i + 1) % 3] - p[:, i], p[:, (i + 2) % 3] - p[:, i]
        angles.append(np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(1)))
    return np.min(angles, axis=0)


def flip_edges(surface, vertices, faces, passes=12, shape_weight=3.0):
    """Flip edges where that brings valences nearer to six (and, if weighted, smallest angles up)."""
    faces = faces.copy()
    normals = look_up(surface, vertices)[1]
    for _ in range(passes):
        edges = edges_of(faces)
        count = len(vertices)
        (a, b), (c, d) = edges.ends.T, edges.opposite.T
        valence = np.bincount(faces.ravel(), minlength=count).astype(float)
        ring = np.stack([valence[a], valence[b], valence[c], valence[d]], 1) - 6.0
        gain = (ring**2).sum(1) - ((ring + [-1, -1, 1, 1]) ** 2).sum(1)
        # The first face runs (start, end, c); keep that orientation for the two new faces.
        corner = faces[edges.faces[:, 0]]
        turn = np.argmax(corner == c[:, None], axis=1)
        start = corner[np.arange(len(corner)), (turn + 1) % 3]
        end = corner[np.arange(len(corner)), (turn + 2) % 3]
        one, two = np.stack([c, start, d], 1), np.stack([d, end, c], 1)
        old = np.minimum(*(corner_angles(vertices, faces[edges.faces[:, i]]) for i in (0, 1)))
        new = np.minimum(corner_angles(vertices, one), corner_angles(vertices, two))
        gain = gain + shape_weight * (new - old)
        # The new faces have to agree with the surface, or at least better than the old ones.
        agree_old, agree_new = (
            np.min([(normalise(face_normals(vertices, f)) * normals[f].mean(1)).sum(1) for f in pair], axis=0)
            for pair in (faces[edges.faces.T], (one, two))
        )
        flat = (agree_new > 0.6) | (agree_new > agree_old + 0.05) | ((gain > 9.0) & (agree_new > 0.2))
        exists = np.isin(np.minimum(c, d) * count + np.maximum(c, d), a * count + b)
        allowed = (
            (gain > 1e-6)
            & flat
            & ~exists
            & ((new > np.minimum(old, np.where(gain > 9.0, 0.2, 0.5))) | (agree_new > agree_old + 0.3))
            & (valence[a] > 4)
            & (valence[b] > 4)
        )
        score = ranked(-gain, allowed)
        chosen = np.flatnonzero(local_minimum(score, edges, count, rings=1))
        if len(chosen) == 0:
            break
        faces[edges.faces[chosen, 0]] = one[chosen]
        faces[edges.faces[chosen, 1]] = two[chosen]
    return faces


def relax(surface, vertices, faces, rounds=3, strength=0.6):
    """Move vertices within the surface towards the (size weighted) centres of their faces, then back onto it."""
    count = len(vertices)
    for _ in range(rounds):
        normal = face_normals(vertices, faces)
        _, n, size = look_up(surface, vertices)
        weight = np.linalg.norm(normal, axis=1) / size[faces].mean(1) ** 2
        centre = vertices[faces].mean(1) * weight[:, None]
        total = np.bincount(faces.ravel(), np.repeat(weight, 3), count)
        goal = np.stack([np.bincount(faces.ravel(), np.repeat(centre[:, i], 3), count) for i in range(3)], 1)
        move = goal / np.maximum(total, 1e-12)[:, None] - vertices
        move -= (move * n).sum(1, keepdims=True) * n
        # Vertices on tips and sharp ridges stay: their faces turn far away from their normals.
        agree = np.ones(count)
        sound = corner_angles(vertices, faces) > 0.2
        np.minimum.at(agree, faces[sound].ravel(), (normalise(normal[sound])[:, None] * n[faces[sound]]).sum(2).ravel())
        move *= strength * np.clip((agree - 0.3) / 0.35, 0.0, 1.0)[:, None]
        vertices = project(surface, vertices + move, 2)
    return vertices


def largest_body(vertices, faces):
    """Drop crumbs that the grid broke off thin tips."""
    a, b = edges_of(faces).ends.T
    adjacency = sparse.csr_matrix((np.ones(len(a)), (a, b)), shape=(len(vertices), len(vertices)))
    label = sparse.csgraph.connected_components(adjacency, directed=False)[1]
    return compact(vertices, faces[label[faces[:, 0]] == np.bincount(label).argmax()])


def sized_surface(vertices, faces, normals, importance):
    """Wanted edge length everywhere: falling with curvature, limited, graded, scaled to meet the target count."""
    edges = edges_of(faces)
    a, b = edges.ends.T
    span = lengths(vertices, edges.ends)
    turn = np.linalg.norm(normals[a] - normals[b], axis=1)
    total_turn, total_span = (np.bincount(np.r_[a, b], np.r_[x, x]) for x in (turn, span))
    curvature = total_turn / total_span
    area = np.bincount(faces.ravel(), np.repeat(np.linalg.norm(face_normals(vertices, faces), axis=1) / 6.0, 3))

    def graded(scale):
        size = np.clip(scale * importance / np.clip(curvature, 0.01, 1.0) ** 0.6, *EDGE_RANGE)
        for _ in range(30):
            old = size.copy()
            np.minimum.at(size, a, old[b] + 0.32 * span)
            np.minimum.at(size, b, old[a] + 0.32 * span)
            if np.abs(old - size).max() < 0.02:
                break
        return size

    low, high = 0.3, 5.0
    for _ in range(9):
        middle = np.sqrt(low * high)
        triangles = (area / (np.sqrt(3.0) / 4.0 * graded(middle) ** 2)).sum()
        low, high = (middle, high) if triangles > TARGET_TRIANGLES else (low, middle)
    print("scale of the wanted edges", round(float(np.sqrt(low * high)), 3))
    return Surface(cKDTree(vertices), vertices, normals, graded(np.sqrt(low * high)))


def remesh(surface, vertices, faces):
    for factor in (0.3, 0.45, 0.6, 0.7, 0.7):
        vertices, faces = collapse_short(surface, vertices, faces, factor, passes=25, thin=True)
        faces = flip_edges(surface, vertices, faces, passes=4)
    for _ in range(12):
        vertices, faces = split_long(surface, vertices, faces, passes=3)
        vertices, faces = collapse_short(surface, vertices, faces, passes=20)
        faces = flip_edges(surface, vertices, faces)
        vertices = relax(surface, vertices, faces)
    for _ in range(5):
        vertices, faces = collapse_short(surface, vertices, faces, factor=0.45, passes=10)
        faces = flip_edges(surface, vertices, faces, shape_weight=6.0)
        vertices = relax(surface, vertices, faces, rounds=2, strength=0.5)
    return vertices, faces


# ---------------------------------------------------------------------------------------------------------------------
# Loop limit surface
# ---------------------------------------------------------------------------------------------------------------------


def limit_matrix(faces, count):
    """Sparse matrix from the cage to the limit points of its vertices."""
    a, b = edges_of(faces).ends.T
    n = np.bincount(np.r_[a, b], minlength=count)
    beta = np.where(n == 3, 3.0 / 16.0, 3.0 / (8.0 * n))
    g = 1.0 / (n + 3.0 / (8.0 * beta))
    ring = sparse.csr_matrix((np.r_[g[a], g[b]], (np.r_[a, b], np.r_[b, a])), shape=(count, count))
    return ring + sparse.diags(1.0 - n * g)


def fit_limit(parts, surface, cage, faces, rough=10, fine=3, strength=0.8):
    """Move the cage along the normals until its limit points lie on the zero set."""
    to_limit = limit_matrix(faces, len(cage))
    for step in range(rough + fine):
        limit = to_limit @ cage
        if step < rough:
            gap, normal, _ = look_up(surface, limit)
        else:
            foot, normal = newton(parts, limit)
            gap = ((limit - foot) * normal).sum(1)
        cage = cage - strength * gap[:, None] * normal
    return cage


# ---------------------------------------------------------------------------------------------------------------------
# Checks and output
# ---------------------------------------------------------------------------------------------------------------------


def report(parts, cage, faces):
    edges = edges_of(faces)
    valence = np.bincount(faces.ravel())
    volume = np.einsum("ij,ij->", cage[faces[:, 0]], np.cross(cage[faces[:, 1]], cage[faces[:, 2]])) / 6.0
    adjacency = sparse.csr_matrix((np.ones(len(edges.ends)), tuple(edges.ends.T)), shape=(len(cage), len(cage)))
    bodies = sparse.csgraph.connected_components(adjacency, directed=False)[0]
    limit = limit_matrix(faces, len(cage)) @ cage
    error = np.abs(field(parts, limit))
    angle = np.degrees(corner_angles(cage, faces))
    print(f"vertices {len(cage)}, triangles {len(faces)}, bodies {bodies}")
    print(f"Euler characteristic {len(cage) - len(edges.ends) + len(faces)}, volume {volume:.0f}")
    print(f"valences {dict(zip(*(x.tolist() for x in np.unique(valence, return_counts=True))))}")
    print(f"smallest angle {angle.min():.1f} degrees, below 20 degrees: {(angle < 20).sum()}")
    print(f"limit points: mean distance {error.mean():.4f}, largest {error.max():.3f}")
    print(f"limit box {limit.min(0).round(1)} {limit.max(0).round(1)}")
    if volume <= 0.0 or valence.min() < 3 or valence.max() > 9 or len(cage) - len(faces) // 2 != 2 * bodies:
        raise ValueError("the cage is inside out, has a degenerate vertex, or a handle")


def write(path, cage, faces):
    points = "\n".join(f"{x:.3f} {y:.3f} {z:.3f}" for x, y, z in cage)
    indices = "\n".join(f"{a} {b} {c}" for a, b, c in faces)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        "# An original horned, kangaroo-like dragon: control cage for three levels of Loop subdivision.\n"
        f"# {len(cage)} vertices, {len(faces)} triangles; closed, outward normals; z is up, it stands on z = -140.\n"
        "# Made by scenes/make_creature.py; change that script rather than this file.\n"
        'Shape "loopsubdiv"\n"integer nlevels" [3]\n'
        f'"point P" [\n{points}\n]\n"integer indices" [\n{indices}\n]\n',
        newline="\n",
    )


def importance_of(vertices, fins):
    """Factor on the wanted edge length: less than one where the eye goes first and on thin ends, more on the tail."""

    def near(centre, radius):
        return np.exp(-((np.linalg.norm(vertices - centre, axis=1) / radius) ** 4))

    factor = 1.0 + 0.15 * np.clip((-60.0 - vertices[:, 1]) / 60.0, 0.0, 1.0)
    for centre, radius, least in (
        (HEAD_ORIGIN + [24, 0, -3] @ HEAD, 30.0, 0.6),  # face
        (HEAD_ORIGIN + [-22, 0, 10] @ HEAD, 40.0, 0.7),  # horns and ears
        ([46.0, 88.0, -66.0], 17.0, 0.65),  # hands
        ([-41.0, 103.0, -50.0], 17.0, 0.65),
        (TAIL[-1, :3], 18.0, 0.45),
    ):
        factor = np.minimum(factor, 1.0 - (1.0 - least) * near(centre, radius))
    ends = np.vstack([part.points[-4:] @ np.linalg.inv(part.mapping).T for part in fins if len(part.points) > 1])
    close = cKDTree(ends).query(vertices)[0]
    return np.minimum(factor, 1.0 - 0.4 * np.exp(-((close / 4.5) ** 4)))


def main():
    start = time.perf_counter()

    def note(text):
        print(f"[{time.perf_counter() - start:6.1f} s] {text}", flush=True)

    body, fins = creature()
    parts = body + fins
    note(f"{len(parts)} parts")
    origin, values = sample_grid(parts, GRID_STEP)
    note(f"grid {values.shape}")
    vertices, faces = marching_tetrahedra(values)
    vertices, faces = largest_body(origin + GRID_STEP * vertices, faces)
    vertices, normals = newton(parts, vertices)
    note(f"dense mesh: {len(vertices)} vertices, {len(faces)} triangles, Euler {len(vertices) - len(faces) // 2}")
    surface = sized_surface(vertices, faces, normals, importance_of(vertices, fins))
    note("sized")
    vertices, faces = remesh(surface, vertices, faces)
    note("remeshed")
    cage = fit_limit(parts, surface, vertices, faces)
    note("fitted")
    report(parts, cage, faces)
    write(OUTPUT, cage, faces)
    note(f"wrote {OUTPUT.name}, {OUTPUT.stat().st_size / 1024:.0f} KiB")


if __name__ == "__main__":
    main()
