"""
Path tracing and direct lighting
================================

How much light arrives over other surfaces? For each scene the figure shows direct
lighting, path tracing over six surfaces, and the indirect share of the radiance. In the
open, under a sky, this share is small. In the box, indirect light brightens the ceiling
and all shadows. The last panel shows the mean of the image against the largest number
of scattering surfaces, and so the speed of convergence.
"""

import numpy as np

import dmis
from dmis import plot
from dmis.examples.gallery import SCENES, options, print_canvas

opts, _ = options("plot_path_vs_direct", __doc__)
DEPTHS = opts.pick((1, 6), (1, 2, 3, 4, 6, 10))
DEEP = 6

# %%
# Render the thesis's scenes at half of the usual size. The rule auto learns again for
# each depth.
scenes = {
    "cornell": dmis.load_scene(
        "cornell", resolution=opts.pick((16, 16), (100, 100), (200, 200))
    )
}
scenes |= {name: opts.scene(name, 2 * opts.shrink) for name in SCENES}
images = {}
for title, scene in scenes.items():
    for depth in DEPTHS if title in ("cornell", "killeroo-gold") else (1, DEEP):
        settings = dmis.Settings(integrator="path", max_depth=depth)
        result = dmis.render(
            scene,
            "auto",
            opts.spp,
            seed=depth,
            settings=settings,
            parallel=opts.threads,
            progress=opts.progress,
        )
        images[title, depth] = result.image
    print(
        f"{title:20} {images[title, DEEP].mean() / images[title, 1].mean():6.3f} times"
        " the light of direct lighting"
    )

# %%
# Draw one column for each scene: direct light, paths, and the indirect share, which
# contains the noise of both images. The curves below are of two scenes.
ratios = [s.camera.resolution[0] / s.camera.resolution[1] for s in scenes.values()]
figure = print_canvas(1, 1, 5.8)[0]
figure.clear()
top, bottom = figure.subfigures(2, 1, height_ratios=[2.1, 1])
axes = top.subplots(3, len(scenes), width_ratios=ratios)
for line, title in zip(axes.T, scenes, strict=True):
    direct, paths = images[title, 1], images[title, DEEP]
    total = paths.mean(axis=2)
    share = 1 - np.divide(
        direct.mean(axis=2), total, out=np.ones_like(total), where=total > 0
    )
    plot.picture(line[0], direct, title)
    plot.picture(line[1], paths)
    share = np.clip(share, 0, 1)
    shown = plot.heat(line[2], share, cmap="magma", vmin=0, vmax=1)
for axis, label in zip(axes[:, 0], ("direct", "paths", "indirect share"), strict=True):
    axis.set_ylabel(label)
top.colorbar(shown, ax=axes[2], location="bottom", shrink=0.5, aspect=40)
axis = bottom.subplots()
for title, mark in (("cornell", "o-"), ("killeroo-gold", "s--")):
    means = np.array([images[title, depth].mean() for depth in DEPTHS])
    axis.plot(DEPTHS, means / means[-1], mark, label=title)
axis.set_xlabel("surfaces that may scatter light (max_depth)")
axis.set_ylabel(f"mean / mean at {DEPTHS[-1]}")
axis.set_ylim(0, None)
axis.legend()
axis.grid(alpha=0.3)
opts.save(
    figure,
    "Path tracing and direct lighting",
    f"""Direct lighting, path tracing {DEEP} surfaces deep, and the share of the
    radiance that other surfaces have scattered, by the rule auto with {opts.spp}
    samples per pixel. Below: the mean of the image against the depth.""",
    panel=axes[1, 0],
)
