"""The alarm: a reference of another scene is found, a right one is not suspected."""

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers import shared_scene

import dmis
from dmis.experiment import alarm
from dmis.experiment.runs import Run, measure
from dmis.experiment.table import Comparison
from dmis.report.compare import compare
from dmis.report.tables import summary
from dmis.testing.scenes import box_scene


@pytest.fixture(scope="module")
def stale(tmp_path_factory) -> tuple[dmis.Scene, dmis.Reference]:
    """A scene, and a reference in which its floor reflects a tenth more."""
    scene = box_scene(resolution=(24, 18))
    floor = replace(scene.parts[0], material=dmis.matte(0.66))
    other = replace(scene, parts=(floor, *scene.parts[1:]))
    return scene, dmis.make_reference(other, 64, folder=tmp_path_factory.mktemp("references"))


def run(z: float, rule: str = "balance", seed: int = 0) -> Run:
    return Run(rule, 32, seed, 1, 0.0, 0.0, 1.0, 1.0, 0.1, 1.0, 1.0, z)


def test_a_stale_reference_raises_the_alarm_once_for_a_rule(stale):
    """`measure` warns, and goes on: rule, samples, seed and the causes are in the message."""
    scene, reference = stale
    with pytest.warns(alarm.ReferenceWarning) as caught:
        runs = measure(scene, [("balance", 16), ("balance", 32), ("pbrt", 16)], 2, reference)
    assert len(caught) == 2 and {w.filename for w in caught} == {__file__}
    causes = "below that of its reference .rule balance, 16 samples per pixel, seed 0.*stale.*biased.*too few"
    assert re.search(causes, str(caught[0].message))
    assert all(r.mean_z < -alarm.ALARM_LIMIT for of in runs.values() for r in of)


@pytest.mark.usefixtures("without_plots")
def test_comparison_and_report_have_the_alarm(stale, tmp_path):
    """A line below the table, a paragraph and a mark on the page; and again when resumed."""
    scene, reference = stale
    for _ in range(2):
        with pytest.warns(alarm.ReferenceWarning):
            comparison = compare(scene, ["pbrt"], [16], [0], reference, tmp_path, parallel=1)
        lines = summary(comparison).splitlines()
        assert lines[-1].startswith("Alarm in 3 of 3 renders: the mean of the image is") and lines[-2] == ""
        page = (tmp_path / "report.html").read_text("utf-8")
        assert page.count('<p class="alarm">') == 1 and "pbrt ⚠" in page and "balance ⚠" in page


@pytest.mark.usefixtures("without_plots")
def test_a_pilot_that_makes_most_of_the_variance_is_named(tmp_path):
    """That of BRDF or light samples alone, on request; not one whose samples are as good as the final ones.

    Both when the images are rendered and when they are read.
    """
    scene = shared_scene("tt", (16, 12))
    good, bad = "second-moment:sampler=independent", "thesis:reuse=yes,sampler=independent"
    reference = dmis.make_reference(scene, 16, integrator="direct")
    for _ in range(2):
        comparison = compare(scene, [good, bad], [32], [0], reference, tmp_path, parallel=1, integrator="direct")
        lines = [line for line in summary(comparison).splitlines() if "the pilot is" in line]
        page = (tmp_path / "report.html").read_text("utf-8")
        assert len(lines) == 1 and page.count("⚠ thesis:reuse=yes,sampler=independent at 32 spp: the pilot is") == 1
    text = rf"{bad} at 32 spp: the pilot is 19% of the image's samples and makes \d\d% of its variance; leave it out "
    assert re.fullmatch(text + r"by reuse_pilot=False, or by an image_weight of 0 in its round\.", lines[0])


def test_z_by_hand():
    """Halves of 64 samples differ by .4: 16 samples have the noise .4^2 / 4 (1 + 2 * 64 / 16) = .36 > d^2, so that the
    mean of 36 pixels has the error .6 / 6, that of 9 pixels .6 / 3; and d / 6 without noise. The largest |z| counts.
    """
    first, d = np.full((6, 6, 3), 1.0), np.array([0.1, -0.3, 0.2])
    reference = dmis.Reference(first, first + 0.4, 64)
    assert alarm.mean_z(first + 0.2 + d, reference, 16) == pytest.approx(-3)
    corner = slice(0, 3), slice(0, 3)
    assert alarm.mean_z((first + 0.2 + d)[corner], reference.cropped(corner), 16) == pytest.approx(-1.5)
    assert alarm.mean_z(first + np.abs(d), dmis.Reference(first, first, 64), 16) == pytest.approx(6)
    # its own error of 0.01 is 5 % of 0.2; one image given as both halves has none that is known
    first, second = np.full((4, 4, 3), 1.0), np.full((4, 4, 3), 1.2)
    for errors, noisy in (([0.9, 0.21], False), ([0.9, 0.19], True), ([-1e-9], True), ([], False)):
        assert bool(alarm.reference_noise(dmis.Reference(first, second, 8), errors)) == noisy
    assert alarm.reference_noise(dmis.Reference(first, first, 0), [0.2]) == ""
    runs = {("balance", 32): [replace(run(0), mse=0.19)]}
    lines = Comparison({}, runs, {}, dmis.Reference(first, second, 8)).alarms()
    assert lines[0].startswith("The reference is too noisy for this table") and lines[1:] == [""]
    # How many of how many; empty without an alarm, and where z is not known
    line = alarm.summary([run(1), run(-7, "pbrt", 3), run(6.5), run(np.nan)])
    assert line.startswith("Alarm in 2 of 4 renders: the mean of the image is 7.0 standard errors below")
    assert "rule pbrt" in line and "seed 3" in line and "\n" not in line
    assert alarm.summary([run(5.9), run(-5.9), run(np.nan)]) == ""


def test_z_is_normal():
    """400 images with noise of a known deviation per pixel, which differs over the image and between channels, against
    a reference of twice 4 times the samples: z of a channel has deviation 1, and the largest of three independent ones
    has E[z^2] = 1.9: the integral of 2 x (1 - (1 - 2 Q(x))^3) over x.
    """
    rng = np.random.default_rng(3)
    sigma = rng.gamma(0.5, 1, (40, 50, 3))
    z = []
    for _ in range(400):
        first, second = (1 + sigma / 8 * rng.standard_normal(sigma.shape) for _ in range(2))
        z.append(alarm.mean_z(1 + sigma / 4 * rng.standard_normal(sigma.shape), dmis.Reference(first, second, 64), 16))
    x = np.linspace(0, 8, 4001)
    from scipy.stats import norm

    expected = np.sum(2 * x * (1 - (1 - 2 * norm.sf(x)) ** 3)) * (x[1] - x[0])
    square = np.square(z)
    assert abs(square.mean() - expected) < 4 * square.std() / np.sqrt(len(z))


def test_rare_bright_samples_that_an_image_misses():
    """A light of value 1000 that one sample in 20000 finds: 2 x 10^6 samples of the reference find 100, 19200 of the
    image none in two fifths of all images, and what is left of these is smooth. The halves say how noisy it is.
    """
    rng, shape, spp, p = np.random.default_rng(4), (20, 30), 32, 1 / 20_000
    alarms = naive = 0
    for _ in range(100):
        halves = [rng.binomial(1667, p, shape)[..., None] * np.full(3, 1000.0) / 1667 for _ in range(2)]
        image = rng.binomial(spp, p, shape)[..., None] * np.full(3, 1000.0) / spp
        z = alarm.mean_z(image, dmis.Reference(*halves, 1667), spp)
        d = image - sum(halves) / 2
        naive += abs(d.mean()) > alarm.ALARM_LIMIT * np.sqrt((d[..., 0] ** 2).mean() / d[..., 0].size)
        alarms += abs(z) > alarm.ALARM_LIMIT
    assert alarms == 0 < naive


@pytest.mark.parametrize("name", ["teapot-area-light", "tt"])
def test_no_alarm_in_correct_comparisons(name, tmp_path):
    """Fixed weights, and a rule that learns; `measure` would warn, which is an error here."""
    scene = shared_scene(name, (24, 18))
    reference = dmis.make_reference(scene, 128, folder=tmp_path)
    z = []
    for sampler in "independent", "sobol":
        runs = measure(scene, [("balance", 32), ("auto", 32)], 2, reference, sampler=sampler)
        z += [run.mean_z for by_seed in runs.values() for run in by_seed]
    assert len(z) == 8 and np.abs(z).max() < 4.5
