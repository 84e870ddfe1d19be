"""
A zoo of reflection models, and the weight that each needs
==========================================================

Eight reflection models, from Phong to GGX, seen from 45 degrees at about the same
roughness. For each model the figure shows the lobe, and the variance of a mixture of
light and BRDF samples against the share w of light samples. A small, a medium and a
large light stand in the mirror direction. Which model needs which share?
"""

import numpy as np
from scipy.stats import qmc

import dmis
from dmis.brdf.fresnel import Dielectric
from dmis.brdf.lobe import Directions
from dmis.estimator.mis import BRDF, LIGHT
from dmis.examples.gallery import options, print_canvas
from dmis.scene.shading_points import ShadingPoints

opts, _ = options("plot_brdf_zoo", __doc__)
GLASS = Dielectric(1.5)
MODELS = {
    "Phong, n = 12": dmis.phong(ks=0.5, exponent=12),
    "Lafortune, n = 12": dmis.lafortune(ks=0.5, exponent=12, c_n=0.7),
    "Blinn-Phong, n = 50": dmis.blinn_phong(ks=0.5, exponent=50),
    "Ward, α = 0.1, 0.4": dmis.ward(ks=0.5, alpha=0.1, alpha_v=0.4),
    "Ashikhmin–Shirley": dmis.ashikhmin_shirley(kd=0.5, ks=0.05, n_u=200, n_v=12),
    "Torrance–Sparrow": dmis.torrance_sparrow(exponent=50, fresnel=GLASS),
    "Cook–Torrance, α = 0.2": dmis.cook_torrance(alpha=0.2, fresnel=GLASS),
    "GGX, α = 0.2": dmis.ggx(alpha=0.2, fresnel=GLASS),
}
LIGHTS = {
    "small": (2.0, "tab:blue"),
    "medium": (25.0, "tab:green"),
    "large": (40.0, "tab:red"),
}  # half angles, degrees
WO = np.array([-np.sqrt(0.5), 0, np.sqrt(0.5)], np.float32)


def surface(material, count):
    """Return `count` copies of one point at the origin of a horizontal plane, with its
    tangent u along x.
    """
    up, wo, along = (
        np.repeat(np.float32(v)[:, None], count, axis=1)
        for v in ((0, 0, 1), WO, (1, 0, 0))
    )
    return ShadingPoints(
        p=0 * up,
        ng=up,
        n=up,
        wo=wo,
        cos_o=wo[2],
        outside=wo[2] > 0,
        dpdu=along,
        reflection=material.lobes,
        delta=(),
    )


# %%
# Evaluate the integrand, for light of unit radiance, and both densities in the
# directions `wi` of the samples.
def integrand(points, light_sample):
    """Return f, p_l and p_b, each ``(N,)``; f is 0 where a direction misses the light
    or is below the horizon.
    """
    directions = Directions(points, light_sample.wi)
    f = (
        np.broadcast_to(points.eval(directions), light_sample.wi.shape).mean(axis=0)
        * directions.cos_i
    )
    p_l, p_b = (
        LIGHT.pdf(points, directions, light_sample.pdf),
        BRDF.pdf(points, directions, light_sample.pdf),
    )
    return tuple(
        a.astype(float) for a in (f * (light_sample.emits & directions.above), p_l, p_b)
    )


# %%
# The variance of one sample in fixed shares is V(w) = w Var_l(f/p_w) + (1-w)
# Var_b(f/p_w). Compute it at every w by integrals over the directions of the light,
# outside of which f is 0, with a Sobol sequence.
NODES, W = opts.pick(2**10, 2**15), np.linspace(0, 1, 41)


def curve(material, light):
    """Return the variance at the shares `W`, and the value of the integral."""
    u = np.minimum(
        qmc.Sobol(2, rng=np.random.default_rng(7)).random(NODES), 1 - 2**-24
    ).T.astype(np.float32)
    points = surface(material, NODES)
    f, p_l, p_b = integrand(points, LIGHT.sample(points, light, u))
    variance = []
    for w in W:
        g = np.divide(f, w * p_l + (1 - w) * p_b, out=np.zeros_like(f), where=f > 0)
        density = (
            p_b / p_l
        )  # a mean over the light's directions times this is one over BRDF samples
        of_brdf = (density * g * g).mean() - (density * g).mean() ** 2
        variance.append(w * g.var() + (1 - w) * of_brdf)
    return np.array(variance), (f / p_l).mean()


# %%
# Check the curve at a few shares by brute force, with independent samples of both
# techniques.
CHECKED, rng = np.array([0.1, 0.3, 0.7, 0.9]), np.random.default_rng(1)


def brute(material, light, w):
    """Return the variance at one share, and its standard error."""
    total = error2 = 0.0
    for technique, share in ((LIGHT, w), (BRDF, 1 - w)):
        points = surface(material, NODES)
        f, p_l, p_b = integrand(
            points,
            technique.sample(points, light, rng.random((2, NODES), dtype=np.float32)),
        )
        g = np.divide(f, w * p_l + (1 - w) * p_b, out=np.zeros_like(f), where=f > 0)
        square = (g - g.mean()) ** 2
        total += share * square.mean()
        error2 += share**2 * square.var() / NODES
    return total, error2**0.5


# %%
# For each model, draw a map of the hemisphere seen from above, and the curves.
def lobe_map(axis, material):
    """Draw BRDF times cosine over the unit disk."""
    x, y = np.meshgrid(*2 * [np.linspace(-1, 1, 241, dtype=np.float32)])
    inside = x * x + y * y < 1
    wi = np.stack([x[inside], y[inside], np.sqrt(1 - x[inside] ** 2 - y[inside] ** 2)])
    points = surface(material, wi.shape[1])
    directions = Directions(points, wi)
    shown = np.ma.masked_equal(np.zeros(x.shape), 0)
    shown[inside] = (
        np.broadcast_to(points.eval(directions), wi.shape).mean(axis=0)
        * directions.cos_i
    )
    image = axis.imshow(
        np.maximum(shown / shown.max(), 1e-3),
        origin="lower",
        extent=(-1, 1, -1, 1),
        cmap="magma",
        norm="log",
        vmin=1e-3,
    )
    axis.plot(*-WO[:2], "c+")
    axis.set_axis_off()
    return image


figure, axes = print_canvas(4, 4, 6.8, height_ratios=[1, 1.1] * 2)
told, deviations = [], []
for k, (name, material) in enumerate(MODELS.items()):
    left, right = axes[2 * (k // 4) : 2 * (k // 4) + 2, k % 4]
    image = lobe_map(left, material)
    left.set_title(name)
    best = []
    for size, (degrees, colour) in LIGHTS.items():
        radius = float(np.sin(np.radians(degrees)))
        light = dmis.SphereLight((-WO[0], 0, WO[2]), radius, (1, 1, 1))
        v, value = curve(material, light)
        half = v[20]
        checked, error = np.transpose([brute(material, light, w) for w in CHECKED])
        deviations.extend((checked - np.interp(CHECKED, W, v)) / error)
        at = v.argmin()
        right.plot(
            W,
            v / half,
            color=colour,
            label=f"{size} light, ±{degrees:g}°",
        )
        right.plot(CHECKED, checked / half, ".", color=colour, markersize=3)
        right.plot(
            W[at], v[at] / half, "v", color=colour, markeredgecolor="black", zorder=3
        )
        best.append(f"{W[at]:.2f}")
        print(
            f"{name:32} {size:7} best w {W[at]:.3f}; over V(1/2): V(best)"
            f" {v[at] / half:.3f}, V(0) {v[0] / half:.3g}, V(1) {v[-1] / half:.3g};"
            f" standard deviation over mean at 1/2: {half**0.5 / value:.2f}"
        )
    right.set_yscale("log")
    right.axhline(1, color="0.7", linewidth=0.8, zorder=0)
    right.set_ylim(2e-3, 2e2)
    told.append(f"{name}: {', '.join(best)}")
    right.set_xticks([0, 0.5, 1], ["0", "½", "1"])
    if k % 4:
        right.set_yticklabels([])
for axis in axes[3]:
    axis.set_xlabel("share of light samples w")
for axis in axes[1::2, 0]:
    axis.set_ylabel("V(w) / V(½)")
figure.colorbar(image, ax=axes[0::2], label="f cos / its largest value", shrink=0.8)
figure.legend(
    *axes[1, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3
)
deviations = np.abs(deviations)
within = (deviations < 2).mean()
print(
    f"brute force against quadrature: {within:.0%} within 2 standard errors, the"
    f" largest {deviations.max():.1f}"
)
opts.save(
    figure,
    "A zoo of reflection models, and the weight that each needs",
    f"""Each model at a point seen from 45 degrees, from the left. Maps: BRDF times
    cosine over the hemisphere, from above; a cross marks the mirror direction. Below:
    variance of a sample of the balance heuristic in fixed shares, over that of w = 1/2,
    under a sphere light in the mirror direction, whose half angle is given; lines by
    quadrature, dots by brute force, triangles where it is least. Best w under the
    small, medium and large light: {"; ".join(told)}.""",
)
