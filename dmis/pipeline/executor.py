"""Where tiles are rendered: threads, processes of this machine, or a cluster; and how the scene gets there.

A worker gets the scene once, however many tiles it renders. Threads share it. Processes read it from their pipes, and
wait for the next call with the same scene. On a Dask cluster it is a task whose result is copied to all workers, from
worker to worker, and stays for the next call; one that joins later gets it with its first tile. Any other executor gets
it with every tile, and its workers keep the last one.

The first process that dies is an error; Dask's scheduler renders the tiles of a dead worker again, as often as its
``allowed-failures`` says.
"""

from __future__ import annotations

import os
import pickle
import platform
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from dmis import __version__
from dmis.base.plugins import load_plugin, loaded_plugins
from dmis.base.validate import whole
from dmis.pipeline.tile import Tile, render_tile
from dmis.scene.scene import Scene
from dmis.variance.moments import Film

MAX_WORKERS = 1024
"""Largest number of threads or processes."""


@dataclass(frozen=True)
class Processes:
    """`number` processes of this machine, 1 to 1024, which render tiles in the place of threads.

    A script must start the render from under ``if __name__ == "__main__":``, because each process imports the script.
    """

    number: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "number", whole("number of processes", self.number, 1, MAX_WORKERS))


Parallel = int | Processes | Executor | None
"""Where tiles are rendered: a number of threads, `Processes`, or any executor; None: one thread per processor."""


def check_parallel(parallel: Parallel) -> int | Processes | Executor:
    """Return `parallel`, with the number of processors in the place of None.

    A ValueError if it is nothing that `Parallel` names, or a number that is not from 1 to 1024.
    """
    if parallel is None:
        return os.cpu_count() or 1
    if isinstance(parallel, Processes | Executor):
        return parallel
    return whole(
        "parallel", parallel, 1, MAX_WORKERS, "the number of threads; or dmis.Processes(number), an executor, or None"
    )


def describe_parallel(parallel: Parallel) -> str:
    """Return where tiles are rendered in words: ``1 thread``, ``8 processes``, ``executor ClientExecutor``."""
    checked = check_parallel(parallel)
    if isinstance(checked, Executor):
        return f"executor {type(checked).__name__}"
    if isinstance(checked, Processes):
        return f"{checked.number} process{'es' * (checked.number > 1)}"
    return f"{checked} thread{'s' * (checked > 1)}"


class Workers:
    """An executor with the scene at its workers, where functions of it are called.

    Parameters
    ----------
    scene
        Sent to each worker once, and kept there.
    parallel
        As that of `dmis.pipeline.render.render`.
    """

    def __init__(self, scene: Scene, parallel: Parallel = None) -> None:
        parallel = check_parallel(parallel)
        self._own: ThreadPoolExecutor | None = None
        self._stop: threading.Event | None = None
        self._done = True
        if isinstance(parallel, Processes):
            self._own = pool = _process_pool(parallel.number, scene, loaded_plugins())
            self._submit: Callable[..., Future[Any]] = lambda function, item: pool.submit(pool.call, function, item)
            return
        if isinstance(parallel, int):
            parallel, self._stop = ThreadPoolExecutor(parallel), threading.Event()
            self._own = parallel
        sent = scene if isinstance(parallel, ThreadPoolExecutor) else _send(parallel, scene)
        self._submit = lambda function, item: parallel.submit(_call, sent, __version__, function, item)

    def render(self, tiles: Sequence[Tile]) -> Generator[tuple[Tile, Film], None, None]:
        """Yield tiles and their films, see `calls`."""
        return self.calls(partial(_render, _this_process(), self._stop), tiles)

    def calls(self, function: Callable[..., Any], items: Iterable[Any]) -> Generator[tuple[Any, Any], None, None]:
        """Yield items and the results of ``function(scene, item)`` in order of completion; they begin in that of items.

        A ChildProcessError if a worker died, or the cluster was lost, and no scheduler repeats its calls.
        """
        waiting: dict[Future[Any], Any] = {}
        distributed = sys.modules.get("distributed")  # Dask's, if it is used
        losses = (BrokenExecutor, CancelledError, *((distributed.KilledWorker,) if distributed else ()))
        try:
            for item in items:
                waiting[self._submit(function, item)] = item
            for future in as_completed(list(waiting)):
                yield waiting[future], future.result()
                del waiting[future]  # not before: a pool whose last call failed is not kept
        except losses as error:
            script = ', or if a script starts the render outside of `if __name__ == "__main__":`' if self._own else ""
            raise ChildProcessError(
                f"workers died before all tiles were rendered ({type(error).__name__}: {error}). They die if memory "
                f"runs out{script}. With a checkpoint, checkpoint=DIR or --checkpoint DIR, finished tiles are kept, "
                f"and the same render resumes"
            ) from None  # the message has the reason
        finally:
            self._done = not waiting
            for future in waiting:
                future.cancel()

    def close(self) -> None:
        """Let go of the scene, and end threads of our own; processes, too, if calls were given up."""
        if self._stop is not None and not self._done:
            self._stop.set()
        if isinstance(self._own, _ProcessPool) and self._done:
            _idle_pools.append(self._own)
        elif self._own is not None:
            self._own.shutdown(wait=self._done, cancel_futures=True)
        del self._submit


def worker_processes(parallel: Parallel) -> int:
    """Return the number of processes that render in `Processes` or on a Dask cluster; 0 for other executors."""
    if isinstance(parallel, Processes):
        return parallel.number
    is_cluster = type(parallel).__module__.partition(".")[0] == "distributed"
    return len(parallel._client.nthreads()) if is_cluster else 0  # type: ignore[union-attr]


class _ProcessPool(ThreadPoolExecutor):
    """Threads, each of which makes its calls in a process of its own, and knows by its pipe when that dies.

    A `ProcessPoolExecutor` waits forever if a process dies while it sends a result, that of loky 3.7, too: all of its
    processes write to one pipe, which the others keep open.
    """

    def __init__(self, number: int, scene: Scene, plugins: Sequence[Path]) -> None:
        super().__init__(number)
        self.about = number, scene, plugins
        self._scene, self._local = pickle.dumps(scene), threading.local()
        self.processes: list[Any] = []

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes, whose calls fail, and then the threads."""
        for process in self.processes:
            process.terminate()
            process.join()
        super().shutdown(wait, cancel_futures=True)

    def call(self, function: Callable[..., Any], item: Any) -> Any:
        """Return ``function(scene, item)`` of the process of this thread, which is started for the first call."""
        try:
            if not hasattr(self._local, "pipe"):
                self._local.pipe = self._start()
            self._local.pipe.send_bytes(_pickled((function, item)))
            answer = self._local.pipe.recv()
        except (EOFError, OSError) as error:
            raise BrokenExecutor(f"a process has closed its pipe, {error!r}") from None
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _start(self) -> Any:
        """Start a process, and return the connection to it."""
        import multiprocessing  # imported where used: threads do without

        if hasattr(signal, "pthread_sigmask"):  # its process inherits that, and does not hear Ctrl-C while it starts
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        context = multiprocessing.get_context("spawn")  # a fork of a process with threads may hang
        ours, its = context.Pipe()
        process = context.Process(target=_serve, args=(its, self.about[2]), daemon=True)
        process.start()
        self.processes.append(process)
        its.close()  # so that a read ends with the process
        ours.send_bytes(self._scene)
        return ours


def _pickled(call: Any) -> bytes:
    """Return a call as bytes; a ValueError if its round holds something that cannot be sent."""
    try:
        return pickle.dumps(call)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ValueError(
            f"a round must be picklable: {error}. Define functions and classes of its "
            f"techniques and statistic at the top level of a module, such as a plug-in"
        ) from error


_idle_pools: list[_ProcessPool] = []
"""The pool of the last call with processes, if it is not in use: a process takes a second to start."""


def _process_pool(number: int, scene: Scene, plugins: Sequence[Path]) -> _ProcessPool:
    """Return the idle pool if it is the same; else end it, and return a new one."""
    while _idle_pools:
        pool = _idle_pools.pop()
        if pool.about == (number, scene, plugins) and all(process.is_alive() for process in pool.processes):
            return pool
        pool.shutdown()
    return _ProcessPool(number, scene, plugins)


def _serve(pipe: Any, plugins: Sequence[Path]) -> None:
    """Make the calls that come through a pipe until it is closed, or its other end dies; ignore Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter("ignore")  # the process that has the scene gives them
    for plugin in plugins:
        load_plugin(plugin)
    with suppress(EOFError, OSError):
        scene = _load(pipe.recv_bytes())
        while True:
            function, item = pipe.recv()
            try:
                answer = function(scene, item)
            except Exception as error:
                answer = error
            pipe.send(answer)


def _call(scene: Scene | bytes, version: str, function: Callable[..., Any], item: Any) -> Any:
    """Return ``function(scene, item)`` in a worker."""
    if version != __version__:
        raise ValueError(
            f"all machines must have the same version of dmis, because the image depends on it; "
            f"{version} asked, and {platform.node()} has {__version__}"
        )
    return function(_load(scene) if isinstance(scene, bytes) else scene, item)


def _render(asking: tuple[str, int], stop: threading.Event | None, scene: Scene, tile: Tile) -> Film:
    """Return the film of a tile, with its CPU seconds if another process is `asking`; `stop` ends it in a thread."""
    began = time.thread_time()
    film = render_tile(scene, tile, None, stop)
    return film if asking == _this_process() else replace(film, worker_seconds=time.thread_time() - began)


def _this_process() -> tuple[str, int]:
    """Return the name of this machine, and the number of this process on it."""
    return platform.node(), os.getpid()


@lru_cache(maxsize=1)
def _load(data: bytes) -> Scene:
    """Return a pickled scene with its tables; the last one is kept."""
    scene: Scene = pickle.loads(data)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that who sent it warns of
        scene.in_float32[0].prepare()  # so that it is not part of the first tile's time
    return scene


def _send(executor: Any, scene: Scene) -> Any:
    """Return the pickled scene; on a Dask cluster the task that has it, whose result all workers there are get."""
    if type(executor).__module__.partition(".")[0] != "distributed":
        return pickle.dumps(scene)
    for plugin in loaded_plugins():
        executor._client.upload_file(str(plugin))  # to workers that join later, too
    return _at_cluster(executor._client, scene)


@lru_cache(maxsize=1)
def _at_cluster(client: Any, scene: Scene) -> Any:
    """Return the pickled scene as the result of a task, which stays at the workers for the next call.

    A task, and not ``scatter``: what was scattered cannot be made again when the workers that have it are gone.
    """
    import dask

    client.run(_ignore_interrupts, os.getpid())
    with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1TB"}):
        future = client.submit(bytes, pickle.dumps(scene), pure=False)
    if client.scheduler_info(n_workers=1)["workers"]:
        client.replicate([future])
    return future


def _ignore_interrupts(parent: int) -> None:
    """Ignore Ctrl-C in a worker that the process `parent` has started and will end: it would print a traceback, too."""
    if os.getppid() == parent and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
