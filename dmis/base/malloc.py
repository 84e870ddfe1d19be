"""Tuning of the C library's allocator: keep freed arrays, and measure peak memory."""

from __future__ import annotations

import ctypes
import sys
from functools import cache
from pathlib import Path

KEEP_BYTES = 2**26
"""Bytes of freed arrays that the C library keeps: more than all arrays of one batch."""


@cache
def keep() -> None:
    """Let the C library keep freed arrays for later ones, in one arena for all threads.

    By default it gives back all but some MB after each batch, and the arrays of the next batch are new pages, which the
    system first fills with zeros. By default each thread also has an arena of its own, whose freed arrays other threads
    cannot reuse. This function changes nothing but in Linux, with a C library that has ``mallopt``; musl lacks it.
    """
    if sys.platform == "linux" and hasattr(library := ctypes.CDLL(None), "mallopt"):
        library.mallopt(-8, 1)  # M_ARENA_MAX
        library.mallopt(-1, KEEP_BYTES)  # M_TRIM_THRESHOLD
        library.mallopt(-3, KEEP_BYTES // 2)  # M_MMAP_THRESHOLD, at its largest


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
