"""Threads, processes and a cluster give the same bits, get the scene once, and end clearly if a worker dies."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
import weakref
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import dmis
from dmis.cli.commands import main
from dmis.experiment.runs import PINNED, measure
from dmis.fit.fixed import Fixed
from dmis.fit.registry import RULES
from dmis.fit.round import Budget
from dmis.fit.rule import merge_settings
from dmis.pipeline import executor
from dmis.pipeline.tile import make_tiles
from dmis.variance.moments import Film

OPTIONS = {"rule": "second-moment", "spp": 32, "seed": 4}


@pytest.fixture(autouse=True)
def no_idle_processes():
    """Each test begins without processes, and ends them."""
    yield
    while executor._idle_pools:
        executor._idle_pools.pop().shutdown()


@pytest.fixture(scope="module")
def wide(box):
    """The box in 15 tiles."""
    return replace(box, camera=replace(box.camera, resolution=(320, 96)))


@pytest.fixture(scope="module")
def threaded(wide):
    """What every executor must give."""
    return dmis.render(wide, parallel=1, **OPTIONS)


@pytest.fixture
def pickled(monkeypatch):
    """How often a scene was pickled here; `Scene.changed`, which a result describes its scene by, does not pickle."""
    calls = []
    get = dmis.Scene.__getstate__

    def state(scene):
        if sys._getframe(1).f_code.co_name != "changed":
            calls.append(scene)
        return get(scene)

    monkeypatch.setattr(dmis.Scene, "__getstate__", state)
    return calls


def check(result, threaded):
    """Same bits, same rays."""
    for name in ("image", "weight", "variance", "samples"):
        np.testing.assert_array_equal(getattr(result, name), getattr(threaded, name))
    assert result.rays == threaded.rays


class Killer:
    """Progress that kills a process, a child by default, after the third tile of the final pass, and keeps count."""

    def __init__(self, victim=None):
        self._victim, self.done = victim, []

    def __call__(self, stage, done, total):
        if stage == "final":
            self.done.append(done)
            if len(self.done) == 3:
                os.kill(self._victim or multiprocessing.active_children()[0].pid, signal.SIGKILL)
            self.total = total


def test_a_dead_process_ends_with_how_to_resume(wide, threaded, pickled, tmp_path):
    """One of two workers is killed: an error; what was finished is kept. The scene was written once."""
    options = {"parallel": dmis.Processes(2), "checkpoint": tmp_path / "c", **OPTIONS}
    progress = Killer()
    with pytest.raises(ChildProcessError, match=r"workers died .*memory runs out.* `if __name__ == .*checkpoint=DIR"):
        dmis.render(wide, progress=progress, **options)
    assert len(pickled) == 1 and not multiprocessing.active_children()
    finished = []
    check(dmis.render(wide, progress=lambda *about: finished.append(about), **options), threaded)
    assert 0 < len(finished) <= 15 - len(progress.done)


def _half(pipe, _):
    pipe.recv_bytes()
    pipe.recv()
    os.write(pipe.fileno(), b"\x00\x01")
    os._exit(1)


def _failing(pipe, plugins):
    executor.render_tile = lambda *_: 1 / 0
    executor._serve(pipe, plugins)


@pytest.mark.parametrize(
    ("serve", "error", "message"),
    [
        (_half, ChildProcessError, "workers died before all tiles were rendered"),
        (_failing, ZeroDivisionError, "by zero"),
    ],
)
def test_an_error_in_a_process_is_the_error_of_the_render(wide, monkeypatch, serve, error, message):
    """A process that dies while it sends a tile, and an error with its own type and message; the processes are gone."""
    monkeypatch.setattr(executor, "_serve", serve)
    with pytest.raises(error, match=message):
        dmis.render(wide, "balance", 2, parallel=dmis.Processes(2))
    assert not multiprocessing.active_children()


def test_a_given_pool_reads_the_scene_once(wide, threaded, pickled):
    """20 tiles in two passes have one copy of the scene, in the pool's process."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        check(dmis.render(wide, parallel=pool, **OPTIONS), threaded)
        assert len(pickled) == 1 and pool.submit(_reads).result() == 1


def _reads():
    return executor._load.cache_info().misses


def run_script(folder, text):
    """A process that runs a script, whose temporary files are in its folder."""
    (folder / "script.py").write_text(text)
    environment = {**os.environ, "TMPDIR": str(folder), "PYTHONPATH": str(Path(dmis.__file__).parent.parent)}
    pipes = dict.fromkeys(("stdout", "stderr"), subprocess.PIPE)
    return subprocess.Popen([sys.executable, folder / "script.py"], env=environment, text=True, **pipes)


def test_error_names_missing_main_guard(tmp_path):
    """The error names the line that the script lacks; no file is left."""
    text = "import dmis\ndmis.render(dmis.load_scene('cornell', (16, 16)), 'balance', 2, parallel=dmis.Processes(2))"
    with run_script(tmp_path, text) as process:
        last = process.communicate(timeout=300)[1].splitlines()[-1]
    assert process.returncode == 1 and os.listdir(tmp_path) == ["script.py"]
    assert last.startswith("ChildProcessError") and 'outside of `if __name__ == "__main__":`' in last


def test_processes_end_with_the_one_that_started_them(tmp_path):
    """Killed with -9, it leaves neither workers nor files behind."""
    with run_script(tmp_path, SCRIPT) as process:
        pids = process.stdout.readline().split()
        assert len(pids) == 2
        process.kill()
    end = time.monotonic() + 120
    while any(map(_runs, pids)):
        assert time.monotonic() < end
        time.sleep(0.05)
    assert os.listdir(tmp_path) == ["script.py"]


SCRIPT = """
import multiprocessing
import dmis

def tell(*_):
    print(*(child.pid for child in multiprocessing.active_children()), flush=True)

if __name__ == "__main__":
    scene = dmis.load_scene("cornell", (400, 400))
    dmis.render(scene, "balance", 256, parallel=dmis.Processes(2), progress=tell)
"""


def _runs(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_processes_wait_for_the_next_call(box, wide, pickled):
    """They stay if it has the same scene; another one ends them. Their CPU seconds are in the result."""
    options = {"rule": "balance", "spp": 4, "parallel": dmis.Processes(2)}
    first = dmis.render(wide, **options)
    before = {child.pid for child in multiprocessing.active_children()}
    again = dmis.render(wide, **options)
    assert {child.pid for child in multiprocessing.active_children()} == before and len(before) == 2
    assert len(pickled) == 1
    here = dmis.render(wide, "balance", 4, parallel=2)
    check(again, first)
    check(here, first)
    assert here.seconds["workers"] == 0 < min(first.seconds["workers"], again.seconds["workers"])
    for child in multiprocessing.active_children():
        os.kill(child.pid, signal.SIGKILL)
        child.join()
    check(dmis.render(wide, **options), first)
    dmis.render(box, **options)
    assert len(multiprocessing.active_children()) == 1  # one tile, and no more of the other scene


def test_another_version_is_refused(box, monkeypatch):
    """A worker of another version than the one that asks says so."""
    monkeypatch.setattr(executor, "_call", partial(_older, executor._call))
    with pytest.raises(ValueError, match=r"the same version of dmis, .*; 0\.0\.1 asked, and .* has 0\.1"):
        dmis.render(box, "balance", 2, parallel=2)


def _older(call, scene, _, function, item):
    return call(scene, "0.0.1", function, item)


def test_results_are_let_go(wide, monkeypatch):
    """Tiles are merged as they come: few are in memory at a time."""
    alive, most = weakref.WeakSet(), []
    merge = Film.merge

    def watched(film, part, *others):
        alive.add(part)
        most.append(len(alive))
        merge(film, part, *others)

    monkeypatch.setattr(Film, "merge", watched)
    dmis.render(wide, "balance", 32, parallel=1)
    assert len(most) == 15 and max(most) <= 3


@pytest.mark.parametrize("parallel", [0, 1.5, True, "4"])
def test_bad_parallel(box, parallel):
    """The message says what is allowed."""
    message = "parallel must be a whole number from 1 to 1024, the number of threads; or dmis.Processes.*; got "
    with pytest.raises(ValueError, match=message):
        dmis.render(box, "balance", 2, parallel=parallel)
    with pytest.raises(ValueError, match="number of processes must be a whole number from 1 to 1024; got"):
        dmis.Processes(parallel)
    assert executor.describe_parallel(8) == "8 threads" and executor.describe_parallel(1) == "1 thread"


@pytest.fixture(scope="module")
def cluster():
    """A Dask cluster of two processes on this machine."""
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def test_cluster_survives_a_death(wide, threaded, pickled, cluster):
    """One of two workers is killed: its nanny starts another, and the scheduler has its tiles done again."""
    before = cluster.run(os.getpid)
    victim = next(iter(before.values()))
    progress = Killer(victim)
    check(dmis.render(wide, parallel=cluster.get_executor(pure=False), progress=progress, **OPTIONS), threaded)
    assert len(progress.done) == 15 and progress.done[-1] == progress.total
    cluster.wait_for_workers(2, timeout=120)
    assert victim not in cluster.run(os.getpid).values()
    assert len(pickled) == 1


@pytest.mark.parametrize("kind", ["processes", "cluster"])
def test_workers_measure_what_threads_do(box, tmp_path, monkeypatch, kind, request):
    """The same errors, and similar CPU seconds, of shipped rules and of one's own."""
    client = None if kind == "processes" else request.getfixturevalue("cluster")
    parallel = client.get_executor(pure=False) if client else dmis.Processes(2)
    monkeypatch.setitem(RULES, "mine", Fixed)
    reference = dmis.make_reference(box, 16, folder=tmp_path)
    budgets = [(PINNED, 8), ("auto", 64), ("balance", 64), ("mine", 64)]
    serial, runs = (measure(box, budgets, 3, reference, parallel=of) for of in (1, parallel))
    if client:  # else each prints a traceback at Ctrl-C
        assert set(client.run(signal.getsignal, signal.SIGINT).values()) == {signal.SIG_IGN}
    for budget, by_seed in runs.items():
        assert [(r.seed, r.mse, r.rays) for r in by_seed] == [(r.seed, r.mse, r.rays) for r in serial[budget]]
        one, other = (np.median([r.cpu_seconds for r in of]) for of in (serial[budget], by_seed))
        assert 0.5 < other / one < 4  # a few tiles, each sent to a worker


def test_threads_end_their_tiles_after_an_interrupt(box):
    """Within a second of CPU time, where the second tile would take a minute."""
    rounds = (Budget(spp, (24, 32), merge_settings(dmis.Settings(), box)[0]).final(dmis.Fit(0.5)) for spp in (4, 2**16))
    workers = executor.Workers(box, 2)
    with closing(workers.render([tile for of in rounds for tile in make_tiles((32, 24), 0, 0, of)])) as tiles:
        next(tiles)
    began = time.process_time()
    workers.close()
    workers._own.shutdown()
    assert time.process_time() - began < 1


def test_cluster_on_the_command_line(cluster, monkeypatch, capsys, tmp_path):
    """``--cluster ADDRESS`` renders there; an address where no one answers ends with a message."""
    distributed = sys.modules["distributed"]
    monkeypatch.setattr("dmis.cli.rendering.CLUSTER_TIMEOUT", 0.5)
    arguments = ["render", "teapot-area-light", "-o", str(tmp_path / "a.exr"), "--resolution", "40x30", "--spp", "8"]
    arguments += ["--quiet", "--cluster"]
    assert main([*arguments, cluster.scheduler.address]) == 0
    here = dmis.render(dmis.load_scene("teapot-area-light", (40, 30)), spp=8)
    np.testing.assert_array_equal(dmis.read_exr(tmp_path / "a.exr")[0]["RGB"], here.image)
    assert main([*arguments, "tcp://127.0.0.1:9"]) == 2
    assert "no Dask scheduler answers at tcp://127.0.0.1:9" in capsys.readouterr().err
    with distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=None) as empty:
        assert main([*arguments, empty.scheduler_address]) == 2
    assert "has no workers" in capsys.readouterr().err
