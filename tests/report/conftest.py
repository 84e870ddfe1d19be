"""What the tests of reports share: a comparison with its report, and a browser."""

import shutil
from pathlib import Path

import pytest

import dmis
from dmis.experiment.table import Comparison


@pytest.fixture(scope="session")
def made(box: dmis.Scene, tmp_path_factory: pytest.TempPathFactory) -> tuple[Comparison, Path]:
    """A comparison of independent samples, and its folder."""
    pytest.importorskip("matplotlib")
    folder = tmp_path_factory.mktemp("report")
    reference = dmis.make_reference(box, 64, folder=folder)
    rules, options = ["pbrt", "thesis:patch=4", "second-moment"], {"parallel": 1, "sampler": "independent"}
    return dmis.compare(box, rules, [8, 16], [0, 1], reference, folder, **options), folder


@pytest.fixture(scope="session")
def browser():
    """A headless browser; skips where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright to drive a browser")
    with playwright.sync_playwright() as driver:
        path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
        if path is None and not Path(driver.chromium.executable_path).exists():
            pytest.skip("needs chromium or google-chrome")
        found = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield found
        found.close()
