"""Tuning of the C library's allocator: keep freed arrays, give them back, and measure peak memory."""

from __future__ import annotations

import ctypes
import sys
from functools import cache
from pathlib import Path

KEEP_BYTES = 2**26
"""Bytes of freed arrays that the C library keeps: more than all arrays of one batch."""
LARGE_IMAGE = 2**18
"""Pixels from which on giving memory back is worth the 0.01 s that it takes, and the refilling of malloc's caches."""


@cache
def keep() -> None:
    """Let the C library keep freed arrays for later ones, in one arena for all threads.

    By default it gives back all but some MB after each batch, and the arrays of the next batch are new pages, which the
    system first fills with zeros. By default each thread also gets an arena of its own, and `release` cannot free the
    end of an arena. Has an effect in Linux only.
    """
    _call("mallopt", -8, 1)  # M_ARENA_MAX
    _call("mallopt", -1, KEEP_BYTES)  # M_TRIM_THRESHOLD
    _call("mallopt", -3, KEEP_BYTES // 2)  # M_MMAP_THRESHOLD, at its largest


def release() -> None:
    """Let the C library give back freed arrays: some tens of MB between the stages of an image of `LARGE_IMAGE` pixels.

    Has an effect in Linux only, with a C library that has ``malloc_trim``.
    """
    _call("malloc_trim", 0)


def _call(function: str, *arguments: int) -> None:
    """Call a function of the C library, in Linux, if it has it; musl does not."""
    if sys.platform == "linux" and hasattr(library := ctypes.CDLL(None), function):
        getattr(library, function)(*arguments)


def peak() -> int:
    """Return the peak resident memory of this process, in bytes; 0 where the system does not tell, as on Windows.

    In Linux it is read from ``/proc``, because `resource.getrusage` includes the peak of the parent process.
    """
    status = Path("/proc/self/status")
    if status.exists():
        (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return 1024 * int(line.split()[1])
    try:
        import resource
    except ImportError:
        return 0
    peak_memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak_memory if sys.platform == "darwin" else 1024 * peak_memory
