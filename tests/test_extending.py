"""Additions of docs/extending.md and examples/extending are made to the letter, from outside."""

from __future__ import annotations

import pickle
import re
import sys
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from inspect import unwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import Z_LIMIT, registries_kept, results_z, shipped, z_score

import dmis
from dmis.base import plugins
from dmis.estimator import mis
from dmis.estimator.mis import TECHNIQUES
from dmis.fit.round import Round
from dmis.pipeline.job import budget_of, resolve
from dmis.scene.groups import light_part
from dmis.testing.scenes import box_scene

pytestmark = pytest.mark.examples
ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "extending.md").read_text("utf-8")


def code_of(name: str) -> str:
    """Return a file of examples/extending, or the first Python block below a heading of the page.

    Each has at most 25 lines of code, beside imports and docstring.
    """
    if name.endswith(".py"):
        text = (ROOT / "examples" / "extending" / name).read_text("utf-8")
        assert f"](../examples/extending/{name})" in PAGE
        code = text.split('"""')[2]
    else:
        found = re.search(rf"^## {name}\n.*?```python\n(.*?)```", PAGE, re.M | re.S)
        assert found
        text = code = found[1]
    lines = [line for line in code.splitlines() if line.strip() and not line.startswith(("import", "from"))]
    assert len(lines) <= 25
    return text


def defined(name: str) -> dict[str, Any]:
    """Return the names that code of the page defines, which runs without the others."""
    names: dict[str, Any] = {"__name__": "page"}
    exec(compile(code_of(name), name, "exec", dont_inherit=True), names)
    return names


def test_technique() -> None:
    """At most ten lines of code; the same mean as the shipped techniques, in place of one and beside both."""
    code = code_of("A technique")
    lines = [line for line in code.splitlines() if line.strip() and not line.startswith(("import", "from"))]
    assert len(lines) <= 10
    exec(code, {})
    scene = shipped("teapot-area-light", (48, 36))
    balance = dmis.render(scene, "balance", 64, seed=1)
    dmis.load_plugin("simplex")
    rules = ("fixed:light=0.5,cosine=0.5", "fixed:light=0.2,brdf=0.3,cosine=0.5", "simplex:light+brdf+cosine")
    for k, rule in enumerate(rules):
        result = dmis.render(scene, rule, 64, seed=k + 2)
        assert result.rays["cosine"] > 0
        assert abs(results_z(result, balance)) < Z_LIMIT


def test_rule_by_normals() -> None:
    """Means of cornell by paths and of tt agree with balance; threads and processes give the same image."""
    defined("by_normal.py")
    for name, integrator in (("cornell", "path"), ("tt", "direct")):
        scene = shipped(name, (48, 36))
        balance = dmis.render(scene, "balance", 64, seed=1, integrator=integrator)
        result = dmis.render(scene, "by-normal", 64, seed=2, integrator=integrator)
        assert len(np.unique(result.weight)) > 1 and result.rays["guide"] == 3 * 48 * 36
        assert abs(results_z(result, balance)) < Z_LIMIT
    other = dmis.render(scene, "by-normal", 64, seed=2, integrator=integrator, parallel=dmis.Processes(2))
    np.testing.assert_array_equal(other.image, result.image)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rays": "shadow"}, "technique mine: rays must be a word under which .* such as 'mine'; .*; got 'shadow'"),
        ({"numbers": 5}, "numbers of technique mine must be a whole number from 2 to 4; got 5"),
    ],
)
def test_techniques_that_are_refused(changes: dict[str, object], message: str) -> None:
    light = TECHNIQUES["light"]
    given = {"name": "mine", "rays": "mine", "sample": light.sample, "pdf": light.pdf, **changes}
    with pytest.raises(ValueError, match=message):
        dmis.register_technique(dmis.Technique(**given))  # type: ignore[arg-type]
    assert "mine" not in TECHNIQUES


def test_learned_technique_rounds_and_heuristic(tmp_path: Path) -> None:
    """A technique that a pilot taught, two rounds, a heuristic: balance's mean, equal in threads and processes."""
    (tmp_path / "gentle.py").write_text(code_of("A heuristic"), "utf-8")
    for file in (
        tmp_path / "gentle.py",
        *(ROOT / "examples" / "extending" / f"{name}.py" for name in ("guided", "twice", "largest")),
    ):
        plugins.load_plugin(file)
    for name, integrator in (("cornell", "path"), ("tt", "direct")):
        scene = shipped(name, (40, 32))
        render = partial(dmis.render, scene, spp=64, integrator=integrator)
        balance = render("balance", seed=1)
        for seed, rule in enumerate(
            ("guided", "twice", "largest", "fixed:0.3,combiner=gentle", "second-moment:combiner=gentle"), 2
        ):
            result = render(rule, seed=seed)
            assert abs(results_z(result, balance)) < Z_LIMIT, rule
            processes = render(rule, seed=seed, parallel=dmis.Processes(2))
            np.testing.assert_array_equal(processes.image, result.image)
            assert (result.rays.get("table", 0) > 0) == (rule == "guided")


def test_statistic(box: dmis.Scene) -> None:
    """The largest value of a pixel is at least its mean for each lamp, and stands at this pixel."""
    names, films = defined("largest.py"), []

    class Keep(names["ByLargest"]):  # type: ignore[misc,name-defined]
        def rounds(self, budget: Any) -> Any:
            rounds = super().rounds(budget)
            films.append((yield next(rounds)))
            yield rounds.send(films[0])

    result = dmis.render(box, Keep(), 64, seed=1, parallel=1, integrator="direct")
    image = films[0].mean.mean(2)
    largest = names["pixels_together"](films[0].sums["largest"], image.shape)
    lit = largest > 0  # the others see the lamp itself, or nothing
    assert lit.mean() > 0.5 and np.all(largest[lit] * 1.001 >= image[lit] / len(box.lights))
    assert np.corrcoef(largest[lit], image[lit])[0, 1] > 0.5
    assert np.ptp(result.samples) > 0


@pytest.mark.parametrize(
    ("heuristic", "message"),
    [
        (lambda a, k: a[k] / sum(a), "must add up to 1 over the techniques; got .* It must return W / a.k., not W"),
        (lambda a, k: (a[k] >= np.max(a, axis=0)) / np.maximum(a[k], 1e-30), "where densities are equal, k must break"),
        (lambda a, k: np.float32(1), r"heuristic mine must be an array of float of shape \(1000,\); got float32"),
    ],
)
def test_heuristics_that_are_refused(heuristic: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        dmis.register_heuristic("mine", heuristic)
    with pytest.raises(ValueError, match=r"combiner must be one of balance, .*, power.*, cutoff.*; got 'mine'"):
        dmis.Settings(combiner="mine")


def test_a_heuristic_that_is_defined_anew_is_not_remembered() -> None:
    for beta in (1.0, 3.0):
        names: dict[str, Any] = {"__name__": "cell", "power": mis.power(beta)}
        exec("def mine(a, k):\n    return power(a, k)", names)
        dmis.register_heuristic("mine", names["mine"])
        weight = mis.combiner_by_name("mine").heuristic(np.float32([[1.5], [0.5]]), 0)
        np.testing.assert_allclose(weight * 1.5, 3**beta / (3**beta + 1), rtol=1e-6)


@pytest.mark.parametrize(
    ("techniques", "changes", "message"),
    [
        (("light", "glow"), {}, "technique must be one of light, brdf"),
        (("light", "brdf", "uniform"), {"combiner": "optimal"}, "combiner optimal needs two techniques; got 3"),
        (("light", replace(TECHNIQUES["brdf"], name="mine", rays="guide")), {}, "such as 'mine'; not one of"),
        (("light", replace(TECHNIQUES["brdf"], name="guide", rays="guide")), {}, "such as 'guide_rays'; not one of"),
    ],
)
def test_techniques_of_a_round_that_are_refused(techniques: Any, changes: dict[str, Any], message: str) -> None:
    shares = np.full(len(techniques), 1 / len(techniques))
    settings = dmis.Settings(integrator="direct", max_depth=1, sampler="sobol", **changes)
    with pytest.raises(ValueError, match=message):
        Round(4, shares, settings, techniques=techniques).checked((2, 2))


def test_techniques_of_a_round_without_brdf_compensate_no_sky(box: dmis.Scene) -> None:
    budget = budget_of(resolve(box, "balance", 4, 0, dmis.Settings(compensation=0.5)))
    rounds = [budget.final(dmis.Fit(0.5), techniques=("light", name)) for name in ("uniform", "brdf")]
    without, with_brdf = (round_.checked(box.camera.resolution[::-1]) for round_ in rounds)
    assert (without.settings.sky_compensation, with_brdf.settings.sky_compensation) == (0, 0.5)


def test_pickled_techniques(box: dmis.Scene) -> None:
    """A shipped technique is pickled as its name, another one with what its functions hold."""
    assert pickle.loads(pickle.dumps(TECHNIQUES["light"])) is TECHNIQUES["light"]
    own = dmis.Technique("own", "own", partial(np.add, np.arange(3)), np.multiply)
    sample = unwrap(pickle.loads(pickle.dumps(own)).sample)  # below the guard
    np.testing.assert_array_equal(sample.args[0], np.arange(3))
    # techniques that cannot be sent
    local = dmis.Technique("own", "own", lambda *_: None, lambda *_: None)  # type: ignore[arg-type,return-value]

    class Local(dmis.Rule):
        def rounds(self, budget: Any) -> Any:
            yield budget.final(dmis.Fit(0.5), techniques=("light", local))

    with pytest.raises(ValueError, match=r"must be picklable: .* at the top level of a module"):
        dmis.render(box, Local(), 4, parallel=dmis.Processes(1))


def test_sampler() -> None:
    """The same mean as independent samples and a smaller error, in a render and as an option of a rule."""
    defined("r2.py")
    scene = shipped("cornell", (48, 36))
    reference = dmis.make_reference(scene, 128)
    independent = dmis.render(scene, "balance", 64, seed=1, sampler="independent")
    even = dmis.render(scene, "balance", 64, seed=2, sampler="r2")
    assert abs(results_z(even, independent)) < Z_LIMIT
    assert abs(results_z(dmis.render(scene, "thesis:sampler=r2", 16, seed=3), independent)) < Z_LIMIT
    errors = [dmis.mse(result.image, reference.first, reference.second) for result in (even, independent)]
    assert errors[0] < 0.8 * errors[1]


@pytest.mark.usefixtures("drawn")
@pytest.mark.parametrize(
    ("heading", "rule", "options", "changed"),
    [
        ("r2.py", "balance", {"sampler": "r2"}, "sampler r2"),
        ("A technique", "fixed:light=0.5,cosine=0.5", {}, "technique cosine"),
    ],
)
def test_edited_code_is_refused(heading: str, rule: str, options: dict, changed: str, box, tmp_path: Path) -> None:
    """By checkpoints and comparisons, which are resumed otherwise. An oracle of an edited technique is another file."""
    file, mine, reference = tmp_path / "my_code.py", {"parallel": 1, **options}, dmis.make_reference(box, 4)
    for seeds, edit in ((1, ""), (2, ""), (3, "# edited\n")):
        file.write_text(code_of(heading) + edit, "utf-8")
        plugins._LOADED.clear()
        sys.modules.pop("my_code", None)
        with registries_kept():
            plugins.load_plugin(file)
            refused = partial(pytest.raises, ValueError) if edit else lambda match: nullcontext()
            with refused(match=rf"{changed} is \w+ in the checkpoint and \w+ in this render$"):
                dmis.render(box, rule, 4, checkpoint=tmp_path / "c", **mine)
            of_table = changed if options else f"rule {rule}"
            with refused(match=rf"other conditions: {of_table} was \w+, now is \w+;"):
                dmis.compare(box, [rule], [4], seeds, reference, tmp_path / "runs", **mine)
            if not options:
                dmis.make_oracle(box, 8, techniques=("light", "cosine"), folder=tmp_path / "oracles")
                assert len(list((tmp_path / "oracles").iterdir())) == (2 if edit else 1)


def test_metric() -> None:
    """It has a value for each render, within the noise of a few samples."""
    names = defined("bias.py")
    assert {budget: len(values) for budget, values in names["errors"].items()} == {("balance", 8): 3, ("thesis", 8): 3}
    assert all(abs(value) < 0.1 * names["reference"].first.mean() for v in names["errors"].values() for value in v)


# Lobes and lights


def agree(scene: dmis.Scene) -> None:
    """Light sampling, BRDF sampling and the balance heuristic have the same mean."""
    settings = dmis.Settings(integrator="direct")

    def means(rule: str, first: int) -> np.ndarray:
        images = (dmis.render(scene, rule, 16, seed=s, settings=settings).image for s in range(first, first + 16))
        return np.array([image.mean() for image in images])

    light, brdf, both = means("fixed:0", 0), means("fixed:1", 100), means("balance", 200)
    assert both.mean() > 0
    assert abs(z_score(light, both)) < Z_LIMIT and abs(z_score(brdf, both)) < Z_LIMIT


def test_lobe_and_textured_light() -> None:
    agree(box_scene(dmis.Material((defined("A lobe")["Dust"]((0.5, 0.4, 0.3)),))))
    # textured light
    lamp = defined("square_lamp.py")["Checks"](2.0)
    agree(box_scene(lights=(lamp,), extra=(light_part(lamp),)))


def test_camera_and_mirror_see_the_texture() -> None:
    """The mirror shows the emission of the lamp times its colour, 8 or 1."""
    lamp = defined("square_lamp.py")["Checks"](2.0)
    mirror = dmis.Material((defined("tinted.py")["Tinted"]((1.0, 0.5, 0.25)),))
    scene = box_scene(mirror, (lamp,), (light_part(lamp),), eye=(0, -1, 1), target=(0, -0.5, 0), fov=60.0)
    image = dmis.render(scene, "balance", 4, settings=dmis.Settings(integrator="direct")).image
    assert np.isclose(image.max(), 8) and image[..., 0].min() < 2
    np.testing.assert_allclose(image[..., 2], image[..., 0] / 4, rtol=1e-5)
