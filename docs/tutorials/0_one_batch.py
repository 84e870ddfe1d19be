"""
0. One batch, from the camera to the image
==========================================

A renderer in NumPy does not follow one ray after the other. It follows a *batch*: all rays of an image at once, and
every step is a few operations on whole arrays. This tutorial puts one batch together from the modules of dmis: camera,
random numbers, ray intersection, a BRDF lobe, a light, and multiple importance sampling. After it you know each step
of direct lighting, and what the arrays hold.
"""

from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import trimesh

import dmis
from dmis import plot
from dmis.base.vectors import dot, frame, normalise
from dmis.brdf.cosines import Directions
from dmis.brdf.distributions import Isotropic
from dmis.brdf.microfacet import GGX
from dmis.estimator.mis import balance
from dmis.intersect import Intersector
from dmis.samplers.pixel_block import PixelBlock
from dmis.samplers.streams import make_sampler, stream

# %%
# The scene
# ---------
# A ball on a floor, both of one metal, under a square light. A mesh has ``vertices`` (V, 3) and ``faces`` (F, 3): for
# each triangle the numbers of its three corners. A *lobe* is a part of a BRDF, and this metal has a single one, made of
# rough microfacets.
floor = trimesh.creation.box((12, 12, 0.1), transform=trimesh.transformations.translation_matrix((0, 0, -1.05)))
shapes = trimesh.util.concatenate([trimesh.creation.icosphere(4), floor])
mesh = dmis.Mesh(shapes.vertices, shapes.faces)
lobe = GGX(np.array([[0.9], [0.7], [0.4]], np.float32), Isotropic(0.3))
light = dmis.QuadLight((-1.5, -1, 3), (0, 2, 0), (2, 0, 0), (6, 6, 6))
camera = dmis.Camera.look_at((0, -6, 3), (0, 0, -0.3), fov=36, resolution=(96, 72))

# %%
# The batch: camera samples
# -------------------------
# Each pixel is the mean over 32 *camera samples*: rays through random points of the pixel. The batch is all of them, N
# = 32 · 96 · 72. A number for each ray is an array (N,), and a vector for each ray is an array (3, N): its rows are all
# x, all y, and all z. So NumPy works on long contiguous rows. `draw` returns two uniform numbers in [0, 1) for each
# ray, (2, N).
width, height = camera.resolution
spp, pixels = 32, width * height
pixel, number = np.tile(np.arange(pixels), spp), np.repeat(np.arange(spp), pixels)
sampler = make_sampler("independent", PixelBlock(stream(1, 0, 0), 1, np.arange(pixels), [spp], 2))
sampler.start(pixel, number)
y, x = np.divmod(pixel, width)
u = sampler.draw("camera", None)
direction = camera.rays((x + u[0]).astype(np.float32), (y + u[1]).astype(np.float32))
origin = np.broadcast_to(camera.origin, direction.shape)

# %%
# Hits
# ----
# Embree finds the first triangle on each ray: ``prim`` is its number, -1 where there is none. From here on the batch is
# the M rays that hit something.
intersector = Intersector(mesh.vertices, mesh.faces)
hits = intersector.closest(origin, direction)
hit = np.flatnonzero(hits.prim >= 0)

# %%
# Shading points
# --------------
# A *shading point* is what a lobe needs to know of a hit: the unit normal n, the unit direction wo to the viewer, and
# tangents. The normal of a triangle with corners a, b, c is along (b - a) × (c - a), turned to the viewer's side. The
# point p is moved off the surface by a little, or its shadow ray would meet the triangle that it starts from.
a, b, c = np.moveaxis(mesh.vertices[mesh.faces[hits.prim[hit]]], 0, -1).astype(np.float32)  # (3, M) each
wo = -direction[:, hit]
n = normalise(np.cross(b - a, c - a, axis=0))
n *= np.sign(dot(n, wo))
p = origin[:, hit] + hits.distance[hit] * direction[:, hit] + np.float32(1e-5) * n
points = SimpleNamespace(n=n, wo=wo, cos_o=dot(n, wo), tangents=frame(n))

# %%
# A light sample and a BRDF sample
# --------------------------------
# Which light does a point reflect towards the viewer? The integral over directions wi of::
#
#     f = f_r(wo, wi) · L(wi) · |n · wi| · V(wi)
#
# BRDF times radiance times cosine times visibility. Two techniques pick a direction for each point. *Light sampling*
# aims at a random point of the light. *BRDF sampling* follows the lobe, and then asks what of the light that direction
# meets. Both return the same: directions ``wi`` (3, M), ``distance``, ``radiance``, whether the light is met
# (``emits``), and the density ``pdf`` with which light sampling picks this direction, per solid angle.
light_sample = light.sample(p, sampler.draw("light", hit))
brdf_sample = light.hit(p, lobe.sample(points, sampler.draw("brdf", hit)))

# %%
# The balance heuristic
# ---------------------
# Half of the samples are light samples: w = 1/2. The balance heuristic treats every sample as if it came from the
# mixture of both techniques::
#
#     estimate = mean of f / p_w,   p_w = w p_l + (1 - w) p_b
#
# where p_l and p_b are the densities of the two techniques in the same direction. `balance` takes the terms of the sum
# p_w and returns 1 / p_w. A *shadow ray* from p to the light says whether V is 0 or 1; it ends just before the light.
w = 0.5
terms = []
for technique, sample in enumerate((light_sample, brdf_sample)):
    directions = Directions(points, sample.wi)  # the cosines between n, wo and wi, that lobes are made of
    p_l, p_b = sample.pdf, lobe.pdf(directions)
    distance = np.where(sample.emits, sample.distance * np.float32(0.9999), 0)
    V = sample.emits & directions.above & ~intersector.occluded(p, sample.wi, distance)
    f = lobe.eval(directions) * sample.radiance * directions.cos_i * V
    terms.append(f * balance((w * p_l, (1 - w) * p_b), technique))

# %%
# The mean
# --------
# A camera sample is the mean of its two shading samples, a pixel the mean of its camera samples. Rays that hit nothing
# are black.
L = np.zeros((3, len(pixel)), np.float32)
L[:, hit] = (terms[0] + terms[1]) / 2
samples = L.reshape(3, spp, height, width)
image = np.moveaxis(samples.mean(axis=1), 0, -1)  # (height, width, 3)

# %%
# Four arrays of the batch, each as the mean over the camera samples of a pixel: normals, the share of light samples
# that reach the light, and f / p_w of either technique. Light sampling finds the light everywhere; BRDF sampling finds
# it where the lobe points at it.
arrays = (n + 1) / 2, np.broadcast_to(np.any(terms[0] > 0, axis=0), n.shape), *(term / 2 for term in terms)
titles = "normals", "light reached", "light samples, f / p_w / 2", "BRDF samples, f / p_w / 2"
figure, axes = plt.subplots(2, 2, figsize=(9, 7), layout="constrained")
for axis, values, title in zip(axes.flat, arrays, titles, strict=True):
    full = np.zeros_like(L)
    full[:, hit] = values
    plot.picture(axis, np.moveaxis(full.reshape(samples.shape).mean(axis=1), 0, -1), title)

# %%
# Is it right?
# ------------
# `dmis.render` computes the same integral with its own random numbers, which are to be independent as well: its default
# points are more even (tutorial 5), so that a variance of its pixels would not be that of its samples. The two images
# have to differ by their noise and by nothing else: the difference over its standard error, z, is then about as often
# above 2 as for a normal distribution, in one pixel of 22, and of the mean of the whole image it is seldom above 3.
scene = dmis.Scene(camera, (dmis.Part(mesh, dmis.Material((lobe,), "metal")),), (light,))
result = dmis.render(scene, "balance", spp, seed=2, sampler="independent")
difference = (image - result.image)[..., 0]  # the red channel; the others follow it
error = np.sqrt(samples[0].var(axis=0, ddof=1) / spp + result.variance[..., 0])
z = difference / np.maximum(error, 1e-12)
print(f"z of the mean of the image: {difference.sum() / np.sqrt((error**2).sum()):.2f}")
print(f"pixels with z above 2: {np.mean(np.abs(z[error > 0]) > 2):.1%}")
figure, axes = plt.subplots(1, 3, figsize=(13, 3.7), layout="constrained")
plot.picture(axes[0], image, "this batch")
plot.picture(axes[1], result.image, "dmis.render")
shown = plot.heat(axes[2], z, "difference over its standard error", cmap="RdBu", vmin=-4, vmax=4)
figure.colorbar(shown, ax=axes[2], label="z")

# %%
# That is the whole of direct lighting. The page "The estimator in sixty lines" (``docs/estimator.md``) does it for any
# scene; the next tutorials are about its noise.
#
# Exercises
# ---------
# * Take w = 0.9 in ``p_w`` and still one sample of each technique. What does the test say, and why? (A sample counts
#   for the share of its technique.)
# * Leave out V. Where does z show it?
# * Take ``Isotropic(0.05)``, a smoother metal. Which technique gets noisy? Which one would you give more samples?
for path in plot.show("0_one_batch"):
    print(path)
