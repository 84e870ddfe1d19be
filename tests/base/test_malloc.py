"""Freed memory that is kept; systems that do not say how much there is."""

import platform
import sys
from pathlib import Path

import pytest
from helpers import fresh_python

import dmis

FAULTS = """
import resource
import numpy as np
from dmis.base.malloc import keep

def faults(number):
    "Page faults while memory is filled and freed again, so many times."
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(number):
        arrays = [np.ones(400_000) for _ in range(4)]
        del arrays
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

faults(1)
given_back = faults(20)
keep()
faults(1)
print(given_back, faults(20))
"""


@pytest.mark.skipif(
    sys.platform != "linux" or platform.libc_ver()[0] != "glibc", reason="only glibc is told what to keep"
)
def test_memory_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Arrays take the place of earlier ones, though the environment says otherwise, as that of Dask's workers does."""
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "65536")
    given_back, kept = map(int, fresh_python(FAULTS).split())
    assert kept < 0.1 * given_back


WITHOUT_POSIX = """
import sys
sys.modules["fcntl"] = sys.modules["resource"] = None
import pkgutil, pathlib, importlib
import dmis
for module in pkgutil.walk_packages(dmis.__path__, "dmis."):
    if module.name != "dmis.__main__":
        importlib.import_module(module.name)
from dmis.base import malloc
from dmis.cli.commands import main
malloc.Path = lambda _: pathlib.Path("absent")
words = ["render", "cornell", "--resolution", "16x12", "--spp", "4", "--quiet", "-o", "a.exr"]
code = main([*words, "--checkpoint", "c", "--stats", "s.json"])
print(code, malloc.peak(), *sorted(path.name for path in pathlib.Path().iterdir()))
"""


def test_systems_without_fcntl_and_resource(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows has neither: every module is imported, and an image is rendered with a checkpoint."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(Path(dmis.__file__).parents[1]))
    assert fresh_python(WITHOUT_POSIX).split() == ["0", "0", "a.exr", "s.json"]
