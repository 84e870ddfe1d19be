"""Renders that stop at a noise or a time: the points of one long render, the achieved error, the bias of stopping."""

import warnings
from collections.abc import Generator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dmis
from dmis.brdf.materials import plastic
from dmis.fit.round import Budget, Round
from dmis.fit.rule import next_round
from dmis.pipeline import stopping
from dmis.pipeline.job import resolve
from dmis.testing.scenes import ABOVE, box_scene
from dmis.variance.moments import Film


def glossy(resolution: tuple[int, int] = (16, 12)) -> dmis.Scene:
    """Return a glossy floor that reflects a light."""
    return box_scene(plastic(0.3, 0.3, 0.02), resolution=resolution)


@pytest.mark.parametrize("rule", ["balance", "fixed:0.3", "counts", "second-moment:reuse=yes"])
@pytest.mark.parametrize("sampler", ["sobol", "independent", "stratified", "lowdiscrepancy"])
def test_doubled_numbers(rule: str, sampler: str) -> None:
    """Samples of each pixel are those of the rule's rounds, the last ones doubled; rays are those of all rounds."""
    scene, options = glossy(), {"sampler": sampler, "seed": 3, "parallel": 1}
    first, result = (dmis.render(scene, rule, spp, noise=0, **options) for spp in (32, 128))
    pilot = 6 if rule.startswith("second") else 0
    np.testing.assert_array_equal(result.samples - pilot, 4 * (first.samples - pilot))
    assert result.provenance["spp"] == pilot + 4 * (32 - pilot)
    assert result.provenance["rounds"] == first.provenance["rounds"] + 2
    np.testing.assert_allclose(result.light_samples + result.brdf_samples, result.samples * result.shading_samples)
    assert result.rays["camera"] > 3 * first.rays["camera"] and (result.variance < first.variance).mean() > 0.7


def test_rounds_have_the_points_of_one_render() -> None:
    """Balance with Sobol points, doubled from 32 to 256 samples, is the render of 256 samples."""
    long = dmis.render(glossy(), "balance", 256, seed=5, sampler="sobol")
    result = dmis.render(glossy(), "balance", 256, seed=5, sampler="sobol", noise=0)
    np.testing.assert_allclose(result.image, long.image, rtol=2e-6)
    assert result.provenance["rounds"] == 4 and result.provenance["spp"] == 256 and result.rays == long.rays


@pytest.mark.parametrize(
    ("rule", "spp", "gain"),
    [("balance", 32, 1.0), ("balance", 128, 1.0), ("auto", 32, 1.0), ("auto", 64, 1.0), ("auto", 64, 1e-12)],
)
def test_stated_errors_are_those_over_seeds(rule: str, spp: int, gain: float) -> None:
    """Deviation and noise of 40 renders, independent points: one round, doubled, two rounds joined, both, rescaled."""
    lamp = replace(ABOVE, radiance=np.array(ABOVE.radiance) * gain)
    scene = replace(glossy(), lights=(lamp,))
    options = {"noise": 0, "sampler": "independent", "parallel": 1}
    results = [dmis.render(scene, rule, spp, seed=k, **options) for k in range(40)]
    images = np.array([result.image for result in results], float)
    variance, stated = images.var(axis=0, ddof=1), np.mean([result.variance for result in results], axis=0)
    assert stated.mean() / variance.mean() == pytest.approx(1, rel=0.15)
    relative = (variance / (images.mean(axis=0) ** 2 + 0.01)).mean()
    noise = np.mean([result.provenance["noise"] ** 2 for result in results])
    assert noise / relative == pytest.approx(1, rel=0.15)


class Joined(dmis.Rule):
    """A rule whose last round is 24 samples that go on from 8."""

    def rounds(self, budget: Budget) -> Generator[Round, Film, None]:
        yield replace(budget.final(dmis.Fit(0.5)), spp=24, begin=8)


def test_noise_by_hand() -> None:
    """Sobol points have a = 1.3. In units of a scene with a tenth of the radiance 3 is .3, and the bound .01 is .01."""
    job = replace(resolve(glossy((2, 1)), Joined(), 32, 0, dmis.Settings(sampler="sobol")), gain=0.1)
    # a mean of 3 with the variance 1 by its sub-blocks; a mean of 4 of twice as many samples
    ones = np.ones((1, 2, 3))
    films = [Film(n, mean * ones, np.sqrt(n * (n - 1)) * ones) for n, mean in ((32, 3), (64, 4))]
    first = 0.01 / 0.1 * 3 / (4**1.3 - 1) / (0.25**0.7 + 0.75**0.7)
    for most, noise in ((32, first), (64, 0.01 / 0.17 / (2**1.3 - 1))):
        stop = stopping.Stop(noise=0)
        rounds = stop.rounds(replace(job, most=most))
        for film in (None, *films):
            if next_round(rounds, film) is None:
                break
        assert stop.job.notes["noise"] == pytest.approx(np.sqrt(noise))


@pytest.mark.parametrize(("pilot", "most", "spp"), [(30, 128, 32), (32, 128, 64), (32, 48, 48), (32, 20, 20)])
def test_first_rounds_have_more_samples_than_the_pilot(pilot: int, most: int, spp: int) -> None:
    """32 samples per pixel, doubled while the pilot takes all of them, and never more than the most."""
    rule = "auto" if most < 32 else f"second-moment:spp={pilot}"
    assert resolve(glossy((4, 4)), rule, most, 0, dmis.Settings(), doubling=True).spp == spp


def test_stops_at_the_noise_and_goes_on_from_there(tmp_path: Path) -> None:
    """A larger noise stops earlier; its checkpoint goes on to a smaller one, bit by bit as in one render."""
    scene, options = glossy(), {"seed": 1, "sampler": "sobol"}
    coarse = dmis.render(scene, "auto", noise=0.006, checkpoint=tmp_path / "tiles", **options)
    fine = dmis.render(scene, "auto", noise=0.001, parallel=1, checkpoint=tmp_path / "tiles", **options)
    alone = dmis.render(scene, "auto", noise=0.001, parallel=dmis.Processes(2), **options)
    for name in ("image", "deviation", "samples", "weight"):
        np.testing.assert_array_equal(getattr(fine, name), getattr(alone, name))
    assert coarse.provenance["noise"] <= 0.006 and fine.provenance["noise"] <= 0.001
    assert coarse.provenance["spp"] < fine.provenance["spp"] and fine.provenance == alone.provenance
    again = dmis.render(scene, "auto", fine.provenance["spp"], noise=0, **options)  # what the provenance says
    np.testing.assert_array_equal(again.image, fine.image)


def test_resumes_inside_of_a_doubled_round(tmp_path: Path) -> None:
    """Interrupted after each of the last tiles: the same command ends with the same bits."""
    scene, options = glossy((96, 40)), {"noise": 0, "seed": 4, "parallel": 1}
    stages: list[tuple[int, int]] = []
    alone = dmis.render(scene, "auto", 128, progress=lambda _, *tile: stages.append(tile), **options)
    assert stages[-2][0] < stages[-2][1]  # the last round has several tiles

    def interrupt(_: str, *tile: int) -> None:
        if tile in stages[-3:-1]:
            stages.remove(tile)
            raise KeyboardInterrupt

    options |= {"progress": interrupt, "checkpoint": tmp_path / "tiles"}
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            dmis.render(scene, "auto", 128, **options)
    result = dmis.render(scene, "auto", 128, **options)
    np.testing.assert_array_equal(result.image, alone.image)
    np.testing.assert_array_equal(result.deviation, alone.deviation)


def test_the_clock_is_read_between_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each round takes as long as all before it, by a clock that rays advance: the last doubling ends in time."""
    clock = 0.0
    render = dmis.pipeline.passes.Passes.render

    def timed(passes, round_):
        nonlocal clock
        film = render(passes, round_)
        clock += float(np.mean(round_.spp)) / 32
        return film

    monkeypatch.setattr("dmis.pipeline.passes.Passes.render", timed)
    monkeypatch.setattr(stopping.time, "perf_counter", lambda: clock)
    for seconds, spp in ((0.5, 32), (1.9, 32), (2.0, 64), (15.9, 256), (16.0, 512)):
        clock = 0.0
        with warnings.catch_warnings(record=True, action="always") as caught:
            result = dmis.render(glossy((4, 3)), "balance", seconds=seconds, parallel=1)
        text = "the first rounds alone took 1 s, more than seconds=0.5; write a smaller spp or resolution"
        assert [(str(one.message), one.filename) for one in caught] == [(text, __file__)] * (seconds < 1)
        assert result.provenance["spp"] == spp and clock == spp / 32


def test_limits(tmp_path: Path) -> None:
    """`spp` is the most; a rule's own rounds are as long as it needs; what is no number is refused."""
    scene = glossy((4, 3))
    assert [dmis.render(scene, "balance", spp, noise=0).provenance["spp"] for spp in (1, 20, 33, 64)] == [1, 20, 32, 64]
    assert dmis.render(scene, "balance", 1, noise=0).provenance["noise"] is None
    assert dmis.render(scene, "thesis:spp=16", noise=1).provenance["spp"] == 64
    assert "noise" not in dmis.render(scene, "balance", 4).provenance
    assert dmis.render(scene, "balance").provenance["spp"] == 128
    for options in ({"noise": -0.1}, {"noise": "x"}, {"seconds": -1}, {"seconds": True}, {"noise": 0.1, "spp": 0}):
        with pytest.raises(ValueError, match=f"^{list(options)[-1]} must be a "):
            dmis.render(scene, "balance", **options)


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The summary has the samples, the rounds and the noise that was estimated."""
    arguments = ["render", "teapot-area-light", "--resolution", "16x12", "-o", str(tmp_path / "a.exr"), "--seed", "2"]
    assert dmis.cli.commands.main([*arguments, "--noise", "0.05", "--spp", "4096", "--seconds", "600"]) == 0
    result = dmis.render(dmis.load_scene("teapot-area-light", resolution=(16, 12)), noise=0.05, seed=2)
    told = result.provenance
    assert f"auto, {told['spp']} spp, rounds: {told['rounds']}, noise {told['noise']:.2g}" in capsys.readouterr().out
    np.testing.assert_array_equal(dmis.read_exr(tmp_path / "a.exr")[0]["RGB"], result.image)
    assert dmis.cli.commands.main([*arguments, "--noise", "0.001", "--spp", "32"]) == 0
    assert "(0.001 was not reached)" in capsys.readouterr().out


def stopped(resolution: tuple[int, int], noise: float, seeds: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return relative bias and standard error of the mean of images that stop, and the roots of their relMSE."""
    scene = glossy(resolution)
    exact = np.mean([dmis.render(scene, "balance", 2**14, seed=s, parallel=1).image for s in range(90, 98)], axis=0)
    results = [dmis.render(scene, "balance", 2**13, noise=noise, seed=s, parallel=1) for s in range(1000, 1000 + seeds)]
    assert len({result.provenance["spp"] for result in results}) >= 3  # they do not all stop at once
    means = np.array([result.image.mean() for result in results]) / exact.mean()
    errors = np.sqrt([dmis.relmse(result, exact) for result in results])
    return means.mean() - 1, means.std(ddof=1) / np.sqrt(seeds), errors


def test_bias_of_stopping() -> None:
    """Twelve pixels that stop at their own noise have a bias of less than a tenth of it; one pixel, of most of it."""
    bias, error, errors = stopped((4, 3), 0.008, 400)
    assert abs(bias) < 0.0008 and 4 * error < 0.0015
    assert 0.5 < np.sqrt((errors**2).mean()) / 0.008 < 1.2
    bias, error, _ = stopped((1, 1), 0.01, 400)
    assert -0.012 < bias < -0.004 and bias < -4 * error


@pytest.mark.slow
@pytest.mark.parametrize("name", ["teapot-area-light", "killeroo-diffuse", "killeroo-gold", "tt", "cornell"])
def test_achieved_noise(name: str, tmp_path: Path) -> None:
    """The error is 0.5 to 1.2 times the noise that was asked for: half of that range is the doubling."""
    width, height = dmis.load_scene(name).camera.resolution
    scene = dmis.load_scene(name, resolution=(76, round(76 * height / width)))
    reference = dmis.make_reference(scene, 2048, folder=tmp_path)
    for seed in range(2):
        result = dmis.render(scene, noise=0.02, seed=seed)
        assert 0.5 < np.sqrt(dmis.relmse(result, reference)) / 0.02 < 1.2
