r"""
7. Many lights, mirrors and paths
=================================

After this tutorial you can

* choose one of several lamps for each sample, with the right density for both
  techniques;
* keep mirrors out of multiple importance sampling;
* count light on a path only once, whichever technique finds it;
* find one common mistake by `dmis.diagnose`, and two others by comparing means.

Each part shows the right code first, and then a common mistake.
"""

import os

import matplotlib.pyplot as plt
import numpy as np

import dmis
from dmis import plot

QUICK = os.environ.get("DMIS_QUICK") == "1"  # small and fast, for tests
PIXELS, SPP = (16, 64) if QUICK else (64, 1024)
rng = np.random.default_rng(1)

# %%
# One of four lamps
# -----------------
# A matte floor lies under four square lamps that face down. All lamps are at the same
# height, so no lamp hides another lamp. Each pixel is one point of the floor, on a line
# below the lamps.
CENTRE = np.array([-1.2, -0.4, 0.3, 1.2])  # x of each lamp
HEIGHT = 0.6
SIDE = np.array([0.1, 0.5, 0.2, 0.9])
RADIANCE = np.array([40.0, 4.0, 9.0, 1.0])
AREA = SIDE**2
point = np.linspace(-1.6, 1.6, PIXELS).repeat(SPP)  # x of each camera sample


def lamp_met(x, wi):
    """Return the lamp that rays from points x meet in directions (3, N), -1: none."""
    met = np.full(len(x), -1)
    t = HEIGHT / np.maximum(wi[2], 1e-9)
    for k in range(4):
        inside = abs(x + t * wi[0] - CENTRE[k]) < SIDE[k] / 2
        met[inside & (abs(t * wi[1]) < SIDE[k] / 2)] = k
    return met


# %%
# A light sample picks lamp k with the probability :math:`q_k`, and then a point on the
# lamp. Let :math:`A_k` be the area of the lamp, d the distance and :math:`\theta_l` the
# angle at the lamp. The density of the direction contains *both* steps:
#
# .. math::
#
#    p_l = q_k \, \frac{1}{A_k} \, \frac{d^2}{\cos\theta_l}
#
# A BRDF sample hits a lamp by chance. For its weight we need the density with which
# light sampling *would have* drawn the same direction. This density contains the
# probability :math:`q_k` of the lamp that the sample hits.
def light_density(x, wi, q):
    """Return p_l of directions, with the probability of the lamp, and the lamp met."""
    met = lamp_met(x, wi)
    cos = np.maximum(wi[2], 1e-9)  # at the floor, and at lamps, which face down
    distance = HEIGHT / cos
    density = q[met] / AREA[met] * distance**2 / cos
    return np.where(met >= 0, density, 0), met


def light_samples(x, q):
    """Return directions to points of lamps that are picked with probabilities q."""
    k = rng.choice(4, len(x), p=q)
    u, v = rng.uniform(-0.5, 0.5, (2, len(x))) * SIDE[k]
    to_lamp = np.stack([CENTRE[k] + u - x, v, np.full(len(x), HEIGHT)])
    return to_lamp / np.linalg.norm(to_lamp, axis=0)


def brdf_samples(count):
    """Return directions in proportion to the cosine: p_b = cos / pi."""
    radius, angle = np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    height = np.sqrt(1 - radius**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height])


def make_table(q, in_brdf_rows=light_density):
    """Return the shading samples of the floor as columns for `dmis.diagnose`.

    ``in_brdf_rows`` is what the renderer computes where the BRDF drew the direction.
    """
    rows = []
    draws = light_samples(point, q), brdf_samples(len(point))
    for technique, wi in enumerate(draws):
        look_up = in_brdf_rows if technique else light_density
        p_l, met = look_up(point, wi, q)
        radiance = np.where(met >= 0, RADIANCE[met], 0)
        f = 0.5 / np.pi * radiance * wi[2]
        rows.append({"f": f, "p_l": p_l, "p_b": wi[2] / np.pi, "light": met})
        rows[-1]["technique"] = np.full(len(f), technique)
        rows[-1]["pixel"] = np.arange(PIXELS).repeat(SPP)
        rows[-1]["camera_sample"] = np.tile(np.arange(SPP), PIXELS)
    table = {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}
    return table | {"light_samples": 1, "brdf_samples": 1, "version": 1}


def estimates(table, weight="balance"):
    """Return what the samples of each technique add, ``(2, PIXELS, SPP)``."""
    of_light = table["technique"] == 0
    own = np.where(of_light, table["p_l"], table["p_b"])
    if weight == "balance":
        own = table["p_l"] + table["p_b"]
    value = np.where(own > 0, table["f"] / np.maximum(own, 1e-30), 0)
    return value.reshape(2, PIXELS, SPP)


# %%
# The mean is the same for all probabilities, if every visible lamp has a probability
# above 0. But the noise depends on the probabilities: lamps that give much light should
# be picked often. Probabilities in proportion to power are a good start. The figure
# shows the noise with uniform probabilities and with probabilities by power, both with
# the balance heuristic.
power = RADIANCE * AREA
choices = {"evenly": np.full(4, 0.25), "by power": power / power.sum()}
figure, axes = plt.subplots(1, 2, figsize=(11, 3.4), layout="constrained")
x = np.linspace(-1.6, 1.6, PIXELS)
for name, q in choices.items():
    values = estimates(make_table(q)).sum(axis=0)
    axes[0].plot(x, values.mean(axis=1), label=name)
    axes[1].plot(x, values.std(axis=1), label=name)
axes[0].set(title="mean: the same", xlabel="x on the floor", ylabel="radiance")
axes[1].set(title="noise of one sample: not", xlabel="x on the floor")
axes[1].legend()


# %%
# **The mistake.** For a BRDF sample, the renderer computes the density of a point on
# the lamp, but forgets the probability :math:`q_k` of the lamp.
def forgets_q(x, wi, q):
    """Return p_l without the factor q_k. This is wrong."""
    return light_density(x, wi, np.ones(4))


right, wrong = (make_table(choices["evenly"], of) for of in (light_density, forgets_q))
for name, table in (("right", right), ("forgets q", wrong)):
    ways = [*estimates(table, "alone"), estimates(table).sum(axis=0)]
    errors = (of.std() / np.sqrt(of.size) for of in ways)
    means = [f"{of.mean():.4f} ± {e:.4f}" for of, e in zip(ways, errors, strict=True)]
    print(f"{name:9}: light {means[0]}, BRDF {means[1]}, balance {means[2]}")

# %%
# Up to noise each technique alone has the right mean, even with this mistake, because
# it divides only by its own density. But with the balance heuristic the image is too
# dark, and this is hard to see. The doctor finds the fault from the samples:
print(dmis.diagnose(right).text(), "\n")
print(dmis.diagnose(wrong).text())

# %%
# The doctor reports which column is wrong, in which rows, and by which factor. The
# factor is 4 = 1 / q. The figure shows the mean of each pixel: the wrong mean is too
# dark everywhere, most of all where both techniques contribute.
figure, axis = plt.subplots(figsize=(8, 3.2), layout="constrained")
for name, table in (("right", right), ("forgets q", wrong)):
    axis.plot(x, estimates(table).sum(axis=0).mean(axis=1), label=name)
axis.set(title="mean of the balance heuristic", xlabel="x on the floor")
axis.legend()

# %%
# Mirrors
# -------
# A mirror reflects light from a single direction to the viewer. Its BRDF is a *delta*
# function: infinite in this direction, and zero elsewhere. So
#
# * light sampling adds nothing: a random point on a lamp lies in this direction with
#   probability 0;
# * the mirrored ray has weight 1, because no other technique can find its direction. It
#   contributes the mirror's reflectance times the radiance, without division by a
#   density.
#
# **The mistake.** A renderer sets the density of a delta lobe to 1, and weights the ray
# like any other sample, by :math:`p_b / (p_l + p_b)`. Let the floor be a mirror of
# reflectance 0.5 that the camera sees from above, at an angle.
slope = np.array([[0.3], [0.0], [1.0]]) / np.linalg.norm([0.3, 0, 1])
mirrored = np.repeat(slope, len(point), axis=1)
p_l, met = light_density(point, mirrored, choices["evenly"])
light_seen = 0.5 * np.where(met >= 0, RADIANCE[met], 0)
weighed = light_seen * 1 / (p_l + 1)
print(f"lamps in the mirror: {light_seen.mean():.3f}, weighed: {weighed.mean():.3f}")

# %%
# The lamps in the mirror are too dark, most of all small lamps, for which p_l is large.
# The doctor cannot find this fault: it compares rows that both techniques could draw,
# and here no such row exists. Delta lobes belong neither in the doctor's tables nor in
# MIS.
figure, axis = plt.subplots(figsize=(8, 3.2), layout="constrained")
for name, values in (("right", light_seen), ("weighed", weighed)):
    axis.plot(x, values.reshape(PIXELS, SPP)[:, 0], label=name, drawstyle="steps-mid")
axis.set(title="lamps seen in a mirror", xlabel="x on the floor", ylabel="radiance")
axis.legend()

# %%
# Once, not twice
# ---------------
# A path continues from each surface in one direction. At surface k, light samples and
# BRDF samples estimate the direct light :math:`D_k`, and the surface itself emits
# :math:`E_k`. The throughput :math:`T_k` is the product of all
# :math:`f_r \cos\theta / p` on the way to surface k. Then the radiance of the path is
#
# .. math::
#
#    L = \sum_k T_k \left( D_k + [k = 0 \text{ or a mirror led to } k] \, E_k \right)
#
# The bracket is 1 if its condition is true, otherwise 0. If the path's next ray hits a
# lamp, :math:`D_{k-1}` already contains this light, so :math:`E_k` would count twice.
# Mirrors have no :math:`D_{k-1}`, so after a mirror :math:`E_k` must count. It also
# counts at the first surface, k = 0.
#
# **The mistake** is to add :math:`E_k` at every surface. Here the code adds the light
# that the next ray finds to the floor's direct light.
gathered = estimates(right).sum(axis=0).ravel()
onwards = brdf_samples(len(point))
met = lamp_met(point, onwards)
met_again = 0.5 * np.where(met >= 0, RADIANCE[met], 0)  # f_r cos / p = 0.5
for name, values in (("once", gathered), ("twice", gathered + met_again)):
    error = values.std() / np.sqrt(len(values))
    print(f"{name:6}: {values.mean():.4f} ± {error:.4f}")

# %%
# The floor gets twice the light everywhere. This fault is invisible without a second
# image. The doctor cannot find this fault, because all samples are right and only their
# sum is wrong. A white furnace test shows the fault. A comparison also shows the fault:
# direct light and paths of one surface must have the same mean. In dmis both images
# have the same bits.
scene = dmis.load_scene("cornell", resolution=(24, 24) if QUICK else (96, 96))
ways = {"direct": {}, "path": {"max_depth": 1}}
images = [
    dmis.render(scene, "balance", 16, integrator=name, **more).image
    for name, more in ways.items()
]
print("the same bits:", np.array_equal(*images))
deep = dmis.render(scene, "balance", 16, integrator="path", max_depth=5)
figure, axes = plt.subplots(1, 2, figsize=(9, 4.4), layout="constrained")
plot.picture(axes[0], images[0], "one surface")
plot.picture(axes[1], deep.image, "paths of five surfaces")

# %%
# Without a rule to stop, a path would never end. Russian roulette ends a path of
# throughput T < 1 with probability 1 - T and divides the surviving paths by T, so the
# mean stays the same.
#
# In scenes with four lamps or more, dmis picks one lamp per sample, as in the first
# part, at all surfaces after the first. The probabilities come from a tree of the
# lamps.
#
# Exercises
# ---------
# Starter files and solutions are on the page "Syllabus". Check your file with
# ``python docs/exercises/checks N FILE``.
#
# 22. *Easy.* Compute the density of a direction with several lamps
#     (``22_one_of_many.py``).
# 23. *Medium.* Compute weights if some samples come from mirrors (``23_delta.py``).
# 24. *Hard.* Compute the radiance of paths, and count all light once (``24_once.py``).
#
# To think about: a lamp that is hidden from a point has q > 0 there. What does this
# cost? If q were 0 for this lamp, what would be wrong at points that see the lamp?
for path in plot.show("7_paths_and_lights"):
    print(path)
