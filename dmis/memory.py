"""Memory that was freed, back to the system."""

from __future__ import annotations

import ctypes
import sys


def release() -> None:
    """Let the C library give back what it keeps of freed arrays, for each thread apart: tens of MB between stages.

    In Linux; elsewhere, and with a C library that cannot, nothing is done. Takes a few milliseconds.
    """
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # musl has none
        if trim is not None:
            trim(0)
