"""Freed memory, kept and given back."""

import platform
import sys

import pytest

from dmis.experiment.speed.bench import fresh_python

GLIBC = pytest.mark.skipif(
    sys.platform != "linux" or platform.libc_ver()[0] != "glibc", reason="only glibc is told what to keep"
)
PRELUDE = """
import resource
import numpy as np
from dmis.base.malloc import keep, release

def rounds(number):
    "Page faults while memory is filled and freed again, so many times."
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(number):
        arrays = [np.ones(400_000) for _ in range(4)]
        del arrays
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

"""


def page_faults(code: str) -> int:
    """What `code` prints in a process of its own."""
    return int(fresh_python(PRELUDE + code))


@GLIBC
def test_kept_memory_is_not_filled_with_zeros_again() -> None:
    """The arrays of later rounds take the place of those of the first; by itself, the C library begins with new pages
    each time.
    """
    assert page_faults("keep(); rounds(1); print(rounds(20))") < 0.1 * page_faults("rounds(1); print(rounds(20))")


@GLIBC
def test_memory_is_kept_where_the_environment_says_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Dask starts its workers with this setting."""
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "65536")
    assert page_faults("keep(); rounds(1); print(rounds(20))") < 0.1 * page_faults("rounds(1); print(rounds(20))")


@GLIBC
def test_what_was_kept_can_be_given_back() -> None:
    """After `release`, a round begins with new pages."""
    kept = page_faults("keep(); rounds(1); print(rounds(1))")
    assert kept < 0.1 * page_faults("keep(); rounds(1); release(10**9); print(rounds(1))")
