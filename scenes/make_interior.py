"""Make one room in three lights: `interior.pbrt`, `interior-glasses.pbrt`, `interior-door.pbrt`.

What: a living room of 43 materials: wood, paint, cloth, china, metals, glass, textures. A panel on the ceiling, a bulb
in a shade and a small desk lamp light it (`interior`); the second camera looks at the glasses on the table; in the
third scene a lamp behind a door that is ajar is the only light. Metres, z up.

Why: scenes of artists have many materials, few of them in the light of a lamp, and no constant of dmis is chosen on
these three.

Writes the scene files, `geometry/interior.pbrt` with the furniture, `geometry/interior-*.ply` of what was turned on a
lathe, and `textures/planks.exr`.

Run: python scenes/make_interior.py        (deterministic, a second, needs dmis itself)
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import trimesh
from make_cornell import lathe
from make_room import planks

from dmis.image import srgb_to_linear, write_exr

Point = Sequence[float]

FOLDER = Path(__file__).parent
HEAD = """# {title}. Written by make_interior.py.
# Held out: no constant, default or threshold of dmis is chosen on this scene.
Scale -1 1 1
LookAt {view}  0 0 1
Camera "perspective" "float fov" [{fov}]
Film "image" "integer xresolution" [320] "integer yresolution" [180]
PixelFilter "box" "float xwidth" [.5] "float ywidth" [.5]
SurfaceIntegrator "directlighting"

WorldBegin
"""
SCENES = {
    "interior": ("INTERIOR: a room with three lamps", "-2.1 -2.7 1.55  .5 1.4 .8", 47, ("panel", "bulb", "desk lamp")),
    "interior-glasses": (
        "INTERIOR, GLASSES: the table of this room",
        "-.35 -.75 1.2  .18 .72 .78",
        26,
        ("panel", "bulb", "desk lamp"),
    ),
    "interior-door": (
        "INTERIOR, DOOR: the room by the light of the hall",
        "-2.1 -2.7 1.55  1.1 1.2 .85",
        47,
        ("hall",),
    ),
}
"""Title, view, angle of view and lamps of each scene."""
LAMPS = {
    "panel": ((20, 18, 15), (0, 0.3, 2.68), ((-0.45, -0.25, 0), (0, 0.5, 0), (0.9, 0, 0))),
    "bulb": ((160, 120, 75), (-1.9, 1.85, 1.45), 'Shape "sphere" "float radius" [.05]'),
    "desk lamp": ((420, 390, 340), (0.78, 1.0, 1.135), 'Rotate 205 1 0 0 Shape "disk" "float radius" [.035]'),
    "hall": ((36, 32, 26), (4.05, 0.2, 1.4), ((0, -0.6, -0.8), (0, 0, 1.6), (0, 1.2, 0))),
}
"""Radiance, place and shape of each lamp; of a panel a corner and two sides."""

METALS = {
    "gold": ((0.143, 0.375, 1.4425), (3.983, 2.3857, 1.6032)),
    "copper": ((0.2004, 0.924, 1.1022), (3.9129, 2.4528, 2.1422)),
    "steel": ((2.757, 2.512, 2.231), (3.867, 3.404, 3.005)),
    "brass": ((0.444, 0.527, 1.094), (3.695, 2.765, 1.829)),
}
"""Index of refraction and absorption."""


def matte(*kd: float, sigma: float = 0) -> str:
    """Return a matte material."""
    return f'"matte" {rgb("Kd", kd)} "float sigma" [{sigma:g}]'


def plastic(roughness: float, ks: float, *kd: float) -> str:
    """Return a diffuse material with a gloss."""
    return f'"plastic" {rgb("Kd", kd)} {rgb("Ks", (ks,) * 3)} "float roughness" [{roughness:g}]'


def substrate(roughness: float, ks: float, *kd: float) -> str:
    """Return varnish or glaze over a diffuse base."""
    rough = f'"float uroughness" [{roughness:g}] "float vroughness" [{roughness:g}]'
    return f'"substrate" {rgb("Kd", kd)} {rgb("Ks", (ks,) * 3)} {rough}'


def metal(name: str, roughness: float) -> str:
    """Return a metal of `METALS`."""
    eta, k = METALS[name]
    return f'"metal" {rgb("eta", eta)} {rgb("k", k)} "float roughness" [{roughness:g}]'


def rgb(name: str, value: Iterable[float]) -> str:
    """Return a parameter that is a color."""
    return f'"color {name}" [{" ".join(f"{x:g}" for x in value)}]'


def texture(name: str, scale: Point, text: str) -> str:
    """Return a texture, repeated `scale` times along u and v."""
    kind, _, rest = text.partition(" ")
    return f'Texture "{name}" "color" {kind} "float uscale" [{scale[0]}] "float vscale" [{scale[1]}] {rest}'


PLANKS = '"imagemap" "string filename" ["textures/planks.exr"]'
MATERIALS = {
    "floor": '"plastic" "texture Kd" "planks" "color Ks" [.12 .12 .12] "float roughness" [.04]',
    "rug": '"matte" "texture Kd" "rug" "float sigma" [30]',
    "wallpaper": '"matte" "texture Kd" "stripes"',
    "picture": '"matte" "texture Kd" "tiles"',
    "paint": matte(0.72, 0.69, 0.62),
    "ceiling": matte(0.82, 0.82, 0.8),
    "hall": matte(0.75, 0.72, 0.66),
    "skirting": plastic(0.02, 0.08, 0.75, 0.74, 0.7),
    "door": substrate(0.03, 0.05, 0.68, 0.66, 0.6),
    "handle": metal("steel", 0.004),
    "table": substrate(0.02, 0.06, 0.23, 0.11, 0.05),
    "legs": metal("steel", 0.02),
    "seat": plastic(0.05, 0.15, 0.5, 0.05, 0.04),
    "chair legs": metal("steel", 0.001),
    "sofa": matte(0.16, 0.2, 0.26, sigma=40),
    "cushion red": matte(0.55, 0.14, 0.1, sigma=30),
    "cushion blue": matte(0.1, 0.2, 0.45, sigma=30),
    "cushion grey": matte(0.5, 0.48, 0.44, sigma=30),
    "shelf": '"uber" "color Kd" [.32 .2 .1] "color Ks" [.1 .1 .1] "float roughness" [.03]',
    "frame": metal("gold", 0.01),
    "mirror": '"mirror" "color Kr" [.85 .87 .86]',
    "china": substrate(0.001, 0.04, 0.8, 0.79, 0.75),
    "celadon": substrate(0.004, 0.05, 0.35, 0.5, 0.42),
    "bowl": metal("copper", 0.006),
    "teapot": metal("steel", 0.0015),
    "candlestick": metal("brass", 0.003),
    "wax": matte(0.8, 0.74, 0.6),
    "tumbler": '"glass" "float index" [1.5]',
    "goblet": '"glass" "float index" [1.52]',
    "bottle": '"glass" "color Kt" [.35 .75 .4] "float index" [1.5]',
    "orange": plastic(0.08, 0.08, 0.75, 0.3, 0.02),
    "apple": plastic(0.01, 0.06, 0.5, 0.06, 0.05),
    "shade": plastic(0.2, 0.05, 0.75, 0.7, 0.6),
    "stand": metal("brass", 0.01),
    **{
        f"book {n}": material
        for n, material in enumerate(
            (
                matte(0.4, 0.08, 0.06),
                plastic(0.03, 0.1, 0.08, 0.14, 0.3),
                matte(0.5, 0.45, 0.32),
                plastic(0.01, 0.12, 0.05, 0.05, 0.05),
                substrate(0.02, 0.05, 0.1, 0.25, 0.12),
                matte(0.6, 0.4, 0.1),
                plastic(0.06, 0.1, 0.6, 0.58, 0.55),
                substrate(0.01, 0.05, 0.3, 0.05, 0.2),
                matte(0.15, 0.3, 0.35),
            )
        )
    },
}
CHECKS = {
    "rug": ((10, 14), (0.45, 0.12, 0.1), (0.6, 0.5, 0.38)),
    "stripes": ((60, 1), (0.62, 0.6, 0.5), (0.5, 0.52, 0.42)),
    "tiles": ((6, 4), (0.1, 0.3, 0.5), (0.8, 0.6, 0.2)),
}
"""Scale and colours of each texture of two colours."""
TURNED = {
    "tumbler": [(0, 0), (0.036, 0), (0.04, 0.11), (0.0375, 0.112), (0.0335, 0.012), (0, 0.01)],
    "goblet": [
        *((0, 0), (0.034, 0), (0.034, 0.003), (0.005, 0.008), (0.004, 0.085), (0.03, 0.105), (0.04, 0.14)),
        *((0.033, 0.19), (0.0315, 0.19), (0.038, 0.14), (0.028, 0.107), (0, 0.095)),
    ],
    "bottle": [(0, 0), (0.037, 0), (0.038, 0.19), (0.014, 0.25), (0.014, 0.31), (0.011, 0.31), (0.011, 0.25), (0, 0.2)],
    "bowl": [(0, 0), (0.05, 0), (0.055, 0.008), (0.12, 0.07), (0.117, 0.072), (0.05, 0.015), (0, 0.012)],
    "china": [(0, 0), (0.06, 0), (0.11, 0.018), (0.11, 0.021), (0.06, 0.006), (0, 0.006)],
    "celadon": [(0, 0), (0.06, 0), (0.1, 0.12), (0.05, 0.24), (0.06, 0.28), (0.055, 0.28), (0.04, 0.24), (0, 0.2)],
    "candlestick": [
        (0, 0),
        (0.05, 0),
        (0.05, 0.01),
        (0.012, 0.03),
        (0.01, 0.12),
        (0.022, 0.13),
        (0.022, 0.15),
        (0, 0.15),
    ],
    "shade": [(0.2, 0), (0.12, 0.26), (0.117, 0.26), (0.197, 0)],
}
"""Corners (radius, height) of what a lathe makes, each in the material of its name."""


def turned(corners: Sequence[Point]) -> trimesh.Trimesh:
    """Return the surface of a profile with sharp corners."""
    p = np.array(corners, float)
    along = np.diff(p, axis=0)
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    return lathe(np.stack([p[:-1], p[1:]], axis=1).reshape(-1, 2), np.repeat(normals, 2, axis=0))


def shape(points: Iterable[Point], indices: str, uv: str = "") -> str:
    """Return a mesh."""
    corners = "  ".join(" ".join(f"{x:g}" for x in p) for p in points)
    return f'Shape "trianglemesh" "integer indices" [{indices}] "point P" [{corners}]{uv}'


def quad(corner: Point, u: Point, v: Point) -> str:
    """Return a parallelogram with texture coordinates."""
    a, b, c = (np.array(x, float) for x in (corner, u, v))
    return shape((a, a + b, a + b + c, a + c), "0 1 2 2 3 0", ' "float uv" [0 0 1 0 1 1 0 1]')


def box(low: Point, high: Point) -> str:
    """Return a box along the axes."""
    (a, b, c), (d, e, f) = low, high
    points = (a, b, c), (d, b, c), (d, e, c), (a, e, c), (a, b, f), (d, b, f), (d, e, f), (a, e, f)
    return shape(points, "0 2 1 0 3 2 4 5 6 4 6 7 0 1 5 5 4 0 1 2 6 6 5 1 2 3 7 7 6 2 3 0 4 4 7 3")


def placed(place: Point, *lines: str) -> str:
    """Return shapes moved to a place."""
    return "\n".join(["AttributeBegin", f"Translate {' '.join(f'{x:g}' for x in place)}", *lines, "AttributeEnd"])


def furniture() -> dict[str, list[str]]:
    """Return the shapes of each material."""
    things: dict[str, list[str]] = {name: [] for name in MATERIALS}
    things["floor"] += [quad((-2.5, -3, 0), (5, 0, 0), (0, 5.4, 0)), quad((2.5, -0.6, 0), (1.6, 0, 0), (0, 2.6, 0))]
    things["rug"] += [quad((-1.3, -1.2, 0.004), (2.6, 0, 0), (0, 1.9, 0))]
    things["wallpaper"] += [quad((-2.5, 2.4, 0), (5, 0, 0), (0, 0, 2.7))]
    things["ceiling"] += [
        quad((-2.5, -3, 2.7), (0, 5.4, 0), (5, 0, 0)),
        quad((2.5, -0.6, 2.7), (0, 2.6, 0), (1.6, 0, 0)),
    ]
    things["paint"] += [
        quad((-2.5, -3, 0), (0, 5.4, 0), (0, 0, 2.7)),
        quad((-2.5, -3, 0), (5, 0, 0), (0, 0, 2.7)),
        *(box((2.5, y, z), (2.58, v, 2.7)) for y, v, z in ((-3, 0.2, 0), (1.1, 2.4, 0), (0.2, 1.1, 2.05))),
    ]
    things["hall"] += [
        quad((2.58, -0.6, 0), (1.52, 0, 0), (0, 0, 2.7)),
        quad((2.58, 2, 0), (1.52, 0, 0), (0, 0, 2.7)),
        quad((4.1, -0.6, 0), (0, 2.6, 0), (0, 0, 2.7)),
    ]
    things["skirting"] += [box((-2.5, 2.38, 0), (2.5, 2.4, 0.09)), box((2.48, 1.1, 0), (2.5, 2.4, 0.09))]
    things["door"] += [placed((2.49, 1.1, 0), "Rotate -28 0 0 1", box((-0.04, -0.9, 0.01), (0, 0, 2.04)))]
    knob = 'Shape "sphere" "float radius" [.03]'
    things["handle"] += [placed((2.49, 1.1, 0), "Rotate -28 0 0 1", f"Translate -.08 -.83 1 {knob}")]
    things["table"] += [box((-0.6, 0.3, 0.71), (1, 1.2, 0.74))]
    things["legs"] += [box((x, y, 0), (x + 0.05, y + 0.05, 0.71)) for x in (-0.57, 0.92) for y in (0.33, 1.12)]
    things["seat"] += [box((-0.1, -0.35, 0.44), (0.35, 0.1, 0.47)), box((-0.1, -0.38, 0.55), (0.35, -0.35, 0.9))]
    for x in (-0.1, 0.33):
        things["chair legs"] += [box((x, -0.37, 0), (x + 0.02, -0.35, 0.9)), box((x, 0.08, 0), (x + 0.02, 0.1, 0.44))]
    things["sofa"] += [
        box((-2.35, -0.9, 0.1), (-1.55, 1.1, 0.42)),
        box((-2.45, -0.9, 0.1), (-2.25, 1.1, 0.85)),
        *(box((-2.35, y, 0.1), (-1.55, y + 0.18, 0.62)) for y in (-1.08, 1.1)),
    ]
    for y, colour in ((-0.7, "red"), (-0.1, "grey"), (0.6, "blue")):
        cushion = f"Rotate 70 0 1 0 Scale .22 .22 .08 {knob.replace('.03', '1')}"
        things[f"cushion {colour}"] += [placed((-2.1, y, 0.6), cushion)]
    things["shelf"] += [box((-0.9, 2.1, z), (1.3, 2.4, z + 0.03)) for z in (1.25, 1.65)]
    x = -0.8
    for n in range(18):
        width, height = 0.03 + 0.02 * (7 * n % 4) / 3, 0.22 + 0.08 * (5 * n % 7) / 6
        things[f"book {4 * n % 9}"] += [box((x, 2.15, 1.28), (x + width, 2.34, 1.28 + height))]
        x += width + 0.004
    things["frame"] += [box((-2.06, 2.37, 1.2), (-1.24, 2.395, 1.78)), box((1.5, 2.37, 1.1), (2.1, 2.395, 2))]
    things["picture"] += [quad((-2, 2.365, 1.26), (0.7, 0, 0), (0, 0, 0.46))]
    things["mirror"] += [quad((1.55, 2.365, 1.15), (0.5, 0, 0), (0, 0, 0.8))]
    for name, places in {
        "tumbler": ((0.12, 0.62, 0.741), (0.3, 0.5, 0.741)),
        "goblet": ((0.02, 0.78, 0.741), (0.4, 0.72, 0.741)),
        "bottle": ((0.22, 0.9, 0.741),),
        "bowl": ((-0.25, 0.75, 0.741),),
        "china": ((0.62, 0.52, 0.741), (-0.1, 0.48, 0.741)),
        "celadon": ((0.9, 2.25, 1.281),),
        "candlestick": ((0.52, 0.95, 0.741),),
        "shade": ((-1.9, 1.85, 1.36),),
    }.items():
        things[name] += [
            placed(p, f'Shape "plymesh" "string filename" ["geometry/interior-{name}.ply"]') for p in places
        ]
    teapot = 'Shape "plymesh" "string filename" ["geometry/teapot.ply"]'
    things["teapot"] += [placed((0.7, 0.8, 0.741), "Rotate 200 0 0 1 Scale .05 .05 .05", teapot)]
    things["wax"] += [
        placed((0.52, 0.95, 0.89), 'Shape "cylinder" "float radius" [.012] "float zmin" [0] "float zmax" [.12]')
    ]
    for name, place, radius in (("orange", (-0.28, 0.74, 0.81), 0.045), ("apple", (-0.2, 0.79, 0.805), 0.04)):
        things[name] += [placed(place, f'Shape "sphere" "float radius" [{radius}]')]
    things["stand"] += [
        box((-1.91, 1.84, 0), (-1.89, 1.86, 1.38)),
        box((-2.05, 1.7, 0), (-1.75, 2, 0.02)),
        box((0.77, 1.12, 0.741), (0.79, 1.14, 1.2)),
        box((0.77, 1.0, 1.18), (0.79, 1.14, 1.2)),
    ]
    return things


def lamp(name: str) -> str:
    """Return one of `LAMPS`."""
    radiance, place, form = LAMPS[name]
    emission = f'AreaLightSource "area" {rgb("L", radiance)}'
    return placed(place, emission, f"Material {matte(0, 0, 0)}", form if isinstance(form, str) else quad(*form))


def main() -> None:
    """Write everything."""
    texels = srgb_to_linear(planks().astype(np.float32) / 255)
    write_exr(FOLDER / "textures" / "planks.exr", {"RGB": texels})
    for name, corners in TURNED.items():
        file = FOLDER / "geometry" / f"interior-{name}.ply"
        file.write_bytes(trimesh.exchange.ply.export_ply(turned(corners), vertex_normal=True))
    lines = ["# The room of the scenes interior*.pbrt. Written by make_interior.py.", texture("planks", (2, 2), PLANKS)]
    lines += [
        texture(name, scale, f'"checkerboard" {rgb("tex1", one)} {rgb("tex2", two)}')
        for name, (scale, one, two) in CHECKS.items()
    ]
    for name, shapes in furniture().items():
        lines += [f"# {name}", f"Material {MATERIALS[name]}", *shapes]
    (FOLDER / "geometry" / "interior.pbrt").write_text("\n".join([*lines, ""]))
    for name, (title, view, fov, lamps) in SCENES.items():
        parts = [HEAD.format(title=title, view=view, fov=fov), *(lamp(of) for of in lamps)]
        text = "\n".join([*parts, 'Include "geometry/interior.pbrt"', "", "WorldEnd", ""])
        (FOLDER / f"{name}.pbrt").write_text(text)


if __name__ == "__main__":
    main()
