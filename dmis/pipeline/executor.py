"""Where tiles are rendered: threads, processes of this machine, or a cluster; and how the scene gets there.

A worker gets the scene once, however many tiles it renders. Threads share it. Processes read it from their pipes. On
a Dask cluster it is a task whose result is copied to all workers, from worker to worker; one that joins later gets it
with its first tile. Any other executor gets it with every tile, and its workers keep the last one.

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
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from dmis import __version__
from dmis.base.plugins import load_plugin, loaded_plugins
from dmis.base.validate import whole
from dmis.pipeline.film import FilmTile
from dmis.pipeline.tile import Tile, render_tile
from dmis.scene.scene import Scene

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
    """An executor with the scene at its workers; an executor of its own is shut down by `close`."""

    def __init__(self, scene: Scene, parallel: Parallel = None) -> None:
        parallel = check_parallel(parallel)
        self._own: ThreadPoolExecutor | _ProcessPool | None = None
        if isinstance(parallel, Processes):
            self._own = _ProcessPool(parallel.number, scene)
            self._submit: Callable[[Tile], Future[FilmTile]] = self._own.submit
            return
        if isinstance(parallel, int):
            parallel = self._own = ThreadPoolExecutor(parallel)
        sent = scene if isinstance(parallel, ThreadPoolExecutor) else _send(parallel, scene)
        self._submit = lambda tile: parallel.submit(_render, sent, tile, __version__)

    def render(self, tiles: Sequence[Tile]) -> Generator[tuple[Tile, FilmTile], None, None]:
        """Yield rendered tiles in order of completion; tiles are submitted in the order given.

        A ChildProcessError if a worker died, or the cluster was lost, and no scheduler renders its tiles again.
        """
        waiting: dict[Future[FilmTile], Tile] = {}
        distributed = sys.modules.get("distributed")  # Dask's, if it is used
        losses = (BrokenExecutor, CancelledError, *((distributed.KilledWorker,) if distributed else ()))
        try:
            for tile in tiles:
                waiting[self._submit(tile)] = tile
            for future in as_completed(list(waiting)):
                tile = waiting.pop(future)
                yield tile, future.result()
        except losses as error:
            script = ', or if a script starts the render outside of `if __name__ == "__main__":`' if self._own else ""
            raise ChildProcessError(
                f"workers died before all tiles were rendered ({type(error).__name__}: {error}). They die if memory "
                f"runs out{script}. With a checkpoint, checkpoint=DIR or --checkpoint DIR, finished tiles are kept, "
                f"and the same render resumes"
            ) from None  # the message has the reason
        finally:
            for future in waiting:
                future.cancel()

    def close(self, now: bool = False) -> None:
        """Let go of the scene, and end the executor if it is our own; do not wait for running tiles if `now`."""
        if self._own is not None:
            self._own.shutdown(wait=not now, cancel_futures=now)
        del self._submit


class _ProcessPool:
    """Threads, each of which renders its tiles in a process of its own, and knows by its pipe when that dies."""

    def __init__(self, number: int, scene: Scene) -> None:
        self._scene, self._threads, self._local = pickle.dumps(scene), ThreadPoolExecutor(number), threading.local()
        self._processes: list[Any] = []

    def submit(self, tile: Tile) -> Future[FilmTile]:
        """Return the future of a tile."""
        return self._threads.submit(self._render, tile)

    def shutdown(self, wait: bool, cancel_futures: bool) -> None:
        """End the threads, and then the processes; at once if not `wait`."""
        if wait:
            self._threads.shutdown()
        for process in self._processes:
            process.terminate()
            process.join()
        self._threads.shutdown(cancel_futures=cancel_futures)

    def _render(self, tile: Tile) -> FilmTile:
        """Return the rendered tile of the process of this thread, which is started for the first tile."""
        try:
            if not hasattr(self._local, "pipe"):
                self._local.pipe = self._start()
            self._local.pipe.send(tile)
            answer: FilmTile | Exception = self._local.pipe.recv()
        except (EOFError, OSError) as error:
            raise BrokenExecutor(f"a process has closed its pipe, {error!r}") from None
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _start(self) -> Any:
        """Start a process, and return the connection to it."""
        import multiprocessing  # imported where used: threads do without

        context = multiprocessing.get_context("spawn")  # a fork of a process with threads may hang
        ours, its = context.Pipe()
        process = context.Process(target=_serve, args=(its, loaded_plugins()), daemon=True)
        process.start()
        self._processes.append(process)
        its.close()  # so that a read ends with the process
        ours.send_bytes(self._scene)
        return ours


def _serve(pipe: Any, plugins: Sequence[Path]) -> None:
    """Render the tiles that come through a pipe until it is closed, or its other end dies; ignore Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for plugin in plugins:
        load_plugin(plugin)
    with suppress(EOFError, OSError):
        scene = pickle.loads(pipe.recv_bytes())
        while True:
            tile = pipe.recv()
            try:
                answer: FilmTile | Exception = _render(scene, tile, __version__)
            except Exception as error:
                answer = error
            pipe.send(answer)


def _render(scene: Scene | bytes, tile: Tile, version: str) -> FilmTile:
    """Render one tile in a worker."""
    if version != __version__:
        raise ValueError(
            f"all machines must have the same version of dmis, because the image depends on it; "
            f"{version} asked, and {platform.node()} has {__version__}"
        )
    return render_tile(_load(scene) if isinstance(scene, bytes) else scene, tile)


@lru_cache(maxsize=1)
def _load(data: bytes) -> Scene:
    scene: Scene = pickle.loads(data)
    return scene


def _send(executor: Any, scene: Scene) -> Any:
    """Return the pickled scene; on a Dask cluster the scene as the result of a task, which all workers there are get.

    A task, and not ``scatter``: what was scattered cannot be made again when the workers that have it are gone.
    """
    data = pickle.dumps(scene)
    if type(executor).__module__.partition(".")[0] != "distributed":
        return data
    import dask

    client = executor._client
    for plugin in loaded_plugins():
        client.upload_file(str(plugin))  # to workers that join later, too
    with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1TB"}):
        future = client.submit(_load, data, pure=False)
    if client.scheduler_info(n_workers=1)["workers"]:
        client.replicate([future])
    return future
