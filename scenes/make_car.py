"""Make the compact coupe of the scene `tt.pbrt`: the files `scenes/geometry/tt-*.ply`.

What: a two-door coupe of this project's own design, 4.0 m long, nose toward -x, right flank toward +y, wheels
standing on z = 0, the middle plane at y = 0.  One binary PLY file (vertices, normals, triangles) per material.

How: the painted skin is an implicit surface.  Five soft "walls" (top, side, front, rear, floor) are intersected to make
the lower body, three more make the greenhouse, and both are joined.  A wall is a smooth function of two coordinates,
a soft maximum joins them, so the skin is smooth everywhere and its gradient is an exact normal: the glossy coat shows
no facets and no dents.  The zero set is meshed (surface nets), moved onto the surface (Newton), and then *cut*
along level curves of further functions: window, lamp, grille, wheel arch, door gap.  A cut inserts vertices exactly on
the curve, so outlines are crisp at any mesh width.  Only the half y >= 0 is made and mirrored.  Wheels, mirrors and
small parts are surfaces of revolution, sweeps, or implicit surfaces too.

Why: the thesis rendered a car model that cannot be passed on; this one may be.

Run: python scenes/make_car.py        (deterministic, about ten seconds, needs numpy and scipy)
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.interpolate import BSpline, CubicSpline

FOLDER = Path(__file__).parent / "geometry"

MESH_WIDTH = 0.0175  # grid step of the skin; its facets are hidden by exact normals
WHEEL_X = (0.80, 3.22)  # front and rear axle
WHEEL_Y, WHEEL_R, WHEEL_W = 0.752, 0.325, 0.225  # centre of the tyre, its radius and width
ARCH_R = 0.366  # radius of the wheel opening in the skin


# ---------------------------------------------------------------------------------------------------------------------
# Curves and soft logic
# ---------------------------------------------------------------------------------------------------------------------


def b_spline(points, degree=3):
    """Open uniform B-spline through its end points; takes t in [0, 1].  Never wiggles more than its control polygon."""
    points = np.asarray(points, float)
    inner = np.linspace(0, 1, len(points) - degree + 1)
    knots = np.concatenate([np.zeros(degree), inner, np.ones(degree)])
    return BSpline(knots, points, degree)


def graph(points):
    """The B-spline with control points (x, value), x increasing, as a twice differentiable function of x."""
    curve = b_spline(points)(np.linspace(0, 1, 400))
    spline = CubicSpline(curve[:, 0], curve[:, 1])
    return lambda x: spline(np.clip(x, curve[0, 0], curve[-1, 0]))


def closed_outline(points, rounds=4):
    """Closed quadratic B-spline (Chaikin's corner cutting); touches the middle of every edge of the polygon."""
    points = np.asarray(points, float)
    for _ in range(rounds):
        following = np.roll(points, -1, axis=0)
        points = np.stack([0.75 * points + 0.25 * following, 0.25 * points + 0.75 * following], 1).reshape(-1, 2)
    return points


def outline_distance(u, v, outline):
    """Signed distance of the points (u, v) to a closed polygon, negative inside."""
    best = np.full(u.shape, np.inf)
    inside = np.zeros(u.shape, bool)
    for (au, av), (bu, bv) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        eu, ev = bu - au, bv - av
        t = np.clip(((u - au) * eu + (v - av) * ev) / (eu * eu + ev * ev), 0, 1)
        best = np.minimum(best, (u - au - t * eu) ** 2 + (v - av - t * ev) ** 2)
        if av != bv:
            inside ^= ((av > v) != (bv > v)) & (u < au + (v - av) / (bv - av) * eu)
    return np.where(inside, -1, 1) * np.sqrt(best)


def soft_max(a, b, r):
    """Smooth maximum; as an intersection it rounds the edge with a radius of about 1.7 r."""
    return 0.5 * (a + b + np.sqrt((a - b) ** 2 + r * r))


def soft_min(a, b, r):
    return -soft_max(-a, -b, r)


def bump(x, width):
    return np.exp(-((x / width) ** 2))


def unit(v):
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-20)


# ---------------------------------------------------------------------------------------------------------------------
# The skin as an implicit function
# ---------------------------------------------------------------------------------------------------------------------

# Lower body.  Height of the centre line, half width seen from above, and inward lean of the flank over height.
TOP = graph(
    [
        (-0.4, 0.46),
        (-0.1, 0.57),
        (0.2, 0.678),
        (0.55, 0.765),
        (0.95, 0.832),
        (1.35, 0.872),
        (1.9, 0.895),
        (2.5, 0.905),
        (3.0, 0.915),
        (3.4, 0.912),
        (3.7, 0.875),
        (3.95, 0.80),
        (4.2, 0.69),
        (4.5, 0.55),
    ]
)
PLAN = graph(
    [
        (-0.4, 0.70),
        (0.0, 0.775),
        (0.4, 0.825),
        (0.8, 0.858),
        (1.3, 0.864),
        (1.9, 0.860),
        (2.5, 0.866),
        (3.0, 0.880),
        (3.4, 0.876),
        (3.8, 0.835),
        (4.1, 0.765),
        (4.5, 0.65),
    ]
)
FLANK = graph(
    [
        (-0.1, -0.14),
        (0.05, -0.095),
        (0.18, -0.050),
        (0.30, -0.018),
        (0.42, -0.002),
        (0.54, 0.0),
        (0.66, -0.006),
        (0.78, -0.030),
        (0.90, -0.080),
        (1.02, -0.15),
        (1.3, -0.35),
    ]
)

# Greenhouse.  Windscreen, roof and rear window in one arc; half width at the belt line over x.
ROOF_MIDDLE = 2.3
ROOF = graph(
    [
        (0.5, 0.40),
        (0.80, 0.585),
        (1.08, 0.775),
        (1.36, 0.965),
        (1.62, 1.155),
        (1.86, 1.310),
        (2.15, 1.368),
        (2.48, 1.362),
        (2.80, 1.305),
        (3.10, 1.185),
        (3.40, 1.015),
        (3.70, 0.825),
        (4.0, 0.62),
        (4.4, 0.33),
    ]
)
BELT = graph(
    [
        (0.4, 0.60),
        (0.9, 0.672),
        (1.3, 0.716),
        (1.8, 0.738),
        (2.3, 0.738),
        (2.8, 0.700),
        (3.2, 0.628),
        (3.6, 0.525),
        (4.0, 0.40),
        (4.4, 0.25),
    ]
)


def wrapped_x(x, y):
    """x of the roof arc: the corners of the two screens sit nearer to the middle of the car than their centres."""
    return ROOF_MIDDLE + (x - ROOF_MIDDLE) * (1 + 0.36 * y * y)


def below_roof(x, y, z):
    """Vertical depth under the roof arc."""
    return ROOF(wrapped_x(x, y)) - 0.085 * y * y - z


def inside_glass_plane(x, y, z):
    """Horizontal depth inside the side windows' surface."""
    h = z - 0.90
    return BELT(x) - 0.36 * h - 0.22 * h * h - y


def nose_x(y, z):
    return 0.095 * y**2 + 0.62 * y**4 + 0.9 * (z - 0.44) ** 2


def tail_x(y, z):
    return 4.02 - 0.085 * y**2 - 0.42 * y**4 - 0.55 * (z - 0.52) ** 2


def flank_y(x, z):
    """Half width of the lower body: plan, lean, wheel-arch flares and a shallow hollow along the foot of the door."""
    y = PLAN(x) + FLANK(z)
    for x0 in WHEEL_X:
        y = y + 0.030 * bump(np.hypot(x - x0, z - WHEEL_R) - ARCH_R + 0.01, 0.085)
    return y - 0.016 * bump(z - 0.315 - 0.02 * (x - 2), 0.055) * bump(x - 2.0, 0.62)


def top_z(x, y):
    """Height of the lower body: crowned, with a crest over each front wheel and a softer one over the rear wheels."""
    z = TOP(x) - 0.11 * y * y
    z = z + 0.045 * bump(y - 0.60, 0.15) * bump(x - 0.72, 0.50) - 0.012 * bump(y - 0.40, 0.12) * bump(x - 0.75, 0.4)
    return z + 0.018 * bump(y - 0.64, 0.14) * bump(x - 3.30, 0.40)


def skin(p):
    """Negative inside the painted body, about a distance near the surface.  p: (..., 3)."""
    x, y, z = p[..., 0], np.abs(p[..., 1]), p[..., 2]
    body = soft_max(z - top_z(x, y), y - flank_y(x, z), 0.075)
    body = soft_max(body, nose_x(y, z) - x, 0.075)
    body = soft_max(body, x - tail_x(y, z), 0.07)
    body = soft_max(body, 0.13 - z, 0.03)
    cabin = soft_max(-0.85 * below_roof(x, y, z), -inside_glass_plane(x, y, z), 0.075)
    cabin = soft_max(cabin, 0.55 - z, 0.02)
    cabin = soft_max(cabin, x - 3.75, 0.05)
    return soft_min(body, cabin, 0.040)


# ---------------------------------------------------------------------------------------------------------------------
# Meshing an implicit function
# ---------------------------------------------------------------------------------------------------------------------


def gradient(f, p, step=2e-4):
    axes = step * np.eye(3)
    return np.stack([f(p + e) - f(p - e) for e in axes], -1) / (2 * step)


def project(f, p, rounds=4):
    """Newton steps along the gradient onto f = 0."""
    for _ in range(rounds):
        g = gradient(f, p)
        p = p - g * (f(p) / np.maximum((g * g).sum(-1), 1e-12))[:, None]
    return p


def implicit_mesh(f, low, high, step):
    """Surface nets: one vertex per grid cell that the surface crosses, one quad per crossed grid edge.

    Returns vertices on f = 0 and triangles that face the outside (f > 0).
    """
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    value = np.stack([f(layer) for layer in grid])
    cells = np.array(value.shape) - 1
    total, count = np.zeros((*cells, 3)), np.zeros(cells, int)
    crossings = []
    for axis in range(3):
        first = [slice(None)] * 3
        second = [slice(None)] * 3
        first[axis], second[axis] = slice(None, -1), slice(1, None)
        a, b = value[tuple(first)], value[tuple(second)]
        i, j, k = np.nonzero((a < 0) != (b < 0))
        va, vb = a[i, j, k], b[i, j, k]
        point = grid[i, j, k].copy()
        point[:, axis] += step * va / (va - vb)
        u, v = (axis + 1) % 3, (axis + 2) % 3
        around = []
        for du, dv in ((0, 0), (-1, 0), (-1, -1), (0, -1)):
            cell = np.stack([i, j, k], 1)
            cell[:, u] += du
            cell[:, v] += dv
            ok = ((cell >= 0) & (cell < cells)).all(1)
            np.add.at(total, tuple(cell[ok].T), point[ok])
            np.add.at(count, tuple(cell[ok].T), 1)
            around.append(np.where(ok, np.ravel_multi_index(np.clip(cell, 0, cells - 1).T, cells), -1))
        quad = np.stack(around, 1)
        quad[va > 0] = quad[va > 0][:, ::-1]  # the outside is where f grows
        crossings.append(quad[(quad >= 0).all(1)])
    quads = np.concatenate(crossings)
    used, quads = np.unique(quads, return_inverse=True)
    quads = quads.reshape(-1, 4)
    p = total.reshape(-1, 3)[used] / count.reshape(-1)[used, None]
    for _ in range(3):  # even out the vertices along the surface
        mean, n = np.zeros_like(p), np.zeros(len(p))
        for k in range(4):
            np.add.at(mean, quads[:, k], p[quads[:, k - 1]])
            np.add.at(n, quads[:, k], 1)
        p = project(f, 0.5 * p + 0.5 * mean / np.maximum(n, 1)[:, None], 2)
    p = project(f, p)
    d02 = np.linalg.norm(p[quads[:, 0]] - p[quads[:, 2]], axis=1)
    d13 = np.linalg.norm(p[quads[:, 1]] - p[quads[:, 3]], axis=1)
    split02 = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])[np.tile(d02 <= d13, 2)]
    split13 = np.concatenate([quads[:, [0, 1, 3]], quads[:, [1, 2, 3]]])[np.tile(d02 > d13, 2)]
    return p, np.concatenate([split02, split13])


def cut(p, triangles, labels, fixed, level, f):
    """Insert the curve level(p) = 0 into a mesh of f = 0; both pieces stay, and every triangle keeps its label.

    Points near the curve are moved onto it, which avoids slivers, unless they are `fixed`: on the curve of an earlier
    cut.  Those within a fraction of a millimetre count as lying on it.
    """
    d, slope = level(p), np.ones(len(p))
    near = np.abs(d) < 0.1
    g = gradient(level, p[near])
    n = unit(gradient(f, p[near]))
    along = g - n * (g * n).sum(1, keepdims=True)
    slope[near] = np.maximum(np.linalg.norm(along, axis=1), 0.2)
    d = d / slope
    move = near & ~fixed & (np.abs(d) < 0.28 * MESH_WIDTH)
    moved = project(f, p[move] - unit(along[move[near]]) * d[move, None], 2)
    back = gradient(level, moved)
    moved = project(f, moved - back * (level(moved) / np.maximum((back * back).sum(1), 0.04))[:, None], 2)
    good = np.abs(level(moved)) < 2e-4
    chosen = np.flatnonzero(move)[good]
    p = p.copy()
    p[chosen], d[chosen] = moved[good], 0
    d[np.abs(d) < 3e-4] = 0
    s = np.sign(d).astype(int)
    fixed = fixed | (s == 0)
    st = s[triangles]
    crossed = (st.min(1) < 0) & (st.max(1) > 0)
    if not crossed.any():
        return p, triangles, labels, fixed
    t, lab, st = triangles[crossed], labels[crossed], st[crossed]

    # Turn every crossed triangle so that the vertex a is alone on its side, or lies on the curve.
    alone = np.where((st == 0).any(1), (st == 0).argmax(1), (st == -np.sign(st.sum(1))[:, None]).argmax(1))
    rows = np.arange(len(t))
    t = np.stack([t[rows, (alone + k) % 3] for k in range(3)], 1)
    touching = s[t[:, 0]] == 0

    edges = np.concatenate([t[~touching][:, [0, 1]], t[~touching][:, [0, 2]], t[touching][:, [1, 2]]])
    unique, index = np.unique(np.sort(edges, 1), axis=0, return_inverse=True)
    index = index.reshape(-1) + len(p)
    a, b = p[unique[:, 0]], p[unique[:, 1]]
    lo, hi = np.zeros(len(a)), np.ones(len(a))
    d_lo, d_hi = level(a), level(b)
    for _ in range(6):  # regula falsi with a bisection guard
        w = np.clip(lo + (hi - lo) * np.clip(d_lo / np.where(d_lo == d_hi, 1, d_lo - d_hi), 0.05, 0.95), 0, 1)
        new = project(f, a + (b - a) * w[:, None], 2)
        dn = level(new)
        left = np.sign(dn) == np.sign(d_lo)
        lo, d_lo = np.where(left, w, lo), np.where(left, dn, d_lo)
        hi, d_hi = np.where(left, hi, w), np.where(left, d_hi, dn)
    p, fixed = np.concatenate([p, new]), np.concatenate([fixed, np.ones(len(new), bool)])

    m = (~touching).sum()
    ab, ac, bc = index[:m], index[m : 2 * m], index[2 * m :]
    ta, tb = t[~touching], t[touching]
    pieces = np.concatenate(
        [
            np.stack([ta[:, 0], ab, ac], 1),
            np.stack([ab, ta[:, 1], ta[:, 2]], 1),
            np.stack([ab, ta[:, 2], ac], 1),
            np.stack([tb[:, 0], tb[:, 1], bc], 1),
            np.stack([tb[:, 0], bc, tb[:, 2]], 1),
        ]
    )
    la, lb = lab[~touching], lab[touching]
    return (
        p,
        np.concatenate([triangles[~crossed], pieces]),
        np.concatenate([labels[~crossed], la, la, la, lb, lb]),
        fixed,
    )


# ---------------------------------------------------------------------------------------------------------------------
# Outlines on the skin: every function is negative inside its region, in metres near its zero set
# ---------------------------------------------------------------------------------------------------------------------


def rounded_outline(corners, r):
    """Polygon with corners rounded over the distance r (at most a third of an edge)."""
    corners = np.asarray(corners, float)
    points = []
    for before, corner, after in zip(np.roll(corners, 1, 0), corners, np.roll(corners, -1, 0), strict=True):
        for other in (before, after):
            length = np.hypot(*(other - corner))
            points.append(corner + (other - corner) * min(r / length, 0.34))
    return closed_outline(points, 4)


def mirrored_outline(half, r):
    """Outline symmetric about u = 0 from its corners with u > 0."""
    half = np.asarray(half, float)
    return rounded_outline(np.concatenate([half, half[::-1] * [-1, 1]]), r)


def on_skin(point):
    """The point of the skin nearest to a guess, with its normal and two tangents: one level and rearward, one up."""
    p = project(skin, np.array([point], float), 8)
    n = unit(gradient(skin, p))[0]
    level = unit(np.cross([0, 0, 1.0], n))
    level *= np.sign(level[0]) if abs(level[0]) > 0.2 else 1
    up = np.cross(n, level)
    return p[0], n, level, up * np.sign(up[2])


def patch(guess, outline):
    """A region seen square to the skin at a point: outline in (rearward, up), guarded against the far side."""
    centre, n, level, up = on_skin(guess)

    def distance(p):
        q = p - centre
        return np.maximum(outline_distance(q @ level, q @ up, outline), -0.25 - q @ n)

    return distance


def xyz(p):
    return p[:, 0], p[:, 1], p[:, 2]


SCREEN_LOW, SCREEN_HIGH = 1.205, 1.84  # windscreen, in wrapped x
REAR_LOW, REAR_HIGH = 2.86, 3.47  # rear window
DOOR = rounded_outline([(1.315, 0.275), (2.36, 0.262), (2.50, 0.48), (2.475, 1.02), (1.40, 1.02), (1.262, 0.72)], 0.10)
MOUTH = mirrored_outline([(0.315, 0.520), (0.385, 0.455), (0.315, 0.215)], 0.045)
INTAKE = rounded_outline([(0.475, 0.225), (0.700, 0.235), (0.725, 0.350), (0.525, 0.330)], 0.04)
HEADLIGHT = closed_outline(
    [
        (-0.205, -0.030),
        (-0.14, -0.068),
        (0.02, -0.078),
        (0.17, -0.050),
        (0.235, 0.02),
        (0.215, 0.062),
        (0.07, 0.070),
        (-0.10, 0.048),
        (-0.19, 0.012),
    ]
)
TAIL_LIGHT = rounded_outline([(-0.13, -0.05), (0.15, -0.065), (0.17, 0.055), (-0.10, 0.06)], 0.05)


def windscreen(p):
    x, y, z = xyz(p)
    xw = wrapped_x(x, y)
    d = soft_max(SCREEN_LOW - xw, xw - SCREEN_HIGH, 0.01)
    return np.maximum(soft_max(d, 0.058 - inside_glass_plane(x, y, z), 0.035), 0.7 - z)


def cowl(p):
    x, y, z = xyz(p)
    xw = wrapped_x(x, y)
    d = soft_max(1.150 - xw, xw - 1.3, 0.01)
    return np.maximum(soft_max(d, 0.056 - inside_glass_plane(x, y, z), 0.02), 0.7 - z)


def rear_window(p):
    x, y, z = xyz(p)
    xw = wrapped_x(x, y)
    d = soft_max(REAR_LOW - xw, xw - REAR_HIGH, 0.02)
    return np.maximum(soft_max(d, 0.075 - inside_glass_plane(x, y, z), 0.06), 0.7 - z)


def side_window(p):
    x, y, z = xyz(p)
    d = soft_max(0.055 - 0.8 * below_roof(x, y, z), 0.928 + 0.012 * (x - 2.0) - z, 0.022)
    d = soft_max(d, x + 0.55 * (z - 0.95) - 3.13, 0.04)
    return np.maximum(d, 0.3 - y)


def b_pillar(p):
    x, y, z = xyz(p)
    return np.abs(x - 2.475 + 0.12 * (z - 0.95)) - 0.022


def wheel_arch(x0):
    return lambda p: np.maximum(np.hypot(p[:, 0] - x0, p[:, 2] - WHEEL_R) - ARCH_R, 0.5 - p[:, 1])


def floor(p):
    return p[:, 2] - 0.158


def lower_trim(p):
    x, y, z = xyz(p)
    rear = np.clip((x - 3.6) / 0.2, 0, 1)
    return z - 0.198 - 0.10 * rear * rear * (3 - 2 * rear) * bump(y, 0.62)


def mouth(p):
    x, y, z = xyz(p)
    return np.maximum(outline_distance(y, z, MOUTH), x - 0.6)


def intake(p):
    x, y, z = xyz(p)
    return np.maximum(outline_distance(y, z, INTAKE), x - 0.6)


def bonnet(p):
    x, y, z = xyz(p)
    return np.maximum(soft_max(y - 0.50 - 0.115 * x, 0.20 + 0.28 * y * y - x, 0.05), 0.45 - z)


def tailgate(p):
    x, y, z = xyz(p)
    return np.maximum(soft_max(y - 0.62 + 0.30 * (x - 3.4), x - 3.86 + 0.22 * y * y, 0.05), 0.45 - z)


def door(p):
    x, y, z = xyz(p)
    return np.maximum(outline_distance(x, z, DOOR), 0.4 - y)


# ---------------------------------------------------------------------------------------------------------------------
# Pieces of mesh: (points, normals, triangles)
# ---------------------------------------------------------------------------------------------------------------------


def join(*pieces):
    """One mesh from several."""
    offsets = np.cumsum([0] + [len(p) for p, _, _ in pieces[:-1]])
    return (
        np.concatenate([p for p, _, _ in pieces]),
        np.concatenate([n for _, n, _ in pieces]),
        np.concatenate([t + k for (_, _, t), k in zip(pieces, offsets, strict=True)]),
    )


def mirror(piece):
    p, n, t = piece
    flip = np.array([1, -1, 1.0])
    return p * flip, n * flip, t[:, ::-1]


def both_sides(*pieces):
    piece = join(*pieces)
    return join(piece, mirror(piece))


def place(piece, rotation, origin):
    """Columns of `rotation` are the images of the axes."""
    p, n, t = piece
    rotation = np.asarray(rotation, float)
    return p @ rotation.T + origin, n @ rotation.T, t


def turn(axis, degrees):
    """Rotation matrix about a coordinate axis (0, 1, 2)."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    r = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    r[i, i], r[i, j], r[j, i], r[j, j] = c, -s, s, c
    return r


def tidy(p, n, t):
    """Drop empty triangles and unused points; let every triangle face the way of its normals."""
    face = np.cross(p[t[:, 1]] - p[t[:, 0]], p[t[:, 2]] - p[t[:, 0]])
    keep = np.linalg.norm(face, axis=1) > 1e-10
    t, face = t[keep], face[keep]
    wrong = (face * n[t].sum(1)).sum(1) < 0
    t = np.where(wrong[:, None], t[:, ::-1], t)
    used, t = np.unique(t, return_inverse=True)
    return p[used], n[used], t.reshape(-1, 3)


def grid_piece(p, n):
    """Mesh of a (rows, columns, 3) grid of points with normals."""
    rows, columns = p.shape[:2]
    i = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    return tidy(p.reshape(-1, 3), n.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def revolve(*profiles, segments=64):
    """Surface of revolution about the y axis.  A profile is a smooth run of (radius, y); its outside is on the right
    of the direction of travel; edges between profiles stay sharp."""
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    ring = np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], 1)
    pieces = []
    for profile in profiles:
        profile = np.asarray(profile, float)
        tangent = unit(np.gradient(profile, axis=0))
        normal = np.stack([tangent[:, 1], -tangent[:, 0]], 1)
        p = profile[:, :1, None] * ring[None] + profile[:, 1, None, None] * np.array([0, 1.0, 0])
        n = normal[:, :1, None] * ring[None] + normal[:, 1, None, None] * np.array([0, 1.0, 0])
        pieces.append(grid_piece(p, n))
    return join(*pieces)


def arc(centre, r, start, stop, steps=9):
    """Points (radius, y) on a circle, angles in degrees from the radius axis toward y."""
    a = np.radians(np.linspace(start, stop, steps))
    return np.stack([centre[0] + r * np.cos(a), centre[1] + r * np.sin(a)], 1)


def tube(points, width, height=None, up=(0, 0, 1.0), sides=16, rounds=40):
    """Sweep an ellipse (half axes across and along `up`) along a B-spline, with round ends."""
    height = width if height is None else height
    curve = b_spline(points, min(3, len(points) - 1))
    t = np.linspace(0, 1, rounds)
    centre, along = curve(t), unit(curve.derivative()(t))
    cap = np.sin(np.linspace(0, np.pi / 2, 6))
    length = np.linalg.norm(np.diff(centre, axis=0), axis=1).sum()
    ends = np.concatenate(
        [-np.cos(np.linspace(0, np.pi / 2, 6)), np.zeros(rounds - 2), np.cos(np.linspace(np.pi / 2, 0, 6))]
    )
    scale = np.concatenate([cap, np.ones(rounds - 2), cap[::-1]])
    index = np.concatenate([np.zeros(6, int), np.arange(1, rounds - 1), np.full(6, rounds - 1)])
    centre = centre[index] + along[index] * (ends * min(width, height, length))[:, None]
    along = along[index]
    side = unit(np.cross(along, np.asarray(up, float)))
    top = np.cross(side, along)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    c, s = np.cos(angle)[None, :, None], np.sin(angle)[None, :, None]
    p = centre[:, None] + scale[:, None, None] * (width * c * side[:, None] + height * s * top[:, None])
    n = unit(
        scale[:, None, None] * (c * side[:, None] / width + s * top[:, None] / height)
        + ends[:, None, None] * along[:, None] / min(width, height)
    )
    return grid_piece(p, n)


def implicit_piece(f, low, high, step):
    p, t = implicit_mesh(f, low, high, step)
    return p, unit(gradient(f, p)), t


def boundary(t):
    """Directed edges that belong to one triangle only."""
    edges = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    _, index, count = np.unique(np.sort(edges, 1), axis=0, return_inverse=True, return_counts=True)
    return edges[count[index.reshape(-1)] == 1]


def edge_outward(p, n, edges):
    """At every boundary point the tangent that leads off the mesh, averaged over its edges; zero elsewhere."""
    out = np.zeros_like(p)
    across = np.cross(p[edges[:, 1]] - p[edges[:, 0]], n[edges[:, 0]] + n[edges[:, 1]])
    for k in range(2):
        np.add.at(out, edges[:, k], across)
    length = np.linalg.norm(out, axis=1, keepdims=True)
    return np.divide(out, length, out=np.zeros_like(out), where=length > 0)


EDGE = 0.0045  # width over which painted panels are rounded at their edges
EDGE_DROP = 0.0012  # and how far the edge lies below the skin


def painted(p, n, t):
    """Round the edges of a cut panel: tilt the normals at its rim and sink the rim a little."""
    edges = boundary(t)
    edges = edges[~(p[edges][:, :, 1] == 0).all(1)]  # not in the middle plane, where the other half follows
    out = edge_outward(p, n, edges)
    rim = np.linalg.norm(out, axis=1) > 0
    p = np.where(rim[:, None], p - EDGE_DROP * n, p)
    return tidy(p, unit(n + 0.9 * out), t)


def sunk(p, n, t, depth, direction=None):
    """The piece lowered by `depth`, and the walls from its rim up to the rim of the panels around."""
    edges = boundary(t)
    edges = edges[~(np.abs(p[edges][:, :, 1]) < 1e-9).all(1)]
    down = -n if direction is None else np.broadcast_to(np.asarray(direction, float), n.shape)
    low = p + depth * down
    inward = -edge_outward(p, n, edges)
    a, b = edges[:, 0], edges[:, 1]
    k = len(a)
    wall_p = np.concatenate([p[a] - EDGE_DROP * n[a], p[b] - EDGE_DROP * n[b], low[b], low[a]])
    wall_n = np.concatenate([inward[a], inward[b], inward[b], inward[a]])
    i = np.arange(k)
    wall_t = np.concatenate([np.stack([i, i + k, i + 2 * k], 1), np.stack([i, i + 2 * k, i + 3 * k], 1)])
    return join(tidy(low, n, t), tidy(wall_p, wall_n, wall_t))


# ---------------------------------------------------------------------------------------------------------------------
# The skin, cut into panels
# ---------------------------------------------------------------------------------------------------------------------

GONE, PAINT, GAP, TRIM, GLASS, LAMP, TAIL, GRILLE, FRAME = range(9)


class Panels:
    """The half skin y >= 0 while it is being cut.  Later regions take only what is still PAINT."""

    def __init__(self):
        low, high = (-0.1, -0.03, 0.08), (4.15, 0.98, 1.42)
        self.p, self.t = implicit_mesh(skin, low, high, MESH_WIDTH)
        self.label = np.full(len(self.t), PAINT)
        self.fixed = np.zeros(len(self.p), bool)
        self.cut(lambda p: p[:, 1])
        self.label[self.middle(lambda p: p[:, 1]) < 0] = GONE
        self.p[np.abs(self.p[:, 1]) < 5e-4, 1] = 0
        self.drop()

    def cut(self, level):
        self.p, self.t, self.label, self.fixed = cut(self.p, self.t, self.label, self.fixed, level, skin)

    def drop(self):
        self.t, self.label = self.t[self.label != GONE], self.label[self.label != GONE]

    def middle(self, level):
        return level(self.p[self.t].mean(1))

    def region(self, level, label, source=PAINT, edge=True):
        """Give the inside of a level curve a new label; with a cut just outside that bounds the rounded edge."""
        self.cut(level)
        if edge:
            self.cut(lambda p: level(p) - EDGE)
        self.label[(self.middle(level) < 0) & (self.label == source)] = label

    def seam(self, level, where, half=0.0027):
        """A gap along level = 0, where `where` of the points is true."""
        for offset in (-half - EDGE, -half, half, half + EDGE):
            self.cut(lambda p, c=offset: level(p) - c)
        inside = (np.abs(self.middle(level)) < half) & self.middle(where) & (self.label == PAINT)
        self.label[inside] = GAP

    def piece(self, label):
        used, t = np.unique(self.t[self.label == label], return_inverse=True)
        p = self.p[used]
        return p, unit(gradient(skin, p)), t.reshape(-1, 3)


HEADLIGHT_AT = (0.235, 0.60, 0.610)
TAIL_LIGHT_AT = (3.86, 0.66, 0.70)


def cut_panels():
    panels = Panels()
    panels.region(floor, GONE, edge=False)
    panels.drop()
    for x0 in WHEEL_X:
        panels.region(wheel_arch(x0), GONE)
        panels.drop()
    for window in (windscreen, side_window, rear_window):
        panels.region(window, TRIM)
        panels.region(lambda p, w=window: w(p) + 0.014, GLASS, source=TRIM, edge=False)
    for sign in (-1, 1):
        panels.cut(lambda p, s=sign: s * b_pillar(p))
    panels.label[(panels.middle(b_pillar) < 0) & (panels.label == GLASS) & (panels.middle(side_window) < 0)] = TRIM
    panels.region(cowl, TRIM)
    panels.region(lower_trim, TRIM)
    panels.region(mouth, FRAME)
    panels.region(lambda p: mouth(p) + 0.013, GRILLE, source=FRAME, edge=False)
    panels.region(intake, GRILLE)
    panels.region(patch(HEADLIGHT_AT, HEADLIGHT), LAMP)
    panels.region(patch(TAIL_LIGHT_AT, TAIL_LIGHT), TAIL)
    panels.seam(bonnet, lambda p: wrapped_x(p[:, 0], p[:, 1]) < 1.156)
    panels.seam(tailgate, lambda p: (wrapped_x(p[:, 0], p[:, 1]) > REAR_HIGH - 0.05) & (p[:, 2] > 0.5))
    panels.seam(door, lambda p: (p[:, 1] > 0.5) & (p[:, 2] < 0.96))
    panels.seam(lambda p: p[:, 2] - 0.545 + 0.10 * (p[:, 0] - 0.45), lambda p: (p[:, 0] < 0.62) & (p[:, 1] > 0.55))
    panels.seam(lambda p: p[:, 2] - 0.575 - 0.05 * (p[:, 0] - 3.6), lambda p: (p[:, 0] > 3.4) & (p[:, 1] > 0.3))
    return panels


def flank_at(x, z):
    """y of the skin beside the point (x, z), by bisection."""
    low, high = np.zeros_like(x), np.ones_like(x)
    for _ in range(40):
        y = 0.5 * (low + high)
        inside = skin(np.stack([x, y, z], -1)) < 0
        low, high = np.where(inside, y, low), np.where(inside, high, y)
    return low


def nose_at(y, z, low=-0.2, high=1.0):
    """x of the front of the skin at (y, z), by bisection."""
    low, high = np.full(y.shape, low), np.full(y.shape, high)
    for _ in range(40):
        x = 0.5 * (low + high)
        inside = skin(np.stack([x, y, z], -1)) < 0
        low, high = np.where(inside, low, x), np.where(inside, x, high)
    return high


def arch_linings():
    """Painted lips (turned in from the skin) and the dark wells around the wheels, one side."""
    lips, wells = [], []
    for x0 in WHEEL_X:
        foot = np.degrees(np.arcsin((0.158 - WHEEL_R) / ARCH_R))
        a = np.radians(np.linspace(foot, 180 - foot, 90))
        x, z = x0 + ARCH_R * np.cos(a), WHEEL_R + ARCH_R * np.sin(a)
        y = flank_at(x, z)
        inward = -np.stack([np.cos(a), np.zeros_like(a), np.sin(a)], 1)
        rows = []
        for depth, shrink in ((0.0012, 0), (0.004, 0.001), (0.03, 0.001)):
            rows.append(np.stack([x, y - depth, z], 1) + shrink * inward)
        tilt = unit(inward + np.array([0, 0.8, 0]))
        lips.append(grid_piece(np.stack(rows), np.stack([tilt, inward, inward])))
        start = np.stack([x, y - 0.028, z], 1) - 0.006 * inward
        end = start.copy()
        end[:, 1] = 0.50
        wells.append(grid_piece(np.stack([start, end]), np.stack([inward, inward])))
        centre = np.broadcast_to([x0, 0.50, 0.158], end.shape)
        side = np.broadcast_to([0, 1.0, 0], end.shape)
        wells.append(grid_piece(np.stack([end, centre]), np.stack([side, side])))
    return join(*lips), join(*wells)


def underbody():
    """A flat dark plate that closes the body from below, between the wheels."""
    x = np.linspace(0.06, 3.98, 120)
    y = flank_at(x, np.full_like(x, 0.170)) - 0.004
    for x0 in WHEEL_X:
        y = np.where(np.abs(x - x0) < ARCH_R + 0.02, np.minimum(y, 0.5), y)
    p = np.stack([np.stack([x, side * y, np.full_like(x, 0.17)], 1) for side in (-1, 1)])
    return grid_piece(p, np.broadcast_to([0, 0, -1.0], p.shape).copy())


# ---------------------------------------------------------------------------------------------------------------------
# Wheels: axis y, outer face toward +y, centre at the origin
# ---------------------------------------------------------------------------------------------------------------------

RIM_R = 0.236


def tyre():
    """Tread with four grooves, round shoulders, bulging side walls with a raised ring."""
    r, w = WHEEL_R, WHEEL_W / 2
    wall = b_spline(
        [
            (RIM_R - 0.006, 0.094),
            (RIM_R + 0.002, 0.106),
            (RIM_R + 0.018, w + 0.004),
            (r - 0.045, w + 0.003),
            (r - 0.014, w - 0.004),
            (r - 0.003, w - 0.020),
            (r - 0.0012, w - 0.034),
        ]
    )(np.linspace(0, 1, 26))
    pieces = [wall[::-1]]
    ring = arc((RIM_R + 0.044, w - 0.001), 0.0035, 150, -10, 8)
    edges = [w - 0.034, 0.049, 0.041, 0.017, 0.009, -0.009, -0.017, -0.041, -0.049, -w + 0.034]
    for k in range(0, len(edges), 2):  # ribs, and the grooves between them
        a, b = edges[k], edges[k + 1]
        crown = r - 0.6 * np.array([a, (a + b) / 2, b]) ** 2
        pieces.append(np.stack([crown, [a, (a + b) / 2, b]], 1)[::-1])
        if k + 2 < len(edges):
            c, low = edges[k + 2], crown[2] - 0.008
            pieces += [
                np.array([(low, b), (crown[2], b)]),
                np.array([(low, c), (low, b)]),
                np.array([(crown[2], c), (low, c)]),
            ]
    pieces.append(wall * [1, -1])
    return revolve(*pieces, ring[::-1], segments=96)


def spokes(p):
    """Five pairs of spokes between hub and rim, dished, joined with fillets."""
    x, y, z = p[..., 0], p[..., 1], p[..., 2]
    rho = np.hypot(x, z)
    fifth = 2 * np.pi / 5
    angle = (np.arctan2(z, x) + fifth / 2) % fifth - fifth / 2
    u, v = rho * np.cos(angle), np.abs(rho * np.sin(angle))
    face = 0.058 + 0.030 * (rho / RIM_R) - 0.030 * bump(rho - 0.05, 0.09) + 0.012 * bump(rho, 0.05)
    y = y - face
    half_width = 0.0105 + 0.006 * (u / RIM_R) ** 2
    spoke = soft_max(np.abs(v - 0.013 - 0.115 * u) - half_width, np.abs(y + 0.014) - 0.014, 0.006)
    spoke = soft_max(spoke, rho - RIM_R + 0.004, 0.004)
    hub = soft_max(rho - 0.060, np.abs(y + 0.018) - 0.019, 0.010)
    flange = soft_max(np.abs(rho - RIM_R + 0.006) - 0.0075, np.abs(y + 0.010) - 0.013, 0.005)
    wheel = soft_min(soft_min(spoke, hub, 0.014), flange, 0.012)
    for k in range(5):  # bolt holes
        a = fifth * (k + 0.5)
        hole = np.hypot(x - 0.040 * np.cos(a), z - 0.040 * np.sin(a)) - 0.009
        wheel = soft_max(wheel, soft_max(-hole, -(y + 0.014), 0.002) * 1.0, 0.003)
    return wheel


def rim():
    """Spokes, and the barrel behind them."""
    face = implicit_piece(spokes, (-0.25, 0.0, -0.25), (0.25, 0.12, 0.25), 0.0056)
    barrel = b_spline(
        [
            (RIM_R - 0.004, 0.085),
            (RIM_R - 0.014, 0.07),
            (RIM_R - 0.020, 0.04),
            (RIM_R - 0.030, -0.02),
            (RIM_R - 0.022, -0.08),
            (RIM_R - 0.004, -0.10),
        ]
    )(np.linspace(0, 1, 20))
    lip = arc((RIM_R - 0.001, 0.0925), 0.0065, 200, -30, 10)[::-1]
    return join(face, revolve(barrel[::-1] * 1.0, lip, segments=96))


def brake_disc():
    edge = arc((0.158, 0.004), 0.004, -0, 90, 5)
    return revolve(
        np.array([(0.159, -0.02), (0.162, 0.004)]),
        edge,
        np.array([(0.158, 0.008), (0.085, 0.008)]),
        np.array([(0.085, 0.008), (0.080, 0.03)]),
        np.array([(0.080, 0.03), (0.0, 0.03)]),
        segments=64,
    )


def caliper(p):
    """A rounded block over part of the disc."""
    rho, angle = np.hypot(p[..., 0], p[..., 2]), np.arctan2(p[..., 2], p[..., 0])
    block = soft_max(np.abs(rho - 0.148) - 0.034, (np.abs(angle) - 0.52) * 0.15, 0.014)
    return soft_max(block, np.abs(p[..., 1] - 0.012) - 0.026, 0.014)


# ---------------------------------------------------------------------------------------------------------------------
# Small parts
# ---------------------------------------------------------------------------------------------------------------------


def stand_on(piece, origin, axis):
    """Put a piece made around the y axis so that +y points along `axis`."""
    axis = unit(np.asarray(axis, float))
    side = unit(np.cross(axis, [0.31, 0.17, 0.93]))
    return place(piece, np.stack([side, axis, np.cross(side, axis)], 1), np.asarray(origin, float))


def dome(r, high):
    """A flat cap of a ball with its foot at y = 0."""
    t = np.linspace(0, np.pi / 2, 12)
    return revolve(np.stack([r * np.cos(t), high * np.sin(t)], 1), segments=40)


def ring(r, thick):
    a = np.linspace(0, 2 * np.pi, 17)
    return revolve(np.stack([r - thick * np.cos(a), thick * np.sin(a)], 1), segments=48)


def mirror_shell(p):
    """Housing of the door mirror: an egg cut flat at the back."""
    x, y, z = p[..., 0] - 1.535, p[..., 1] - 0.872, p[..., 2] - 0.972
    q = np.sqrt((x / 0.110) ** 2 + (y / 0.118) ** 2 + (z / (0.072 - 0.06 * y)) ** 2 + 1e-9)
    return soft_max((q - 1) * 0.075, x - 0.030 - 0.12 * y, 0.012)


def lamps():
    """Two lamps with bright rings in each headlight bucket, one fog lamp in each side intake: rings, lenses."""
    rings, lenses = [], []
    centre, n, level, up = on_skin(HEADLIGHT_AT)
    for u, v, r in ((-0.085, -0.012, 0.043), (0.045, 0.000, 0.052), (0.155, 0.012, 0.030)):
        p = centre + u * level + v * up
        foot, n, _, _ = on_skin(p)
        axis = unit(0.75 * n + 0.25 * np.array([-1, 0, 0]))
        at = foot - 0.030 * n
        rings.append(stand_on(ring(r, 0.007), at + 0.012 * axis, axis))
        rings.append(stand_on(revolve(np.array([(r, 0.0), (r, 0.014)]), segments=40), at - 0.006 * axis, axis))
        lenses.append(stand_on(dome(r - 0.004, 0.024), at, axis))
    x = nose_at(np.array([0.615]), np.array([0.282]))[0]
    at, axis = np.array([x + 0.035, 0.615, 0.282]), np.array([-1, 0.35, 0.05])
    rings.append(stand_on(ring(0.036, 0.005), at + 0.006 * unit(axis), axis))
    lenses.append(stand_on(dome(0.034, 0.018), at, axis))
    return rings, lenses


def grille_bars():
    """Level bars across the mouth, a hand's breadth behind the skin's surface."""
    bars = []
    for z, half in ((0.250, 0.315), (0.295, 0.33), (0.340, 0.345), (0.385, 0.358), (0.430, 0.365), (0.475, 0.340)):
        y = np.linspace(-half, half, 15)
        x = nose_at(np.abs(y), np.full_like(y, z)) + 0.020
        bars.append(tube(np.stack([x, y, np.full_like(y, z)], 1), 0.010, 0.0065, sides=10, rounds=30))
    for z in (0.262, 0.300):
        y = np.linspace(0.50, 0.70, 8)
        x = nose_at(y, np.full_like(y, z)) + 0.045
        bar = tube(np.stack([x, y, np.full_like(y, z)], 1), 0.008, 0.005, sides=10, rounds=20)
        bars += [bar, mirror(bar)]
    return join(*bars)


def plate(z0, half_width, half_height, front):
    """A licence plate that follows the bumper: holder, and the plate proper on it."""
    pieces = []
    for grow, lift in ((0.008, 0.006), (0.0, 0.010)):
        y = np.linspace(-half_width - grow, half_width + grow, 25)
        z = z0 + (half_height + grow) * np.array([-1, -0.98, 0.98, 1])
        yy, zz = np.meshgrid(y, z, indexing="ij")
        sign = -1 if front else 1
        x = nose_at(np.abs(y), np.full_like(y, z0)) if front else tail_x(y, z0) - 0.002
        xx = x[:, None] + sign * lift * np.array([-2.5, 1, 1, -2.5])
        p = np.stack([xx, yy, zz], -1)
        n = np.broadcast_to([sign, 0, 0.0], p.shape)
        face = np.stack([np.gradient(x, y) * -sign, np.zeros_like(y)], 1)
        n = unit(np.stack([np.full_like(xx, sign), np.repeat(face[:, :1], 4, 1), np.zeros_like(xx)], -1))
        pieces.append(grid_piece(p, n))
    return pieces


LETTERS = {  # strokes on a grid of 2 x 4
    "D": [[(0, 0), (0, 4), (1.2, 4), (2, 3.2), (2, 0.8), (1.2, 0), (0, 0)]],
    "M": [[(0, 0), (0, 4), (1, 1.8), (2, 4), (2, 0)]],
    "I": [[(1, 0), (1, 4)]],
    "S": [
        [
            (2, 3.4),
            (1.4, 4),
            (0.6, 4),
            (0, 3.3),
            (0, 2.6),
            (0.6, 2.1),
            (1.4, 1.9),
            (2, 1.4),
            (2, 0.7),
            (1.4, 0),
            (0.6, 0),
            (0, 0.6),
        ]
    ],
    "-": [[(0.5, 2), (1.5, 2)]],
    "2": [[(0, 3.3), (0.6, 4), (1.4, 4), (2, 3.3), (2, 2.6), (0, 0), (2, 0)]],
}


def plate_text(text, z0, unit_size):
    """Raised letters on the front plate; a reader before the car sees -y to the right."""
    strokes, width = [], 3.1
    for k, letter in enumerate(text):
        for line in LETTERS[letter]:
            for start, stop in pairwise(line):
                u = np.array([start, stop], float) + [(k - (len(text) - 1) / 2) * width - 1, -2]
                y, z = -u[:, 0] * unit_size, z0 + u[:, 1] * unit_size
                x = nose_at(np.abs(y), np.full_like(y, z0)) - 0.0105
                strokes.append(tube(np.stack([x, y, z], 1), 0.0048, 0.0025, up=(-1, 0, 0), sides=8, rounds=3))
    return join(*strokes)


def wipers():
    """Two arms that lie on the windscreen, a little above the glass."""
    pieces = []
    for start, stop in (((1.30, 0.40), (1.43, -0.28)), ((1.20, -0.12), (1.40, -0.62))):
        xy = np.linspace(start, stop, 12)
        z = ROOF(wrapped_x(xy[:, 0], xy[:, 1])) - 0.085 * xy[:, 1] ** 2 + 0.004
        blade = np.column_stack([xy, z + 0.012])
        pieces.append(tube(blade, 0.006, 0.010, sides=8, rounds=24))
        low = np.array([*start, 0.0])
        low[2] = z[0] + 0.01
        middle = blade[6] + [0, 0, 0.012]
        foot = np.array([start[0] - 0.10, start[1] - 0.02, 0.0])
        foot[2] = top_z(foot[0], abs(foot[1])) + 0.006
        pieces.append(tube([foot, 0.5 * (foot + middle) + [0, 0, 0.014], middle], 0.008, 0.006, sides=8, rounds=20))
    return join(*pieces)


def door_handle():
    """A bright bar in front of the door skin."""
    x = np.linspace(2.17, 2.37, 9)
    z = np.full_like(x, 0.735)
    y = flank_at(x, z) + 0.014 * (1 - ((x - 2.27) / 0.11) ** 4)
    return tube(np.stack([x, y, z], 1), 0.007, 0.011, sides=14, rounds=30)


def fuel_cap():
    """A round bright lid on the right rear shoulder."""
    at, n, _, _ = on_skin((3.38, 0.80, 0.80))
    lid = revolve(
        arc((0.066, 0.004), 0.006, 0, 90, 6),
        np.array([(0.066, 0.010), (0.054, 0.010)]),
        arc((0.054, 0.0065), 0.0035, 90, 180, 5),
        np.array([(0.0505, 0.0065), (0.03, 0.0085), (0, 0.0095)]),
    )
    bolts = [
        place(dome(0.004, 0.003), np.eye(3), [0.060 * np.cos(a), 0.010, 0.060 * np.sin(a)])
        for a in np.arange(8) * np.pi / 4
    ]
    return stand_on(join(lid, *bolts), at, n), stand_on(ring(0.074, 0.003), at, n)


def exhausts():
    pipe = revolve(
        arc((0.036, 0), 0.004, -90, 90, 8),
        np.array([(0.036, 0.004), (0.032, 0.003), (0.031, -0.08)]),
        np.array([(0.040, -0.12), (0.040, 0.0)]),
        segments=32,
    )
    return [place(pipe, turn(2, -90), [tail_x(0.42, 0.24) - 0.005, 0.42 + dy, 0.225]) for dy in (-0.045, 0.045)]


# ---------------------------------------------------------------------------------------------------------------------
# Files
# ---------------------------------------------------------------------------------------------------------------------


def write_ply(name, piece):
    """Binary little-endian PLY: float32 points and normals, triangles of int32."""
    p, n, t = tidy(*piece)
    vertices = np.hstack([p, unit(n)]).astype("<f4")
    faces = np.empty(len(t), [("count", "u1"), ("index", "<i4", 3)])
    faces["count"], faces["index"] = 3, t
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(p)}",
        *(f"property float {c}" for c in ("x", "y", "z", "nx", "ny", "nz")),
        f"element face {len(t)}",
        "property list uchar int vertex_indices",
        "end_header",
        "",
    ]
    path = FOLDER / f"tt-{name}.ply"
    path.write_bytes("\n".join(header).encode() + vertices.tobytes() + faces.tobytes())
    print(f"{path.name:24s} {len(p):7d} points {len(t):7d} triangles {path.stat().st_size / 1e6:6.2f} MB")
    return len(t)


def main():
    FOLDER.mkdir(exist_ok=True)
    panels = cut_panels()
    lips, wells = arch_linings()
    shell = implicit_piece(mirror_shell, (1.40, 0.72, 0.86), (1.62, 1.03, 1.08), 0.0095)
    rings, lenses = lamps()
    lid, lid_ring = fuel_cap()
    front_holder, front_plate = plate(0.300, 0.24, 0.048, front=True)
    rear_holder, rear_plate = plate(0.50, 0.26, 0.055, front=False)
    foot = tube([(1.52, 0.70, 0.895), (1.525, 0.78, 0.915), (1.535, 0.83, 0.945)], 0.042, 0.022)
    glass_back = stand_on(dome(0.062, 0.004), (1.567, 0.872, 0.972), (1, -0.12, 0))
    badge_at, badge_n, _, _ = on_skin((0.12, 0.0, 0.61))
    badge = stand_on(join(ring(0.030, 0.0045), dome(0.027, 0.006)), badge_at + 0.001 * badge_n, badge_n)

    parts = {
        "body": both_sides(painted(*panels.piece(PAINT)), lips, shell),
        "gaps": both_sides(sunk(*panels.piece(GAP), 0.007)),
        "trim": join(both_sides(sunk(*panels.piece(TRIM), 0.002), foot), wipers(), lid_ring),
        "windows": both_sides(sunk(*panels.piece(GLASS), 0.0035)),
        "headlights": both_sides(sunk(*panels.piece(LAMP), 0.034)),
        "lenses": both_sides(*lenses),
        "taillights": both_sides(sunk(*panels.piece(TAIL), 0.003)),
        "grille": join(both_sides(sunk(*panels.piece(GRILLE), 0.06, (1.0, 0, 0))), grille_bars()),
        "chrome": join(
            both_sides(sunk(*panels.piece(FRAME), -0.002), *rings, door_handle(), glass_back, *exhausts()), badge, lid
        ),
        "wells": join(both_sides(wells), underbody()),
        "plateholder": join(front_holder, rear_holder, plate_text("DMIS-2", 0.300, 0.0165)),
        "plate": join(front_plate, rear_plate),
        # one wheel at the origin: tt.pbrt puts it in four places
        "tyre": tyre(),
        "rim": rim(),
        "disc": brake_disc(),
        "caliper": implicit_piece(caliper, (0.08, -0.04, -0.14), (0.21, 0.07, 0.14), 0.007),
    }
    total = sum(write_ply(name, piece) for name, piece in parts.items())
    size = sum(path.stat().st_size for path in FOLDER.glob("tt-*.ply"))
    print(f"{total} triangles, {size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
