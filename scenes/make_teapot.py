"""Make the teapot of the scene `teapot-area-light.pbrt`: the file `scenes/geometry/teapot.ply`.

What: Martin Newell's teapot of 1975 as it is usually passed on: 32 bicubic Bézier patches, with the bottom that was
added later, z up, spout toward +x, standing on z = 0. Of the 306 control points of the old listing 290 are distinct.
One binary PLY file: vertices, exact unit normals, triangles, all wound so that the outside is outside.

How: by symmetry six profiles and four half tubes say it all. Rim, body, lid and bottom are surfaces of revolution: each
profile is swept through four quarter turns by the same weights (1, 0), (1, .56), (.56, 1), (0, 1), which stay within
half a percent of a circle; only the knob has .45 where .448 would follow. Handle and spout are halves and their mirror
images.

Why: the control points are in the public domain, the triangles of the original scene file are not ours to pass on, and
24 divisions of a patch, where the original has 6, leave no corners in the silhouette.

Run: python scenes/make_teapot.py        (deterministic, a second, needs dmis itself)
"""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh

from dmis.base.vectors import Floats
from dmis.geometry.mesh import Mesh
from dmis.geometry.shapes import grid

DIVISIONS = 24
FILE = Path(__file__).parent / "geometry" / "teapot.ply"

# Profiles (radius, height), each running down the outside.
RIM = (1.4, 2.4), (1.3375, 2.53125), (1.4375, 2.53125), (1.5, 2.4)
SHOULDER = (1.5, 2.4), (1.75, 1.875), (2, 1.35), (2, 0.9)
BELLY = (2, 0.9), (2, 0.45), (1.5, 0.225), (1.5, 0.15)
BOTTOM = (1.5, 0.15), (1.5, 0.075), (1.425, 0), (0, 0)
KNOB = (0, 3.15), (0.8, 3.15), (0, 2.85), (0.2, 2.7)
LID = (0.2, 2.7), (0.4, 2.55), (1.3, 2.55), (1.3, 2.4)

# Half tubes: four rows along the tube, each ((x, z) of one end of a half circle, (x, z) of the other, y of its bulge).
# The ends lie in the middle plane y = 0.
HANDLE_TOP = (
    ((-1.6, 2.025), (-1.5, 2.25), 0.3),
    ((-2.3, 2.025), (-2.5, 2.25), 0.3),
    ((-2.7, 2.025), (-3, 2.25), 0.3),
    ((-2.7, 1.8), (-3, 1.8), 0.3),
)
HANDLE_BOTTOM = (
    ((-2.7, 1.8), (-3, 1.8), 0.3),
    ((-2.7, 1.575), (-3, 1.35), 0.3),
    ((-2.5, 1.125), (-2.65, 0.9375), 0.3),
    ((-2, 0.9), (-1.9, 0.6), 0.3),
)
SPOUT_BOTTOM = (
    ((1.7, 1.425), (1.7, 0.6), 0.66),
    ((2.6, 1.425), (3.1, 0.825), 0.66),
    ((2.3, 2.1), (2.4, 2.025), 0.25),
    ((2.7, 2.4), (3.3, 2.4), 0.25),
)
SPOUT_TOP = (
    ((2.7, 2.4), (3.3, 2.4), 0.25),
    ((2.8, 2.475), (3.525, 2.49375), 0.25),
    ((2.9, 2.475), (3.45, 2.5125), 0.15),
    ((2.8, 2.4), (3.2, 2.4), 0.15),
)


def quarters(profile: tuple[tuple[float, float], ...]) -> Floats:
    """Control points (4, 4, 4, 3) of four quarter turns: down the profile, then counter-clockwise."""
    r, z = np.array(profile, float).T
    weight = np.array([(1, 0), (1, 0.56), (0.56, 1), (0, 1)])
    xy = r[:, None, None] * weight
    if profile is KNOB:  # Newell wrote .45, not .56 · .8
        xy[1, 1, 1] = xy[1, 2, 0] = 0.45
    x, y = xy[..., 0], xy[..., 1]
    height = np.broadcast_to(z[:, None], x.shape)
    return np.stack(
        [np.stack(turned, axis=2) for turned in ((x, y, height), (-y, x, height), (-x, -y, height), (y, -x, height))]
    )


def halves(tube: tuple[tuple[tuple[float, float], tuple[float, float], float], ...]) -> Floats:
    """Control points (2, 4, 4, 3) of a tube: the half y <= 0 and its mirror image, run through backwards."""
    half = np.array([[(b[0], 0, b[1]), (b[0], -y, b[1]), (a[0], -y, a[1]), (a[0], 0, a[1])] for a, b, y in tube])
    return np.stack([half, half[:, ::-1] * (1, -1, 1)])


def teapot() -> Floats:
    """Control points (32, 4, 4, 3) of the teapot; dp/du x dp/dv is outside."""
    turned = [quarters(profile) for profile in (RIM, SHOULDER, BELLY, BOTTOM, KNOB, LID)]
    return np.concatenate(turned + [halves(tube) for tube in (HANDLE_TOP, HANDLE_BOTTOM, SPOUT_BOTTOM, SPOUT_TOP)])


def bezier_patches(control: npt.ArrayLike, divisions: int = 16) -> Mesh:
    """Tessellate bicubic Bézier patches, with analytic normals.

    Parameters
    ----------
    control
        Control points of P patches, (P, 4, 4, 3). u runs along axis 1, v along axis 2, and dp/du x dp/dv is outside.
    divisions
        Quads along a side of a patch, >= 1.

    Returns
    -------
    Mesh
        P·2·divisions² triangles, less those without area; uv are each patch's (u, v). Patches that share a boundary
        curve share its points to the last bit. Where a tangent vanishes, at a pole, the normal is the limit inside.
    """
    net = np.asarray(control, np.float64)
    t = np.linspace(0, 1, divisions + 1)
    cubic = np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]])  # Bernstein, row i for t^i
    power = np.vander(t, 4, increasing=True)
    basis = power @ cubic, power[:, :3] @ (cubic[1:] * [[1], [2], [3]]), power[:, :2] @ (cubic[2:] * [[2], [6]])

    def derivative(i: int, j: int) -> Floats:
        return np.einsum("ui,vj,pijk->puvk", basis[i], basis[j], net, optimize=True)

    pu, pv, puv = derivative(1, 0), derivative(0, 1), derivative(1, 1)
    normal = np.cross(pu, pv)
    # Where the normal vanishes: the direction in which it grows towards the inside of the patch.
    sign = np.where(t < 0.5, 1.0, -1.0)[:, None]
    growth = sign[:, None] * (np.cross(derivative(2, 0), pv) + np.cross(pu, puv))
    growth += sign * (np.cross(puv, pv) + np.cross(pu, derivative(0, 2)))
    length = np.linalg.norm(normal, axis=3, keepdims=True)
    least = 1e-9 * length.max(axis=(1, 2), keepdims=True)
    normal = np.where(length > least, normal, growth)
    return grid(derivative(0, 0), normal, np.stack(np.broadcast_arrays(t[:, None], t), axis=2))


def main() -> None:
    """Tessellate and write."""
    mesh = bezier_patches(teapot(), DIVISIONS)
    pot = trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_normals=mesh.normals, process=False)
    FILE.parent.mkdir(exist_ok=True)
    FILE.write_bytes(trimesh.exchange.ply.export_ply(pot, vertex_normal=True))
    print(f"{FILE.name}: {mesh.triangles} triangles, {FILE.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
