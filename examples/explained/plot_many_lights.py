"""
A thousand lamps, and a lamp of 100,000 triangles
=================================================

dmis samples all lamps as one light, and all triangles as one light. A light sample
selects a lamp or triangle in proportion to its power, or by a light tree, which prefers
lamps near and facing the surface. Each lamp of the divided room lights only half of it.
"""

import runpy
import time

import dmis
from dmis import plot
from dmis.examples.gallery import options, print_canvas
from dmis.formats.shipped import SCENE_FOLDER

opts, _ = options("plot_many_lights", __doc__)
SPP, SIZE = 16, opts.pick((40, 25), (480, 300), (960, 600))
make = runpy.run_path(str(SCENE_FOLDER / "make_many_lights.py"))

# %%
# Half the squared difference of two renders with different seeds estimates the
# variance; relMSE divides it by the squared image plus 1 % of the squared mean.
scenes = (
    make["many_lights"](resolution=SIZE),
    make["glowing_knot"](*opts.pick((100, 10), (1000, 50)), resolution=SIZE),
)
figure, axes = print_canvas(2, 2, 4.7)
rows = ["| scene | selection | relMSE | CPU seconds of both |", "|---|---|---|---|"]
for line, scene in zip(axes, scenes, strict=True):
    for axis, lights in zip(line, ("power", "tree"), strict=True):
        begin = time.process_time()
        one, two = (
            dmis.render(
                scene, "balance", SPP, lights=lights, seed=seed, parallel=opts.threads
            )
            for seed in (1, 2)
        )
        seconds = time.process_time() - begin
        mean = (one.image + two.image) / 2
        over = mean**2 + 0.01 * mean.mean() ** 2
        error = ((one.image - two.image) ** 2 / 2 / over).mean()
        rows.append(f"| {scene.name} | {lights} | {error:#.2g} | {seconds:.1f} |")
        title = f"{scene.name}, {lights}: relMSE {error:#.2g}"
        plot.picture(axis, one.image, title, exposure=3 if scene is scenes[0] else 1)

print(*rows, f"{SPP} samples per pixel.", sep="\n")
opts.save(
    figure,
    "Many lights",
    f"""A divided room with 1,000 lamps above the view, and a knotted lamp of 100,000
    triangles, by {SPP} camera samples per pixel of the balance heuristic. Left: lamps
    and triangles are selected in proportion to their power. Right: by a light tree, in
    about the same time.""",
    panel=axes[0, 1],
)
