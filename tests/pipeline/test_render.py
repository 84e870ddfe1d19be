"""The pipeline: pilot, fit, final pass; the same image however the work is divided; work that is not lost."""

import json
import re
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from helpers import shared_scene

import dmis
from dmis.estimator.allocation import shares_of
from dmis.estimator.patterns import PatternMap
from dmis.estimator.settings import make_settings
from dmis.fit.fixed import Fixed
from dmis.fit.round import Fit, Round
from dmis.pipeline.job import resolve
from dmis.pipeline.passes import Passes
from dmis.pipeline.tile import MAX_SIDE, make_tiles
from dmis.scene.scene import SceneWarning

RULES = ["balance", "pbrt", "fixed:0.3", "one-sample", "thesis:patch=4", "thesis:reuse=yes"]


def same(a, b):
    """Whether two results are equal to the last bit."""
    return all(np.array_equal(getattr(a, n), getattr(b, n)) for n in ("image", "weight", "variance", "samples"))


@pytest.mark.parametrize("spp", [1, 2, 7, 8, 31, 33, 100])
def test_tiles_cover_every_pixel_once(spp):
    """For every number of samples, at a resolution that no tile size divides."""
    times_covered = np.zeros((171, 229), int)
    tiles = make_tiles((229, 171), 1, 0, Round(spp, shares_of(0.5), dmis.Settings()))
    for tile in tiles:
        times_covered[tile.area] += 1
        assert max(tile.shape) <= MAX_SIDE and tile.camera_samples == spp * np.prod(tile.shape)
    assert (times_covered == 1).all()
    assert [tile.number for tile in tiles] == list(range(len(tiles)))


def test_tiles_have_the_maps_of_their_pixels():
    """Samples and shares of a tile are those of its rows and columns; equal shares become one column."""
    rng, settings = np.random.default_rng(1), dmis.Settings(techniques=("light", "brdf", "uniform"))
    spp, shares = rng.integers(1, 9, (40, 50)), rng.dirichlet((1, 1, 1), (40, 50)).transpose(2, 0, 1)
    patterns = PatternMap(((1, 1),), rng.integers(0, 9, (40, 50)), rng.integers(0, 4, (3, 40, 50)))
    for tile in make_tiles((50, 40), 1, 0, Round(spp, shares, settings, tilt=shares[::-1], patterns=patterns)):
        area = tile.area
        row = tile.round.in_row_order()
        np.testing.assert_array_equal(row.spp, spp[area].reshape(-1))
        np.testing.assert_array_equal(row.shares, [share[area].reshape(-1) for share in shares])
        np.testing.assert_array_equal(row.tilt, row.shares[::-1])
        assert tile.camera_samples == spp[area].sum()
        np.testing.assert_array_equal(tile.round.patterns.pattern, patterns.pattern[area])
        np.testing.assert_array_equal(tile.round.patterns.halvings, patterns.halvings[:, *area])
    of_image = np.array([0.2, 0.3, 0.5])
    for equal in (of_image, np.broadcast_to(of_image[:, None, None], (3, 40, 50))):
        row = make_tiles((50, 40), 1, 0, Round(4, equal, settings, tilt=equal))[0].round.in_row_order()
        assert (row.spp, row.shares.tolist()) == (4, [[0.2], [0.3], [0.5]]) and (row.tilt == row.shares).all()


@pytest.mark.parametrize(
    ("integrator", "rule", "options"),
    [
        ("direct", "balance", {}),
        ("direct", "fixed:0.3", {"sampler": "independent"}),
        ("path", "fixed:0.3", {}),  # whose roulette takes numbers of the tile
        ("path", "one-sample", {}),
        ("direct", "balance", {"preset": "thesis"}),
    ],
)
@pytest.mark.parametrize("window", [(0, 3, 1, 4), (17, 31, 70, 34), (65, 0, 75, 40)])
def test_window_has_the_bits_of_the_whole_image(integrator, rule, options, window):
    """At odd places and across tiles, and through a window of a window; its deviation, and its checkpoint, too."""
    scene, settings = shared_scene("cornell", (75, 40)), {"integrator": integrator, **options}
    whole = dmis.render(scene, rule, 32, seed=2, parallel=1, **settings)
    x0, y0, x1, y1 = window
    inside = scene.crop((0, y0, x1, 40)).crop((x0, 0, x1, y1 - y0))
    part = dmis.render(inside, rule, 32, seed=2, **settings)
    for name in ("image", "deviation"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[y0:y1, x0:x1])
    assert part.samples.shape == part.image.shape[:2]
    assert part.provenance["window"] == "the same pixels as in the whole image"


def test_window_is_an_image_of_its_own_to_rules_that_learn(box):
    """They say so; no film of theirs has pixels outside."""
    crop = box.crop((0, 0, 8, 12))
    result = dmis.render(crop, "thesis", 16)
    assert "an image of its own" in result.provenance["window"] and result.rays["camera"] <= 16 * 12 * 8
    assert crop.intersector is box.intersector
    assert result.provenance["scene_hash"] != dmis.render(box, "balance", 1).provenance["scene_hash"]
    alone = dmis.render(replace(crop, camera=replace(crop.camera, frame=None, corner=(0, 0))), "balance", 1)
    assert "window" not in alone.provenance
    job = resolve(crop, "balance", 4, 0, make_settings()).alone
    assert job.window is None and job.scene.camera.resolution == (8, 12)


def test_the_default_rule_learns_where_that_pays(box):
    """``auto``, but for few samples and for odd numbers of shading samples."""
    assert dmis.render(box, spp=16).provenance["rule"] == "auto"
    assert dmis.render(box, spp=15).provenance["rule"] == "balance"
    for s, rule in ((3, "balance"), (50, "auto"), (52, "balance")):
        settings = dmis.Settings(shading_samples=s)
        with nullcontext() if rule == "auto" else pytest.warns(SceneWarning, match="must be"):
            assert dmis.render(box.crop((0, 0, 8, 8)), spp=16, settings=settings).provenance["rule"] == rule


def test_pilot_counts_in_the_budget(box):
    """Rays: spp camera rays per pixel that may see something, six of them the pilot's; `samples` says the same."""
    result = dmis.render(box, "thesis", 16)
    assert result.rays["camera"] == box.covered_pixels.sum() * 16
    assert (result.samples == 16).all()
    assert (dmis.render(box, "thesis:reuse=yes", 16).samples == 16).all()
    # Doubling joins the same samples as in the whole image; a checkpoint of a window resumes
    whole = dmis.render(box, "balance", 64, noise=0, parallel=1)
    part = dmis.render(box.crop((1, 5, 30, 20)), "balance", 64, noise=0, parallel=1)
    np.testing.assert_array_equal(part.image, whole.image[5:20, 1:30])


@pytest.mark.parametrize(("sampler", "reused"), [("independent", True), ("stratified", False), ("sobol", False)])
def test_pilot_is_in_the_image_if_the_rest_is_as_independent(box, sampler, reused):
    """Unless a rule or the settings say so: a few independent samples would spoil samples that are more even."""
    asked = dmis.Settings(sampler=sampler)
    by_rule = {r: dmis.render(box, f"second-moment:reuse={r}", 16, settings=asked) for r in ("yes", "no")}
    assert not same(by_rule["yes"], by_rule["no"])
    found = dmis.render(box, "second-moment", 16, settings=asked)
    assert same(found, by_rule["yes" if reused else "no"])
    assert found.provenance["settings"]["reuse_pilot"] is reused
    for reuse, word in ((True, "yes"), (False, "no")):
        settings = replace(asked, reuse_pilot=reuse)
        assert same(dmis.render(box, "second-moment", 16, settings=settings), by_rule[word])


class Own(dmis.Rule):
    """A rule of one's own, whose fit is given, and perhaps a pilot and settings."""

    def __init__(self, fit, **attributes):
        self._fit = fit
        vars(self).update(attributes)

    def fit(self, pilot):
        return self._fit


@pytest.mark.parametrize("spread", [1, 4])
def test_weight_of_a_reused_pilot_does_not_depend_on_numbers_of_samples(box, spread):
    """The image is (2 pilot + 16 final) / 18 however many samples a pixel has: else it would be biased."""
    fit = Fit(0.5, samples=np.linspace(1, spread, 24 * 32).reshape(24, 32))
    rules = (Own(fit, pilot={0.5: 2}, settings={"reuse_pilot": reuse}) for reuse in (True, False))
    both, final = (dmis.render(box, rule, 18, seed=4).image.astype(float) for rule in rules)
    job = resolve(box, "thesis", 16, 4, dmis.Settings(sampler="independent"))  # as those of a pilot
    with Passes(job, 1) as passes:
        pilot = passes.render(Round(2, shares_of(0.5), job.settings)).mean
    np.testing.assert_allclose((both * 18 - final * 16) / 2, pilot, atol=2e-5)


class Yields(dmis.Rule):
    """A rule whose rounds are given."""

    def __init__(self, rounds):
        self.given = rounds

    def rounds(self, budget):
        return self.given(budget)


@pytest.mark.parametrize("w", [0.5, 0.3])
def test_rounds_that_go_on_are_one_render(box, w):
    """The sequence, and the rounding of shares, go on: the image is that of one round, but for the order of sums."""

    def rounds(budget):
        whole = budget.final(Fit(w))
        film = yield replace(whole, spp=4, image_weight=4)
        assert film.n == 4 and film.rays["camera"] > 0
        yield replace(whole, spp=12, begin=4, image_weight=12)

    two = dmis.render(box, Yields(rounds), 16, seed=3, sampler="sobol")
    one = dmis.render(box, f"fixed:{w}", 16, seed=3, sampler="sobol")
    np.testing.assert_allclose(two.image, one.image, rtol=1e-5, atol=1e-6)
    assert two.rays == one.rays and (two.samples == 16).all()


@pytest.mark.parametrize(
    ("rounds", "message"),
    [
        (lambda budget: (replace(budget.final(Fit(0.5)), image_weight=0) for _ in range(2)), "with an image_weight"),
        (lambda budget: [budget.final(Fit(0.5))], "must be a generator, which yields Rounds; got list"),
        (lambda budget: (Fit(0.5) for _ in range(1)), "must yield Rounds, such as .*; got Fit"),
        (
            lambda budget: (budget.final(Fit(0.5), spent=16) for _ in range(1)),
            "spent must be .* from 0 to 15",
        ),
    ],
)
def test_rounds_of_a_rule_are_checked(box, rounds, message):
    with pytest.raises(ValueError, match=message):
        dmis.render(box, Yields(rounds), 16)


@pytest.mark.parametrize("rule", RULES)
def test_variance_layer_predicts_the_scatter_of_the_image(box, rule):
    """Over 40 seeds, the mean of the variance layer is the images' variance (systematic rounding can only lower it)."""
    results = [dmis.render(box, rule, 16, seed=s, sampler="independent") for s in range(40)]
    measured = np.var([r.image for r in results], axis=0, ddof=1).mean()
    predicted = np.mean([r.variance for r in results])
    assert (0 if rule == "fixed:0.3" else 0.85) < measured / predicted < 1.15


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"spp": 0}, "spp must be a whole number from 1 to 1048576; got 0"),
        ({"spp": "8", "rule": None}, "spp must be a whole number .*; got '8'"),
        ({"rule": "thesis", "spp": 6}, "more than the pilot's 6 camera samples"),
        ({"seed": -1}, "seed must be a whole number of at least 0; got -1"),
        ({"reuse_pilot": "no"}, "reuse_pilot must be True or False or None; got 'no'"),
        ({"sampler": "halton"}, "sampler must be auto or independent or"),
        ({"threads": 4}, "options must be among .*; got threads. Write parallel="),
        ({"settings": "path"}, "settings must be a dmis.Settings or None; got 'path'"),
        ({"rule": 3}, "rule must be a rule, or text such as thesis:patch=16; got 3"),
        ({"rule": "thesis:weigh=heuristics", "spp": 8}, "weigh must be samples or heuristic; got 'heuristics'"),
        ({"rule": "thesi"}, r"got 'thesi', did you mean 'thesis'\? dmis\.register_rule adds one"),
        ({"rule": "thesis:pach=4"}, r"rule thesis has the options .*; got 'pach', did you mean 'patch'\?"),
        ({"rule": "thesis:patch"}, "option patch of rule thesis needs a value, of type int or auto: thesis:patch="),
        ({"rule": "thesis:4,patch=8"}, "option patch of rule thesis must be given once; got 4 and 8"),
        ({"shading_sample": 4}, r"got shading_sample, did you mean 'shading_samples'\?"),
        ({"rule": "auto", "spp": 32, "shading_samples": 3}, "even for rule auto,.*; got 3. Use 4, or rule thesis"),
        ({"compensation": "0.5"}, "compensation must be .* less than 1.*; got '0.5'"),
        ({"combiner": ["power"]}, r"combiner must be one of balance, .*; got .\['power'\]"),
        ({"progress": 5}, "progress must be a function progress.*, True for a bar, or None; got 5"),
        ({"rule": None, "preset": "thesis"}, "; got 4. Use a larger spp or another rule, such as balance"),
    ],
)
def test_bad_arguments(box, options, message):
    """Each message names the argument, the constraint and the value."""
    with pytest.raises(ValueError, match=message):
        dmis.render(box, **{"rule": "balance", "spp": 4, **options})


def test_a_rule_of_ones_own(box):
    """Anything with a fit is a rule, here light sampling on the left and BRDF sampling on the right; the share map says
    what was used.
    """
    result = dmis.render(box, Own(Fit((np.arange(32) < 16) * np.ones((24, 1)))), 16, seed=1)
    assert (result.weight[:, :16] == 1).all() and (result.weight[:, 16:] == 0).all()
    light, brdf = (dmis.render(box, f"fixed:{w}", 16, seed=1) for w in (1, 0))
    total = light.rays["shadow"] + brdf.rays["brdf"]
    assert 0 < result.rays["shadow"] < light.rays["shadow"]
    assert result.rays["shadow"] + result.rays["brdf"] < total


def test_numbers_of_numpy_become_pythons(box, tmp_path):
    """They can be written with the image and to a checkpoint, and are the same image."""
    camera = replace(box.camera, resolution=tuple(np.array(box.camera.resolution)))
    numbers = {"shading_samples": np.int64(2), "max_depth": np.int64(5), "reuse_pilot": np.bool_(True)}
    settings = dmis.Settings(**numbers, sampler="independent")
    options = {"seed": np.int64(1), "parallel": np.int64(1), "settings": settings, "checkpoint": tmp_path / "c"}
    result = dmis.render(replace(box, camera=camera), "balance", np.int64(8), **options)
    dmis.write_image(tmp_path / "o.exr", result)
    held = json.loads(dmis.read_exr(tmp_path / "o.exr")[1]["dmis.provenance"])
    plain = dmis.render(box, "balance", 8.0, seed=1.0, settings=dmis.Settings(max_depth=5, sampler="independent"))
    assert same(result, plain)
    assert held == json.loads(json.dumps(plain.provenance))
    assert repr(settings) == repr(dmis.Settings(max_depth=5, reuse_pilot=True, sampler="independent"))


@pytest.mark.parametrize(
    "fit, message",
    [
        (Fit(1.5), "weight must be in .0, 1., a share of the samples; got 1.5$"),
        (Fit(np.where(np.arange(32) < 8, np.nan, 0.5) * np.ones((24, 1))), "got nan in 192 of 768 pixels"),
        (Fit(np.full((32, 24), 0.5)), r"weight must be of shape \(\) or \(24, 32\), .*height, width.*; got \(32, 24\)"),
        (Fit(np.full((3, 24, 32), 1 / 3)), r"weight must be \(2, ...\), one for each technique; got shape .3, 24, 32."),
        (Fit((0.5, 0.4)), "must add up to 1 over the techniques, .*; got sums from 0.9 to 0.9"),
        (Fit(0.5, samples=np.zeros((24, 32))), "samples must be positive, finite, and of shape"),
        (Fit(0.5, samples=3.0), r"samples must be .*; got shape \(\)"),
        (None, "must be a dmis.Fit; got NoneType"),
    ],
)
def test_bad_weights_are_refused(box, fit, message):
    """It would not stop the image, but spoil it."""
    with pytest.raises(ValueError, match=message):
        dmis.render(box, Own(fit), 8)


@pytest.mark.parametrize(
    ("rule", "option", "settings"),
    [
        *((rule, "combiner=power", {"combiner": "power"}) for rule in ("auto", "counts", "thesis")),
        *((rule, "combiner=optimal", {"combiner": "optimal"}) for rule in ("second-moment", "fixed:0.3")),
        ("second-moment", "combiner=maximum", {"combiner": "maximum"}),
        ("one-sample", "combiner=power", {"combiner": "power"}),
        ("thesis", "reuse=yes", {"reuse_pilot": True}),
        ("fixed:0.3", "allocation=random", {"allocation": "random"}),
    ],
)
def test_settings_are_options_that_a_rule_leaves_open(box, rule, option, settings):
    """The rule learns and renders with them as if it had named them itself."""
    option_text = f"{rule}{',' if ':' in rule else ':'}{option}"
    result = dmis.render(box, rule, 32, settings=dmis.Settings(**settings))
    assert same(result, dmis.render(box, option_text, 32)) and not same(result, dmis.render(box, rule, 32))
    assert settings.items() <= result.provenance["settings"].items()
    jobs = [resolve(box, rule, 32, 0, dmis.Settings(**given)) for rule, given in ((rule, settings), (option_text, {}))]
    assert jobs[0].rule == jobs[1].rule and "fallback" not in result.provenance


@pytest.mark.usefixtures("literature")
@pytest.mark.parametrize(
    ("settings", "rule", "reason"),
    [
        ({"combiner": "power"}, "auto", None),
        ({"techniques": ("light", "uniform")}, "auto", None),
        ({"allocation": "random"}, "balance", "rule auto needs allocation systematic, because .* Use thesis or"),
        ({"reuse_pilot": True}, "balance", "conflicting reuse_pilot: Settings has True, rule auto uses False"),
        ({"combiner": "optimal"}, "fixed:0.5", "combiner must be a heuristic, .* Use second-moment:combiner=optimal"),
        ({"techniques": ("light", "brdf", "uniform")}, "Fixed.*", "rule auto needs two techniques; got 3"),
        ({"techniques": ("resampled", "brdf")}, "balance", "needs the pdf of every technique, but 'resampled' has"),
    ],
)
def test_settings_without_a_rule(box, settings, rule, reason):
    """`auto` where it goes with the settings, else equal shares with these; warning and provenance say why."""
    with pytest.warns(SceneWarning, match=reason) if reason else nullcontext():
        result = dmis.render(box, None, 16, **settings)
    about = result.provenance
    assert re.fullmatch(rule, about["rule"]) and settings.items() <= about["settings"].items()
    if reason:
        assert re.search(reason, about["fallback"])
        k = len(about["settings"]["techniques"])
        equal = Fixed(0.5 if k == 2 else (1 / k,) * k)
        assert same(result, dmis.render(box, equal, 16, **settings))
    else:
        assert "fallback" not in about


@pytest.mark.parametrize(("weight", "reused"), [(0.0, False), (1.0, False), (0.2, True)])
def test_a_pilot_of_one_technique_is_in_the_image_on_request_only(box, weight, reused):
    """At w = 0 or 1 a few samples may have most of the error."""
    rule = Own(Fit(0.5), pilot={weight: 2})
    settings = dmis.Settings(sampler="independent")
    result = dmis.render(box, rule, 8, settings=settings)
    assert result.provenance["settings"]["reuse_pilot"] is reused
    asked = dmis.render(box, rule, 8, settings=replace(settings, reuse_pilot=True))
    assert same(asked, result) is reused
