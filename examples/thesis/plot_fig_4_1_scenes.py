"""
Figure 4.1: the four scenes
===========================

The four scenes of the thesis, rendered with the balance heuristic. All rules have the
same expected image, and this figure shows only what is in the scenes. Cameras, lights
and materials are the thesis's. The meshes that come with dmis are its own, because the
killeroo and the car may not be redistributed. ``--scene-dir`` renders the original
files.
"""

import dmis
from dmis import plot
from examples.gallery import SCENES, options, print_canvas

opts, _ = options("plot_fig_4_1_scenes", __doc__)
SPP = opts.pick(16, 32, 128)
INTEGRATOR = {"killeroo-gold": "path"}

# %%
# One light and one BRDF sample at a surface, n_l = n_b = 1: the balance heuristic adds
# f / (p_l + p_b) for each of the two directions. No pilot is needed. The points are
# those that pbrt-v2's files of these scenes ask for, because they are less noisy. Gold
# reflects little but its surroundings. By direct light alone it would be black except
# for reflections of the light, so KILLEROO GOLD is rendered by paths.
results = {}
for name, about in SCENES.items():
    scene = opts.scene(name, opts.pick(32, min(about.size) / 800, 1))
    more = {"integrator": INTEGRATOR.get(name, "direct"), "sampler": "lowdiscrepancy"}
    results[about.title] = dmis.render(
        scene,
        "balance",
        SPP,
        seed=1,
        progress=opts.progress,
        preset="thesis",
        **more,
    )
    triangles = len(scene.plan.face_row)
    width, height = scene.camera.resolution
    print(
        f"{scene.name:20} {width}x{height}, {triangles:,} triangles,"
        f" {len(scene.lights)} lights"
    )

# %%
# Draw the images with 800 dots or more on the shorter side of each.
figure, axes = print_canvas(2, 2, 5, height_ratios=[1.15, 1])
for axis, (title, result) in zip(axes.flat, results.items(), strict=True):
    plot.picture(axis, result.image, title)
    axis.set_axis_off()
opts.save_for_print(
    figure,
    "Figure 4.1: the four scenes",
    f"""The thesis's scenes, rendered with the balance heuristic and pbrt-v2's
    low-discrepancy points at {SPP} camera samples per pixel.
    TEAPOT AREA LIGHT: a plastic pot on a plastic board, under a disk of radius 2 that
    is partly in view, with a point light at the camera. KILLEROO DIFFUSE and KILLEROO
    GOLD: a creature on a gridded floor before two gridded walls, under a disk of radius
    150 at height 800, with a headlight, a distant light along the view direction. TT: a
    car under a sky, with a small point light in the closed cabin. Direct lighting,
    KILLEROO GOLD by paths. sRGB without tone mapping: values above 1 are clipped. The
    script's PNG has 800 dots or more on the shorter side of each scene; copies on pages
    have fewer.""",
    panel=axes[1, 1],
    dpi=430,
)
