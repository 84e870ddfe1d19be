"""References: two independent halves, rendered once."""

import numpy as np

import dmis
from dmis.experiment import reference


def test_reference_is_made_once_and_kept(box, tmp_path, monkeypatch):
    """The second call reads the file of the first; the halves differ, and agree within their noise."""
    made = dmis.make_reference(box, np.int64(64), folder=tmp_path)
    assert not np.array_equal(made.first, made.second)
    monkeypatch.setattr(reference, "render", None)
    kept = dmis.make_reference(box, 64, folder=tmp_path)
    np.testing.assert_array_equal(made.first, kept.first)
    np.testing.assert_array_equal(made.second, kept.second)
    assert len(list(tmp_path.iterdir())) == 1


def test_error_is_that_of_the_average(box, tmp_path, monkeypatch):
    """`mse` is the error of the mean of the halves: against a far better reference it is the same, on the average of
    ten, which scatter by 0.15.
    """
    fine, ratios = dmis.make_reference(box, 2048, folder=tmp_path), []
    for seed in range(0, 20, 2):
        monkeypatch.setattr("dmis.experiment.reference.REFERENCE_SEED", seed)
        rough = dmis.make_reference(box, 32, folder=tmp_path / str(seed))
        ratios.append(dmis.mse(rough.mean, fine.first, fine.second) / rough.mse)
    assert 0.85 < np.mean(ratios) < 1.2


def test_cache_folder_comes_from_the_environment(box, tmp_path, monkeypatch):
    """DMIS_CACHE is the folder of the cache."""
    monkeypatch.setenv("DMIS_CACHE", str(tmp_path / "cache"))
    dmis.make_reference(box, 4)
    assert len(list((tmp_path / "cache").glob("box-32x24-4spp-*.exr"))) == 1
