"""Where tiles are rendered: threads, processes of this machine, or a cluster; and how the scene gets there.

A worker gets the scene once, however many tiles it renders. Threads share it. Processes read it from a temporary
file. On a Dask cluster it is a task whose result is copied to all workers, from worker to worker; one that joins later
gets it with its first tile. Any other executor gets it with every tile.

Tiles whose worker died are rendered again: by Dask's scheduler (as often as its ``allowed-failures`` says), or in a new
pool of processes, if the pool is ours.
"""

from __future__ import annotations

import os
import pickle
import platform
import signal
import sys
import tempfile
import threading
from collections.abc import Generator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmis import __version__
from dmis.base.malloc import keep
from dmis.base.plugins import load_plugin, loaded_plugins
from dmis.base.validate import whole
from dmis.pipeline.tile import Rendered, Tile, render_tile
from dmis.scene.scene import Scene

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor

PATIENCE = 2.0
"""Seconds after the death of a process within which its pool knows of it."""
ATTEMPTS = 3
"""New pools in a row in which not one tile was finished, after which we give up."""
MAX_WORKERS = 1024
"""Largest number of threads or processes."""

MAIN_GUARD = 'if __name__ == "__main__":'
"""Line of a script under which it must start processes."""


@dataclass(frozen=True)
class Processes:
    """`number` processes of this machine, 1 to 1024, which render tiles in the place of threads.

    Tiles of a process that dies are rendered again in a new pool. A script must start the render from under
    ``if __name__ == "__main__":``.
    """

    number: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "number", whole("number of processes", self.number, 1, MAX_WORKERS))


Parallel = int | Processes | Executor | None
"""Where tiles are rendered: a number of threads, `Processes`, or any executor; None: one thread per processor."""


def check_parallel(parallel: Parallel) -> int | Processes | Executor:
    """Return `parallel`, with the number of processors in the place of None.

    Raises
    ------
    ValueError
        If it is nothing that `Parallel` names, or a number that is not from 1 to 1024.
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
    number, kind = (checked.number, "process") if isinstance(checked, Processes) else (checked, "thread")
    return f"{number} {kind}" if number == 1 else f"{number} {kind}{'es' if kind == 'process' else 's'}"


class Workers:
    """An executor with the scene at its workers; an executor of its own is shut down by `close`."""

    def __init__(self, scene: Scene, parallel: Parallel = None) -> None:
        parallel = check_parallel(parallel)
        if isinstance(parallel, Processes):
            _check_main_guard()
        keep()  # threads that are there already have their arenas
        self._processes = parallel.number if isinstance(parallel, Processes) else None
        self._fruitless = 0
        self._file: Path | None = None
        self._own = not isinstance(parallel, Executor)
        self._scene: Any = scene  # what every tile carries in the scene's place
        if isinstance(parallel, int):
            self._executor: Executor = ThreadPoolExecutor(parallel)
        elif isinstance(parallel, Processes) or _is_processes(parallel):
            with tempfile.NamedTemporaryFile(prefix="dmis-scene-", delete=False) as file:
                pickle.dump(scene, file)
            self._scene = self._file = Path(file.name)
            self._executor = self._pool() if isinstance(parallel, Processes) else parallel
        else:
            self._executor = parallel
            if _is_dask(parallel):
                self._scene = _send(parallel, scene)

    def render(self, tiles: Sequence[Tile]) -> Generator[tuple[Tile, Rendered], None, None]:
        """Yield rendered tiles in order of completion; tiles are submitted in the order given.

        Raises
        ------
        ChildProcessError
            If workers died, or the cluster was lost, and no one is left to try again.
        """
        while tiles:
            lost, reason = yield from self._round(tiles)
            if reason is not None:
                self._recover(lost, reason, len(lost) < len(tiles))
            tiles = lost

    def close(self, now: bool = False) -> None:
        """Let go of the scene, and end the executor if it is our own; do not wait for running tiles if `now`."""
        if self._own:
            self._executor.shutdown(wait=not now, cancel_futures=now)
        if self._file is not None:
            self._file.unlink(missing_ok=True)
        self._scene = None

    def _round(
        self, tiles: Sequence[Tile]
    ) -> Generator[tuple[Tile, Rendered], None, tuple[list[Tile], Exception | None]]:
        """Every tile once; returns those that were lost, and why."""
        waiting: dict[Future[Rendered], Tile] = {}
        lost: list[Tile] = []
        reason: Exception | None = None
        over = threading.Event()
        try:
            for k, tile in enumerate(tiles):
                try:
                    waiting[self._executor.submit(_render, self._scene, tile, __version__)] = tile
                except BrokenExecutor as error:
                    reason = error
                    lost.extend(tiles[k:])
                    break
            if _is_processes(self._executor):
                threading.Thread(target=_watch, args=(self._executor, over), daemon=True).start()
            for future in as_completed(list(waiting)):
                tile = waiting.pop(future)
                try:
                    rendered = future.result()
                except _losses() as error:
                    reason = error
                    lost.append(tile)
                else:
                    yield tile, rendered
        finally:
            over.set()
            for future in waiting:
                future.cancel()
        return lost, reason

    def _recover(self, lost: Sequence[Tile], reason: Exception, fruitful: bool) -> None:
        self._fruitless = 0 if fruitful else self._fruitless + 1
        if self._own and self._processes and self._fruitless < ATTEMPTS:
            self._executor.shutdown(wait=False)
            self._executor = self._pool()
            return
        first = lost[0]
        again, hint = "", ", or if the scheduler of a cluster does"
        if self._own:
            again = f"in {ATTEMPTS} new pools in a row "
            hint = f"; or, in a script, if what starts the render is not under `{MAIN_GUARD}`"
        raise ChildProcessError(
            f"{len(lost)} tiles were lost {again}with the workers that rendered them, the first at rows "
            f"{first.rows[0]} to {first.rows[1]}, columns {first.columns[0]} to {first.columns[1]} "
            f"({type(reason).__name__}: {reason}). Tiles are lost if memory runs out{hint}. "
            "Finished ones are kept if there is a checkpoint"
        ) from None  # the message has the reason

    def _pool(self) -> ProcessPoolExecutor:
        assert self._file is not None
        import multiprocessing  # imported where used: threads do without
        from concurrent.futures import ProcessPoolExecutor

        context = multiprocessing.get_context("spawn")  # a fork of a process with threads may hang
        return ProcessPoolExecutor(
            self._processes, context, initializer=_start, initargs=(self._file, loaded_plugins())
        )


def _check_main_guard() -> None:
    """Raise a RuntimeError in a worker process that runs the user's script again, because it has no main guard.

    Every worker of every new pool would print a traceback of 40 lines: it is left out here, and the workers end.
    """
    import multiprocessing

    if getattr(multiprocessing.current_process(), "_inheriting", False):
        sys.tracebacklimit = 0
        raise RuntimeError(
            f"a script that renders with dmis.Processes must start it under `{MAIN_GUARD}`, because each process "
            f"imports the script. Indent the render under that line"
        )


def _render(scene: Scene | Path, tile: Tile, version: str) -> Rendered:
    """Render one tile in a worker."""
    if version != __version__:
        raise ValueError(
            f"all machines must have the same version of dmis, because the image depends on it; "
            f"{version} asked, and {platform.node()} has {__version__}"
        )
    keep()
    return render_tile(_read(scene) if isinstance(scene, Path) else scene, tile)


@lru_cache(maxsize=1)
def _read(path: Path) -> Scene:
    return _load(path.read_bytes())


def _load(data: bytes) -> Scene:
    scene: Scene = pickle.loads(data)
    return scene


def _start(file: Path, plugins: Sequence[Path]) -> None:
    """A worker process begins: Ctrl-C is for the process that started it, and it ends when that one does. It knows the
    plugins of that process.
    """
    import multiprocessing
    from multiprocessing.connection import wait

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            wait([parent.sentinel])
            file.unlink(missing_ok=True)
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    for plugin in plugins:
        load_plugin(plugin)


def _watch(pool: Any, over: threading.Event) -> None:
    """End a pool of processes that does not know that one of them died, unless all tiles are `over`.

    One that is killed while it sends a result leaves half a message, and the pool waits for the rest: the pipe is open
    as long as the other processes are there, and there is an end of it in this process.
    """
    from multiprocessing.connection import wait

    processes = list((pool._processes or {}).values())
    while not wait([process.sentinel for process in processes], timeout=0.5):
        if over.is_set():
            return
    if over.wait(PATIENCE) or pool._broken:
        return
    for process in processes:
        process.kill()
    _close_for_good(pool._result_queue._writer)


def _close_for_good(connection: Any) -> None:
    """Close a connection that the pool's own shutdown closes, too, perhaps at the same moment.

    A connection forgets its handle after closing it. A second ``close`` in between, from another thread, would close
    that handle again: an error, or the end of another file that has got the same number.
    """
    handle, connection._handle = connection.fileno(), None
    type(connection)(handle).close()


def _is_processes(executor: Executor) -> bool:
    from concurrent.futures import ProcessPoolExecutor

    return isinstance(executor, ProcessPoolExecutor)


def _is_dask(executor: Executor) -> bool:
    return type(executor).__module__.partition(".")[0] == "distributed"


def _send(executor: Any, scene: Scene) -> Any:
    """The scene as the result of a task, at all workers there are.

    A task, and not ``scatter``: what was scattered cannot be made again when the workers that have it are gone.
    """
    import dask

    client = executor._client
    for plugin in loaded_plugins():
        client.upload_file(str(plugin))  # to workers that join later, too
    with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1TB"}):
        future = client.submit(_load, pickle.dumps(scene), pure=False)
    if client.scheduler_info(n_workers=1)["workers"]:
        client.replicate([future])
    return future


def _losses() -> tuple[type[Exception], ...]:
    """Return the errors of a future whose worker died or whose cluster is gone."""
    distributed = sys.modules.get("distributed")
    return (BrokenExecutor, CancelledError, *((distributed.KilledWorker,) if distributed else ()))
