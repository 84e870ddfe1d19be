"""
Figure 4.1: the four scenes
===========================

The scenes of the thesis, rendered with its rule. Cameras, lights and materials are the thesis's; the meshes of those
that come with this library are not, because the killeroo and the car may not be handed on. With ``--scene-dir`` the
original files are rendered.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import SCENES, options, show

import dmis
from dmis import plot

opts, _ = options(__file__, __doc__)

# %%
# 128 samples per pixel, 6 of them the pilot's.
results = {}
for name, about in SCENES.items():
    scene = opts.scene(name)
    result = dmis.render(scene, "thesis", opts.spp, seed=1, parallel=opts.threads, progress=show(name))
    results[about.title] = result
    triangles = len(scene.plan.face_row)
    width, height = scene.camera.resolution
    print(
        f"{scene.name:20} {width}x{height}, {triangles:,} triangles, {len(scene.lights)} lights, "
        f"{result.seconds['total']:.1f} s"
    )

# %%
# Nothing but the images.
figure, axes = plot.canvas(2, 2, 14, 10.5)
for axis, (title, result) in zip(axes.flat, results.items(), strict=True):
    plot.picture(axis, result.image, f"{title} ({result.provenance['scene']})")
opts.save(
    figure,
    "Figure 4.1: the four scenes",
    f"""The thesis's scenes, rendered with its rule at {opts.spp} camera samples per pixel: a teapot on a floor under a
    disk light; a diffuse creature and a golden one in a tiled room with a small sphere light; a car under an
    environment map. sRGB, no tone mapping but clipping.""",
)
