"""Why a pixel is noisy: its variance and sources against closed forms and renders, its samples against the formulas."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers import shared_scene

import dmis
from dmis.base.vectors import Array
from dmis.cli.commands import main
from dmis.experiment.explain import FURTHER, LARGEST, SEEN, Explanation
from dmis.geometry.shapes import quad
from dmis.testing.scenes import ABOVE, box_scene
from dmis.variance.curves import GRID, HALF


def lamp_edge(kd: float = 0.0, *lights: dmis.QuadLight) -> dmis.Scene:
    """Scene of one pixel, whose square a lamp covers to 3/10; the rest is a floor, black by default."""
    camera = dmis.Camera.look_at((0, 0, 2), (0, 0, 0), (0, 1, 0), np.degrees(2 * np.arctan(0.5)), (1, 1))
    lamp = dmis.QuadLight((-1, -1, 0), (0.6, 0, 0), (0, 2, 0), (5, 4, 3))
    floor = dmis.Part(quad((-4, -4, -1), (8, 0, 0), (0, 8, 0)), dmis.matte(kd))
    return dmis.Scene(camera, (dmis.light_part(lamp), floor), (lamp, *lights))


@pytest.fixture(scope="module")
def floor() -> dmis.Scene:
    """Matte floor under a lamp."""
    return box_scene(dmis.matte((0.6, 0.3, 0.6)), resolution=(16, 16))


@pytest.fixture(scope="module")
def explained(floor: dmis.Scene) -> Explanation:
    """Explanation of a pixel of the floor."""
    return dmis.explain(floor, (9, 6), rules=("fixed:0.3",), seed=3)


def test_lamp_edge_is_named() -> None:
    """Emission E on the share q of the square has the variance E^2 q (1 - q); no w changes it."""
    why = dmis.explain(lamp_edge(), (0, 0), rules=())
    assert abs(why.mean / 4 - 0.3) < 4 * np.sqrt(0.3 * 0.7 / 4096)
    np.testing.assert_allclose(why.variance, 16 * 0.3 * 0.7, rtol=0.05)
    assert why.sources == {SEEN: pytest.approx((1, 1))} and why.largest == ()
    assert why.causes[0].startswith("100.0% of the variance is emission that is seen: an edge in the pixel's square")
    assert not re.search("among|at a place", " ".join(why.causes))


def test_part_of_a_lamp_edge() -> None:
    """Beside a floor of radiance I it has Cov(E 1, E 1 + I (1 - 1)) = E (E - I) q (1 - q) of the variance."""
    why = dmis.explain(
        lamp_edge(0.8, replace(ABOVE, corner=(-0.5, -0.5, 0.5), radiance=(90, 90, 90))), (0, 0), rules=()
    )
    radiance = (why.mean - 0.3 * 4) / 0.7
    v, p = why.sources[SEEN]
    assert 0.05 < abs(v) < 0.9 and p == pytest.approx(v, rel=0.2)
    assert v == pytest.approx(4 * (4 - radiance) * 0.3 * 0.7 / why.variance[HALF], rel=0.15)


def test_units_of_the_scene(floor: dmis.Scene, explained: Explanation) -> None:
    """2^40 times the light, which float32 holds in other units, has 2^80 times the variance."""
    lamp = replace(ABOVE, radiance=tuple(2.0**40 * x for x in (5, 4, 3)))
    why = dmis.explain(replace(floor, lights=(lamp,)), (9, 6), rules=(), seed=3)
    np.testing.assert_allclose(why.variance, explained.variance * 2.0**80, rtol=1e-3)
    assert why.mean == pytest.approx(explained.mean * 2.0**40, rel=1e-4)
    for key in ("f", "value"):
        np.testing.assert_allclose(why.largest[0][key], np.multiply(explained.largest[0][key], 2.0**40), rtol=1e-4)


def test_variance_is_that_of_renders() -> None:
    """V(1/2) and P = V - A / S: with 16 times the shading samples a render has P + A / (16 S)."""
    scene, spp = box_scene(dmis.matte((0.6, 0.3, 0.6)), resolution=(1, 1)), 2**14
    why = dmis.explain(scene, (0, 0), spp, rules=())
    p = sum(share for _, share in why.sources.values())
    assert sum(v for v, _ in why.sources.values()) == pytest.approx(1) and 0.1 < p < 0.9
    for s, expected in ((2, 1.0), (32, p + (1 - p) / 16)):
        options = {"sampler": "independent", "shading_samples": s, "integrator": "direct"}
        result = dmis.render(scene, "balance", spp, seed=5, **options)  # type: ignore[arg-type]
        # channels rise and fall together
        assert spp * result.deviation.mean() ** 2 == pytest.approx(expected * why.variance[HALF], rel=0.06)
    assert why.mean == pytest.approx(result.image.mean(), rel=0.03)
    among, within = (next(c for c in why.causes if words in c) for words in ("among places", "at a place"))
    assert float(among.split("%")[0]) + float(within.split("%")[0]) == pytest.approx(100, abs=0.2)


def test_marks(explained: Explanation) -> None:
    """The share of a rule, and where V is least; the text has both."""
    assert explained.marks == {"balance": 0.5, "fixed": pytest.approx(0.3), "oracle": GRID[explained.variance.argmin()]}
    v = np.interp(0.3, GRID, explained.variance) / explained.variance[HALF]
    assert f"fixed    w = 0.30, V = {v:.2f}" in explained.text()
    wide = box_scene(dmis.plastic(0.2, 0.4, 0.01), resolution=(20, 6))
    marks = dmis.explain(wide, (18, 3), 64, rules=("thesis:weigh=samples,patch=2",)).marks
    assert marks["thesis"] == dmis.render(wide, "thesis:weigh=samples,patch=2", 64).weight[3, 18]


def test_largest_samples_by_hand(explained: Explanation) -> None:
    """f = kd / pi L cos, p_l = d^2 / (A cos), p_b = cos / pi, W and the value of the balance heuristic, per sample."""
    assert len({sample["source"] for sample in explained.largest}) == len(explained.largest) == 2 <= LARGEST
    for sample in explained.largest:
        ((x, y, z),) = sample["path"]
        cos = sample["wi"][2]
        on_lamp = np.array([x, y, z]) + np.array(sample["wi"]) * (2 - z) / cos
        assert np.abs(on_lamp[:2]).max() <= 0.5 + 1e-5 and sample["lobes"] == ["Lambert"]
        np.testing.assert_allclose(sample["f"], np.multiply((0.6, 0.3, 0.6), (5, 4, 3)) / np.pi * cos, rtol=1e-4)
        assert sample["p_l"] == pytest.approx((2 / cos) ** 2 / cos, rel=1e-3)
        assert sample["p_b"] == pytest.approx(cos / np.pi, rel=1e-4)
        light, technique, surface = sample["source"]
        own = sample["p_l"] if technique == "light" else sample["p_b"]
        assert (light, surface) == ("QuadLight 0", 1)
        assert sample["W"] == pytest.approx(own / (sample["p_l"] + sample["p_b"]))
        assert sample["value"] == pytest.approx(sample["W"] * np.mean(sample["f"]) / (own / 2), rel=1e-5)
    values = [sample["value"] for sample in explained.largest]
    assert values == sorted(values, reverse=True)


def test_seed_replays(floor: dmis.Scene, explained: Explanation) -> None:
    """The same seed has the same largest samples, another seed others; no render of a rule is needed."""
    same, other = (dmis.explain(floor, (9, 6), rules=(), seed=seed) for seed in (3, 4))
    assert same.largest == explained.largest and other.largest != explained.largest


def test_paths_by_surface() -> None:
    """Sources name later surfaces; the path of a sample has a point for each surface up to its own."""
    why = dmis.explain(shared_scene("cornell", (40, 30)), (8, 12), 1024, rules=(), integrator="path", max_depth=3)
    assert {surface for *_, surface in why.sources} == {1, 2, 3}
    assert sum(p for _, p in why.sources.values()) > 0.1 and "what paths meet further on" in why.text()
    for sample in why.largest:
        assert 1 <= len(sample["path"]) <= sample["source"][2]
    pytest.importorskip("matplotlib")
    why.figure(0.2)


def test_names_of_lights() -> None:
    """A tree selects among four lamps where a path has scattered; lights that are picked are told."""
    lamps = tuple(replace(ABOVE, corner=(x, -0.5, 2)) for x in (-2, -1, 0, 1))
    wall = dmis.Part(quad((-2, 1, 0), (4, 0, 0), (0, 0, 3)), dmis.matte(0.9))
    sun = dmis.DistantLight((0, -0.5, 1), (1, 1, 1))
    scene = box_scene(dmis.matte(0.5), (*lamps, sun), (wall, *map(dmis.light_part, lamps)))
    why = dmis.explain(scene, (8, 8), 512, rules=(), integrator="path", max_depth=2)
    lights = {(light, surface) for light, _, surface in why.sources.keys() - {SEEN, FURTHER}}
    assert lights == {*((f"QuadLight {number}", 1) for number in range(4)), ("SelectedLights 0", 2)}
    assert "picked at random" in dmis.explain(scene, (8, 8), 256, rules=(), lights="one").text()
    # seen in a mirror they have samples each, from the floor that is seen there on a tree selects
    mirrored = replace(scene, parts=(dmis.Part(scene.parts[0].mesh, dmis.mirror()), *scene.parts[1:]), lights=lamps)
    lights = {source[::2] for source in dmis.explain(mirrored, (8, 8), 512, rules=(), integrator="path").sources}
    assert {light for light, surface in lights if surface == 2} == {f"QuadLight {number}" for number in range(4)}


def test_caustic_is_no_edge() -> None:
    """A lamp that shines upwards alone, on a mirror: a floor below has light of scattered paths only."""
    lamp = replace(ABOVE, edge_u=ABOVE.edge_v, edge_v=ABOVE.edge_u)
    mirror = dmis.Part(quad((-3, -3, 3), (0, 6, 0), (6, 0, 0)), dmis.mirror())
    scene = box_scene(dmis.matte(0.5), (lamp,), (mirror, dmis.light_part(lamp)))
    why = dmis.explain(scene, (12, 8), 1024, rules=(), integrator="path", max_depth=4)
    assert why.sources == {FURTHER: pytest.approx((1, 1))} and "100.0% of the variance is light of paths" in why.text()


def test_hemisphere_integrates(explained: Explanation) -> None:
    """Equal areas are equal solid angles: p_l and p_b integrate to 1, f to the radiance of the pixel."""
    pytest.importorskip("matplotlib")
    from dmis.experiment.report.pixel_figure import hemisphere

    assert explained.vertex is not None
    surface, light, directions = explained.vertex
    maps: tuple[Array, ...] = hemisphere(surface, light, explained.job.scene)
    f, p_l, p_b = (2 * np.pi * float(np.nanmean(values)) for values in maps)
    assert (p_l, p_b, f) == (
        pytest.approx(1, rel=0.02), pytest.approx(1, rel=0.02), pytest.approx(explained.mean, rel=0.1)
    )  # fmt: skip
    assert all(wi.shape[0] == 3 and wi.shape[1] > 100 for wi in directions)


def test_pixels_without_noise(floor: dmis.Scene) -> None:
    """Of a scene whose light is far away and even: it says so."""
    sun = dmis.DistantLight((0, 0, -1), (1, 1, 1))
    why = dmis.explain(box_scene(dmis.matte(0.5), (sun,)), (3, 3), 64, rules=())
    assert why.causes == ["all camera samples of this pixel are equal: it has no noise"]
    assert why.largest == () and why.text().splitlines() == [
        f"pixel (3, 3): mean {why.mean:.4g}, standard deviation of a camera sample 0",
        f"  {why.causes[0]}",
    ]
    pytest.importorskip("matplotlib")
    why.figure()


@pytest.mark.parametrize(("pixel", "options", "message"), [
    ((16, 0), {}, r"pixel must be \(column, row\), from \(0, 0\) to \(15, 15\); got \(16, 0\)"),
    ((0, 0), {"shading_samples": 3}, "shading_samples must be even"),
    ((0, 0), {"techniques": ("light", "resampled")}, "needs the pdf of every technique"),
    ((0, 0), {"spp": 1}, "spp must be a whole number"),
])  # fmt: skip
def test_refuses(floor: dmis.Scene, pixel: tuple[int, int], options: dict[str, object], message: str) -> None:
    """Pixels outside, and settings that have no curves."""
    with pytest.raises(ValueError, match=message):
        dmis.explain(floor, pixel, **options)  # type: ignore[arg-type]


def test_command(tmp_path, capsys) -> None:
    """It prints the text and draws the figure."""
    pytest.importorskip("matplotlib")
    command = ["explain", "teapot-area-light", "20,15", "--resolution", "40x30", "--spp", "256"]
    assert main([*command, "-o", str(tmp_path / "why.png")]) == 0
    assert (
        re.match(r"pixel \(20, 15\): mean ", capsys.readouterr().out) and (tmp_path / "why.png").stat().st_size > 10_000
    )
    assert main([*command, "-o", str(tmp_path / "why.pdf")]) == 2 and "must end in .png" in capsys.readouterr().err
