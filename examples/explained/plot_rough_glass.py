"""
Rough glass
===========

Facets reflect and refract: three balls of glass, from almost smooth to frosted, lie on
tiles under a bright lamp, rendered by path tracing. Light comes to each point of the
glass from both sides, and light and BRDF samples are mixed for each side. Frosted
glass blurs objects behind it, and at each crossing of its surface facets mask some
light.
"""

import numpy as np

import dmis
from dmis import plot
from dmis.examples.gallery import options, print_canvas
from dmis.geometry.shapes import quad, sphere

opts, _ = options("plot_rough_glass", __doc__)
ALPHAS = (0.02, 0.15, 0.4)
SPP = opts.pick(16, 1024)

# %%
# The balls lie on tiles before a wall, with a lamp to the left and a dim sky. A path
# reaches the lamp through glass only if a facet refracts the path towards the lamp.
# Smooth glass would make a caustic, which path tracing seldom finds.
squares = (np.indices((256, 256)) // 16).sum(axis=0) % 2
tiles = dmis.Image(
    np.where(squares[..., None], (0.75, 0.7, 0.6), (0.1, 0.15, 0.25)).astype(np.float32)
)
lamp = dmis.QuadLight((-4, -1, 2.5), (0, 3, 0), (1, 0, 2.5), (14, 13, 12))
sky = dmis.EnvironmentLight(np.full((2, 4, 3), 0.3, np.float32))
floor = dmis.Part(quad((-8, -4, 0), (16, 0, 0), (0, 16, 0)), dmis.matte(tiles))
wall = dmis.Part(quad((-8, 6, 0), (16, 0, 0), (0, 0, 10)), dmis.matte((0.5, 0.2, 0.15)))
balls = [
    dmis.Part(
        sphere(0.8, segments=96).transformed(
            [[1, 0, 0, 1.8 * k - 1.8], [0, 1, 0, 0.4], [0, 0, 1, 0.8], [0, 0, 0, 1]]
        ),
        dmis.rough_glass(alpha=alpha),
    )
    for k, alpha in enumerate(ALPHAS)
]
size = opts.pick((48, 24), (240, 120), (640, 320))
camera = dmis.Camera.look_at((0, -6, 2.2), (0, 0.4, 0.75), (0, 0, 1), 28, size)
scene = dmis.Scene(camera, (floor, wall, *balls), (lamp, sky), "rough-glass")

# %%
# Render the same scene three times: light through the glass needs paths.
direct = dmis.render(
    scene,
    "auto",
    SPP,
    settings=dmis.Settings(integrator="direct"),
    parallel=opts.threads,
)
settings = dmis.Settings(integrator="path", max_depth=12)
paths = dmis.render(
    scene,
    "auto",
    SPP,
    settings=settings,
    parallel=opts.threads,
    progress=opts.progress,
)
for name, result in (("direct", direct), ("paths", paths)):
    seconds = result.seconds["total"]
    print(f"{name:8} mean radiance {result.image.mean():.3f}, {seconds:.1f} s")

# %%
# Direct lighting shows the sky and the lamp in the balls. Only paths show objects
# behind the balls.
figure, axes = print_canvas(1, 2, 2)
plot.picture(axes[0, 0], direct.image, "direct light")
plot.picture(axes[0, 1], paths.image, "paths")
opts.save(
    figure,
    "Rough glass",
    f"""Three balls of rough glass (alpha {", ".join(f"{a:g}" for a in ALPHAS)} from
    the left) by direct lighting and by path tracing twelve surfaces deep, with {SPP}
    samples per pixel of the rule auto.""",
    panel=axes[0, 1],
)
