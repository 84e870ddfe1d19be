"""
One dimension: a mixture of three densities
===========================================

Three techniques have three shares whose sum is 1: a point in a triangle. Here the
integrand is a mixture of the three densities with known shares. At these shares every
sample has the same value, and the variance is 0. The figure shows the variance around
this point, and whether one pilot at equal shares finds it. The script calls the code of
the rule ``simplex``, a plug-in; only the integrand is new.
"""

import numpy as np

import dmis
from dmis.estimator.mis import balance
from dmis.estimator.records import Record
from dmis.examples.gallery import options, print_canvas

simplex = dmis.load_plugin("simplex")
opts, _ = options("plot_1d_simplex", __doc__)
rng = np.random.default_rng(1)

# %%
# Define three bell-shaped densities on the line. The integrand is half of the first
# plus a third of the second plus a sixth of the third, so its integral is 1.
MEANS, WIDTHS = np.array([0.2, 0.45, 0.8]), np.array([0.05, 0.2, 0.08])
PLANTED = np.array([1 / 2, 1 / 3, 1 / 6])


def densities(x):
    """Return the three normal densities ``(3, N)`` at x ``(N,)``."""
    t = (x - MEANS[:, None]) / WIDTHS[:, None]
    return np.exp(-0.5 * t**2) / (WIDTHS[:, None] * np.sqrt(2 * np.pi))


def f(x):
    """Return the integrand, a mixture of the densities with known shares."""
    return PLANTED @ densities(x)


# %%
# Compute the true variance by quadrature. With fixed shares, the variance of a sample
# is the second moment minus the mean of the techniques' squared means, weighted by the
# shares.
x = np.linspace(-0.8, 1.7, 5_001)
p, dx = densities(x), x[1] - x[0]


def variance(shares):
    """Return the variance of one sample at shares ``(3,)`` or ``(3, G)``."""
    p_w = np.maximum(np.tensordot(p, shares, (0, 0)), 1e-300)
    estimate = f(x).reshape(-1, *[1] * (np.ndim(shares) - 1)) / p_w
    means = np.tensordot(p, estimate, (1, 0)) * dx
    second = np.tensordot(f(x), estimate, (0, 0)) * dx
    return second - (shares * means**2).sum(axis=0)


# %%
# Draw a pilot for a "patch" of pixels. In each pixel every technique takes two of six
# samples, three times; record the samples as the renderer does. The balance heuristic
# at equal shares gives each sample the value f / p_w.
PIXELS, SPP, PAIR = 64, 3, 2


def draw(technique, turn, count):
    """Return samples of one technique as a record: contributions and all densities."""
    at = rng.normal(MEANS[technique], WIDTHS[technique], count)
    pdf = densities(at)
    value = np.repeat(
        (f(at) * balance(pdf / 3, technique))[None], 3, axis=0
    )  # the same in all channels
    return Record(
        technique, (0,), turn, None, value.astype(np.float32), pdf.astype(np.float32)
    )


records = [
    draw(technique, turn, PIXELS * SPP)
    for technique in range(3)
    for turn in range(PAIR)
]
radiance = np.mean([record.value for record in records], axis=0)
statistic = simplex.SimplexCurves(PIXELS, 3 * PAIR, (True, True, True))
statistic.add(records, radiance, SPP)
shares, _ = simplex.grid(3)
estimate = PAIR * statistic.sums()["curve"].mean(
    axis=1
)  # of one sample; a final camera sample carries two
truth = variance(
    np.maximum(shares, 1e-6)
)  # without a technique that is needed there would be no bound
learned = int(estimate.argmin())
equal = variance(np.full(3, 1 / 3))

print(
    f"planted shares {PLANTED.round(3)}, variance {variance(PLANTED):.1e}; at equal"
    f" shares {equal:.3f}"
)
print(
    f"one pilot finds {shares[:, learned].round(3)}, where the variance is"
    f" {truth[learned]:.1e}"
)
for k, name in enumerate(("first", "second", "third")):
    without = np.delete(np.arange(shares.shape[1]), np.flatnonzero(shares[k]))
    best = without[truth[without].argmin()]
    print(
        f"without the {name} technique: at best {truth[best]:.2g}, at"
        f" {shares[:, best].round(3)}"
    )


# %%
# Left: integrand and densities. Middle: the variance over the triangle; at a corner one
# technique takes all samples. Right: the pilot's estimate at each point of the grid
# against the truth.
def corner(shares):
    """Return the place of shares ``(3, ...)`` in the triangle, x and y."""
    return shares[1] + shares[2] / 2, shares[2] * np.sqrt(3) / 2


figure, axes = print_canvas(1, 3, 2.9, width_ratios=[1, 1.9, 1])
left, middle, right = axes[0]
inside = (x > -0.3) & (x < 1.2)
left.plot(x[inside], f(x)[inside], color="black", label="f")
for k, colour in enumerate(("tab:blue", "tab:red", "tab:green")):
    left.plot(x[inside], p[k][inside], color=colour, label=f"p_{k + 1}")
left.set_xlabel("x")
left.set_ylabel("f and densities (1 / unit of x)")
n = opts.pick(40, 90)
fine = (
    np.array(
        [(n - a - b, a, b) for a in range(n + 1) for b in range(n + 1 - a)], float
    ).T
    / n
)
fine = 0.985 * fine + 0.005  # at the very edges the variance is without bound
level = np.log10(np.maximum(variance(fine), 1e-4))
shown = middle.tricontourf(
    *corner(fine), level, levels=np.linspace(-4, 1, 21), cmap="viridis", extend="max"
)
figure.colorbar(shown, ax=middle, label="log10 of the variance")
middle.plot(
    *corner(shares),
    "o",
    color="white",
    markeredgecolor="black",
    markersize=3,
    label="points of the grid",
)
middle.plot(
    *corner(PLANTED), "*", color="black", markersize=10, label="planted: ½, ⅓, ⅙"
)
middle.plot(
    *corner(shares[:, learned]),
    "o",
    color="tab:red",
    fillstyle="none",
    markersize=9,
    label="learned",
)
for k, (dx_, dy) in enumerate(((-0.02, -0.05), (0.02, -0.05), (0, 0.04))):
    at = corner(np.eye(3)[k])
    middle.text(at[0] + dx_, at[1] + dy, f"p_{k + 1} alone", ha="center", va="center")
middle.set_aspect("equal")
middle.set_ylim(-0.1, 1.12)
middle.axis("off")
usual = truth < 3
right.plot([2e-3, 3], [2e-3, 3], color="0.5", label="equal")
seen = usual & (truth > 1e-3)
right.plot(
    truth[seen],
    np.maximum(estimate[seen], 2e-3),
    "o",
    color="tab:blue",
    label="points of the grid",
)
right.plot(
    equal,
    estimate[np.abs(shares - 1 / 3).sum(axis=0).argmin()],
    "s",
    color="tab:orange",
    label="equal shares",
)
right.set_xscale("log")
right.set_yscale("log")
right.set_xlabel("variance, by quadrature")
right.set_ylabel("variance, from one pilot")
labelled = {}
for axis in (left, middle, right):
    handles, labels = axis.get_legend_handles_labels()
    labelled = dict(zip(labels, handles, strict=True)) | labelled
figure.legend(labelled.values(), labelled, loc="outside lower center", ncols=5)
opts.save(
    figure,
    "One dimension: a mixture of three densities",
    f"""Left: three densities, and an integrand that is a mixture of them with the
    shares 1/2, 1/3, 1/6. Middle: variance of a sample over the triangle of shares, by
    quadrature: 0 at the planted shares, {equal:.3f} at equal ones, and without bound
    where a technique that is needed is left out. Right: the same at the points of the
    grid, those below 3, from one pilot of {len(records) * SPP * PIXELS} samples at
    equal shares; its minimum is at {
        ", ".join(f"{share:.2f}" for share in shares[:, learned])
    }.""",
    panel=middle,
)
