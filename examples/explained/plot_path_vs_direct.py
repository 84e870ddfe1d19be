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
from dmis.examples.gallery import SCENES, options

opts, _ = options("plot_path_vs_direct", __doc__)
DEPTHS = opts.pick((1, 6), (1, 2, 3, 4, 6, 10))
DEEP = 6

# %%
# Render the thesis's scenes at half of the usual size. The rule auto learns again for
# each depth.
scenes = {
    "CORNELL": dmis.load_scene(
        "cornell", resolution=opts.pick((16, 16), (100, 100), (200, 200))
    )
}
scenes |= {
    about.title: opts.scene(name, 2 * opts.shrink) for name, about in SCENES.items()
}
images = {}
for title, scene in scenes.items():
    for depth in DEPTHS if title in ("CORNELL", "KILLEROO GOLD") else (1, DEEP):
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
# Draw one row for each scene: direct light, paths, and the indirect share, which
# contains the noise of both images.
figure, axes = plot.canvas(len(scenes) + 1, 3, 13, 3.6 * (len(scenes) + 1))
for line, title in zip(axes, scenes, strict=False):
    direct, paths = images[title, 1], images[title, DEEP]
    plot.picture(line[0], direct, f"{title}: direct lighting")
    plot.picture(line[1], paths, f"{title}: paths, depth {DEEP}")
    total = paths.mean(axis=2)
    share = 1 - np.divide(
        direct.mean(axis=2), total, out=np.ones_like(total), where=total > 0
    )
    shown = plot.heat(
        line[2],
        np.clip(share, 0, 1),
        "share of light that bounced",
        cmap="magma",
        vmin=0,
        vmax=1,
    )
    figure.colorbar(shown, ax=line[2], shrink=0.8)
for axis in axes[-1, 1:]:
    axis.set_visible(False)
for title in ("CORNELL", "KILLEROO GOLD"):
    means = np.array([images[title, depth].mean() for depth in DEPTHS])
    axes[-1, 0].plot(DEPTHS, means / means[-1], "o-", label=title)
axes[-1, 0].set_xlabel("surfaces that may scatter light (max_depth)")
axes[-1, 0].set_ylabel(f"mean / mean at depth {DEPTHS[-1]}")
axes[-1, 0].set_ylim(0, None)
axes[-1, 0].legend(fontsize=8)
axes[-1, 0].grid(alpha=0.3)
opts.save(
    figure,
    "Path tracing and direct lighting",
    f"""Direct lighting, path tracing {DEEP} surfaces deep, and the share of the
    radiance that other surfaces have scattered, by the rule auto with {opts.spp}
    samples per pixel. Below: the mean of the image against the depth.""",
    panel=axes[0, 1],
)
