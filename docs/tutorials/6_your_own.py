r"""
6. Your own scene, reflection model and rule
============================================

After this tutorial you can

* load a mesh, and give it materials, lamps and a camera;
* write a reflection model, and check its density;
* write a rule that decides how many samples each technique gets;
* compare your rule with others, in a table with intervals.

Each extension takes a few lines of code, and then works like a built-in extension in
`render`, in `compare`, in plots and in tables.
"""

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import matplotlib.pyplot as plt
import numpy as np
import trimesh

import dmis
from dmis import plot
from dmis.base.color import luminance
from dmis.base.patches import patch_mean, patch_spread
from dmis.base.vectors import normalise
from dmis.brdf.lobe import Lambert, Lobe
from dmis.report.tables import summary
from dmis.samplers.warp import INV_PI, square_to_sphere

QUICK = os.environ.get("DMIS_QUICK") == "1"  # small and fast, for tests
RESOLUTION = (40, 30) if QUICK else (320, 240)
folder = Path(tempfile.mkdtemp())

# %%
# A scene
# -------
# `dmis.load_mesh` reads OBJ, PLY, STL and GLB. The code first writes two such files;
# use your own files instead. Lengths are in the unit of the file. Radiance is in linear
# RGB.
#
# A scene has a camera, parts and lights. A part is a mesh with a material. A visible
# lamp is a light and also a part, made by `dmis.light_part`.
ring = trimesh.creation.torus(1, 0.4, major_sections=96, minor_sections=48)
ground = trimesh.creation.box((6, 6, 0.1)).apply_translation((0, 0, -0.5))
ring.export(folder / "ring.obj")
ground.export(folder / "ground.obj")


def make_scene(material, radius=0.5, name="ring", resolution=RESOLUTION):
    """Return the ring on its ground, under a round lamp of this radius."""
    radiance = (6 / radius**2,) * 3  # the same power for each radius
    lamp = dmis.DiskLight((1.2, -0.6, 2.2), (-0.4, 0.2, -1), radius, radiance)
    eye, target = (0, -5, 3.2), (0, 0, -0.1)
    camera = dmis.Camera.look_at(eye, target, fov=32, resolution=resolution)
    floor = dmis.plastic(kd=0.3, ks=0.3, roughness=0.01)
    parts = [
        dmis.Part(dmis.load_mesh(folder / "ring.obj", smooth=True), material),
        dmis.Part(dmis.load_mesh(folder / "ground.obj", smooth=False), floor),
        dmis.light_part(lamp),
    ]
    return dmis.Scene(camera, parts, [lamp], name)


gold = dmis.metal(roughness=0.02)
figure, axes = plt.subplots(1, 3, figsize=(13, 3.7), layout="constrained")
for axis, radius in zip(axes, (0.1, 0.5, 1.0), strict=True):
    scene = make_scene(gold, radius)
    result = dmis.render(scene, spp=16, seed=1, integrator="direct")
    share = f"{result.weight.mean():.0%} light samples"
    plot.picture(axis, result.image, f"lamp of radius {radius}: {share}")


# %%
# For a single mesh, one call is enough:
# ``dmis.load_scene("ring.obj", material=gold, lights=[lamp])``.
#
# A reflection model
# ------------------
# A *lobe* is a frozen dataclass with three methods:
#
# * ``eval`` returns the BRDF without the cosine;
# * ``pdf`` returns the density per solid angle with which the lobe is sampled;
# * ``sample`` turns uniform numbers ``u`` ``(2, N)`` into directions ``(3, N)``.
#
# `Directions` computes the cosines between the normal, the two directions and the half
# vector.
#
# Our example is velvet: dust on the surface catches light at the rim of an object,
# where the view direction grazes the surface. Let :math:`\theta_o` and :math:`\theta_i`
# be the angles of the two directions from the normal. Then
#
# .. math::
#
#    f_r = \frac{\rho}{\pi} (1 - \cos\theta_o)^2 (1 - \cos\theta_i)^2, \qquad
#    p_b = \frac{\cos\theta_i}{\pi}
#
# The density is that of a matte surface. To draw a direction, take a uniform point on
# the unit sphere that touches the surface from above: the direction to this point has
# the density :math:`p_b`.
@dataclass(frozen=True, eq=False)
class Velvet(Lobe):
    """Brighter where the view grazes."""

    reflectance: float
    colours: ClassVar = ("reflectance",)  # this field may be a colour or an image

    def eval(self, directions):
        """Return the BRDF, ``(1, N)`` or ``(3, N)``."""
        rim = (1 - directions.cos_o) * (1 - directions.cos_i)
        return self.reflectance * (INV_PI * rim * rim)

    def pdf(self, directions):
        """Return the density, ``(N,)``; 0 below the horizon."""
        return np.maximum(directions.cos_i_signed, 0) * INV_PI

    def sample(self, surface, u):
        """Return directions, ``(3, N)``."""
        return normalise(surface.n + square_to_sphere(u))


velvet = dmis.Material((Lambert((0.25, 0.02, 0.05)), Velvet(3.0)), "velvet")
scene = make_scene(velvet, name="velvet-ring")

# %%
# Is the lobe right? If ``pdf`` is not the density of ``sample``, every image is wrong
# but looks right. One check works for any model: all techniques must agree. Light
# sampling never calls ``sample``, while BRDF sampling needs all three methods. The
# images of the two techniques may differ only by noise.
images = [
    dmis.render(scene, f"fixed:{w}", 32, seed=w, sampler="independent") for w in (0, 1)
]
difference = (images[0].image - images[1].image)[..., 1].sum()
error = np.sqrt(sum(result.variance[..., 1].sum() for result in images))
print(f"BRDF against light sampling: z = {difference / error:.2f}, allowed -3 to 3")


# %%
# A rule
# ------
# A rule requests a pilot: numbers of camera samples at given shares of light samples.
# From the pilot the rule computes a `Fit`, which contains a share for each pixel.
# `dmis.Rule` has defaults for everything except ``fit``.
#
# This rule's pilot takes two BRDF samples and two light samples per pixel. From the
# variances :math:`V_l` and :math:`V_b` of a patch it computes
#
# .. math::
#
#    w = \frac{V_b}{V_l + V_b}
#
# so the less noisy technique gets more samples. The rule keeps w between 0.1 and 0.9,
# because a variance that was estimated from two samples may be far off.
@dataclass(frozen=True)
class Quieter(dmis.Rule):
    """More samples for the technique whose pilot was less noisy."""

    patch: int = 8
    pilot: ClassVar = {0.0: 2, 1.0: 2}
    settings: ClassVar = {"reuse_pilot": False}

    def fit(self, pilot):
        """Return a share of light samples for each pixel, and a diagnostic."""
        variances = {w: luminance(pilot[w].variance()) for w in self.pilot}
        brdf, light = (patch_mean(variances[w], self.patch) + 1e-9 for w in (0.0, 1.0))
        w = np.clip(brdf / (brdf + light), 0.1, 0.9)
        return dmis.Fit(patch_spread(w, self.patch, variances[0.0].shape), {"patch": w})


dmis.register_rule("quieter", Quieter)  # its fields are options: quieter:patch=4

# %%
# Now the rule works like any other, for example in `render`:
result = dmis.render(scene, "quieter:patch=8", 16, seed=1)
figure, axes = plt.subplots(1, 2, figsize=(12, 4.4), layout="constrained")
plot.picture(axes[0], result.image, "quieter:patch=8")
shown = plot.weights(axes[1], result.weight, "its shares")
plot.weight_bar(figure, shown, axes[1])

# %%
# It also works in `compare`, which writes a table, a plot of error against time, an
# image of each rule, and a report of all results (``report.html``). Here all rules use
# independent points, so only the shares differ.
size = (40, 30) if QUICK else (80, 60)
small = make_scene(velvet, name="velvet-ring-small", resolution=size)
seeds, output = range(2 if QUICK else 5), folder / "comparison"
reference = dmis.make_reference(small, 16 if QUICK else 256)
rules, spp = ["balance", "quieter", "second-moment"], [16, 64]
comparison = dmis.compare(
    small, rules, spp, seeds, reference, output, sampler="independent"
)
print(summary(comparison))
print(", ".join(sorted(path.name for path in output.iterdir())))
figure, axis = plt.subplots(figsize=(9, 5), layout="constrained")
axis.imshow(plt.imread(output / "convergence.png"))
axis.set_axis_off()

# %%
# How to read the table: "relMSE / balance" and "MSE / balance" are errors divided by
# those of ``balance`` at equal samples, with 95 % intervals over the seeds. A rule wins
# if its whole interval is below 1. "relMSE·CPU s / balance" and "MSE·CPU s / balance"
# are ratios of error times CPU time.
#
# The images are EXR files. They contain the shares as a layer, and a text with
# everything needed to repeat the render.
path = next((output / "images").glob("quieter*64*.exr"))
layers, attributes = dmis.read_exr(path)
print(", ".join(layers), "|", attributes["dmis.provenance"][:60], "...")

# %%
# The rule ``quieter`` loses at 16 samples: the whole interval of its ratio is above 1.
# The map of its shares shows why. In the red patches of the floor the pilot's BRDF
# samples missed the lamp, so their variance looked small. The rule ``second-moment``
# wins at equal samples, with a pilot of six samples instead of four.
#
# Does your rule win at equal samples? Does it also win in equal time, and on your own
# scenes?
#
# To use a rule from the command line, write it into a file ``mine.py``, with its
# imports and ``register_rule``. ``python -m dmis check mine.py`` tests the rule. Then
# compare it by
# ``python -m dmis compare teapot-area-light --plugin mine.py --rules quieter,auto
# -o mine``.
#
# Exercises
# ---------
# Starter files and solutions are on the page "Syllabus". Check your file with
# ``python docs/exercises/checks N FILE``.
#
# 19. *Easy.* Divide a budget over pixels by variance and cost
#     (``19_sample_counts.py``).
# 20. *Medium.* Give velvet a density that fits it better (``20_velvet.py``).
# 21. *Hard.* Write a rule that wins on two scenes: one needs mostly light samples, the
#     other mostly BRDF samples (``21_rule.py``).
#
# To think about: let `Quieter` learn from standard deviations instead of variances
# (Neyman's allocation). When is this better?
for path in plot.show("6_your_own"):
    print(path)
