"""
What a scene needs, and what is left out
========================================

Six small scenes, their plans, and their numbers of rays. dmis follows a camera sample
only as far as the sample can contribute. Where the camera sees nothing, dmis samples
nothing. A mirror needs no light samples, a point light no BRDF samples, and a black
wall ends a path. The two rooms are rendered by paths.
"""

from dataclasses import replace

import numpy as np

import dmis
from dmis import plot
from dmis.examples.gallery import options, print_canvas
from dmis.geometry.shapes import quad, sphere
from dmis.geometry.transforms import translate
from dmis.scene.groups import light_part

opts, _ = options("plot_scene_plan", __doc__)
SIZE, SPP = opts.pick((48, 36), (240, 180)), opts.pick(8, 64)

# %%
# Make the parts of the scenes.
FLOOR = quad((-4, -4, 0), (8, 0, 0), (0, 8, 0))
LAMP = dmis.QuadLight((-0.5, -0.5, 2.4), (0, 1, 0), (1, 0, 0), (6, 5, 4))
POINT = dmis.PointLight((-1.5, -1.5, 2.5), (6, 6, 6))
CAMERA = dmis.Camera.look_at((0, -3.6, 1.8), (0, 0, 0.7), fov=45, resolution=SIZE)


def ball(material):
    """Return a ball on the floor."""
    return dmis.Part(
        sphere(0.6, segments=opts.pick(48, 160)).transformed(translate((0, 0, 0.6))),
        material,
    )


def walls(albedo):
    """Return the walls of a room: two sides, a back, a ceiling, and a front behind the
    camera.
    """
    corners = [
        ((-2, 2, 0), (4, 0, 0), (0, 0, 2.6)),
        ((-2, -4, 0), (0, 6, 0), (0, 0, 2.6)),
        ((2, -4, 0), (0, 6, 0), (0, 0, 2.6)),
        ((-2, -4, 2.6), (4, 0, 0), (0, 6, 0)),
        ((-2, -4, 0), (4, 0, 0), (0, 0, 2.6)),
    ]
    return tuple(dmis.Part(quad(*corner), dmis.matte(albedo)) for corner in corners)


def scene(name, parts, *lights, integrator="direct"):
    """Return a scene with its name and the integrator that renders it."""
    return dmis.Scene(CAMERA, tuple(parts), lights, name, dmis.Suggestions(integrator))


grey = dmis.Part(FLOOR, dmis.matte(0.5))
sky = dmis.EnvironmentLight(
    np.linspace(0.2, 1.5, 16)[::-1, None, None] * np.ones((1, 32, 3)) * (0.8, 0.9, 1.0)
)
SCENES = [
    scene("a ball before nothing", [ball(dmis.plastic((0.5, 0.2, 0.1)))], LAMP),
    scene("a point light", [grey, ball(dmis.ggx((0.1, 0.2, 0.4), 0.5, 0.15))], POINT),
    scene("an area light", [grey, ball(dmis.ggx((0.1, 0.2, 0.4), 0.5, 0.15))], LAMP),
    scene(
        "mirrors under a sky",
        [dmis.Part(FLOOR, dmis.mirror(0.6)), ball(dmis.mirror(0.9))],
        sky,
    ),
    scene(
        "black walls",
        [grey, ball(dmis.glass()), light_part(LAMP), *walls(0)],
        LAMP,
        integrator="path",
    ),
    scene(
        "white walls",
        [grey, ball(dmis.glass()), light_part(LAMP), *walls(0.7)],
        LAMP,
        integrator="path",
    ),
]

# %%
# Render all with the same settings, except for the integrator.
KINDS = {
    "camera": "0.3",
    "shadow": "tab:blue",
    "brdf": "tab:red",
    "delta": "tab:cyan",
    "specular": "tab:purple",
    "bounce": "tab:orange",
}
figure, axes = print_canvas(4, 3, 7.2, height_ratios=[3, 2] * 2)
told = []
for k, one in enumerate(SCENES):
    above, below = axes[2 * (k // 3) : 2 * (k // 3) + 2, k % 3]
    result = dmis.render(one, "balance", SPP, seed=1, parallel=opts.threads)
    unseen = (
        np.zeros(SIZE[::-1], bool)
        if one.covered_pixels is None
        else ~one.covered_pixels
    )
    image = np.where(unseen[..., None], np.float32((0.25, 0.0, 0.25)), result.image)
    plot.picture(above, image, f"{one.name} ({one.suggested.integrator})")
    samples = SIZE[0] * SIZE[1] * SPP
    rays = {
        kind: sum(n for k, n in result.rays.items() if k.split()[0] == kind) / samples
        for kind in KINDS
    }
    below.bar(list(KINDS), list(rays.values()), color=list(KINDS.values()))
    below.set_ylim(0, 4.2)
    below.tick_params(axis="x", rotation=45)
    if k % 3 == 0:
        below.set_ylabel("rays per sample")
    told.append(
        f"{one.name}: {sum(rays.values()):.1f}, {unseen.mean():.0%} of the pixels"
    )
    print(f"{one.name}\n{one.describe()}\n")

# %%
# Check the plan: without skipping any work, the first scene has the same bits.
first = SCENES[0]
blind = replace(first)
vars(blind)["covered_pixels"] = None
a, b = (
    dmis.render(one, "balance", SPP, seed=1, parallel=opts.threads).image
    for one in (first, blind)
)
same = "the same to the last bit" if np.array_equal(a, b) else "not the same"
print(f"with and without the pixels that see nothing, the images are {same}")
opts.save(
    figure,
    "What a scene needs, and what is left out",
    f"""Six scenes rendered by the balance heuristic with {SPP} samples.
    Purple: pixels that provably see nothing, and are not sampled; with and without them
    the images are {same}. Bars: rays per camera sample by kind. Their sum, and the
    purple part:
    {"; ".join(told)}.""",
    panel=axes[0, 1],
)
