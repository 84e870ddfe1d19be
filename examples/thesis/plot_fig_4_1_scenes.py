"""
Figure 4.1: the four scenes
===========================

The four scenes of the thesis, rendered with the balance heuristic. All rules have the
same expected image, and this figure shows only what is in the scenes. Cameras, lights
and most materials are those of pbrt-v2's public files. KILLEROO DIFFUSE, which has no
such file, is KILLEROO GOLD with a matte creature. The meshes that come with dmis, and
the sky of TT, are its own, because the killeroo and the car may not be redistributed.
``--scene-dir`` renders the original files.

A plastic pot stands on a plastic board, under a disk of radius 2 that is partly in
view, with a point light at the camera. The creature stands on a gridded floor before
two gridded walls, under a disk of radius 150 at height 800, with a headlight, a distant
light along the view direction. TT is a car under a sky, with a small point light in the
closed cabin.
"""

import dmis
from dmis import plot
from dmis.examples.gallery import SCENES, options, print_canvas

opts, _ = options("plot_fig_4_1_scenes", __doc__)
SPP = opts.pick(16, 32, 128)
PATHS = {"integrator": "path", "spp": 2 * SPP}

# %%
# One light and one BRDF sample at a surface, n_l = n_b = 1: the balance heuristic adds
# f / (p_l + p_b) for each of the two directions. No pilot is needed. The points are
# those that pbrt-v2's files of these scenes ask for, because they are less noisy. Gold
# reflects little but its surroundings. By direct light alone it would be black except
# for reflections of the light. So both killeroo scenes are rendered by paths, as in the
# set-up ``nearest`` of Table 4.1; paths are noisier and get twice as many samples.
results = {}
for name, about in SCENES.items():
    scene = opts.scene(name, opts.pick(32, about.size[0] / 800, 1))
    more = {"sampler": "lowdiscrepancy", "progress": opts.progress, "preset": "thesis"}
    more |= PATHS if name.startswith("killeroo") else {"spp": SPP}
    results[about.title] = dmis.render(scene, "balance", seed=1, **more).image
    triangles = len(scene.plan.face_row)
    width, height = scene.camera.resolution
    print(
        f"{scene.name:20} {width}x{height}, {triangles:,} triangles,"
        f" {len(scene.lights)} lights"
    )

# %%
# Two columns of one width: the teapot above the car, the killeroos above each other.
figure = print_canvas(1, 1, 5.8)[0]
figure.clear()
titles = list(results)
for half, pair in zip(figure.subfigures(1, 2), (titles[::3], titles[1:3]), strict=True):
    heights = [results[title].shape[0] / results[title].shape[1] for title in pair]
    axes = half.subplots(2, 1, height_ratios=heights)
    for axis, title in zip(axes, pair, strict=True):
        plot.picture(axis, results[title], title)
        axis.set_axis_off()
opts.save_for_print(
    figure,
    "Figure 4.1: the four scenes",
    f"""Cameras, lights and most materials are those of pbrt-v2's public files (KILLEROO
    DIFFUSE: GOLD made matte); meshes and TT's sky are dmis's. {results["TT"].shape[1]}
    pixels wide, balance heuristic, pbrt-v2's points. Direct light at {SPP} camera
    samples per pixel; killeroos by paths at {PATHS["spp"]}. sRGB, clipped at 1.""",
    panel=axes[0],
    dpi=235,
)
