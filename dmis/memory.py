"""Memory that was freed: kept for the arrays to come, or given back to the system."""

from __future__ import annotations

import ctypes
import sys
from functools import cache

KEPT = 2**26
"""Bytes of freed arrays that the C library keeps, per arena: more than the arrays of a batch together."""
LARGE = 2**18
"""Pixels of images that are worth the hundredth of a second that it takes, and to fill the caches of malloc again."""


@cache
def keep() -> None:
    """Let the C library keep freed arrays for the next ones, from now on.

    By itself it gives back all but some MB at each turn, and the next batch's arrays are new pages, which the system
    fills with zeros first. In Linux; elsewhere nothing is done.
    """
    if sys.platform == "linux":
        mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # musl has none
        if mallopt is not None:
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
