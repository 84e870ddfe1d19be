"""What all tests share: where the original pbrt-v2 scenes and their converged images are, if they are here.

Neither may be redistributed, so the project does not contain them. ``DMIS_PBRT_SCENES`` and ``DMIS_REFERENCES`` name
their folders; the tests that need them skip, and say why, where the variable is not set. A variable that names no
folder is a mistake, and fails.
"""

import gc
import itertools
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
import trimesh
from helpers import load_literature, registries_kept

import dmis
from dmis import intersect
from dmis.geometry import shapes

os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # else each of the processes that tests start compiles dmis anew
sys.dont_write_bytecode = False
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for the workers of pytest-xdist, which occupy all cores
intersect.CHECK_RAYS = True  # a NaN in a ray fails a test, in place of looking like a hang

DATA = {"DMIS_PBRT_SCENES": "the original pbrt-v2 scenes", "DMIS_REFERENCES": "the converged pbrt-v2 images"}


def pytest_report_header(config: pytest.Config) -> list[str]:
    """Lines for the head of the report: which of the two folders this run has."""
    return [f"{name}: {os.environ.get(name) or f'not set; tests against {what} skip'}" for name, what in DATA.items()]


@pytest.fixture(scope="session", autouse=True)
def frozen() -> Iterator[None]:
    """Keep the collector of garbage off the thousands of tests, which live as long as the run: a tenth of its time."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()  # modules of C++ count what is left at the end


def _folder(name: str) -> Path:
    value = os.environ.get(name)
    if not value:
        pytest.skip(f"needs {DATA[name]}: set {name} to their folder")
    path = Path(value)
    if not path.is_dir():
        pytest.fail(f"{name} must name the folder of {DATA[name]}; got {value!r}, which is no folder", pytrace=False)
    return path.resolve()


@pytest.fixture(scope="session")
def pbrt_scenes() -> Path:
    """Folder of the original pbrt-v2 scenes, ``killeroo-gold.pbrt`` and so on; skips the test if there is none."""
    return _folder("DMIS_PBRT_SCENES")


@pytest.fixture(scope="session")
def references() -> Path:
    """Folder of the converged pbrt-v2 images, ``killeroo-gold.npz`` and so on; skips the test if there is none."""
    return _folder("DMIS_REFERENCES")


CACHES = itertools.count()


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Let each test begin without plugins and with an empty cache, and forget what it registers and imports.

    Modules of tests have names that begin with ``my_``.
    """
    monkeypatch.setattr("dmis.base.plugins._LOADED", [])
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setenv("DMIS_CACHE", str(tmp_path_factory.getbasetemp() / f"cache-{next(CACHES)}"))
    with registries_kept():
        yield
    for name in [name for name in sys.modules if name.startswith("my_")]:
        del sys.modules[name]


@pytest.fixture
def literature() -> SimpleNamespace:
    """The modules of examples/literature, loaded as plug-ins."""
    return load_literature()


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Folders whose plot and report `compare` would write; the test does without, since they take most of its time."""
    folders: list[Path] = []
    monkeypatch.setattr("dmis.report.compare._draw", lambda comparison, folder: folders.append(folder))
    return folders


@pytest.fixture(scope="session")
def box() -> dmis.Scene:
    """A glossy ball on a matte floor under a square light, 32x24 pixels: everything that a small render needs."""
    light = dmis.QuadLight((-1, -1, 3), (0, 2, 0), (2, 0, 0), (8, 8, 8))
    ball = trimesh.creation.icosphere(3)
    floor = shapes.quad((-5, -5, -1), (10, 0, 0), (0, 10, 0))
    parts = (
        dmis.Part(floor, dmis.matte(0.5)),
        dmis.Part(dmis.Mesh(ball.vertices, ball.faces, ball.vertices), dmis.plastic((0.5, 0.3, 0.1), 0.3, 0.02)),
    )
    camera = dmis.Camera.look_at((0, -6, 2), (0, 0, -0.2), fov=40, resolution=(32, 24))
    return dmis.Scene(camera, parts, (light, dmis.PointLight((3, -3, 3), (2, 2, 2))), "box")


@pytest.fixture
def without_plots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the plots of a comparison and of its report, which take most of its time."""
    pytest.importorskip("matplotlib")
    from dmis.report import page, plots

    monkeypatch.setattr(plots, "convergence", lambda *_: None)
    monkeypatch.setattr(page, "error_svg", lambda *_: "")
