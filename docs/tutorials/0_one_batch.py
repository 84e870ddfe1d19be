r"""
0. One batch, from the camera to the image
==========================================

After this tutorial you can

* name the five steps of direct lighting, and say what each of them computes;
* write the estimator of light and BRDF samples with the balance heuristic;
* work on whole arrays of rays in NumPy, and know their shapes;
* test whether two images agree, pixel by pixel.

A renderer in NumPy processes a *batch*: all rays of an image at once. Each step is a
few operations on whole arrays. This tutorial builds one batch with the modules of dmis.

This tutorial uses five terms; tutorials 1 to 3 explain why these terms matter. An
*estimate* is a random number whose mean is the integral that we want. A *density* says
how often a random direction is picked: it is the probability per solid angle. A
*technique* is a way to pick directions, with its own density. The *variance* of an
estimate is its mean squared distance from its mean. The *standard error* is the square
root of the variance of a mean.
"""

import os
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import trimesh

import dmis
from dmis import plot
from dmis.base.vectors import dot, frame, normalise
from dmis.brdf.distributions import Isotropic
from dmis.brdf.lobe import Directions
from dmis.brdf.microfacet import GGX
from dmis.estimator.mis import balance
from dmis.intersect import Intersector
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.streams import Independent, stream

QUICK = os.environ.get("DMIS_QUICK") == "1"  # small and fast, for tests
RESOLUTION = (96, 72) if QUICK else (320, 240)

# %%
# The scene
# ---------
# A ball lies on a floor, under a square light. Ball and floor are of the same metal.
#
# A mesh has ``vertices`` ``(V, 3)`` and ``faces`` ``(F, 3)``. A face is a triangle,
# given by the numbers of its three vertices. A *lobe* is a part of a BRDF. This metal
# has a single lobe, made of rough microfacets.
ball = trimesh.creation.icosphere(4)
floor = trimesh.creation.box((12, 12, 0.1)).apply_translation((0, 0, -1.05))
shapes = trimesh.util.concatenate([ball, floor])
mesh = dmis.Mesh(shapes.vertices, shapes.faces)
lobe = GGX(np.array([[0.9], [0.7], [0.4]], np.float32), Isotropic(0.3))
light = dmis.QuadLight((-1.5, -1, 3), (0, 2, 0), (2, 0, 0), (6, 6, 6))
camera = dmis.Camera.look_at((0, -6, 3), (0, 0, -0.3), fov=36, resolution=RESOLUTION)

# %%
# The batch: camera samples
# -------------------------
# A pixel is the mean over *camera samples*: rays through random points of the pixel.
# Here each pixel takes 16 camera samples. The batch contains the N camera samples of
# all pixels.
#
# One number per ray is an array ``(N,)``. One vector per ray is an array ``(3, N)``,
# with all x in the first row, all y in the second, all z in the third. So NumPy works
# on long contiguous rows. ``draw`` returns two uniform numbers in [0, 1) for each ray,
# ``(2, N)``.
width, height = camera.resolution
spp, pixels = 16, width * height
pixel = np.tile(np.arange(pixels), spp)
number = np.repeat(np.arange(spp), pixels)
block = PixelBlock(stream(1, 0, 0), 1, np.arange(pixels), [spp], 2)
sampler = Independent(block)
sampler.start(pixel, number)
y, x = np.divmod(pixel, width)
u = sampler.draw("camera", None)
direction = camera.rays((x + u[0]).astype(np.float32), (y + u[1]).astype(np.float32))
origin = np.broadcast_to(camera.origin, direction.shape)

# %%
# Hits
# ----
# Embree finds the first triangle on each ray. ``prim`` is the number of the triangle,
# or -1 if the ray hits nothing. From here on the batch contains only the M rays that
# hit a triangle.
intersector = Intersector(mesh.vertices, mesh.faces)
hits = intersector.closest(origin, direction)
hit = np.flatnonzero(hits.prim >= 0)

# %%
# Shading points
# --------------
# A *shading point* is the data of a hit for a lobe: the unit normal :math:`n`, the unit
# direction :math:`\omega_o` to the viewer, and tangents. The normal of a triangle with
# the corners a, b, c is along :math:`(b - a) \times (c - a)`. If this vector points
# away from the viewer, we take the opposite one.
#
# The point p is moved slightly off the surface. Otherwise its shadow ray would hit the
# triangle from which the ray starts.
corners = mesh.vertices[mesh.faces[hits.prim[hit]]].astype(np.float32)  # (M, 3, 3)
a, b, c = np.moveaxis(corners, 0, -1)  # (3, M) each
wo = -direction[:, hit]
n = normalise(np.cross(b - a, c - a, axis=0))
n *= np.sign(dot(n, wo))
p = origin[:, hit] + hits.distance[hit] * direction[:, hit] + np.float32(1e-5) * n
points = SimpleNamespace(n=n, wo=wo, cos_o=dot(n, wo), tangents=frame(n))

# %%
# A light sample and a BRDF sample
# --------------------------------
# How much light does a point reflect towards the viewer? The answer is an integral over
# the directions :math:`\omega_i`. The integrand f is the product of BRDF, radiance
# (light along a ray), cosine (slanted light spreads over more surface) and visibility:
#
# .. math::
#
#    f(\omega_i) = f_r(\omega_o, \omega_i)\, L(\omega_i)\, |n \cdot \omega_i|\,
#    V(\omega_i)
#
# Two techniques pick a direction for each point. *Light sampling* aims at a random
# point of the light. *BRDF sampling* draws a direction from the lobe, and then tests
# whether this direction hits the light. Both return directions ``wi`` ``(3, M)``,
# ``distance``, ``radiance``, ``emits`` (true if the direction hits the light), and
# ``pdf``. ``pdf`` is the density per solid angle with which light sampling picks this
# direction. A solid angle is an area on the unit sphere around the point. Let the
# light have the area A and the distance r, and let :math:`\theta_l`
# be the angle between its normal and the direction. Then this density is
#
# .. math::
#
#    p_l = \frac{r^2}{A\, |\cos \theta_l|}
#
light_sample = light.sample(p, sampler.draw("light", hit))
brdf_sample = light.hit(p, lobe.sample(points, sampler.draw("brdf", hit)))

# %%
# The balance heuristic
# ---------------------
# Let w be the share of light samples, here 1/2. The balance heuristic is a way to
# weight samples of two techniques. It treats every sample as if its direction came from
# a *mixture* of both techniques, with the density :math:`p_w`:
#
# .. math::
#
#    \hat I = \frac{1}{S} \sum_{i=1}^{S} \frac{f(\omega_i)}{p_w(\omega_i)},
#    \qquad p_w = w\, p_l + (1 - w)\, p_b
#
# S is the number of samples, and :math:`p_l` and :math:`p_b` are the densities of the
# two techniques in the same direction. The function `balance` takes the two terms of
# :math:`p_w` and returns :math:`1 / p_w`.
#
# A *shadow ray* from p to the light decides whether the visibility V is 0 or 1. The ray
# ends just before the light.
w = 0.5
terms = []
for technique, sample in enumerate((light_sample, brdf_sample)):
    directions = Directions(points, sample.wi)  # the cosines between n, wo and wi
    p_l, p_b = sample.pdf, lobe.pdf(directions)
    distance = np.where(sample.emits, sample.distance * np.float32(0.9999), 0)
    blocked = intersector.occluded(p, sample.wi, distance)
    V = sample.emits & directions.above & ~blocked
    f = lobe.eval(directions) * sample.radiance * directions.cos_i * V
    terms.append(f * balance((w * p_l, (1 - w) * p_b), technique))

# %%
# The mean
# --------
# The value of a camera sample is the mean of its two shading samples. The value of a
# pixel is the mean of its camera samples. Rays that hit nothing are black.
L = np.zeros((3, len(pixel)), np.float32)
L[:, hit] = (terms[0] + terms[1]) / 2
samples = L.reshape(3, spp, height, width)
image = np.moveaxis(samples.mean(axis=1), 0, -1)  # (height, width, 3)

# %%
# Four arrays of the batch, averaged over the camera samples of each pixel, make images:
# the normals, the fraction of light samples that reach the light, and half of
# :math:`f / p_w` of each technique. Light sampling finds the light from every point
# outside of the shadow; the ball blocks the light in the black part of "light reached".
# BRDF sampling finds the light only where the lobe points at the light.
reached = np.broadcast_to(np.any(terms[0] > 0, axis=0), n.shape)
arrays = (n + 1) / 2, reached, terms[0] / 2, terms[1] / 2
titles = "normals", "light reached", "light samples, half", "BRDF samples, half"
figure, axes = plt.subplots(2, 2, figsize=(9, 7), layout="constrained")
for axis, values, title in zip(axes.flat, arrays, titles, strict=True):
    full = np.zeros_like(L)
    full[:, hit] = values
    mean = full.reshape(samples.shape).mean(axis=1)
    plot.picture(axis, np.moveaxis(mean, 0, -1), title)

# %%
# Is it right?
# ------------
# `dmis.render` computes the same integral with its own random numbers. So the two
# images may differ only by noise. Their difference divided by its standard error is
#
# .. math::
#
#    z = \frac{x - y}{\sqrt{\sigma_x^2 + \sigma_y^2}}
#
# A normally distributed z has :math:`|z| > 2` in 4.6 % of the pixels. Here each
# variance is an estimate from 16 samples. So z nearly follows Student's t with 30
# degrees of freedom, whose tails are wider: expect about 5.5 %, or 5 to 6 % in one run.
# The white patches of the third picture are pixels without light, where both images are
# exactly 0. The code also computes z for the mean of the whole image. This z is between
# -3 and 3 in 99.7 % of all runs.
material = dmis.Material((lobe,), "metal")
scene = dmis.Scene(camera, (dmis.Part(mesh, material),), (light,))
result = dmis.render(scene, "balance", spp, seed=2, sampler="independent")
difference = (image - result.image)[..., 0]  # the red channel; the others follow it
error = np.sqrt(samples[0].var(axis=0, ddof=1) / spp + result.variance[..., 0])
z = difference / np.maximum(error, 1e-12)
z_mean = difference.sum() / np.sqrt((error**2).sum())
print(f"z of the mean of the image: {z_mean:.2f}")
print(f"pixels with |z| above 2: {np.mean(np.abs(z[error > 0]) > 2):.1%}")
figure, axes = plt.subplots(1, 3, figsize=(13, 3.7), layout="constrained")
plot.picture(axes[0], image, "this batch")
plot.picture(axes[1], result.image, "dmis.render")
title = "difference over its standard error"
shown = plot.heat(axes[2], z, title, cmap="RdBu", vmin=-4, vmax=4)
figure.colorbar(shown, ax=axes[2], label="z")

# %%
# Direct lighting has no other steps. The page "The estimator in sixty lines" shows code
# for any scene. The next tutorials explain the noise.
#
# Exercises
# ---------
# Starter files and solutions are on the page "Syllabus". Check your file with
# ``python docs/exercises/checks N FILE``.
#
# 1. *Easy.* Reflect the directions of a batch about normals (``01_mirror.py``).
# 2. *Medium.* Write the density of a point on a light per solid angle
#    (``02_light_density.py``).
# 3. *Hard.* Write direct light with one light sample for each point
#    (``03_direct_light.py``).
#
# To think about: set w = 0.9 in :math:`p_w`, but keep one sample of each technique.
# What does z of the mean say, and why? Leave out ``& ~blocked``: in which pixels does z
# show the error? Use ``Isotropic(0.05)``, a smoother metal: which technique gets noisy?
for path in plot.show("0_one_batch"):
    print(path)
