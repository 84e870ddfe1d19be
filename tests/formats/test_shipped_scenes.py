"""The scenes that come with the library: the thesis's four, one of them without sun, a box of paths, two held out."""

import io
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from helpers import channels_z, results_z, shared_scene, shipped

import dmis

ROOT = Path(__file__).parents[2]
RESOLUTIONS = {
    "teapot-area-light": (800, 800),
    "killeroo-diffuse": (1368, 1026),
    "killeroo-gold": (1368, 1026),
    "tt": (1500, 833),
    "tt-overcast": (1500, 833),
    "cornell": (200, 200),
    "veach-mis": (480, 360),
    "ten-lights": (400, 300),
}
LONG = "ten-lights", "killeroo-diffuse", "tt-overcast"
"""Scenes whose renders take long, or have the geometry of another one."""
RENDERED = [pytest.param(name, marks=pytest.mark.slow) if name in LONG else name for name in RESOLUTIONS]


def small(name: str) -> dmis.Scene:
    """Return a scene at 40 pixels across."""
    width, height = RESOLUTIONS[name]
    return shared_scene(name, (40, round(40 * height / width)))


@pytest.mark.parametrize("name", RESOLUTIONS)
def test_film_has_its_resolution(name):
    """Images compare with the thesis's only at its resolutions."""
    assert shipped(name).camera.resolution == RESOLUTIONS[name]


@pytest.mark.parametrize("name", RENDERED)
def test_every_mixture_agrees(name):
    """|z| < 4 between techniques in the mean over the image, at 40 pixels across."""
    balance, light = (dmis.render(small(name), rule, 128, seed=k) for k, rule in enumerate(("balance", "fixed:1")))
    assert np.abs(channels_z(light, balance)).max() < 4
    assert balance.image.mean(axis=(0, 1)).min() > 0.05


@pytest.mark.parametrize("name", RENDERED)
def test_rules_agree_on_paths(name):
    """|z| < 4 between rules in the mean over the image, six surfaces deep, at 40 pixels across."""
    scene = small(name)
    settings = dmis.Settings(integrator="path", max_depth=6)
    rules = ("balance", "thesis", "second-moment", "auto")
    balance, *others = (dmis.render(scene, rule, 32, seed=k, settings=settings) for k, rule in enumerate(rules))
    for result in others:
        assert abs(results_z(result, balance)) < 4
    direct = dmis.render(scene, "balance", 32, settings=replace(settings, max_depth=1))
    assert balance.image.mean() > direct.image.mean()


def test_veach_mis_has_a_region_for_each_technique():
    """The small lamp in the rough plate favours light samples, the large lamp in the smooth plate BRDF samples.

    Over three seeds the ratios of the variances are 1.0 to 1.5 million and 3,000 to 4,000; `balance` is far from the
    worse technique in both.
    """
    scene = shared_scene("veach-mis", (120, 90))
    brdf, light, balance = (
        dmis.render(scene, rule, 32, seed=1, integrator="direct").variance.mean(axis=2, dtype=float)
        for rule in ("fixed:0", "fixed:1", "balance")
    )
    small_in_rough, large_in_smooth = np.s_[72:82, 4:28], np.s_[31:39, 94:114]
    assert brdf[small_in_rough].mean() > 1e4 * light[small_in_rough].mean()
    assert light[large_in_smooth].mean() > 1e3 * brdf[large_in_smooth].mean()
    assert balance[small_in_rough].mean() < 0.01 * brdf[small_in_rough].mean()
    assert balance[large_in_smooth].mean() < 0.1 * light[large_in_smooth].mean()


def test_ten_lights_has_ten_lights():
    """Eight lights of four kinds have two techniques, a spot and a point have one; the plan leaves none of them out."""
    plan = shipped("ten-lights").plan
    kinds = Counter(type(light).__name__ for light in plan.sampled)
    assert kinds == {"QuadLight": 2, "DiskLight": 1, "SphereLight": 3, "MeshLight": 2}
    assert sorted(type(light).__name__ for light in plan.deltas) == ["PointLight", "SpotLight"]


@pytest.mark.parametrize("name", dmis.HELD_OUT)
def test_held_out_scenes_say_so(name):
    """The header of the file says that no constant is chosen on it."""
    text = (ROOT / "scenes" / f"{name}.pbrt").read_text("utf-8")
    assert "# Held out: no constant, default or threshold of dmis is chosen on this scene." in text


def test_skies():
    """The overcast sky is the other without its sun: a disk of 2.5 degrees, 38 to 40 % of the power."""
    folder = ROOT / "scenes" / "textures"
    (sunny, _), (overcast, _) = (dmis.read_exr(folder / f"{name}.exr") for name in ("sky", "sky-overcast"))
    sine = np.sin((np.arange(512) + 0.5) / 512 * np.pi)[:, None]
    sunny, overcast = (sky["RGB"].astype(float) @ [0.2126, 0.7152, 0.0722] for sky in (sunny, overcast))
    mean, power = (overcast * sine).sum() / sine.sum() / 1024, (sunny * sine).sum() / sine.sum() / 1024
    assert overcast.max() < 6 * mean and sunny.max() > 500 * power  # 5.4 and 826
    assert 0.38 < 1 - mean / power < 0.40
    sun = sunny != overcast
    assert (sun * sine).sum() / sine.sum() / 1024 == pytest.approx((1 - np.cos(np.radians(3.1))) / 2, rel=0.1)


@pytest.mark.parametrize("path", [*(ROOT / "scenes").rglob("*.*")], ids=lambda p: p.name)
def test_files_are_small(path):
    """Under 3 MB each, so that a checkout stays light."""
    assert path.stat().st_size < 3_000_000


def same_file(path: Path, content: bytes) -> bool:
    """Whether a file has this content; the last digit of a mesh's positions may differ between processors."""
    now = path.read_bytes()
    if path.suffix != ".ply" or now == content:
        return now == content
    one, other = (trimesh.load(io.BytesIO(data), file_type="ply", process=False) for data in (now, content))
    return np.array_equal(one.faces, other.faces) and np.allclose(one.vertices, other.vertices, rtol=1e-6, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("script", sorted((ROOT / "scenes").glob("make_*.py")), ids=lambda p: p.stem)
def test_scripts_make_the_files_that_are_here(script, tmp_path):
    """Each script run in a copy of its folder writes again what is checked in, but for the last digits of positions."""
    import shutil

    folder = tmp_path / "scenes"
    shutil.copytree(ROOT / "scenes", folder)
    before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    to = [tmp_path / "room"] if script.stem == "make_room" else []  # whose files are not checked in
    subprocess.run([sys.executable, folder / script.name, *to], check=True, cwd=tmp_path, timeout=900)
    changed = [p.name for p, content in before.items() if not same_file(p, content)]
    new = [p.name for p in folder.rglob("*") if p.is_file() and p not in before and "__pycache__" not in p.parts]
    assert not changed and not new
