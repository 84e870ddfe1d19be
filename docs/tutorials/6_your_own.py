"""
6. Your own scene, reflection model and rule
============================================

Everything so far came with dmis. Here is what it takes to bring your own: a mesh from a file, a lamp whose radius you
can change, a reflection model, and a rule that decides where the samples go. Each is a few lines, and each works
everywhere as if it had always been there: in `render`, in `compare`, in plots and tables.
"""

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
from dmis.brdf.diffuse import Lambert
from dmis.brdf.lobe import Lobe
from dmis.experiment.compare import summary
from dmis.samplers.warp import INV_PI, square_to_sphere

folder = Path(tempfile.mkdtemp())

# %%
# A scene
# -------
# `dmis.load_scene` reads OBJ, PLY, STL and GLB. (We write a file first, so that there is one; take your own.) A mesh
# has no lamps, so give it some; without any it stands under an even sky. Lengths are those of the file; z is up for
# the default camera (y in GLB files), which looks down at the whole mesh. Radiance is in linear RGB.
knot = trimesh.creation.torus(major_radius=1, minor_radius=0.4, major_sections=96, minor_sections=48)
ground = trimesh.creation.box((6, 6, 0.1), transform=trimesh.transformations.translation_matrix((0, 0, -0.5)))
knot.export(folder / "ring.obj")
ground.export(folder / "ground.obj")


def make_scene(material, radius=0.5, name="ring"):
    """The ring on its ground, under a round lamp of this radius."""
    lamp = dmis.DiskLight((1.2, -0.6, 2.2), (-0.4, 0.2, -1), radius, (6 / radius**2,) * 3)
    camera = dmis.Camera.look_at((0, -5, 3.2), (0, 0, -0.1), fov=32, resolution=(88, 66))
    parts = [
        dmis.Part(dmis.load_mesh(folder / "ring.obj", smooth=True), material),
        dmis.Part(dmis.load_mesh(folder / "ground.obj", smooth=False), dmis.plastic(kd=0.3, ks=0.3, roughness=0.01)),
    ]
    return dmis.Scene(camera, (*parts, dmis.light_part(lamp)), (lamp,), name)


gold = dmis.metal(roughness=0.02)
figure, axes = plt.subplots(1, 3, figsize=(13, 3.7), layout="constrained")
for axis, radius in zip(axes, (0.1, 0.5, 1.0), strict=True):
    result = dmis.render(make_scene(gold, radius), spp=32, seed=1, settings=dmis.Settings(integrator="direct"))
    plot.picture(axis, result.image, f"lamp of radius {radius}: {result.weight.mean():.0%} light samples")


# %%
# For a single mesh, `dmis.load_scene` alone will do: ``dmis.load_scene("ring.obj", material=gold, lights=[lamp])``.
#
# A reflection model
# ------------------
# A *lobe* is a frozen dataclass with three methods: ``eval``, the BRDF without the cosine; ``pdf``, the density per
# solid angle with which it samples; and ``sample``, which turns pairs of even random numbers ``u`` ``(2, N)`` into
# directions ``(3, N)``. `Directions` has the cosines of n, wo, wi and the half vector. Here is velvet: dust on the
# surface that catches light at its edges, where the normal is across the view. It is sampled like a matte surface,
# whose density is cos / pi.
@dataclass(frozen=True, eq=False)
class Velvet(Lobe):
    """Brighter where the view grazes: ``f = reflectance / pi (1 - cos_o)^2 (1 - cos_i)^2``."""

    reflectance: float
    colours: ClassVar = ("reflectance",)  # a field that is named here may also be a colour or an image

    def eval(self, directions):
        """The BRDF, ``(1, N)`` or ``(3, N)``."""
        rim = (1 - directions.cos_o) * (1 - directions.cos_i)
        return self.reflectance * (INV_PI * rim * rim)

    def pdf(self, directions):
        """cos / pi, ``(N,)``; nothing below the horizon."""
        return np.maximum(directions.cos_i_signed, 0) * INV_PI

    def sample(self, surface, u):
        """A point on the unit sphere that touches the surface."""
        return normalise(surface.n + square_to_sphere(u))


velvet = dmis.Material((Lambert((0.25, 0.02, 0.05)), Velvet(3.0)), "velvet")
scene = make_scene(velvet, name="velvet-ring")

# %%
# Is it right? ``pdf`` has to be what ``sample`` does, or every image is wrong without looking wrong. The surest check
# is one that knows nothing of the model: all techniques have to agree. Light sampling never calls ``sample``, BRDF
# sampling needs all three methods, and their difference must be within their own noise.
checked = {w: dmis.render(scene, f"fixed:{w}", 64, seed=w) for w in (0, 1)}
difference = checked[0].image.mean() - checked[1].image.mean()
error = np.sqrt(sum(r.variance.sum(axis=-1).sum() for r in checked.values())) / checked[0].image.size * np.sqrt(3)
print(f"light against BRDF sampling: difference {difference:.5f}, allowed by the noise ± {3 * error:.5f}")


# %%
# A rule
# ------
# A rule says which pilot it wants, camera samples by weight, and makes a `Fit` of it: a share of light samples for
# each pixel. `dmis.Rule` has a default for everything but ``fit``. This one takes two samples of each technique alone,
# and gives more to the one that was less noisy in a patch; it never leaves a technique without samples, because two
# samples may be wrong.
@dataclass(frozen=True)
class Quieter(dmis.Rule):
    """More samples for the technique whose pilot was less noisy."""

    patch: int = 8
    pilot = {0.0: 2, 1.0: 2}
    settings = {"reuse_pilot": False}

    def fit(self, pilot):
        """A share of light samples for each pixel, and a diagnostic."""
        brdf, light = (patch_mean(luminance(pilot[w].moments.variance()), self.patch) for w in (0.0, 1.0))
        w = np.clip((brdf + 1e-9) / (brdf + light + 2e-9), 0.1, 0.9)
        return dmis.Fit(patch_spread(w, self.patch, pilot[0.0].moments.mean.shape[:2]), {"patch": w})


dmis.register_rule("quieter", Quieter)  # now it has a name, and its fields are options: quieter:patch=4

# %%
# From here on it is a rule like any other. In `render`:
result = dmis.render(scene, "quieter:patch=4", 32, seed=1)
figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
plot.picture(axes[0], result.image, "quieter:patch=4")
shown = plot.weights(axes[1], result.weight, "its weights")
plot.weight_bar(figure, shown, axes[1])

# %%
# And in `compare`, which writes a table, a plot of error against time, an image of each rule, and a report with
# everything (``report.html``):
reference = dmis.make_reference(scene, 64)
comparison = dmis.compare(scene, ["quieter", "auto"], [16, 64], range(2), reference, folder / "comparison")
print(summary(comparison.runs))
print("\n".join(sorted(path.name for path in (folder / "comparison").iterdir())))
figure, axis = plt.subplots(figsize=(9, 5), layout="constrained")
axis.imshow(plt.imread(folder / "comparison" / "convergence.png"))
axis.set_axis_off()

# %%
# The images are EXR files with the weights as a layer, and what is needed to make them again as text:
layers, attributes = dmis.read_exr(next((folder / "comparison" / "images").glob("quieter*64*.exr")))
print(", ".join(layers), "|", attributes["dmis.provenance"][:100], "...")

# %%
# Two samples decide, and two seeds make wide intervals, so be suspicious of the table: does the new rule win anywhere?
# In equal time, too? On your own scenes?
#
# Exercises
# ---------
# * Give `Velvet` a density that fits it better, and check it again. Which share of light samples does it need then?
# * Make `Quieter` learn from standard deviations in place of variances. (Neyman's allocation; when is it right?)
# * Let ``fit`` return ``samples=`` too, one positive number for each pixel, in proportion to the root of the variance:
#   noisy patches get more samples. (Only ratios matter. Every pixel needs some: add a little where the pilot saw no
#   noise.)
# * Put the rule into a file ``mine.py``, with its imports above and ``dmis.register_rule("quieter", Quieter)`` below:
#   now ``python -m dmis compare teapot-area-light --plugin mine.py --rules quieter,auto -o mine`` knows it by its name.
for path in plot.show("6_your_own"):
    print(path)
