"""Memory that was freed, back to the system."""

from __future__ import annotations

import ctypes
import sys

LARGE = 2**18
"""Pixels of images that are worth the hundredth of a second that it takes, and to fill the caches of malloc again."""


def release(pixels: int) -> None:
    """Let the C library give back what it keeps of freed arrays: between the stages of a large image some tens of MB.

    In Linux; elsewhere, and with a C library that cannot, nothing is done.
    """
    if pixels >= LARGE and sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # musl has none
        if trim is not None:
            trim(0)
