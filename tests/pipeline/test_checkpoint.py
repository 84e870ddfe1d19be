"""Interrupted work: nothing finished is lost, nothing is done twice, and no wrong file is taken for a checkpoint."""

import random
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from helpers import pixel_shares

import dmis
from dmis.pipeline import checkpoint
from dmis.pipeline.film import FilmTile
from dmis.pipeline.tile import Rendered, Tile
from dmis.variance.moments import Moments

OPTIONS = {"rule": "thesis", "spp": 32, "seed": 9, "parallel": 1}
CHILD = """
import json, resource, sys
import numpy as np
import dmis
from dmis.pipeline.checkpoint import Store

append = Store.append
def append_and_print(store, tile):
    append(store, tile)
    print(tile.pass_, tile.number, flush=True)

Store.append = append_and_print
if len(sys.argv) > 4:
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[4]),) * 2)
scene = dmis.load_scene("teapot-area-light", resolution=(int(sys.argv[3]),) * 2)
result = dmis.render(scene, "thesis", 40, seed=3, parallel=2, checkpoint=sys.argv[1])
np.savez(sys.argv[2], image=result.image, variance=result.variance, rays=json.dumps(result.rays))
"""


@pytest.fixture(scope="module")
def wide(box):
    """The box in 15 tiles of the final pass, and 2 of each of three pilots."""
    return replace(box, camera=replace(box.camera, resolution=(160, 96)))


class Interrupted(BaseException):
    """Stands for Ctrl-C."""


def interrupt(scene, file, after=9, **options):
    """Render until `after` tiles are finished."""
    tiles = []

    def stop(*_):
        tiles.append(None)
        if len(tiles) == after:
            raise Interrupted

    with pytest.raises(Interrupted):
        dmis.render(scene, progress=stop, checkpoint=file, **{**OPTIONS, **options})
    return file


class Counting:
    """A caster that counts rays."""

    def __init__(self, caster):
        self._caster, self.rays = caster, 0

    def closest(self, origin, direction):
        self.rays += origin.shape[1]
        return self._caster.closest(origin, direction)

    def occluded(self, origin, direction, distance):
        self.rays += origin.shape[1]
        return self._caster.occluded(origin, direction, distance)


def test_only_the_missing_tiles_are_traced(wide, tmp_path):
    """Rays traced before and after the interruption are those of one go, and so are the bits of the image."""
    counting = Counting(wide.intersector)
    vars(wide)["intersector"] = counting
    try:
        whole = dmis.render(wide, **OPTIONS)
        in_one_go, counting.rays = counting.rays, 0
        assert in_one_go == sum(whole.rays.values())
        file = interrupt(wide, tmp_path / "c")
        time.sleep(0.5)  # the tile that was begun is finished for nothing
        before, counting.rays = counting.rays, 0
        resumed = dmis.render(wide, checkpoint=file, **OPTIONS)
        stored = in_one_go - counting.rays
    finally:
        vars(wide)["intersector"] = counting._caster
    assert 0 < stored <= before < in_one_go  # a tile that was begun, not finished, is traced again
    one_tile = 2.5 * in_one_go / 15
    assert before - stored < one_tile
    assert np.array_equal(whole.image, resumed.image) and np.array_equal(whole.variance, resumed.variance)
    assert whole.rays == resumed.rays
    assert not file.exists()


@pytest.mark.parametrize("after", [1, 7])
@pytest.mark.parametrize("rule", ["auto", "counts"])
def test_rules_of_two_rounds_resume(wide, tmp_path, rule, after):
    """After a kill in the first round and in the second: numbers of samples are those of one go."""
    options = {"rule": rule, "sampler": "sobol"}
    whole = dmis.render(wide, **{**OPTIONS, **options})
    file = interrupt(wide, tmp_path / "c", after, **options)
    resumed = dmis.render(wide, checkpoint=file, **{**OPTIONS, **options, "parallel": 2})
    for name in ("image", "deviation", "samples", "weight", "shading_samples"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(resumed, name))
    assert whole.rays == resumed.rays


class Least:
    """A plain class as a rule, without a ``__repr__`` of its own."""

    pilot = {0.5: 2}  # noqa: RUF012

    def __init__(self, least):
        self.least = least

    def fit(self, pilot):
        return dmis.Fit(weight=self.least)


def test_equal_objects_of_a_plain_class_resume(wide, tmp_path):
    """The text of a rule has no memory address: another object with the same fields resumes, as a new process would."""
    first, second = Least(0.2), Least(0.2)
    file = interrupt(wide, tmp_path / "c", rule=first)
    resumed = dmis.render(wide, checkpoint=file, **{**OPTIONS, "rule": second})
    assert np.array_equal(resumed.image, dmis.render(wide, **{**OPTIONS, "rule": first}).image)
    assert resumed.provenance["rule"] == "Least(least=0.2)"
    file = interrupt(wide, tmp_path / "c", rule=first)
    with pytest.raises(ValueError, match=r"Least\(least=0.2\) in the checkpoint and Least\(least=0.3\) in this render"):
        dmis.render(wide, checkpoint=file, **{**OPTIONS, "rule": Least(0.3)})


def start(*arguments):
    """A render in a process of its own, which says when a tile is finished."""
    command = [sys.executable, "-c", CHILD, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize(
    ("kills", "size"), [(2, 160), pytest.param(20, 512, marks=pytest.mark.slow)], ids=["2 kills", "20 kills"]
)
def test_kills_lose_nothing(tmp_path, kills, size):
    """``kill -9`` at random moments, while tiles are written too: none that was finished is rendered again."""
    rng = random.Random(kills)
    file, out, other = (tmp_path / name for name in ("c", "a.npz", "b.npz"))
    finished = []
    for _ in range(kills):
        with start(file, out, size) as process:
            finished += [process.stdout.readline() for _ in range(rng.randint(1, 4))]
            time.sleep(rng.uniform(0, 0.05))
            process.kill()
            finished += process.stdout.readlines()
        assert process.returncode == -signal.SIGKILL
    for arguments in ((file, out), (tmp_path / "unused", other)):
        with start(*arguments, size) as process:
            rest, error = process.communicate(timeout=300)
        assert process.returncode == 0, error
        if arguments[0] == file:
            finished += rest.splitlines(keepends=True)
    assert len(set(finished)) == len(finished)
    tiles = 3 * (size // 128 + (size % 128 > 0)) ** 2 + (size // 32) ** 2
    assert tiles - kills <= len(finished) <= tiles  # killed between writing a tile and saying so
    with np.load(out) as one, np.load(other) as two:
        for name in one:
            np.testing.assert_array_equal(one[name], two[name])
    assert not file.exists()


def test_a_disk_that_fills_up(tmp_path):
    """An error that says so; what is written is good, and there is a way on."""
    file, out = tmp_path / "c", tmp_path / "a.npz"
    with start(file, out, 160, 1_500_000) as process:
        said, error = process.communicate(timeout=300)
    assert process.returncode == 1 and f"cannot write checkpoint {file}: File too large" in error.splitlines()[-1]
    with start(file, out, 160) as process:
        rest, error = process.communicate(timeout=300)
    assert process.returncode == 0, error
    assert said and rest and not set(said.splitlines()) & set(rest.splitlines())


def test_a_file_in_use_is_refused(tmp_path):
    """Two renders do not write to one file."""
    file = tmp_path / "c"
    with start(file, tmp_path / "a.npz", 512) as process:
        process.stdout.readline()
        with pytest.raises(ValueError, match="is in use by another process"):
            dmis.render(dmis.load_scene("teapot-area-light", (8, 8)), "balance", 2, checkpoint=file)
        process.kill()


@pytest.mark.parametrize(
    ("changes", "difference"),
    [
        ({"seed": 10}, "seed is 9 in the checkpoint and 10 in this render"),
        ({"spp": 33}, "spp is 32 in the checkpoint and 33 in this render"),
        ({"rule": "thesis:patch=4"}, "rule is thesis in the checkpoint and thesis:patch=4 in this render"),
        ({"settings": dmis.Settings(lights="one")}, "settings.lights is all in the checkpoint and one in this render"),
    ],
)
def test_a_checkpoint_of_another_image_is_refused(wide, tmp_path, changes, difference):
    """The difference is named, no other is, and the file is left alone."""
    file = interrupt(wide, tmp_path / "c", 1)
    before = file.read_bytes()
    with pytest.raises(ValueError, match=f"belongs to a different image; .*: {difference}$"):
        dmis.render(wide, checkpoint=file, **{**OPTIONS, **changes})
    assert file.read_bytes() == before


def test_a_checkpoint_of_another_scene_or_version_is_refused(wide, tmp_path, monkeypatch):
    """Scenes are told apart by their description, whatever their names."""
    file = interrupt(wide, tmp_path / "c", 1)
    other = replace(wide, lights=wide.lights[:1])
    with pytest.raises(ValueError, match=r": scene_hash is \w+ in the checkpoint and \w+ in this render$"):
        dmis.render(other, checkpoint=file, **OPTIONS)
    monkeypatch.setattr(sys.modules["dmis.pipeline.job"], "__version__", "9.9")
    with pytest.raises(ValueError, match=r": dmis is 0\.1\S+ in the checkpoint and 9\.9 in this render$"):
        dmis.render(wide, checkpoint=file, **OPTIONS)
    file.write_bytes(file.read_bytes().replace(b"checkpoint 3", b"checkpoint 2"))
    with pytest.raises(ValueError, match="is of another version: b'dmis checkpoint 2'"):
        dmis.render(wide, checkpoint=file, **OPTIONS)


def test_damage_is_found(tmp_path):
    """Wherever the file ends and whatever byte is changed: an error that names it."""
    file, key = tmp_path / "c", {"seed": 1}
    rng, settings = np.random.default_rng(1), dmis.Settings()
    store = checkpoint.Store(file, key)
    for k in range(3):
        columns = 4 * k, 4 * k + 4
        tile = Tile(1, 0, k, (0, 4), columns, 2, pixel_shares(0.5), settings)
        moments = Moments(2, rng.random((4, 4, 3)), rng.random((4, 4, 3)))
        store.append(FilmTile.of(tile, Rendered(k, moments, Counter(camera=k), {"sums": rng.random((2, 1, 1))})))
    store.close()
    good = file.read_bytes()
    for place in range(0, len(good), 7):
        file.write_bytes(good[:place])
        with pytest.raises(ValueError, match=f"checkpoint {file} is (not readable|truncated|of another)"):
            checkpoint.Store(file, key)
    for place in range(0, len(good), 3):
        file.write_bytes(good[:place] + bytes([good[place] ^ 0x55]) + good[place + 1 :])
        with pytest.raises(ValueError, match=f"checkpoint {file} is"):
            checkpoint.Store(file, key)


def test_no_pickles(tmp_path):
    """A record with a Python object in it is refused, and not run."""
    key = {"seed": 1}
    file = tmp_path / "c"
    evil = checkpoint._pack({"key": key}, {"x": np.array([_Evil()], dtype=object)})
    file.write_bytes(checkpoint.MAGIC + (checkpoint._START + len(evil)).to_bytes(8, "little") + evil)
    with pytest.raises(ValueError, match="damaged at byte 26: Object arrays cannot be loaded"):
        checkpoint.Store(file, key)
    assert not _Evil.ran


class _Evil:
    ran = False

    def __reduce__(self):
        return _run, ()


def _run():
    _Evil.ran = True
