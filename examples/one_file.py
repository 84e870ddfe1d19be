"""The method in one file: data-driven multiple importance sampling, by Seo's thesis (KAIST, 2014), without dmis.

Renders three balls on a floor under a lamp, with the thesis's rule and with the balance heuristic, prints the ratios of
their errors, and draws what each step found, in half a minute. Letters and equation numbers are the thesis's: f is the
integrand of Eq. 1.1, p_l and p_b are the densities of light and BRDF sampling per solid angle, and w is the weight of
light sampling. N vectors are an array (3, N), N numbers (N,); images are (H, W, 3), row 0 on top.
"""

import matplotlib.pyplot as plt
import numpy as np

BUDGET = 128  # samples per pixel of each rule (chapter 4)
PILOT = 2  # of them for each of the three strategies (Sec. 3.1), so that 122 remain
PATCH = 8  # pixels on a side of a patch; the thesis has 4 to 32
STRATEGIES = np.array([0, 0.5, 1])  # w of BRDF sampling, of the balance heuristic, of light sampling

# The scene: balls of radius 1 on the floor z = 0, under a lamp at the height 5 that shines down.
# Columns are the floor's material and the balls': f_r = k_d / pi + k_s (e + 2) / (2 pi) cos^e, with the cosine of the
# angle to the mirror direction (Phong's lobe as Lafortune and Willems normalised it in 1994)
CENTRES = np.array([[-2.3, 0, 2.3], [0, 0, 0], [1, 1, 1]])
K_D = np.array([[0.5, 0.6, 0.1, 0.08], [0.5, 0.1, 0.4, 0.15], [0.5, 0.08, 0.12, 0.5]])
K_S, EXPONENT = np.array([[0.1, 0.3, 0.3, 0.3], [20, 10, 50, 250]])
CORNER, SIDES, RADIANCE = np.array([[-2], [-3], [5]]), np.array([[4], [3], [0]]), 4
EYE, TARGET, FIELD_OF_VIEW = np.array([0, -8, 4.5]), np.array([0, 0.2, 0.55]), 34  # degrees across the shorter side


def dot(a, b):
    return (a * b).sum(axis=0)


def unit(a):
    return a / np.sqrt(dot(a, a))


def camera_rays(x, y, shape):
    """Return unit directions from EYE through the points (x, y) of an image of the shape (H, W)."""
    forward = unit(TARGET - EYE)
    right = unit(np.cross(forward, [0, 0, 1]))
    pixel = 2 * np.tan(np.radians(FIELD_OF_VIEW) / 2) / min(shape)
    a, b = (x - shape[1] / 2) * pixel, (shape[0] / 2 - y) * pixel
    return unit(forward[:, None] + np.outer(right, a) + np.outer(np.cross(right, forward), b))


def intersect(o, d):
    """Return the distance along each ray to what it meets first, inf for nothing, and its number: 0 is the floor."""
    floor = np.divide(-o[2], d[2], out=np.zeros_like(d[2]), where=d[2] < 0)
    distances = [np.where(floor > 1e-4, floor, np.inf)]
    for centre in CENTRES.T:
        to = centre[:, None] - o
        along = dot(to, d)
        root2 = along**2 - dot(to, to) + 1
        near = along - np.sqrt(np.maximum(root2, 0))
        distances.append(np.where((root2 > 0) & (near > 1e-4), near, np.inf))
    return np.min(distances, axis=0), np.argmin(distances, axis=0)


class Points:
    """Where camera rays meet the scene: point p, unit normal n, mirror direction of the ray, and material."""

    def __init__(self, o, d):
        distance, part = intersect(o, d)
        self.hit = np.isfinite(distance)
        self.p = o + np.where(self.hit, distance, 0) * d
        self.n = np.where(part == 0, [[0], [0], [1]], self.p - CENTRES[:, np.maximum(part, 1) - 1])
        self.mirror = d - 2 * dot(self.n, d) * self.n
        self.k_d, self.k_s, self.e = K_D[:, part], K_S[part], EXPONENT[part]


def light_sample(points, u):
    """Return the unit directions to uniform points of the lamp."""
    return unit(CORNER + SIDES * [u[0], u[1], 0 * u[0]] - points.p)


def brdf_sample(points, u):
    """Return directions about the normal or, as often, about the mirror direction: density (e + 1) / (2 pi) cos^e."""
    matte = u[2] < 0.5
    axis = np.where(matte, points.n, points.mirror)
    cos = u[0] ** (1 / (np.where(matte, 1, points.e) + 1))
    across = unit(np.cross(axis, np.where(np.abs(axis[2]) < 0.9, [[0], [0], [1]], [[1], [0], [0]]), axis=0))
    phi = 2 * np.pi * u[1]
    around = np.cos(phi) * across + np.sin(phi) * np.cross(axis, across, axis=0)
    return cos * axis + np.sqrt(1 - cos**2) * around


def integrand(points, wi):
    """Return f = L_i f_r cos(theta_i) of Eq. 1.1 in the directions wi, (3, N), and the densities there, p_l and p_b."""
    cos_i = np.maximum(dot(points.n, wi), 0)
    lobe = np.maximum(dot(points.mirror, wi), 0) ** points.e / (2 * np.pi)
    f_r = points.k_d / np.pi + points.k_s * (points.e + 2) * lobe
    p_b = 0.5 * cos_i / np.pi + 0.5 * (points.e + 1) * lobe
    # where wi meets the plane of the lamp, and whether inside of the lamp with nothing between
    up = np.maximum(wi[2], 1e-9)
    distance = (CORNER[2] - points.p[2]) / up
    x, y, _ = points.p + distance * wi - CORNER
    on_lamp = (wi[2] > 0) & (x >= 0) & (x <= SIDES[0]) & (y >= 0) & (y <= SIDES[1])
    p_l = on_lamp * distance**2 / (SIDES[0] * SIDES[1] * up)  # r^2 / (A cos) per solid angle
    L_i = RADIANCE * (on_lamp & (intersect(points.p, wi)[0] > distance))
    return L_i * f_r * cos_i, p_l, p_b


def camera_sample(shape, w, rng):
    """Return a sample of each pixel, (H, W, 3): one light and one BRDF sample, weighted by w, a number or (H, W)."""
    y, x = np.indices(shape).reshape(2, -1)
    u = rng.random((7, x.size))
    d = camera_rays(x + u[0], y + u[1], shape)
    points = Points(np.broadcast_to(EYE[:, None], d.shape), d)
    w = np.broadcast_to(w, shape).ravel()
    # Eq. 1.2 for both techniques, with the balance heuristic (Veach and Guibas 1995):
    # W_l f / p_l = w f / (w p_l + (1 - w) p_b),  W_b f / p_b = (1 - w) f / (w p_l + (1 - w) p_b)
    total = 0
    for weight, wi in ((w, light_sample(points, u[2:4])), (1 - w, brdf_sample(points, u[4:]))):
        f, p_l, p_b = integrand(points, wi)
        total += weight * f / np.maximum(w * p_l + (1 - w) * p_b, 1e-30)
    return (total * points.hit).T.reshape(*shape, 3)


def render(shape, w, spp, seed):
    """Return the mean of spp samples of each pixel, weighted by w."""
    rng = np.random.default_rng(seed)
    return sum(camera_sample(shape, w, rng) for _ in range(spp)) / spp


def patch_means(image):
    """Return the means over patches in the last two axes."""
    *more, height, width = image.shape
    return image.reshape(*more, height // PATCH, PATCH, width // PATCH, PATCH).mean(axis=(-3, -1))


def parabola_minima(y):
    """Return where the parabolas through the variances y of the strategies, (3, rows, columns), are least."""
    # Eqs. 3.2-3.4: least squares of d_i = y_i - (a_0 + a_1 v_i + a_2 v_i^2); v_i is the weight, y_i the variance
    a_2, a_1, _ = np.polyfit(STRATEGIES, y.reshape(3, -1), 2).reshape(3, *y.shape[1:])
    # Eq. 3.5: W_opt = -a_1 / (2 a_2). The thesis leaves open what to do outside of [0, 1] (here: the nearer end),
    # without a minimum (the best strategy), and without light (1/2)
    minimum = np.clip(-a_1 / np.where(a_2 > 0, 2 * a_2, 1), 0, 1)
    return np.where(y.any(axis=0), np.where(a_2 > 0, minimum, STRATEGIES[y.argmin(axis=0)]), 0.5)


def gaussian_5x5(weights):
    """Return the weights of patches, smoothed. The thesis does not say sigma, which is 1 patch here."""
    taps = np.exp(-0.5 * np.arange(-2, 3) ** 2)
    near = np.lib.stride_tricks.sliding_window_view(np.pad(weights, 2, mode="edge"), (5, 5))
    return np.einsum("ijkl,k,l->ij", near, taps, taps) / taps.sum() ** 2


def learn_weights(pilot):
    """Return variances and weights, raw and filtered, of patches from n samples of each strategy, (3, n, H, W, 3)."""
    # Eq. 3.1: the estimate has no bias, so its MSE is its variance, sum (x - mean)^2 / (n - 1), here of the luminance
    variance = pilot.var(axis=1, ddof=1) @ [0.212671, 0.715160, 0.072169]
    y = patch_means(variance)  # Sec. 3.2: two samples of a pixel say little, those of a patch more
    raw = parabola_minima(y)  # Sec. 3.3
    return y, raw, gaussian_5x5(raw)  # Sec. 3.4


def compare(shape, budget):
    """Render with the thesis's rule and with the balance heuristic, print their errors, return what `draw` takes."""
    rng = np.random.default_rng(1)
    pilot = np.array([[camera_sample(shape, w, rng) for _ in range(PILOT)] for w in STRATEGIES])  # Sec. 3.1
    y, raw, filtered = learn_weights(pilot)
    # the rest of the budget, each pixel with the weight of its patch; the pilot's samples are not in the image
    thesis = render(shape, np.kron(filtered, np.ones((PATCH, PATCH))), budget - 3 * PILOT, seed=2)
    balance = render(shape, 0.5, budget, seed=3)
    # squared errors against two independent halves of a reference, whose noise cancels in the mean
    a, b = (render(shape, 0.5, 2 * budget, seed) for seed in (4, 5))
    error, baseline = (patch_means(((x - a) * (x - b)).mean(axis=2)) for x in (thesis, balance))
    row, column = np.indices(shape).reshape(2, -1) + 0.5
    balls = patch_means(intersect(EYE[:, None], camera_rays(column, row, shape))[1].reshape(shape)) > 0
    for name, part in (("image", balls | True), ("floor", ~balls), ("balls", balls)):
        ratio = error[part].mean() / baseline[part].mean()
        spread = np.std(error[part] - ratio * baseline[part]) / np.sqrt(part.sum()) / baseline[part].mean()
        print(f"{name}: MSE of the thesis's rule over that of balance {ratio:.2f}, standard error {spread:.2f}")
    return thesis, raw, filtered, y, *(np.abs(x - (a + b) / 2).mean(axis=2) for x in (thesis, balance))


def draw(thesis, raw, filtered, y, error, baseline, file):
    """Save a picture of what `compare` returned."""
    figure, axes = plt.subplots(2, 3, figsize=(15, 7.4), layout="constrained")
    weights, errors = {"cmap": "RdBu", "vmin": 0, "vmax": 1}, {"cmap": "magma", "vmax": np.quantile(baseline, 0.99)}
    shown = {
        "image of the thesis's rule": (np.clip(thesis, 0, 1) ** (1 / 2.2), {}),
        "w, minima of the parabolas (red: BRDF samples)": (raw, weights),
        "w after the filter (blue: light samples)": (filtered, weights),
        "error of the thesis's rule": (error, errors),
        "error of the balance heuristic": (baseline, errors),
    }
    for axis, (title, (image, how)) in zip(axes.flat, shown.items()):
        axis.imshow(image, **how)
        axis.set(title=title, xticks=[], yticks=[])
    w = np.linspace(0, 1, 101)
    for variances, name in ((y[0], "BRDF sampling"), (y[2], "light sampling")):
        place = np.unravel_index(variances.argmax(), raw.shape)
        parabola = np.polyval(np.polyfit(STRATEGIES, y[:, *place] / variances.max(), 2), w)
        axes[1, 2].plot(w, parabola, "o-", markevery=50, label=f"where {name} is worst: w = {raw[place]:.2f}")
    axes[1, 2].set(title="variances of two patches, and parabolas through them", xlabel="w")
    axes[1, 2].legend()
    figure.savefig(file, dpi=80)


if __name__ == "__main__":
    draw(*compare((192, 256), BUDGET), "one_file.png")
