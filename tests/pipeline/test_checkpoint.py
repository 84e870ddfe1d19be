"""Interrupted work: nothing finished is lost, nothing is done twice, and no wrong folder is taken for a checkpoint."""

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import shared_scene

import dmis
from dmis.estimator.allocation import shares_of
from dmis.fit.round import Round
from dmis.pipeline import checkpoint
from dmis.pipeline.tile import Tile
from dmis.variance.moments import Film

OPTIONS = {"rule": "thesis", "spp": 32, "seed": 9, "parallel": 1}
CHILD = """
import json, sys
import numpy as np
import dmis
from dmis.pipeline.checkpoint import Store

append = Store.append
def append_and_print(store, tile, film):
    append(store, tile, film)
    print(tile.pass_, tile.number, flush=True)

Store.append = append_and_print
scene = dmis.load_scene("cornell", resolution=(int(sys.argv[3]),) * 2)
print("ready", flush=True)
sys.stdin.readline()
result = dmis.render(scene, "thesis", 40, seed=3, parallel=2, checkpoint=sys.argv[1], integrator="direct")
np.savez(sys.argv[2], image=result.image, variance=result.variance, rays=json.dumps(result.rays))
dmis.remove_checkpoint(sys.argv[1])
"""


@pytest.fixture(scope="module")
def wide(box):
    """The box in 15 tiles of the final pass, and 2 of each of three pilots."""
    return replace(box, camera=replace(box.camera, resolution=(160, 96)))


def interrupt(scene, file, after=9, **options):
    """Render until `after` tiles are finished."""
    tiles = []

    def stop(*_):
        tiles.append(None)
        if len(tiles) == after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        dmis.render(scene, progress=stop, checkpoint=file, **{**OPTIONS, **options})
    return file


def test_only_the_missing_tiles_are_rendered(wide, tmp_path):
    """To the same bits; a finished checkpoint is left to its caller, and has the whole image."""
    tiles, rest = [], []
    whole = dmis.render(wide, progress=lambda *about: tiles.append(about), **OPTIONS)
    file = interrupt(wide, tmp_path / "c")
    resumed = dmis.render(wide, checkpoint=file, progress=lambda *about: rest.append(about), **OPTIONS)
    again = dmis.render(wide, checkpoint=file, progress=pytest.fail, **OPTIONS)
    assert rest == tiles[9:]
    for result in (resumed, again):
        assert np.array_equal(whole.image, result.image) and np.array_equal(whole.variance, result.variance)
        assert whole.rays == result.rays
    dmis.remove_checkpoint(file)
    assert not os.listdir(tmp_path)


def start(folder, result, size):
    """A render in a process of its own, which begins at `go`."""
    command = [sys.executable, "-c", CHILD, *map(str, (folder, result, size))]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    process = subprocess.Popen(command, text=True, **pipes)
    assert process.stdout.readline() == "ready\n"
    return process


def go(process):
    process.stdin.write("\n")
    process.stdin.flush()


def here(folder, size):
    """The same render in this process: the result, and the tiles that it has rendered."""
    tiles, append = [], checkpoint.Store.append
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            checkpoint.Store, "append", lambda store, tile, film: tiles.append(tile) or append(store, tile, film)
        )
        scene = shared_scene("cornell", (size, size))
        result = dmis.render(scene, "thesis", 40, seed=3, parallel=2, checkpoint=folder, integrator="direct")
    return result, [f"{tile.pass_} {tile.number}" for tile in tiles]


@cache
def undisturbed(size):
    """The result and the tiles of a render of a size in one go."""
    with tempfile.TemporaryDirectory() as folder:
        return here(Path(folder) / "c", size)


def check(result, size):
    """A result has the bits of one go."""
    expected = undisturbed(size)[0]
    np.testing.assert_array_equal(result.image, expected.image)
    np.testing.assert_array_equal(result.variance, expected.variance)
    assert result.rays == expected.rays


@pytest.mark.parametrize(
    ("kills", "size"), [(1, 128), pytest.param(20, 512, marks=pytest.mark.slow)], ids=["1 kill", "20 kills"]
)
def test_kills_lose_nothing(tmp_path, kills, size):
    """``kill -9`` at random moments, while tiles are written too: none that was finished is rendered again."""
    rng = random.Random(kills)
    file = tmp_path / "c"
    finished = []
    for _ in range(kills):
        with start(file, tmp_path / "a.npz", size) as process:
            go(process)
            finished += [process.stdout.readline().strip() for _ in range(rng.randint(1, 4))]
            time.sleep(rng.uniform(0, 0.05))
            process.kill()
            finished += process.stdout.read().splitlines()
        assert process.returncode == -signal.SIGKILL
    result, last = here(file, size)
    finished, tiles = finished + last, undisturbed(size)[1]
    assert len(set(finished)) == len(finished) >= len(tiles) - kills  # killed between writing a tile and saying so
    assert set(finished) <= set(tiles)
    check(result, size)


def test_two_processes_share_a_checkpoint(tmp_path):
    """They start at the same moment; each ends with the image of one go, though the other removes the checkpoint."""
    file, out = tmp_path / "c", tmp_path / "a.npz"
    with start(file, out, 128) as process:
        go(process)
        result, _ = here(file, 128)
        _, error = process.communicate(timeout=300)
    assert process.returncode == 0, error
    check(result, 128)
    with np.load(out) as arrays:
        check(SimpleNamespace(**{**arrays, "rays": json.loads(str(arrays["rays"]))}), 128)
    dmis.remove_checkpoint(file)
    assert os.listdir(tmp_path) == ["a.npz"]


@pytest.mark.parametrize(
    ("changes", "difference"),
    [
        ({"rule": "thesis:patch=4"}, "rule is thesis in the checkpoint and thesis:patch=4 in this render"),
        ({"lights": "one"}, "settings.lights is auto in the checkpoint and one in this render"),
        ("scene", r"scene_hash is \w+ in the checkpoint and \w+ in this render"),
        (("job.__version__", "9.9"), r"dmis is 0\.1\S+ in the checkpoint and 9\.9 in this render"),
        (("tile.CHUNK", 2**10), r"tiles\.batch is 65536 in the checkpoint and 1024 in this render; tiles.chunk .*"),
        (("fingerprint.package_hash", lambda: "0"), r"package_hash is \w+ in the checkpoint and 0 in this render"),
    ],
)
def test_a_checkpoint_of_another_image_is_refused(wide, tmp_path, monkeypatch, changes, difference):
    """The difference is named, no other is, and the folder is left alone; tiles have one size in a checkpoint."""
    file = interrupt(wide, tmp_path / "c", 1)
    before = {path: path.read_bytes() for path in file.iterdir()}
    scene = replace(wide, lights=wide.lights[:1]) if changes == "scene" else wide
    if isinstance(changes, tuple):
        monkeypatch.setattr(f"dmis.pipeline.{changes[0]}", changes[1])
    options = {**OPTIONS, **(changes if isinstance(changes, dict) else {})}
    with pytest.raises(ValueError, match=f"belongs to a different image; .*: {difference}$"):
        dmis.render(scene, checkpoint=file, **options)
    assert {path: path.read_bytes() for path in file.iterdir()} == before


@pytest.mark.parametrize("content", ["file", "folder", "key", "more"])
def test_other_files_are_not_taken_for_checkpoints(box, tmp_path, content):
    """A file, a folder of other files, a checkpoint with a damaged key, and one with another file: all are left."""
    path = tmp_path / "c"
    if content == "file":
        path.write_bytes(b"mine")
    elif content == "more":
        dmis.render(box, "balance", 4, checkpoint=path, parallel=1)
        (path / "mine").touch()
    else:
        path.mkdir()
        (path / (checkpoint.KEY if content == "key" else "mine.npz")).write_bytes(b"mine")
    before = sorted(tmp_path.rglob("*"))
    if content != "more":
        with pytest.raises(ValueError, match=f"{path} is not a checkpoint of this version of dmis, .*Remove it"):
            dmis.render(box, "balance", 4, checkpoint=path, progress=pytest.fail)
    if content != "key":
        with pytest.raises(ValueError, match="is not removed: it is not a checkpoint, or has other files in it"):
            dmis.remove_checkpoint(path)
    assert sorted(tmp_path.rglob("*")) == before
    dmis.remove_checkpoint(tmp_path / "absent")


def stored(path):
    """A checkpoint with one tile of 4x4 pixels, and the tile's file."""
    rng = np.random.default_rng(1)
    moments = rng.random((2, 4, 4, 3), np.float32)
    store = checkpoint.Store(path, {"seed": 1})
    tile = Tile(1, 0, 5, (slice(0, 4), slice(4, 8)), Round(2, shares_of(0.5), dmis.Settings()))
    store.append(tile, Film(2, *moments, {"camera": 5}, {"sums": rng.random((2, 1, 1))}))
    return store, path / "0-5.npz"


def test_damaged_tiles_are_rendered_again(tmp_path):
    """Wherever the file ends and whatever byte is changed, it is either the tile or none."""
    store, file = stored(tmp_path / "c")
    ((_, whole),), good = store.finished_tiles(0), file.read_bytes()
    for place in range(0, len(good), 7):
        file.write_bytes(good[:place])
        assert not list(store.finished_tiles(0))
    number = 0
    for place in range(0, len(good), 3):
        file.write_bytes(good[:place] + bytes([good[place] ^ 0x55]) + good[place + 1 :])
        for tile, film in store.finished_tiles(0):
            number += 1
            assert (tile, film.n, film.rays) == (5, 2, {"camera": 5})
            np.testing.assert_array_equal(film.mean, whole.mean)
            np.testing.assert_array_equal(film.root, whole.root)
            np.testing.assert_array_equal(film.sums["sums"], whole.sums["sums"])
    assert number < len(good) / 15  # times and places that nothing depends on


def test_no_pickles(tmp_path):
    """A Python object in a tile's file is not run; the tile is rendered again."""
    store, file = stored(tmp_path / "c")
    with np.load(file) as archive:
        np.savez(file, **{**archive, "mean": np.array([print], dtype=object)})
    assert not list(store.finished_tiles(0))
