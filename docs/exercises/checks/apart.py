"""Checks a hand-in in a separate process: one that ends, hangs or takes too much memory gets a verdict.

The process has limits of CPU time and of memory, an empty working folder, and a hook that refuses what no exercise
needs: files written elsewhere, the folder of solutions, other processes, the network. That stops carelessness and
simple tricks. It is not a sandbox: check the work of strangers in a container.
"""

from __future__ import annotations

import math
import os
import resource
import shutil
import signal
import sys
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import grading
from dmis.base.plugins import load_plugin
from dmis.testing.outcome import Outcome

SOLUTIONS = Path(__file__).resolve().parent.parent / "solutions"
REFUSED = ("subprocess.", "os.system", "os.exec", "os.posix_spawn", "os.fork", "os.kill", "socket.connect")
"""Beginnings of the audit events of what no exercise needs."""
CHANGES = ("os.remove", "os.rename", "os.rmdir", "os.mkdir", "shutil.rmtree")
BUSY = 0.02
"""Least CPU seconds per second of a hand-in that computes; one that only waits is ended."""
LISTS = ("os.listdir", "os.scandir")
WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


@dataclass(frozen=True)
class Limits:
    """What a hand-in may take: CPU seconds, gigabytes; `quiet`: what it prints is not shown."""

    seconds: float = 20.0
    memory: float = 2.0
    quiet: bool = False


def check_file(number: int, file: Path, seed: int = 0, limits: Limits = Limits()) -> list[Outcome]:
    """Return the outcomes of an exercise's check for the solution in `file`.

    Raises
    ------
    ValueError
        If there is no such file, or it cannot be imported, see `dmis.base.plugins.load_plugin`.
    """
    context = get_context("spawn")
    here, there = context.Pipe(duplex=False)
    folder = tempfile.mkdtemp()
    process = context.Process(target=_report, args=(number, file.resolve(), seed, limits, folder, there))
    process.start()
    there.close()
    try:
        result = here.recv()
    except EOFError:
        process.join()
        why = f"{file.name} ended the process before its check was complete"
        if process.exitcode in (-signal.SIGXCPU, -signal.SIGKILL):
            why = f"it did not finish in {limits.seconds:g} CPU s. Does a loop never end? --seconds allows more"
        return [Outcome(f"exercise {number}", False, why)]
    finally:
        if process.is_alive():
            os.kill(process.pid, signal.SIGKILL)  # type: ignore[arg-type]
        process.join()
        shutil.rmtree(folder, ignore_errors=True)
    if isinstance(result, Exception):
        raise result
    return result


def _report(number: int, file: Path, seed: int, limits: Limits, folder: str, there: Connection) -> None:
    """Send the outcomes of the check of a file, or the error of its import; runs in the process of the hand-in."""
    from exercises import EXERCISES

    grading.SEED = seed
    os.chdir(folder)
    if limits.quiet:
        null = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(null, stream)
    sys.dont_write_bytecode = True
    _limit(limits)
    hidden = None if file.is_relative_to(SOLUTIONS) else SOLUTIONS  # the solutions are checked, too
    sys.addaudithook(lambda event, arguments: _audit(event, arguments, Path(folder).resolve(), hidden))
    try:
        result: Any = EXERCISES[number](load_plugin(file))
    except (OSError, ValueError) as error:
        result = ValueError(str(error))
    there.send(result)


def _limit(limits: Limits) -> None:
    """Limit the memory and the CPU time of this process, and end it where it waits: a busy machine costs no marks."""
    memory, seconds = int(limits.memory * 2**30), math.ceil(time.process_time() + limits.seconds)
    with suppress(OSError, ValueError):  # some systems have no limit of memory
        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    threading.Thread(target=_end_if_idle, args=(limits.seconds,), daemon=True).start()


def _end_if_idle(seconds: float) -> None:
    """End this process once it was not `BUSY` for so many seconds."""
    used = -seconds
    while time.process_time() > used + BUSY * seconds:
        used = time.process_time()
        time.sleep(seconds)
    signal.raise_signal(signal.SIGKILL)


def _audit(event: str, arguments: tuple, folder: Path, hidden: Path | None) -> None:
    """Raise a PermissionError for what a hand-in must not do; it may change files in `folder`, and not see `hidden`."""
    if event.startswith(REFUSED):
        raise PermissionError(f"a hand-in must not start processes or connect to others ({event})")
    if event not in ("open", *CHANGES, *LISTS) or not isinstance(arguments[0], str | bytes | os.PathLike):
        return
    path = Path(os.fsdecode(arguments[0])).resolve()
    if hidden and path.is_relative_to(hidden):
        raise PermissionError("a hand-in must not read the solutions")
    changes = event in CHANGES or (event == "open" and bool((arguments[2] or 0) & WRITES))
    if changes and not path.is_relative_to(folder) and str(path) != os.devnull:
        raise PermissionError(f"a hand-in must not change files outside of its folder; got {path}")
