"""Memory: what was freed is kept for the arrays to come, or given back to the system; and how much it was at most."""

from __future__ import annotations

import ctypes
import sys
from functools import cache
from pathlib import Path

KEPT = 2**26
"""Bytes of freed arrays that the C library keeps: more than the arrays of a batch together."""
LARGE = 2**18
"""Pixels of images that are worth the hundredth of a second that it takes, and to fill the caches of malloc again."""


@cache
def keep() -> None:
    """Let the C library keep freed arrays for the next ones, from now on, and all threads share what is kept.

    By itself it gives back all but some MB at each turn, and the next batch's arrays are new pages, which the system
    fills with zeros first. And each thread that is started gets an arena of its own, of which `release` leaves the end.
    In Linux; elsewhere nothing is done.
    """
    if sys.platform == "linux":
        mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # musl has none
        if mallopt is not None:
            mallopt(-8, 1)  # M_ARENA_MAX
            mallopt(-1, KEPT)  # M_TRIM_THRESHOLD
            mallopt(-3, KEPT // 2)  # M_MMAP_THRESHOLD, at its largest


def release(pixels: int) -> None:
    """Let the C library give back what it keeps of freed arrays: between the stages of a large image some tens of MB.

    In Linux; elsewhere, and with a C library that cannot, nothing is done.
    """
    if pixels >= LARGE and sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # musl has none
        if trim is not None:
            trim(0)


def peak() -> int:
    """Peak resident memory of this process, in bytes (POSIX).

    Linux is asked directly: what `resource.getrusage` says begins with the memory of the process that started this one.
    """
    status = Path("/proc/self/status")
    if status.exists():
        (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return 1024 * int(line.split()[1])
    import resource

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most if sys.platform == "darwin" else 1024 * most
