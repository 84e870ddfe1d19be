"""
One dimension: a mixture of two densities
=========================================

The whole method on one small integral of f over [0, 1]. The density p_l fits one bump
of f, the density p_b the other. The figure answers three questions. How does the
variance depend on the share w? Which share does a parabola through three points give?
Which share do the same samples give if each sample is evaluated at every w? The script
calls the renderer's code; only the integrand is new.
"""

import numpy as np

import dmis
from dmis.estimator.records import Record
from dmis.examples.gallery import options, print_canvas
from dmis.fit.thesis import parabola_minimum
from dmis.variance.curves import GRID, Curves

opts, _ = options("plot_1d_mixture", __doc__)
rng = np.random.default_rng(1)

# %%
# Define two bell-shaped densities on the line, one narrow and one wide, and an
# integrand that mixes both.
MEANS, WIDTHS = (0.3, 0.6), (0.03, 0.15)


def density(technique, x):
    """Return a normal density: 0 is the narrow "light", 1 the wide "BRDF"."""
    return np.exp(-0.5 * ((x - MEANS[technique]) / WIDTHS[technique]) ** 2) / (
        WIDTHS[technique] * np.sqrt(2 * np.pi)
    )


def f(x):
    """Return 0.35 of the narrow and 0.65 of the wide density; a dent keeps every
    mixture from fitting exactly.
    """
    return 0.35 * density(0, x) + 0.65 * density(1, x) * (
        1 - 0.8 * np.exp(-0.5 * ((x - 0.75) / 0.05) ** 2)
    )


# %%
# Compute the true variance by quadrature. With shares w and 1 - w, a sample has the
# variance M2 - w m_l^2 - (1 - w) m_b^2, where M2 is the second moment and m_l, m_b are
# the means of f / p_w under p_l and p_b.
x = np.linspace(-0.6, 1.8, opts.pick(20_001, 200_001))
p_l, p_b, dx = density(0, x), density(1, x), x[1] - x[0]
w = np.linspace(
    0.005, 0.995, 199
)  # at an end one of the densities vanishes where f does not


def variance(w):
    """Return the variance of one sample."""
    p_w = np.maximum(w * p_l + (1 - w) * p_b, 1e-300)
    second, light, brdf = (
        np.sum(g) * dx for g in (f(x) ** 2 / p_w, p_l * f(x) / p_w, p_b * f(x) / p_w)
    )
    return second - w * light**2 - (1 - w) * brdf**2


truth = np.array([variance(share) for share in w])
best = w[truth.argmin()]


# %%
# Draw a pilot for a "patch" of pixels. At w = 1/2 each technique draws half of a
# pixel's samples. Record the samples as the renderer does: three camera samples with
# two pairs each.
def draw(technique, turn, count):
    """Return samples of one technique as a record: positions, contributions and both
    densities.
    """
    at = rng.normal(MEANS[technique], WIDTHS[technique], count)
    pdf = np.stack([density(0, at), density(1, at)])
    value = np.repeat(
        (f(at) / pdf.mean(axis=0))[None], 3, axis=0
    )  # the same in all channels
    return Record(
        technique, (0,), turn, None, value.astype(np.float32), pdf.astype(np.float32)
    )


PIXELS, SPP = 64, 3
records = [
    draw(technique, turn, PIXELS * SPP) for technique in (0, 1) for turn in (0, 1)
]
radiance = np.mean([record.value for record in records], axis=0)
curves = Curves(PIXELS, 4)
curves.add(records, radiance, SPP)
estimate = 2 * curves.sums()["curve"].mean(
    axis=1
)  # of one sample; a final camera sample carries two
learned = GRID[estimate.argmin()]

# %%
# Apply the thesis's rule: average the variances of 2 samples at w = 0, 1/2, 1 over the
# pixels, and fit a parabola.
alone = [
    f(at) / density(k, at)
    for k, at in ((k, rng.normal(MEANS[k], WIDTHS[k], (2, PIXELS))) for k in (1, 0))
]
pairs = [
    ((records[0].value + records[2].value) / 2)[0].reshape(SPP, PIXELS)[k]
    for k in (0, 1)
]
shares = np.array([0, 0.5, 1])
points = np.array(
    [
        alone[0].var(axis=0, ddof=1).mean(),
        2 * np.var(pairs, axis=0, ddof=1).mean(),
        alone[1].var(axis=0, ddof=1).mean(),
    ]
)
vertex = float(parabola_minimum(shares, points)[0])


# %%
# Let the rules of the literature learn from the same pilot: they come with a plug-in.
dmis.load_plugin("objectives")
RELATIVES = (
    "taylor",
    "inverse-variance",
    "neyman",
    "representativity",
    "kl",
    "tsallis",
)


def relative(name):
    """Return the share that a rule learns."""
    rule = dmis.make_rule(name)
    statistic = rule.statistic(PIXELS, 4)
    statistic.add(records, radiance, SPP)
    means = statistic.sums()["values"].mean(axis=-1)[..., None, None]
    return float(np.clip(rule.solve(means, (1.0, 1.0)), 0, 1)[0, 0])


answers = {
    "second-moment": float(learned),
    "thesis": vertex,
    **{name: relative(name) for name in RELATIVES},
}
print(
    f"best w = {best:.2f}, variance {truth.min():.4f}; at w = 1/2: {variance(0.5):.4f}"
)
for name, share in answers.items():
    print(
        f"{name:18} w = {share:.3f}, variance / that of w = 1/2:"
        f" {variance(share) / variance(0.5):.3f}"
    )

# %%
# Left: integrand and densities. Middle: variance against the share. Right: variance at
# the share of each rule.
figure, axes = print_canvas(1, 3, 3.1)
left, middle, right = axes[0]
inside = (x > -0.1) & (x < 1.2)
left.plot(x[inside], f(x)[inside], color="black", label="f")
left.plot(x[inside], p_l[inside], color="tab:blue", label='p_l, the "light"')
left.plot(x[inside], p_b[inside], color="tab:red", label='p_b, the "BRDF"')
left.set_xlabel("x")
left.set_ylabel("f and densities (1 / unit of x)")
middle.plot(w, truth, color="black", label="V(w), by quadrature")
middle.plot(
    GRID,
    estimate,
    "o",
    color="tab:green",
    label="V(w), one pilot at w = ½",
)
middle.plot(shares, points, "s", color="tab:red", label="three variances")
middle.plot(
    w,
    np.polyval(np.polyfit(shares, points, 2), w),
    "--",
    color="tab:red",
    label="their parabola",
)
middle.axvline(best, color="black", linestyle=":", label="best w")
middle.set_yscale("log")
middle.set_ylim(0.3 * truth.min(), 30 * variance(0.5))
middle.set_xlabel("share of light samples w")
middle.set_ylabel("variance of a sample")
names = list(answers)
right.barh(
    names[::-1],
    [variance(answers[name]) / variance(0.5) for name in names[::-1]],
    color="tab:green",
    label="rule",
)
right.axvline(1, color="0.35", linestyle="--", label="w = ½")
right.axvline(truth.min() / variance(0.5), color="black", linestyle=":")
right.set_xscale("log")
right.set_xlabel("variance / that of w = ½")
figure.legend(loc="outside lower center", ncols=5)
opts.save(
    figure,
    "One dimension: a mixture of two densities",
    f"""Left: an integrand and the densities of two techniques. Middle: variance of a
    sample of the mixture against the share of the first technique, by quadrature
    (black); estimated at all weights at once from one pilot (green); the three
    variances that the thesis's rule uses, those at the ends above the frame, and the
    parabola through them (red), which gives w = {vertex:.2f}. Right: what the weight
    that each rule finds costs. The best is w = {best:.2f}.""",
    panel=middle,
)
