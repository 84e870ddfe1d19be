"""Weights of first and of later surfaces: planted curves, closed forms, furnaces, and what renders measure."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
import scipy.stats
from helpers import LEVEL, Z_LIMIT, box_scene, z_score
from test_curves import exact, f, unbiased
from test_learned import PLAIN, pilot

import dmis
from dmis.batch import Record
from dmis.camera import Camera
from dmis.curves import GRID, HALF, Curves
from dmis.fit import Fit
from dmis.geometry import quad, sphere
from dmis.learned import Learned
from dmis.light import MeshLight, QuadLight
from dmis.material import matte, plastic
from dmis.oracle import Oracle, make_oracle
from dmis.rules import make_rule
from dmis.scene import Part, Scene
from dmis.settings import Settings
from dmis.vec import Array

LAMP = QuadLight((-0.7, -0.7, 1.6), (0, 1.4, 0), (1.4, 0, 0), (4, 4, 4))
WALLS = (
    Part(quad((-4, 1, 0), (8, 0, 0), (0, 0, 4)), matte((0.8, 0.3, 0.2))),
    Part(quad((-1.5, -4, 0), (0, 8, 0), (0, 0, 4)), plastic((0.2, 0.5, 0.3), 0.4, 0.02)),
)
ROOM = box_scene(plastic(0.5, 0.3, 0.02), (LAMP,), WALLS, resolution=(12, 12)).crop((4, 12), (0, 12))
PATHS = Settings(integrator="path", max_depth=4)


@dataclass(frozen=True)
class Two:
    """Two weights for the whole image, without a pilot."""

    w: float
    later: float
    settings: dict[str, Any] = field(default_factory=dict)
    pilot: dict[float, int] = field(default_factory=dict)

    def fit(self, pilot: object) -> Fit:
        return Fit(self.w, later=self.later)


# Curves -------------------------------------------------------------------------------------------------------------


def test_curves_of_classes() -> None:
    """One surface, then two that see the same y: their own noise adds up, and that of uneven counts goes along, so that
    Var_y(D) is four times that of one.
    """
    pixels, count, s = 20_000, 6, 2
    rng = np.random.default_rng(3)
    curves = Curves(pixels, 2 * s, classes=2)
    n = pixels * count
    y = rng.random(n)
    radiance, records = np.zeros(n), []
    for key in ((0,), (1, 0), (4, 0)):
        for side in (0, 1):
            for turn in range(s):
                x = np.sqrt(rng.random(n))
                x = x if side == 0 else 1 - x
                pdf = np.stack([2 * x, 2 * (1 - x)]).astype(np.float32)
                value = f(x, y) / pdf.mean(axis=0)
                radiance += value / (2 * s)
                records.append(Record(side, key, turn, None, np.repeat(value[None], 3, axis=0), pdf))
    curves.add(records, np.repeat(radiance[None], 3, axis=0), count)
    sums = curves.sums()
    assert unbiased(sums["position"], 9 * exact(0.5, s)[1])
    for g in (1, 4, HALF, 9):
        w = float(GRID[g])
        total, position = exact(w, s)
        part = w * s % 1
        rounding = part * (1 - part) / s**2
        pattern = _pattern(w)
        assert unbiased(sums["curve"][0, g], total - position)
        assert unbiased(sums["curve"][1, g], 2 * (total - position - rounding * pattern) + 4 * rounding * pattern)
        assert unbiased(sums["pattern"][0, g], pattern) and unbiased(sums["pattern"][1, g], 4 * pattern)


def _pattern(w: float) -> float:
    """Var_y(D) of the planted integrand, by quadrature."""
    x, y = ((np.arange(20_000) + 0.5) / 20_000)[:, None], (np.arange(400) + 0.5) / 400
    p_l, p_b = 2 * x, 2 * (1 - x)
    return float(((p_l - p_b) * f(x, y) / (w * p_l + (1 - w) * p_b)).mean(axis=0).var())


def test_depth_of_a_record() -> None:
    """The light comes last in the key."""
    nothing = np.zeros((3, 0), np.float32)
    assert [Record(0, key, 0, None, nothing, nothing).depth for key in ((3,), (1, 3), (7, 0))] == [0, 1, 7]


@pytest.mark.parametrize("first, later", [(0, 12), (3, 6), (9, 2)])
def test_planted_minima(first: int, later: int) -> None:
    """Each class has its own; the variance at both together is what each saves."""
    one = pilot(((GRID - GRID[first]) ** 2 + 0.1)[:, None, None])[0.5]
    other = pilot(2 * ((GRID - GRID[later]) ** 2 + 0.1)[:, None, None])[0.5]
    both = {name: np.stack([a, other.sums[name]]) for name, a in one.sums.items() if name != "position"}
    fit = Learned(**PLAIN).fit({0.5: replace(one, sums={**both, "position": one.sums["position"]})})
    np.testing.assert_array_equal(fit.weight, GRID[first])
    np.testing.assert_array_equal(fit.later, GRID[later])
    np.testing.assert_allclose(fit.maps["variance"], 0.3, rtol=1e-6)
    np.testing.assert_array_equal(fit.maps["later"], GRID[later])


def test_one_weight_unless_paths_go_on(box: dmis.Scene) -> None:
    """Direct lighting, one bounce, a shared weight, and combiners that know of one weight only: no second map."""
    for rule, settings, apart in (
        ("bounces=separate", PATHS, True),
        ("bounces=shared", PATHS, False),
        ("bounces=separate,filter=quadtree", PATHS, False),
        ("bounces=separate,combiner=optimal", PATHS, False),
        ("bounces=separate", replace(PATHS, max_depth=1), False),
        ("bounces=separate", Settings(integrator="direct"), False),
    ):
        assert ("later" in dmis.render(box, f"second-moment:{rule}", 8, settings=settings).maps) == apart
    with pytest.raises(ValueError, match="bounces must be shared or separate; got 'each'"):
        make_rule("auto:bounces=each")


# Renders ------------------------------------------------------------------------------------------------------------


def means(scene: Scene, rule: Any, seeds: range, spp: int = 16, settings: Settings = PATHS) -> Array:
    """Mean over the image for each seed."""
    return np.array([dmis.render(scene, rule, spp, seed=s, settings=settings, threads=1).image.mean() for s in seeds])


@pytest.mark.parametrize(
    "w, later, sampler", [(0.5, 0.2, "independent"), (0.3, 0.8, "stratified"), (0.3, 0.8, "sobol"), (1.0, 0.1, "sobol")]
)
def test_two_weights_have_the_same_mean(w: float, later: float, sampler: str) -> None:
    """Whatever the shares, however their numbers are drawn."""
    settings = replace(PATHS, sampler=sampler)
    a = means(ROOM, Two(w, later), range(24), 16, settings)
    assert abs(z_score(a, means(ROOM, "balance", range(100, 148), 16))) < Z_LIMIT


def test_threads_do_not_matter() -> None:
    """The second rounding is part of the tile's stream."""
    a, b = (dmis.render(ROOM, Two(0.3, 0.7), 8, seed=3, settings=PATHS, threads=n).image for n in (1, 3))
    np.testing.assert_array_equal(a, b)


def test_curves_predict_paths() -> None:
    """The variance of rendered images at two weights, over many seeds, is what pilots at 1/2 say of each."""
    rule = Learned(patch=32, spp=512, filter="none", shrink=False, bounces="separate")
    first, behind = np.mean(
        [dmis.render(ROOM, rule, 513, seed=s, settings=PATHS).maps["variances"][:, :, 0, 0] for s in range(4)], axis=0
    )
    for w, later in ((0.73, 0.27), (0.27, 0.84)):
        at = [list(GRID).index(np.float32(share)) for share in (w, later)]
        predicted = first[at[0]] + behind[at[1]] - first[HALF]
        images = [dmis.render(ROOM, Two(w, later), 64, seed=s, settings=PATHS).image.mean(axis=2) for s in range(96)]
        measured = np.var(images, axis=0, ddof=1).mean() * 64
        assert measured == pytest.approx(predicted, rel=0.07)  # four standard errors of both


RULES = (
    "fixed:0", "fixed:1", "fixed:0.3", "balance", "pbrt", "one-sample", "resampled", "thesis", "linear", Two(0.2, 0.9),
    *(f"{rule}:bounces={kind}" for rule in ("second-moment", "auto") for kind in ("shared", "separate")),
)  # fmt: skip


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_furnace_of_an_emitting_sphere(rule: Any) -> None:
    """Inside a wall that emits 1 and reflects a, the radiance is 1 + a + ... + a^D: every sample meets the light."""
    ball = sphere(1.0, segments=16)
    inside = replace(ball, faces=ball.faces[:, ::-1].copy(), normals=None)
    light = MeshLight(inside.vertices, inside.faces, (1.0, 1.0, 1.0))
    camera = Camera.look_at((0.2, 0, 0), (1, 0.3, 0), fov=60, resolution=(4, 4))
    scene = Scene(camera, (Part(inside, matte(0.6), light),), (light,))
    for depth in (1, 2, 5, None):
        expected = (1 - 0.6 ** (np.inf if depth is None else depth + 1)) / 0.4
        settings = Settings(integrator="path", max_depth=depth)
        found = means(scene, rule, range(20), 16, settings)
        # a technique alone has no noise here at one bounce, but that of rounding
        limit = scipy.stats.t.isf(LEVEL / 2, len(found) - 1)
        assert abs(found.mean() - expected) < limit * found.std(ddof=1) / np.sqrt(len(found)) + 1e-5 * expected


# Oracle -------------------------------------------------------------------------------------------------------------


def test_oracle_of_paths(tmp_path: Any) -> None:
    """Two curves, whose changes add up; weights of their own save at least as much as one for all; kept by settings."""
    oracle = make_oracle(ROOM, 64, settings=PATHS, folder=tmp_path)
    direct = make_oracle(ROOM, 64, settings=Settings(integrator="direct"), folder=tmp_path)
    assert oracle.apart is not None and direct.apart is None and len(list(tmp_path.glob("*.npz"))) == 2
    assert oracle.best_apart().shape == (2, *oracle.best().shape)
    assert oracle.limit(apart=True) <= (1 + 1e-12) * oracle.limit() < 1
    np.testing.assert_allclose(oracle.at(0.5, 0.5), oracle.variance[HALF], rtol=1e-6)
    np.testing.assert_allclose(oracle.at(0.27, 0.27), oracle.at(0.27), rtol=1e-6)
    with pytest.raises(ValueError, match="knows of one weight only"):
        direct.at(0.5, 0.5)


def test_numbers_of_samples() -> None:
    """Half of the patches dark: all samples in the other half give half of the variance; evenly lit, nothing."""
    variance = np.ones((len(GRID), 2, 2))
    assert Oracle(variance, GRID, 4, 1).spread_evenly() == pytest.approx(1)
    variance[:, 0] = 0
    assert Oracle(variance, GRID, 4, 1).spread_evenly() == pytest.approx(0.5)


def test_numbers_of_samples_and_weights() -> None:
    """The same, with a weight that has a quarter of the variance and costs twice as much: of the half, half is left."""
    variance, cost = np.ones((len(GRID), 2, 2)), np.ones(len(GRID))
    assert Oracle(variance, cost, 4, 1).limit_with_counts() == pytest.approx(1)
    variance[:, 0] = 0
    variance[2], cost[2] = variance[2] / 4, 2
    assert Oracle(variance, cost, 4, 1).limit_with_counts() == pytest.approx(0.25)
