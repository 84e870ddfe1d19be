"""MIS-Bench: tables agree with renders, films made of them with the films of pilots, scores with planted curves."""

import json
import sys
import zipfile
from collections.abc import Callable, Generator, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import dmis
from dmis.base.patches import PATCH, patch_mean, patch_spread
from dmis.base.vectors import Array
from dmis.bench.data import GRID, HALF, PACKAGED, SMALL, Pilots, Truth, checksum, path_of, read_pilots, read_truth
from dmis.bench.decide import SETTINGS, SPP, _part, decide
from dmis.bench.judge import BASELINES, ORACLES, Score, error_time, interval, of_pixels, report, report_json, score
from dmis.bench.samples import SampleTable
from dmis.cli.commands import main
from dmis.estimator.cost import count_camera_samples, surface_points
from dmis.experiment.oracle import Oracle
from dmis.fit.round import Budget, Fit, Round
from dmis.fit.second_moment import SecondMoment
from dmis.scene.feature_buffers import render_feature_buffers
from dmis.variance.moments import Film
from tests.helpers import Z_LIMIT, fresh_python, shared_scene

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from mis_bench import (
    draw_blocks,
    draw_pilots,
    load,
    measure,
    pilots_of_blocks,
    truth_of_blocks,
    write_pilots,
    write_truth,
)

ROOT = Path(__file__).resolve().parents[2]
RULE, *_ = (ROOT / "docs" / "mis-bench.md").read_text("utf-8").split("```python\n")[1].partition("\n\nif __name__")


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("teapot-area-light", {}),
        ("veach-mis", {}),
        ("tt", {"sampler": "independent"}),
        ("cornell", {"integrator": "path", "weight": 0.25}),
    ],
)
def test_samples_are_those_of_a_render(name: str, options: dict[str, object]) -> None:
    """The mean over all rows is the image, a choice of pixels has the same rows, and costs count the same rays."""
    scene = shared_scene(name, (36, 33))
    table = dmis.samples(scene, spp=4, seed=3, **options)  # type: ignore[arg-type]
    weight = options.pop("weight", 0.5)
    result = dmis.render(scene, f"fixed:{weight}", 4, seed=3, parallel=1, **options)  # type: ignore[arg-type]
    scale = result.image.max()
    np.testing.assert_allclose(table.radiance().mean(axis=0) / scale, result.image / scale, atol=1e-6)
    traced = (table.cost[table.technique >= 0] > 0).sum()
    assert traced == pytest.approx(result.rays["shadow"] + result.rays["brdf"], rel=2e-3)
    some = dmis.samples(scene, [7, 1000], spp=4, seed=3, weight=weight, **options)  # type: ignore[arg-type]
    mask = np.isin(table.pixel, [7, 1000])
    np.testing.assert_array_equal(some.f, table.f[mask])
    assert set(some.pixel) == {7, 1000} and (some.camera_sample == table.camera_sample[mask]).all()


def test_windows_and_pixels() -> None:
    """They are those of the whole image, by the numbers of the window's pixels."""
    scene = shared_scene("cornell", (70, 40))
    options = {"spp": 4, "integrator": "path"}
    of_window = dmis.samples(scene.crop((29, 30, 60, 37)), [6 * 31 + 5], **options)
    of_whole = dmis.samples(scene, [36 * 70 + 34], **options)
    np.testing.assert_array_equal(of_window.f, of_whole.f)
    assert set(of_window.pixel) == {6 * 31 + 5} and of_window.shape == (7, 31)
    # pixels that are refused
    for pixels in ([-1], [36 * 33], [0.5], [], (3, 4), 3):
        with pytest.raises(ValueError, match="pixels must be whole numbers from 0 to 1187"):
            dmis.samples(shared_scene("teapot-area-light", (36, 33)), pixels)  # type: ignore[arg-type]


class Tilted(dmis.Rule):
    """A rule whose pilot tilts the heuristic."""

    pilot = {0.25: 2}  # noqa: RUF012
    weigh = "heuristic"


def with_films(rule: dmis.Rule, films: list[Film]) -> dmis.Rule:
    """Return a rule that keeps the film of the first round of `rule`, and decides nothing."""

    class Keeper(type(rule)):  # type: ignore[misc]
        def rounds(self, budget: Budget) -> Generator[Round, Film, None]:
            films.append((yield next(super().rounds(budget))))
            yield budget.final(Fit(0.5), spent=8)

    return Keeper(**vars(rule))  # type: ignore[no-any-return]


@pytest.mark.parametrize(("rule", "spp", "shading_samples"), [(SecondMoment(), 3, 4), (Tilted(), 2, 2)])
def test_films_are_those_of_the_pilot(rule: dmis.Rule, spp: int, shading_samples: int) -> None:
    """From the samples of a pilot, a rule gets the film that the render of the pilot makes."""
    scene = shared_scene("veach-mis", (36, 33))
    settings = replace(SETTINGS, shading_samples=shading_samples)
    table, films = dmis.samples(scene, spp=spp, seed=5, settings=settings), list[Film]()
    decide(with_films(rule, films), Pilots({0.5: table}, {}))
    dmis.render(scene, with_films(rule, films), SPP, seed=5, parallel=1, settings=SETTINGS)
    film, expected = films
    np.testing.assert_allclose(film.mean, expected.mean, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(film.root, expected.root, rtol=1e-3, atol=1e-4)
    assert film.shading_samples == shading_samples and film.rays == expected.rays
    assert expected.sums.keys() - film.sums.keys() <= {"lights"}  # which needs a plan
    for name, sums in film.sums.items():
        np.testing.assert_allclose(expected.sums[name], sums, rtol=1e-3, atol=1e-4 * np.abs(sums).max())


def test_part_of_a_table_has_the_same_mean() -> None:
    """Half of the shading samples estimate the same image, with their share of the rays; films share no samples."""
    pilots = read_pilots(path_of(SMALL, 0))
    table = pilots.tables[0.5]
    whole, part = (t.radiance().mean(axis=3) for t in (table, _part(table, 0, 6, 2)))
    difference = (whole - part).mean(axis=0)
    assert abs(difference.mean()) / (difference.std() / np.sqrt(difference.size)) < Z_LIMIT
    assert part.var(axis=0).mean() > whole.var(axis=0).mean()
    assert _part(table, 0, 6, 2).rays["shadow"] == pytest.approx(table.rays["shadow"] / 2, abs=1)
    first, rest = _part(table, 0, 2, 4), _part(table, 2, 4, 4)
    np.testing.assert_allclose(np.concatenate([first.radiance(), rest.radiance()]), table.radiance(), atol=1e-6)


def test_truth_agrees_with_renders() -> None:
    """Curves of shares and tilts are the variance of renders, in both measures."""
    scene, settings = load(SMALL)
    truth = read_truth(path_of(SMALL))
    for k, (w, weigh) in enumerate([(0.3, "samples"), (0.73, "samples"), (0.84, "heuristic")]):
        rule = dmis.Given(w, weigh=weigh)
        final = Budget(SPP, truth.shape, SETTINGS, weigh=weigh).final(rule.fit({}))
        seeds = range(100 * k, 100 * k + 40)
        grey = np.stack(
            [dmis.render(scene, rule, 16, seed=s, parallel=1, settings=settings).image for s in seeds]
        ).mean(-1)
        mean = grey.mean(axis=0)
        for number, scale in enumerate((np.ones(truth.shape), 1 / (mean**2 + 0.01))):
            squares = (16 * (grey - mean) ** 2 * scale * 40 / 39).mean(axis=(1, 2))
            error = np.hypot(squares.std() / np.sqrt(40), 0.03 * squares.mean())  # the curves have noise as well
            assert abs(of_pixels(final, truth, number)[0].mean() - squares.mean()) < Z_LIMIT * error


def test_cost_counts_rays() -> None:
    """The mean cost of the curves is the counted cost of the samples of a table, and by paths that of a render."""
    table = dmis.samples(shared_scene("cornell", (36, 33)), spp=4, integrator="path")
    rays = dmis.render(shared_scene("cornell", (36, 33)), "fixed:0.5", 4, parallel=1, integrator="path").rays
    expected = 1.5 * surface_points(rays) * 4 * 36 * 33 + 0.4 * (rays["shadow"] + rays["brdf"])
    assert table.cost.sum() == pytest.approx(expected, rel=1e-3)
    scene, settings = load(SMALL)
    truth, camera_samples = read_truth(path_of(SMALL)), 8 * 24 * 18
    for w in (0.03, 0.5, 0.97):
        table = dmis.samples(scene, spp=8, weight=w, settings=settings)
        final = Budget(SPP, truth.shape, SETTINGS).final(Fit(w))
        assert of_pixels(final, truth, 0)[1].mean() == pytest.approx(table.cost.sum() / camera_samples, rel=0.01)


@pytest.fixture
def planted() -> Truth:
    """Two patches of 4x4 and 4x2 pixels, with V = |w - 1/4| + 1 and 8 times |w - 3/4| + 1, and C = 1 + w."""
    w = GRID[:, None].astype(float)
    curves = np.concatenate([np.abs(w - 0.25) + 1, 8 * (np.abs(w - 0.75) + 1)], axis=1)[:, None]
    variance = np.broadcast_to(curves, (2, 2, *curves.shape)) * np.array([1, 2])[None, :, None, None, None]
    return Truth(variance, np.full((2, 1, 2), 3.0), np.broadcast_to(1 + w[:, None], curves.shape), (4, 6))


def round_of(truth: Truth, weight: Array | float, samples: Array | None = None, **settings: str) -> Round:
    weigh = settings.pop("weigh", "samples")
    budget = Budget(SPP, truth.shape, replace(SETTINGS, **settings), weigh=weigh)  # type: ignore[arg-type]
    return replace(budget.final(Fit(weight)), **({} if samples is None else {"spp": samples}))


def test_error_times_cost_of_planted_curves(planted: Truth) -> None:
    """``mean(V / n) mean(n C)``, V of the harmonic mean between the shares of the grid."""
    shares = np.array([[0.16] * 4 + [0.84] * 2] * 4)
    expected = (16 * 1.09 + 8 * 8 * 1.09) / 24 * (16 * 1.16 + 8 * 1.84) / 24
    assert error_time(round_of(planted, shares), planted, 0) == pytest.approx(expected)
    half, between = error_time(round_of(planted, 0.5), planted, 0), error_time(round_of(planted, 0.56), planted, 0)
    assert half == pytest.approx((16 * 1.25 + 64 * 1.25) / 24 * 1.5)
    light, brdf = (2 / (1 / a + 1 / b) for a, b in ((1.25, 1.37), (1.25, 1.13)))
    assert between == pytest.approx((16 * light + 64 * brdf) / 24 * 1.56)
    n = np.where(shares < 0.5, 1, 3)
    expected = (16 * 1.25 + 64 * 1.25 / 3) / 24 * (16 * 1 + 8 * 3) / 24 * 1.5
    assert error_time(round_of(planted, 0.5, n), planted, 0) == pytest.approx(expected)
    # a tilt has curves of its own, and the cost of w = 1/2; the power heuristic has one variance
    assert error_time(round_of(planted, 0.84, weigh="heuristic"), planted, 0) == pytest.approx(
        2 * (16 * 1.59 + 64 * 1.09) / 24 * 1.5
    )
    assert error_time(round_of(planted, 0.5, combiner="power"), planted, 1) == pytest.approx(3 * 1.5)
    with pytest.raises(ValueError, match="combiner of a rule must be"):
        error_time(round_of(planted, 0.4, combiner="power"), planted, 0)


def test_oracles_of_planted_curves(planted: Truth) -> None:
    """No map of shares on the grid has less than the oracle, and numbers of samples gain what the formula says."""
    curves, area = Oracle(planted.variance[0, 0], planted.cost, 4, SPP, planted.shape), np.array([16, 8]) / 24
    v, c = planted.variance[0, 0, :, 0], planted.cost[:, 0, 0]
    half = error_time(round_of(planted, 0.5), planted, 0)
    least = curves.limit(costly=True) * half
    every = [(area @ [v[i, 0], v[j, 1]]) * (area @ [c[i], c[j]]) for i in range(len(GRID)) for j in range(len(GRID))]
    assert least == pytest.approx(min(every))
    roots = np.sqrt((v * c[:, None]).min(axis=0))
    assert curves.limit_with_counts() * half == pytest.approx((area @ roots) ** 2)
    assert (area @ roots) ** 2 < least


def test_scores_of_the_scene_that_comes_with_dmis() -> None:
    """Balance is 1, saves nothing and harms nothing; the oracle saves all; no map saves more than it."""
    values = {name: score(rule, [SMALL]).values[SMALL][0] for name, rule in BASELINES.items()}
    np.testing.assert_allclose(values["balance"][[0, 1, 2, 3, 5]], [1, 1, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(values["oracle"][2:], [1, 1, 0, 0], atol=1e-12)
    oracles = [ORACLES[rule] for rule in BASELINES.values() if isinstance(rule, str) and rule in ORACLES]
    assert oracles == [False, True]
    for name, row in values.items():
        assert np.isfinite(row).all() and (row[2:4] <= 1 + 1e-9).all() and row[4] > -1e-9, name
    assert values["random"][1] > values["thesis, shares"][1] and values["oracle, samples"][0] < values["oracle"][0]
    paths = path_of(SMALL), path_of(SMALL, 0)
    assert sum(path.stat().st_size for path in paths) < 150_000


BLOCKED = "import sys; sys.modules.update(dict.fromkeys(('embreex', 'trimesh', 'OpenEXR')))\n"
WRITER = (ROOT / "examples" / "exporters" / "bench_data.py").read_text("utf-8")


def test_scores_without_embree_trimesh_and_openexr(tmp_path: Path) -> None:
    """A stranger's file is written and scored, and so are scenes that come with dmis, by a rule of 20 lines; rays have
    a clear error.
    """
    assert RULE.count("\n") <= 20
    code = f"""{BLOCKED}
import os; os.chdir({str(tmp_path)!r})
{WRITER}{RULE}
import dmis
for name in ("thesis", "second-moment:filter=gaussian"):
    print(dmis.score(name, ["toy.npz"]).over_scenes()[0, :2])
print(*dmis.score("thesis", {PACKAGED}).values)
print(float(dmis.score(rule, ['small']).over_scenes()[0, 1]))
try:
    dmis.intersect.Intersector(np.eye(3), np.array([[0, 1, 2]]))
except ValueError as error:
    print(error)
"""
    *_, scenes, relative, error = fresh_python(code).splitlines()
    assert scenes.split() == list(PACKAGED) and 0.8 < float(relative) < 1
    assert error.startswith("a render, which traces rays, needs embreex, which cannot be imported")
    assert "pip install embreex" in error and error.endswith("dmis.score needs no rays")


def test_the_writer_of_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its pilots have the mean and, per shading sample, the variance of its converged curves; scores take the path."""
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(WRITER, names)
    for w, table in read_pilots(tmp_path / "toy-0.npz").tables.items():
        radiance = table.radiance()[..., 0]
        truth = read_truth(tmp_path / "toy.npz")
        k = {0.0: 0, 0.5: HALF, 1.0: -1}[w]
        if w == 0.5:
            measured = radiance.var(axis=0, ddof=1).mean()
            assert measured == pytest.approx(truth.variance[0, 0, k].mean() / 2, rel=0.25)
        mean = names["f"](names["x"], np.arange(96)[:, None]).mean()
        error = np.sqrt(truth.variance[0, 0, k].mean() / radiance.size)
        assert abs(radiance.mean() - mean) < Z_LIMIT * error
    path = tmp_path / "toy.npz"
    np.testing.assert_array_equal(dmis.score("balance", [path]).values[str(path)][:, :2], [[1, 1]])
    (tmp_path / "toy-0.npz").rename(tmp_path / "toy-2.npz")
    assert len(dmis.score("balance", ["toy.npz"]).values["toy.npz"]) == 1
    with pytest.raises(ValueError, match=r"toy\.npz must have pilots of at least one seed, such as toy-0\.npz"):
        dmis.score("balance", ["toy.npz"], seeds=[0, 1])
    with pytest.raises(ValueError, match=r"there is no kitchen\.npz"):
        dmis.score("balance", ["kitchen.npz"])


def test_scenes_that_come_with_dmis() -> None:
    for scene in PACKAGED:
        assert sum(path_of(scene, seed).stat().st_size for seed in (None, 0)) < 1_000_000
        scene_, settings = load(scene)
        assert read_truth(path_of(scene)).shape == scene_.camera.resolution[::-1] and settings.compensation == 0
    pilots, kept = draw_pilots(*load(SMALL), 0), read_pilots(path_of(SMALL, 0))
    for w, table in pilots.tables.items():
        np.testing.assert_allclose(kept.tables[w].radiance(), table.radiance(), rtol=1e-2, atol=1e-3)


def test_renders_of_a_rule() -> None:
    """They have the error times cost that its score predicts."""
    scene, settings = load(SMALL)
    rounds = (decide(rule, read_pilots(path_of(SMALL, 0))) for rule in ("fixed:0.03", "balance"))
    (value, error), (balance, _) = (measure(scene, settings, round_, 0.0) for round_ in rounds)
    predicted = score("fixed:0.03", [SMALL]).over_scenes()[0, :2]
    np.testing.assert_allclose(value / balance, predicted, rtol=0.3)
    assert (0 < error).all() and (error < 0.3).all()


# Blocks of a larger image --------------------------------------------------------------------------------------------


@pytest.fixture
def blocks(tmp_path: Path) -> Path:
    """Twelve blocks of two patches: one that is judged, with V = k + 1 at w = 0.5 in block k, which stands for 16, 32,
    ... pixels, and context with the weight 0 whose V is huge and whose cost is 0, as benchmarks/mis_bench.py writes it.
    """
    number = np.arange(12.0)
    curves = np.stack([np.abs(GRID[:, None] - 0.16) + number + 0.66, np.full((len(GRID), 12), 1e9)], axis=-1)
    variance = np.broadcast_to(curves, (2, 2, *curves.shape))
    weight = np.stack([16 * (number + 1), np.zeros(12)], axis=-1)
    truth = Truth(variance, np.ones((2, 12, 2)), np.broadcast_to(weight > 0, curves.shape), (48, 8), weight, 12)
    write_truth(tmp_path / "blocks.npz", truth)
    table = dmis.samples(shared_scene("teapot-area-light", (8, 48)), spp=6, shading_samples=4, sampler="independent")
    pilots = Pilots({w: replace(table, w=np.full_like(table.w, w)) for w in (0.0, 0.5, 1.0)}, {})
    write_pilots(tmp_path / "blocks-0.npz", pilots)
    return tmp_path / "blocks.npz"


def test_a_rule_decides_in_one_block_after_the_other(blocks: Path) -> None:
    """It sees the pixels of one block, and patches count as the pixels that they stand for; context does not."""
    tables = list[SampleTable]()

    def rule(pilots: Mapping[float, SampleTable]) -> float:
        tables.append(pilots[0.5])
        return 0.16 if len(tables) % 2 else 0.5

    columns = score(rule, [blocks]).values[str(blocks)]
    assert columns.shape == (12, 6) and len(tables) == 12
    whole = read_pilots(blocks.with_name("blocks-0.npz")).tables[0.5]
    np.testing.assert_array_equal(
        np.concatenate([t.f for t in tables]), whole.f[np.argsort(whole.pixel // 32, kind="stable")]
    )
    assert all(t.shape == (4, 8) and t.pixel.max() < 32 for t in tables)
    assert all(t.rays["shadow"] == whole.rays["shadow"] // 12 for t in tables)
    number = np.arange(12.0)
    v, weight = number + np.where(number % 2, 1, 0.66), number + 1
    for left_out, row in enumerate(columns):
        kept = number != left_out
        expected = (v * weight)[kept].sum() / ((number + 1) * weight)[kept].sum()
        assert row[0] == pytest.approx(expected, rel=1e-5)
        assert row[5] == 0


def test_interval_of_blocks_is_the_jackknife(blocks: Path) -> None:
    """Of a mean it is the standard error of independent values, times the quantile."""
    values = np.random.default_rng(0).random(12)
    left = (values.sum() - values) / 11
    for of, is_blocks in ((left, True), (values, False)):
        mean, half = interval(of, is_blocks)
        assert mean == pytest.approx(values.mean())
        assert half == pytest.approx(2.201 * values.std(ddof=1) / np.sqrt(12), rel=1e-3)
    scored = score("fixed:0.16", [blocks])
    assert scored.blocks and "±" in repr(scored) == report({scored.rule: scored})


def test_numbers_of_samples_do_not_count_in_blocks(blocks: Path) -> None:
    """They are decided for a whole image, so that those of a block say nothing; the oracle's do."""
    calls = list[int]()

    def pair(tables: Mapping[float, SampleTable]) -> tuple[float, Array]:
        calls.append(1)
        return 0.16, np.arange(32.0).reshape(4, 8) + len(calls)

    with_numbers, shares = (score(rule, [blocks]).values[str(blocks)] for rule in (pair, lambda tables: 0.16))
    np.testing.assert_allclose(with_numbers, shares)
    assert score("oracle-samples", [blocks]).values[str(blocks)][0, 0] < shares[0, 0]
    with pytest.raises(ValueError, match="must all be blocks of larger images, or none; got"):
        score("balance", [blocks, SMALL])


def test_blocks_are_those_of_the_image() -> None:
    """Pilots and truth of blocks are those of the whole image's pixels; rays are its rays per camera sample."""
    scene, settings = load("teapot-area-light")
    scene = replace(scene, camera=replace(scene.camera, resolution=(72, 64)))
    corners, cores, weight = draw_blocks(scene, settings, 3, 32)
    assert (corners % PATCH == 0).all() and (corners >= 0).all() and (corners + 32 <= (64, 72)).all()
    assert ((cores >= 0) & (cores <= 16)).all() and weight.shape == (3,)
    pilots = pilots_of_blocks(scene, settings, 3, 32, 0)
    assert count_camera_samples(pilots.tables[0.5].rays) == pytest.approx(3 * 32**2 * 6, abs=2)
    result = dmis.render(scene, "balance", 256, settings=settings, parallel=1)
    normal = render_feature_buffers(scene)[0]["normal"]
    truth = truth_of_blocks(scene, settings, 3, 32, 128)
    assert truth.blocks == 3 and truth.shape == (96, 32) and truth.weight is not None
    for k, (part, block) in enumerate(zip(pilots.split(3), truth.split(), strict=True)):
        (y, x), (top, left) = corners[k].tolist(), (corners[k] + cores[k]).tolist()
        shown = result.image[y : y + 32, x : x + 32].mean(axis=2)
        mean = part.tables[0.5].radiance().mean(axis=(0, 3))
        assert np.abs(mean - shown).mean() < 0.2 * shown.mean() + 0.01
        np.testing.assert_array_equal(part.features["normal"], normal[:, y // 4 : y // 4 + 8, x // 4 : x // 4 + 8])
        judged = np.split(truth.weight, 3)[k] > 0
        assert judged.sum() == 16 and np.split(truth.weight, 3)[k].max() == pytest.approx(16 * weight[k])
        v = block.variance[0, 0, HALF]
        assert (v[~judged] == 0).all() and (block.cost[HALF][judged] > 1).all()
        area = result.image[top : top + 16, left : left + 16], result.variance[top : top + 16, left : left + 16]
        # of a channel; those of a pixel rise and fall together
        assert v[judged].mean() == pytest.approx(256 * area[1].mean(), rel=0.6) or area[1].max() < 1e-7


def test_files_keep_what_was_written(tmp_path: Path, planted: Truth) -> None:
    table = dmis.samples(shared_scene("ten-lights", (16, 16)), spp=2, shading_samples=2, sampler="independent")
    path = tmp_path / "pilots.npz"
    write_pilots(path, Pilots({0.5: table}, {"normal": np.ones((3, 4, 4), np.float32)}))
    kept = read_pilots(path)
    order = np.lexsort((table.pixel, table.camera_sample, table.sample_index, table.technique, table.light))
    for name in ("pixel", "camera_sample", "technique", "light"):
        np.testing.assert_array_equal(getattr(kept.tables[0.5], name), getattr(table, name)[order])
    np.testing.assert_allclose(kept.tables[0.5].f, table.f[order], rtol=2**-10, atol=1e-30)
    assert kept.tables[0.5].rays == table.rays and kept.features["normal"].shape == (3, 4, 4)
    write_truth(tmp_path / "truth.npz", planted)
    np.testing.assert_allclose(read_truth(tmp_path / "truth.npz").variance, planted.variance, rtol=1e-6)


def test_refuses_files_that_changed(tmp_path: Path, planted: Truth) -> None:
    """Files that are cut, have another byte, or other values with the checksum of the old ones, or none."""
    path = tmp_path / "truth.npz"
    with pytest.raises(ValueError, match="Make it in a checkout of dmis: python benchmarks"):
        read_truth(path)
    write_truth(path, planted)
    data = bytearray(path.read_bytes())
    with zipfile.ZipFile(path) as archive:
        largest = max(archive.infolist(), key=lambda member: member.compress_size)
    with np.load(path) as arrays_of_file:
        arrays = dict(arrays_of_file)
    data[largest.header_offset + 60 + largest.compress_size // 2] ^= 1
    header = json.loads(str(arrays["header"]))
    del header["checksum"]
    for change in (
        lambda: path.write_bytes(data),
        lambda: path.write_bytes(b"PK"),
        lambda: np.savez(path, **(arrays | {"power": arrays["power"] * 2})),
        lambda: np.savez(path, **(arrays | {"header": np.array(json.dumps(header))})),
    ):
        change()
        with pytest.raises(ValueError, match="it is damaged, or its SHA-256 is not that in its header"):
            read_truth(path)


@pytest.mark.parametrize(("name", "change", "message"), [
    ("-0 about", lambda about: [{**p, "shape": [24, 18]} for p in about], r"shape of all pilots .*; got \(24, 18\)"),
    ("-0 about", lambda about: [{**about[0], "spp": 1}], "'0.0 camera_sample' must .* from 0 to 0; got .* from 0 to 1"),
    ("-0 0.5 f", lambda f: f * np.nan, r"'0.5 f' must have shape \(N 3\).* from nan to nan"),
    ("-0 0.5 technique", lambda t: t + 0.0, "'0.5 technique' must .* integer values from -1 to 1; got .* float64"),
    ("-0 feature normal", lambda n: n[:, 1:], r"'feature normal' must have shape \(3 R C\) = \(3, 5, 6\)"),
    (" cost", lambda cost: cost * (np.arange(6) != 3), r"'cost' must be above 0 in .*; got 0 in patch \(0, 3\)"),
    (" about", lambda about: [18], "H and W, must be two numbers"),
    (" about", lambda about: [18, 24, 5], "blocks must be 1, or a multiple of 12"),
])  # fmt: skip
def test_what_a_file_holds_is_checked(tmp_path: Path, name: str, change, message: str) -> None:
    """The checksum is right, but not one number or array (None: there is none): score names file and array."""
    ending, _, name = name.partition(" ")
    for k, of_file in ((None, ""), (0, "-0")):
        with np.load(path_of(SMALL, k)) as archive:
            arrays = dict(archive)
        header = json.loads(str(arrays.pop("header")))
        if of_file == ending:
            of = header if name == "about" else arrays
            of |= {name: change(of[name])} if change else {}
            of.pop(None if change else name, None)
        text = json.dumps({**header, "checksum": checksum(arrays)})
        np.savez(tmp_path / f"own{of_file}.npz", header=np.array(text), **arrays)
    with pytest.raises(ValueError, match=f"own{ending}.npz: .*{message}"):
        score("second-moment", [str(tmp_path / "own.npz")])


THREE = "light", "brdf", "uniform"
DIRECTIONS = SimpleNamespace(wants=dmis.Wants(directions=True))


class Asking(dmis.Rule):
    """A rule that asks for the rounds which a function of the budget returns."""

    def __init__(self, ask: Callable[[Budget], Round]) -> None:
        self.ask = ask

    def rounds(self, budget: Budget) -> Generator[Round, Film, None]:
        yield self.ask(budget)


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        ("fixed:light=0.5,brdf=0.3,uniform=0.2", "needs systematic shares of light and brdf and uniform; pilots have"),
        ("auto:spp=32", "must learn at 32 samples per pixel"),
        ("second-moment:compensation=0.9", "conflicting compensation"),
        (Asking(lambda b: b.pilot(0.5, 100)), "needs 100 camera samples of 2 shading samples at w = 0.5, after 0 oth"),
        (Asking(lambda b: replace(b.pilot(0.5, 2), needs_features="pixels")), "needs features of pixels; pilots have"),
        (Asking(lambda b: b.final(Fit((0.4, 0.4, 0.2)), 0, techniques=THREE)), "needs light and brdf and uniform"),
        (Asking(lambda b: b.pilot(0.5, 2, lambda *_: DIRECTIONS)), "needs directions of samples"),
        (Asking(lambda b: b.pilot(0.5, 2)), "must yield a final round"),
        (lambda tables: np.ones((2, 2)), r"one share or shares \(18, 24\), .* got shape \(2, 2\)"),
        (lambda tables: np.full(tables[0.5].shape, 2.0), r"weight must be in \[0, 1\]"),
        (SecondMoment, "Make an object of the class"),
    ],
)
def test_refusals(rule: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        score(rule, [SMALL])  # type: ignore[arg-type]


def test_numbers_of_samples_count() -> None:
    """A function may also return numbers of samples; the scale of these does not matter."""

    def rule(tables: Mapping[float, SampleTable]) -> tuple[float, Array]:
        deviation = tables[0.5].radiance().std(axis=0).mean(axis=2)
        return 0.5, patch_spread(patch_mean(deviation, PATCH) + 0.02, PATCH, (18, 24))

    value, scaled = (score(of, [SMALL]).values[SMALL][0] for of in (rule, lambda t: (0.5, 9 * rule(t)[1])))
    assert value[0] < 0.6
    np.testing.assert_allclose(value, scaled)


def test_reports() -> None:
    """Tables name rules and scenes; intervals come from seeds."""
    values = {SMALL: np.array([[0.8, 0.9, 0.1, 0.2, 0.3, 0.4], [1.0, 1.1, 0, 0, 0, 0]])}
    scores = {"thesis": Score("thesis", values)}
    text = report(scores)
    assert "thesis" in text and SMALL in text and "0.9 ± 1" in text
    assert json.loads(report_json(scores))["scores"]["thesis"][SMALL][0] == [0.8, 1.0]


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "rule_of_a_student.py"
    file.write_text(RULE)
    assert main(["bench-rules", str(file), "thesis", "--scenes", SMALL]) == 0
    out = capsys.readouterr().out
    assert "rule_of_a_student" in out and "thesis" in out and "relative" in out
    assert "all scenes" not in out and out.startswith(SMALL)
    for number, (code, message) in enumerate(
        {"tables[0.25]": "rule raised KeyError: 0.25 (wrong_rule_0.py, line 2)", "None": "a fun"}.items()
    ):
        wrong = tmp_path / f"wrong_rule_{number}.py"
        wrong.write_text(f"def rule(tables):\n    return {code}\n")
        assert main(["bench-rules", str(wrong), "--scenes", SMALL]) == 2
        assert f"error: {wrong}: {message}" in capsys.readouterr().err
    empty = tmp_path / "rule_without_rule.py"
    empty.write_text("x = 1\n")
    assert main(["bench-rules", str(empty), "--scenes", SMALL]) == 2
    assert "must define a function rule(tables)" in capsys.readouterr().err
    assert main(["bench-rules", "--scenes", "teapot"]) == 2 and "scene must be" in capsys.readouterr().err
