"""Layers of an image: sums against the image, what is seen against closed forms, names in files."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import shared_scene

import dmis
from dmis.cli.commands import main
from dmis.estimator.settings import make_settings
from dmis.geometry.shapes import quad
from dmis.pipeline.image_layers import with_layers
from dmis.pipeline.job import budget_of, resolve
from dmis.testing.scenes import ABOVE, FLOOR, box_scene

LIGHT = ["direct", "indirect", "emission", "light", "technique"]
SURFACE = ["albedo", "normal", "depth", "position", "uv", "part"]


def total(layers: dict[str, np.ndarray], *names: str) -> np.ndarray:
    """Sum of the layers whose names begin with some words."""
    return np.sum([values for name, values in layers.items() if name.partition(".")[0] in names], axis=0)


@pytest.mark.parametrize(
    ("name", "rule", "options"),
    [
        ("cornell", "balance", {"integrator": "path"}),
        ("cornell", "thesis", {"integrator": "path", "reuse_pilot": True}),
        ("veach-mis", "pbrt", {}),
        ("tt", "second-moment", {"sampler": "independent", "reuse_pilot": False}),
        ("cornell", "fixed:0.25", {"integrator": "direct"}),
    ],
)
def test_layers_sum_to_the_image(name: str, rule: str, options: dict[str, object]) -> None:
    """Direct and indirect light, lights, and techniques; the image has the same bits as without layers."""
    scene = shared_scene(name, (35, 33))
    plain = dmis.render(scene, rule, 12, parallel=1, **options)  # type: ignore[arg-type]
    result = dmis.render(scene, rule, 12, layers=LIGHT, parallel=1, **options)  # type: ignore[arg-type]
    np.testing.assert_array_equal(result.image, plain.image)
    assert plain.layers == {}
    for parts in (("direct", "indirect"), ("emission", "light"), ("emission", "technique")):
        np.testing.assert_allclose(total(result.layers, *parts), plain.image, atol=1e-6 * plain.image.max())
    assert (result.layers["indirect"] > 0).any() == (options.get("integrator") == "path")
    assert result.provenance["layers"] == ",".join(LIGHT)


def test_layers_in_units_of_the_scene() -> None:
    """Of a scene that float32 holds in other units, and of a window, which is an image of its own."""
    lamp = replace(ABOVE, radiance=(5e12, 4e12, 3e12))
    scene = box_scene(dmis.matte(0.5), (lamp,), resolution=(9, 7)).crop((2, 1, 9, 6))
    result = dmis.render(scene, "balance", 8, layers=["direct", "depth"], integrator="direct")
    np.testing.assert_allclose(result.layers["direct"], result.image, rtol=1e-5)
    assert result.layers["depth"].shape == (5, 7) and result.image.max() > 1e10
    large, k = quad((-4 * 2**22, -4 * 2**22, 0), (8 * 2**22, 0, 0), (0, 8 * 2**22, 0)), 2**22
    of_large, of_small = (
        dmis.render(box_scene(eye=(0, -3 * s, 2 * s), floor=floor), "balance", 1, layers=["depth", "position"]).layers
        for s, floor in ((k, large), (1, FLOOR))
    )
    for name in ("depth", "position"):
        np.testing.assert_allclose(of_large[name], k * of_small[name], rtol=1e-4, atol=k * 1e-5)


def test_what_is_seen() -> None:
    """A floor at z = 0, a lamp above its middle, and nothing beyond, in closed form."""
    kd = (0.6, 0.3, 0.1)
    scene = box_scene(dmis.matte(kd), (ABOVE,), (dmis.light_part(ABOVE),), (40, 30), (0, -7, 6), (0, 0, 0.5), 60)
    layers = dmis.render(scene, "balance", 1, layers=SURFACE).layers
    floor, lamp, nothing = (layers["part"] == number for number in (0, 1, -1))
    assert floor.any() and lamp.any() and nothing.any() and (floor | lamp | nothing).all()
    p = layers["position"]
    np.testing.assert_allclose(p[floor][:, 2], 0, atol=1e-5)
    np.testing.assert_allclose(p[lamp][:, 2], 2, atol=1e-5)
    np.testing.assert_allclose(layers["depth"][~nothing], np.linalg.norm(p - (0, -7, 6), axis=-1)[~nothing], rtol=1e-5)
    assert np.isinf(layers["depth"][nothing]).all() and not p[nothing].any()
    np.testing.assert_allclose(layers["uv"][floor], (p[floor][:, :2] + 4) / 8, atol=1e-5)
    inner = floor & (np.abs(p[..., :2]) < 3).all(axis=-1) & (layers["albedo"][..., 0] > 0.599)
    np.testing.assert_allclose(layers["albedo"][inner], np.broadcast_to(kd, (inner.sum(), 3)), rtol=1e-5)
    np.testing.assert_allclose(layers["normal"][inner], np.broadcast_to((0, 0, 1), (inner.sum(), 3)), atol=1e-6)
    np.testing.assert_allclose(layers["albedo"], layers["albedo"][:, ::-1], atol=1e-5)  # the scene is symmetric
    # edges are means over the square: shares of 16 rays
    share = layers["albedo"][..., 0] / kd[0]
    assert ((share > 0.01) & (share < 0.99)).any()
    np.testing.assert_allclose(16 * share, np.rint(16 * share), atol=1e-3)


def test_albedo_is_at_most_one() -> None:
    """Of white surfaces, whose lobes' nominal reflectances add up to more."""
    glossy = dmis.rough_glass(0.1), dmis.coated_diffuse(1.0), dmis.metallic_roughness(1.0, 0.0, 0.5)
    for material in (dmis.glass(), dmis.plastic(1.0, 1.0, 0.1), *glossy):
        albedo = dmis.render(box_scene(material, fov=20), "balance", 1, layers=["albedo"]).layers["albedo"]
        assert 0.9 < albedo.min() and albedo.max() <= 1, material.name
    # no axis is lost
    layers = dmis.render(box_scene(resolution=(1, 3)), "balance", 2, layers=[*SURFACE, "direct"]).layers
    assert layers["depth"].shape == (3, 1) and layers["uv"].shape == (3, 1, 2) and layers["direct"].shape == (3, 1, 3)
    # by paths; directly it shines at the first surface
    scene = box_scene(dmis.matte(0.5), (ABOVE, dmis.PointLight((0, 0, 1), (1, 1, 1))))
    with pytest.raises(ValueError, match="without delta lights"):
        dmis.render(scene, "balance", 2, layers=["direct"], integrator="path")
    result = dmis.render(scene, "balance", 2, layers=["direct"], integrator="direct")
    np.testing.assert_allclose(result.layers["direct"], result.image, rtol=1e-5)


def test_light_of_one_lamp() -> None:
    """The first of two lamps has the samples of a scene without the second; a sun is in another layer."""
    other = replace(ABOVE, corner=(0.5, -0.5, 2), radiance=(1, 2, 3))
    sun = dmis.DistantLight((0, 0, 1), (0.1, 0.1, 0.1))
    both = box_scene(dmis.plastic(0.3, 0.3, 0.1), (ABOVE, other, sun), resolution=(12, 12))
    layers = dmis.render(both, "balance", 16, layers=["light", "light:0", "emission"], parallel=1).layers
    alone = dmis.render(replace(both, lights=(ABOVE,)), "balance", 16, parallel=1).image
    np.testing.assert_allclose(layers["light.0"], alone, rtol=1e-5)
    of_sun = dmis.render(replace(both, lights=(sun,)), "balance", 16, parallel=1).image
    np.testing.assert_allclose(layers["emission"], of_sun, rtol=1e-4)
    of_other = dmis.render(replace(both, lights=(other,)), "balance", 16, parallel=1).image
    assert layers["light.1"].mean() == pytest.approx(of_other.mean(), rel=0.02)
    assert sorted(dmis.render(both, "balance", 1, layers=["light:1"]).layers) == ["light.1"]


def test_lamps_by_paths() -> None:
    """At later surfaces, too, a sample belongs to its lamp: means are those of each lamp alone."""
    other = replace(ABOVE, corner=(0.5, -0.5, 2), radiance=(3, 2, 1))
    wall = dmis.Part(quad((-2, 1, 0), (4, 0, 0), (0, 0, 3)), dmis.matte(0.9))
    scene = box_scene(dmis.matte(0.9), (ABOVE, other), (wall,), (8, 8))
    options = {"integrator": "path", "max_depth": 3}
    layers = dmis.render(scene, "balance", 256, layers=["light", "indirect"], **options).layers  # type: ignore[arg-type]
    assert layers["indirect"].mean() > 0.1 * layers["light.0"].mean()
    four = tuple(replace(ABOVE, corner=(x, -0.5, 2)) for x in (-2, -1, 0, 1))
    many = box_scene(dmis.matte(0.9), four, (wall, *map(dmis.light_part, four)))
    with pytest.raises(ValueError, match="set lights=all"):
        dmis.render(many, "balance", 4, layers=["light"], **options)  # type: ignore[arg-type]
    for number, lamp in enumerate((ABOVE, other)):
        alone = dmis.render(replace(scene, lights=(lamp,)), "balance", 256, seed=1, **options)  # type: ignore[arg-type]
        assert layers[f"light.{number}"].mean() == pytest.approx(alone.image.mean(), rel=0.03)


@dataclass(frozen=True)
class TwoRounds(dmis.Rule):
    """Half of the samples as usual, and half in a round of which other fields are made from the film."""

    fields: Callable[[dmis.Film], Mapping[str, Any]]

    def rounds(self, budget: dmis.Budget) -> Generator[dmis.Round, dmis.Film, None]:
        first = replace(budget.final(dmis.Fit(0.5)), spp=32, image_weight=32)
        film = yield first
        yield replace(first, **self.fields(film))


GOES_ON = TwoRounds(lambda film: {"begin": 32, "before": film.moments, "image_weight": 64})
UNIFORM = TwoRounds(lambda film: {"techniques": ("uniform", "brdf")})
THREE = TwoRounds(lambda film: {"techniques": ("light", "uniform", "brdf"), "shares": np.full(3, 1 / 3)})


@pytest.mark.parametrize(("layers", "options", "message"), [
    (["albdo"], {}, r"layers must be of albedo, .*light:0 \(QuadLight\); got 'albdo'.*albedo"),
    (["unweighted"], {}, "rendered by rule fixed:1 for light, fixed:0 for BRDF"),
    (["direct"], {"rule": "auto"}, "same number of samples in all pixels"),
    (["direct"], {"rule": "balance", "noise": 0.5}, "without noise or seconds"),
    (["direct"], {"rule": "fixed:0.5", "combiner": "optimal"}, "combiner that only weighs.*got combiner optimal"),
    (["direct"], {"rule": GOES_ON}, "go on from no earlier one"),
    (["technique"], {"rule": UNIFORM}, "techniques, light, brdf; got .* techniques uniform, brdf"),
    (["technique"], {"rule": THREE}, "got .* techniques light, uniform, brdf"),
])  # fmt: skip
def test_refuses(layers: list[str], options: dict[str, object], message: str) -> None:
    """Names that are none, and rules of other numbers of samples."""
    with pytest.raises(ValueError, match=message):
        dmis.render(box_scene(), spp=64, layers=layers, **options)  # type: ignore[arg-type]


def test_statistics_go_to_workers() -> None:
    """A round that gathers layers is pickled, as processes need it."""
    job = with_layers(resolve(box_scene(), "balance", 4, 0, make_settings()), LIGHT)
    round_ = pickle.loads(pickle.dumps(next(job.rule.rounds(budget_of(job)))))
    assert round_.statistic(16, 2).sums().keys() == {
        "direct", "indirect", "emission", "light.0", "technique.light", "technique.brdf"
    }  # fmt: skip


def test_names_in_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Those of Blender and tev, from the command line."""
    pytest.importorskip("OpenEXR")
    path = tmp_path / "cornell.exr"
    command = ["render", "cornell", "-o", str(path), "--resolution", "8x6", "--spp", "2", "--rule", "balance"]
    assert main([*command, "--layers", "albedo,normal,depth,position,uv,part,direct,light:0,technique"]) == 0
    layers, _ = dmis.read_exr(path)
    assert {"RGB", "albedo", "Z", "part", "direct", "light.0", "technique.light", "technique.brdf"} <= layers.keys()
    names = {"N.X", "N.Y", "N.Z", "P.X", "P.Y", "P.Z", "UV.U", "UV.V"}
    assert names <= layers.keys() and layers["Z"].shape == (6, 8)
    assert main([*command, "--layers", "albdo"]) == 2 and "layers must be of albedo" in capsys.readouterr().err


def test_a_crop_has_its_place_in_the_file(tmp_path: Path) -> None:
    """Viewers lay it over the whole image; it is read as before."""
    openexr, path = pytest.importorskip("OpenEXR"), tmp_path / "part.exr"
    part = box_scene(resolution=(20, 15)).crop((1, 2, 9, 12)).crop((2, 2, 7, 8))
    result = dmis.render(part, "balance", 2)
    dmis.write_image(path, result)
    with openexr.File(str(path)) as file:
        np.testing.assert_array_equal(file.header()["dataWindow"], ((3, 4), (7, 9)))
        np.testing.assert_array_equal(file.header()["displayWindow"], ((0, 0), (19, 14)))
    layers, attributes = dmis.read_exr(path)
    np.testing.assert_array_equal(layers["RGB"], result.image)
    provenance = json.loads(attributes["dmis.provenance"])
    assert provenance["crop"] == [3, 4, 8, 10] and provenance["frame"] == [20, 15]
