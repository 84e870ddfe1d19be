"""References: two independent halves, rendered once."""

from dataclasses import replace

import numpy as np
import pytest

import dmis
from dmis.experiment import reference
from dmis.experiment.oracle_renders import make_oracle
from dmis.pipeline.checkpoint import KEY, Store


def interrupt(*_: object) -> None:
    """Progress that stops a render after its first tile."""
    raise KeyboardInterrupt


def test_reference_is_made_once_and_kept(box, tmp_path, monkeypatch):
    """The second call reads the file of the first, in the folder DMIS_CACHE; the halves differ."""
    monkeypatch.setenv("DMIS_CACHE", str(tmp_path))
    made = dmis.make_reference(box, np.int64(64))
    assert not np.array_equal(made.first, made.second)
    monkeypatch.setattr(reference, "render", None)
    kept = dmis.make_reference(box, 64, folder=tmp_path)
    np.testing.assert_array_equal(made.first, kept.first)
    np.testing.assert_array_equal(made.second, kept.second)
    assert len(list(tmp_path.glob("box-32x24-64spp-*.exr"))) == 1


def test_halves_are_renders_of_the_balance_heuristic(box, tmp_path):
    """With Sobol points, the seeds of references, and the integrator and depth that are asked for."""
    options = {"integrator": "path", "max_depth": 2}
    made = dmis.make_reference(box, 8, folder=tmp_path, preset="thesis", **options)
    for seed, half in enumerate((made.first, made.second), reference.REFERENCE_SEED):
        np.testing.assert_array_equal(half, dmis.render(box, "balance", 8, seed=seed, sampler="sobol", **options).image)


def test_settings_of_the_estimator_do_not_count(box, tmp_path):
    """Settings that do not change the expected image give the file of the default ones, even where auto lacks them."""
    made = dmis.make_reference(box, 16, folder=tmp_path)
    for options in (
        {"preset": "thesis"}, {"shading_samples": 1}, {"combiner": "optimal"}, {"techniques": ("uniform", "brdf")},
        {"sampler": "independent"}, {"sampler": "sobol"},
    ):  # fmt: skip
        np.testing.assert_array_equal(dmis.make_reference(box, 16, folder=tmp_path, **options).first, made.first)
    assert len(list(tmp_path.iterdir())) == 1
    for files, options in ((2, {"max_depth": 1}), (3, {"max_depth": 2})):
        dmis.make_reference(box, 16, folder=tmp_path, **options)
        assert len(list(tmp_path.iterdir())) == files


@pytest.mark.parametrize(("kind", "make"), [("reference", dmis.make_reference), ("oracle", make_oracle)])
def test_a_damaged_file_of_the_cache_is_named(box, tmp_path, kind, make):
    """The error says which file, and what to do."""
    make(box, 8, folder=tmp_path)
    (path,) = tmp_path.iterdir()
    for data in (b"junk", path.read_bytes()[:-100]):
        path.write_bytes(data)
        with pytest.raises(ValueError, match=rf"{kind} {path} is damaged .*; remove it, and it is rendered again"):
            make(box, 8, folder=tmp_path)


@pytest.mark.parametrize("stale", ["other package", "damaged", "resumed"])
def test_an_interrupted_reference(box, tmp_path, monkeypatch, stale):
    """A half is resumed, and made anew from a checkpoint of another package or a damaged one; the bits are the same."""
    large = replace(box, camera=replace(box.camera, resolution=(96, 64)))
    whole = dmis.make_reference(large, 32, folder=tmp_path / "whole")
    with monkeypatch.context() as patch:
        if stale == "other package":
            patch.setattr("dmis.pipeline.fingerprint.package_hash", lambda: "another")
        with pytest.raises(KeyboardInterrupt):
            dmis.make_reference(large, 32, folder=tmp_path, parallel=1, progress=interrupt)
    checkpoint = next(tmp_path.glob("*.0.tiles"))
    if stale == "damaged":
        (checkpoint / KEY).write_bytes((checkpoint / KEY).read_bytes()[:-7])
    tiles = []
    monkeypatch.setattr(
        Store, "append", lambda self, tile, film, append=Store.append: tiles.append(append(self, tile, film))
    )
    again = dmis.make_reference(large, 32, folder=tmp_path)
    of_one = len(tiles)
    np.testing.assert_array_equal(again.first, whole.first)
    np.testing.assert_array_equal(again.second, whole.second)
    assert not list(tmp_path.glob("*.tiles"))
    tiles.clear()
    dmis.make_reference(large, 32, folder=tmp_path / "third")
    assert (of_one < len(tiles)) == (stale == "resumed")


def test_standard_error_is_said():
    """Half of the root mean squared difference of the halves; not known for one image given as both."""
    first, second = np.full((4, 5, 3), 1.0), np.full((4, 5, 3), 1.04)
    made = dmis.Reference(first, second, 64)
    assert made.mse == pytest.approx(0.0004)
    assert made.text() == (
        "Reference of 2 x 64 samples per pixel: standard error 0.02, mean squared error 0.0004 (by its two halves)."
    )
    assert "not known" in dmis.Reference(first, first, 0).text()


@pytest.mark.parametrize(
    ("name", "make"),
    [("room.v2", make_oracle), *((name, dmis.make_reference) for name in ("..", "../up/Küche 3.5", "x" * 300))],
)
def test_scenes_of_any_name_have_files_of_their_own(box, tmp_path, make, name):
    """Other numbers of samples and other scenes of one name are never taken for each other."""
    dim = replace(box, camera=replace(box.camera, resolution=(8, 6)), lights=box.lights[:1], name=name)
    bright = replace(dim, lights=(replace(dim.lights[0], radiance=np.full(3, 80)),))
    made = [make(scene, spp, folder=tmp_path / "cache") for scene in (dim, bright) for spp in (8, 12)]
    assert [one.spp for one in made] == [8, 12, 8, 12]
    means = [one.mean.mean() if make is dmis.make_reference else one.variance[0].mean() ** 0.5 for one in made]
    assert means[2] > 5 * means[0] and means[3] > 5 * means[1]
    assert len(list((tmp_path / "cache").iterdir())) == 4 and len(list(tmp_path.iterdir())) == 1


def test_a_given_reference_of_another_image_is_refused(box, tmp_path):
    """Of another scene, size, integrator or depth; one that does not say what it is of is for the alarm."""
    dmis.make_reference(box, 4, folder=tmp_path, max_depth=1)
    (path,) = tmp_path.iterdir()
    assert reference.load_reference(path, box, dmis.Settings(max_depth=1)).first.shape == (24, 32, 3)
    small = replace(box, camera=replace(box.camera, resolution=(16, 12)))
    for scene, settings, difference in (
        (replace(box, lights=box.lights[:1]), {"max_depth": 1}, r"scene is \w+, not \w+\."),
        (small, {"max_depth": 1}, r"scene is .*; resolution is \[32, 24\], not \[16, 12\]\."),
        (box, {"integrator": "path"}, r"integrator is direct, not path; max_depth is 1, not 5\."),
    ):
        with pytest.raises(ValueError, match=rf"reference {path} does not match: {difference}"):
            reference.load_reference(path, scene, dmis.Settings(**settings))
    dmis.write_exr(path, dmis.read_exr(path)[0])
    assert reference.load_reference(path, small).spp == 0
