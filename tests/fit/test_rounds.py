"""The rule of two rounds: planted variances, the colours of pixels, budgets, and images without bias."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from helpers import Z_LIMIT

import dmis
from dmis.base.patches import COLOURS, PATCH, patch_sum
from dmis.base.vectors import Array
from dmis.estimator.patterns import FIRST, PATTERNS, SHARES
from dmis.fit import rounds
from dmis.fit.registry import make_rule
from dmis.fit.rounds import HALF, Rounds
from dmis.fit.rule import Pilot
from dmis.variance.moments import Film, join

RAYS = {"camera": 1000, "shadow": 2000, "brdf": 2000}
"""Of a first round whose samples all trace a ray."""


def first_round(
    curve: Array, position: float = 0.0, size: int = 16, n: int = 8, budget: int = 128
) -> dict[float, Pilot]:
    """Return a first round of an image whose patches all have the curve ``(G,)`` for two shading samples."""
    rows = -(-size // PATCH)
    pixels = np.zeros((4, size, size))
    for k, at in enumerate(COLOURS):
        pixels[k][at] = 1
    area = np.stack([patch_sum(a, PATCH) for a in pixels])
    planted = area[:, None] * np.broadcast_to(curve[:, None, None], (len(SHARES), rows, rows))
    second = area[:, None] * np.broadcast_to((curve**2)[:, None, None], (len(SHARES), rows, rows))
    cross = area[:, None] * np.broadcast_to((curve * curve[HALF])[:, None, None], (len(SHARES), rows, rows))
    sums = {"curve": planted, "square": second, "cross": cross, "position": area * position}
    variance = curve[HALF] / 2 + position
    film = Film(
        n, np.ones((size, size, 3), np.float32), np.full((size, size, 3), np.sqrt(variance * (n - 1)), np.float32)
    )
    return {0.5: Pilot(film, RAYS, sums, 4, budget=budget)}


def rule(**options: object) -> Rounds:
    """Return the rule as it is for 128 Sobol samples."""
    adapted = Rounds(filter="none", **options).adapted(128, "sobol")  # type: ignore[arg-type]
    assert isinstance(adapted, Rounds)
    return adapted


def chosen(curve: Array, position: float = 0.0, **options: object) -> tuple[int, int]:
    """Return the pattern that all pixels get."""
    pattern = rule(**options).fit(first_round(curve, position)).continuation.patterns.pattern  # type: ignore[union-attr]
    assert (pattern == pattern[0, 0]).all()
    return PATTERNS[pattern[0, 0]]


def test_planted_curves_give_their_pattern() -> None:
    """Light samples alone where these have no variance, the reverse, and both where the curve is a deep valley."""
    assert chosen(1 - SHARES)[1] == 0 and chosen(SHARES)[0] == 0
    assert chosen(1e-3 + np.abs(SHARES - 0.8)) == (4, 1)
    assert chosen(1e-3 + np.abs(SHARES - 1 / 3)) == (1, 2)
    # V C^a of a flat curve: many shading samples where the camera's are quiet, few where they are not
    flat = np.ones(len(SHARES))
    assert chosen(flat) in ((2, 2), (4, 4)) and chosen(flat, 100.0) in ((1, 1), (2, 2))


def test_equal_shares_stay_equal() -> None:
    """`counts` takes no other share, whatever the curve."""
    n_l, n_b = chosen(1 - SHARES, weights=False)
    assert n_l == n_b


def test_a_small_gain_does_not_pay_for_a_new_beginning() -> None:
    """1 % less variance is less than the first round is worth."""
    curve = np.where(SHARES > 0.6, 0.99, 1.0)
    assert chosen(curve) == PATTERNS[FIRST]


def test_a_share_without_evidence_is_not_taken() -> None:
    """The standard error of the gain is far above it."""
    found = first_round(1 - 0.5 * SHARES)
    sums = dict(found[0.5].sums)
    sums["square"] = sums["square"] + 1e6
    pattern = rule().fit({0.5: replace(found[0.5], sums=sums)}).continuation.patterns  # type: ignore[union-attr]
    assert all(PATTERNS[k][0] == PATTERNS[k][1] for k in np.unique(pattern.pattern))


@pytest.mark.parametrize("colour", range(4))
def test_a_pixel_does_not_decide_for_itself(colour: int) -> None:
    """Samples of one colour change the patterns and numbers of all the others, and not its own."""
    found = first_round(1 - SHARES, 0.3)[0.5]
    rng = np.random.default_rng(colour)
    sums = {name: a.copy() for name, a in found.sums.items()}
    for a in sums.values():
        a[colour] *= rng.random(a[colour].shape) * 100
    root = found.moments.root.copy()
    root[COLOURS[colour]] *= rng.random(root[COLOURS[colour]].shape) * 100
    changed = replace(found, sums=sums, moments=replace(found.moments, root=root))
    before, after = (rule().fit({0.5: pilot}).continuation for pilot in (found, changed))
    assert before is not None and after is not None
    for at, same in ((COLOURS[k], k == colour) for k in range(4)):
        assert np.array_equal(before.density[at], after.density[at]) == same
        if same:
            np.testing.assert_array_equal(before.patterns.pattern[at], after.patterns.pattern[at])


def test_joined_films_have_all_samples() -> None:
    """Where a pixel goes on; where it begins anew the first film does not matter."""
    values = np.random.default_rng(3).normal(2, 1, (24, 2, 3, 3))
    taken = np.array([[8, 0, 8], [0, 8, 8]])

    def film(some: Array) -> Film:
        deviation = some - some.mean(axis=0)
        root = np.sqrt((deviation**2).sum(axis=0))
        return Film(len(some), some.mean(axis=0).astype(np.float32), root.astype(np.float32))

    more = film(values[8:])
    joined = join(film(values[:8]), film(values[8:]), taken)
    whole = np.where(taken[..., None] > 0, values.mean(axis=0), values[8:].mean(axis=0))
    np.testing.assert_allclose(joined.mean, whole, rtol=1e-5)
    np.testing.assert_array_equal(joined.n[..., 0], np.where(taken > 0, 24, 16))  # type: ignore[index]
    np.testing.assert_allclose(joined.root[taken == 0], more.root[taken == 0], rtol=1e-5)


def test_options_are_checked() -> None:
    """A first round of whole pairs, an exponent that an error can have, a heuristic."""
    for wrong, message in (
        ("auto:spp=6", "spp of the first round must be a multiple of 4"),
        ("auto:exponent=0.5", r"exponent must be in \[1, 3\]"),
        ("auto:guard=-1", "guard must not be negative"),
        ("auto:combiner=optimal", "combiner must be a heuristic"),
        ("counts:filter=median", "filter must be gaussian, none or joint"),
    ):
        with pytest.raises(ValueError, match=message):
            make_rule(wrong)


@pytest.mark.parametrize("sampler", ["sobol", "independent", "stratified", "lowdiscrepancy"])
@pytest.mark.parametrize("size", [(1, 1), (3, 2), (9, 7)])
@pytest.mark.parametrize("spp", [1, 7, 16, 40])
def test_small_images(sampler: str, size: tuple[int, int], spp: int) -> None:
    """Finite, and what was taken is told."""
    scene = dmis.load_scene("killeroo-gold", resolution=size)
    for name in ("auto", "counts"):
        result = dmis.render(scene, name, spp, seed=1, sampler=sampler)
        assert np.isfinite(result.image).all() and (result.samples >= 1).all()
        assert result.deviation_of == ("sub-blocks" if sampler == "sobol" else "samples")
        np.testing.assert_allclose(
            result.light_samples + result.brdf_samples, result.samples * result.shading_samples, rtol=1e-6
        )


@pytest.mark.parametrize("options", [{"integrator": "path", "max_depth": 3}, {"shading_samples": 4}])
def test_same_bits_on_any_number_of_threads(options: Mapping[str, object]) -> None:
    """By paths, and with patterns of twice as many samples."""
    scene = dmis.load_scene("cornell", resolution=(40, 30))
    one, two = (dmis.render(scene, "auto", 32, seed=3, sampler="sobol", parallel=k, **options) for k in (1, 2))
    np.testing.assert_array_equal(one.image, two.image)
    assert set(np.unique(one.samples * one.shading_samples) % 2) == {0}


def biases(renders: int, spp: int) -> tuple[float, Array]:
    """Return z of the image, and of blocks of 4x4 pixels, of the mean of that many renders against a reference."""
    scene = dmis.load_scene("killeroo-gold", resolution=(16, 12))
    truth = [dmis.render(scene, "balance", 2**14, seed=10**6 + k, sampler="sobol").image for k in range(2)]
    images = np.stack(
        [
            dmis.render(scene, "auto", spp, seed=k, sampler="sobol", parallel=1).image.mean(axis=2)
            for k in range(renders)
        ]
    )
    blocks = np.stack([patch_sum(image, 4) for image in (*images, *(t.mean(axis=2) for t in truth))])
    blocks, reference = blocks[:renders], blocks[renders:]
    noise = blocks.var(axis=0, ddof=1) / renders + (reference[0] - reference[1]) ** 2 / 4
    total = blocks.sum(axis=(1, 2))
    image_noise = total.var(ddof=1) / renders + (reference[0].sum() - reference[1].sum()) ** 2 / 4
    z = (blocks.mean(axis=0) - reference.mean(axis=0)) / np.sqrt(noise)
    return float((total.mean() - reference.mean(axis=0).sum()) / np.sqrt(image_noise)), z


@pytest.mark.parametrize("spp", [16, 32])
def test_image_is_unbiased(spp: int) -> None:
    """Over 200 renders of few samples, of a scene with rare bright ones."""
    image, blocks = biases(200, spp)
    assert abs(image) < Z_LIMIT and np.abs(blocks).max() < Z_LIMIT, (image, blocks)


def test_a_leak_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """If the samples of a pixel decide how many it gets, the same test fails."""
    nothing = (slice(0, 0), slice(0, 0))
    own = rounds.Rounds._variance
    monkeypatch.setattr(
        rounds.Rounds, "_variance", lambda self, variance, curves, n, colour: own(self, variance, curves, n, nothing)
    )
    monkeypatch.setattr(rounds, "gaussian", lambda values, *_: values)
    image, _ = biases(200, 32)
    assert image < -Z_LIMIT
