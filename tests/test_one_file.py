"""The method in one file, against dmis: the same image but for noise, the same weights from the same samples."""

from __future__ import annotations

import ast
import importlib.util
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")

import dmis
from dmis.brdf.lobe import Lambert
from dmis.brdf.phong import Lafortune
from dmis.geometry import shapes, transforms
from dmis.variance.moments import Film, Moments

pytestmark = pytest.mark.examples
FILE = Path(__file__).parent.parent / "examples" / "one_file.py"
SHAPE = 24, 32


@pytest.fixture(scope="module")
def one():
    spec = importlib.util.spec_from_file_location("one_file", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def scene(one):
    """The scene of the file, in dmis; its balls are fine meshes."""
    height, width = SHAPE
    camera = dmis.Camera.look_at(
        tuple(one.EYE.tolist()), tuple(one.TARGET.tolist()), fov=one.FIELD_OF_VIEW, resolution=(width, height)
    )
    meshes = [shapes.quad((-500, -500, 0), (1000, 0, 0), (0, 1000, 0))]
    meshes += [shapes.sphere(1, 512).transformed(transforms.translate(centre)) for centre in one.CENTRES.T]
    parts = []
    for k, mesh in enumerate(meshes):
        k_d, k_s = (np.broadcast_to(a, 3).astype(np.float32)[:, None] for a in (one.K_D[:, k], one.K_S[k]))
        lobes = Lambert(k_d), Lafortune(k_s, np.float32(one.EXPONENT[k]))
        parts.append(dmis.Part(mesh, dmis.Material(lobes, "matte and glossy")))
    (a, b, _), corner = one.SIDES.ravel(), tuple(one.CORNER.ravel())
    lamp = dmis.QuadLight(corner, (0, b, 0), (a, 0, 0), (one.RADIANCE,) * 3)
    return dmis.Scene(camera, tuple(parts), (lamp,))


def test_one_file_reads_without_dmis(one, tmp_path, capsys) -> None:
    text = FILE.read_text("utf-8")
    tree = ast.walk(ast.parse(text))
    imports = {alias.name for node in tree if isinstance(node, ast.Import) for alias in node.names}
    assert imports == {"numpy", "matplotlib.pyplot"} and "\nfrom " not in text
    assert text.count("\n") <= 200
    assert all(f"Eq. {number}" in text or f"Eqs. {number}" in text for number in ("1.1", "1.2", "3.1", "3.2", "3.5"))
    # a small comparison prints three ratios and saves a picture
    one.draw(*one.compare((48, 64), 12), tmp_path / "picture.png")
    assert capsys.readouterr().out.count("standard error") == 3
    assert (tmp_path / "picture.png").stat().st_size > 10_000


@pytest.mark.parametrize("w", [0.1, 0.5, 0.9])
def test_one_file_agrees_with_render(one, scene, w) -> None:
    """Patches of 8 by 8 pixels agree in the mean, each by its z, and in the variance."""
    rng = np.random.default_rng(1)
    samples = np.stack([one.camera_sample(SHAPE, w, rng) for _ in range(256)])
    result = dmis.render(scene, f"fixed:{w},weigh=heuristic", 512, seed=2, sampler="independent", integrator="direct")
    error2 = samples.var(axis=0, ddof=1) / len(samples) + result.variance
    difference = one.patch_means(np.moveaxis(samples.mean(axis=0) - result.image, 2, 0))
    z = difference / np.sqrt(one.patch_means(np.moveaxis(error2, 2, 0)) / one.PATCH**2)
    assert np.abs(z).max() < 4  # 36 of them
    ratio = samples.var(axis=0, ddof=1).mean() / (result.variance.mean() * 512)
    assert ratio == pytest.approx(1, abs=0.1)


def test_one_file_has_the_weights_of_the_rule(one) -> None:
    """From the same samples the rule ``thesis`` of dmis finds the same variances and weights."""
    rng = np.random.default_rng(3)
    pilot = np.array([[one.camera_sample((96, 128), w, rng) for _ in range(2)] for w in one.STRATEGIES])
    pilot[..., : one.PATCH, : one.PATCH, :] = 0  # a patch without light
    y, raw, filtered = one.learn_weights(pilot)
    films = {w: Film.of(Moments.of(samples)) for w, samples in zip(one.STRATEGIES.tolist(), pilot)}
    fit = dmis.make_rule(f"thesis:patch={one.PATCH}").fit(films)
    assert set(fit.maps["status"].ravel()) == {0, 1, 2, 3}  # every case occurs
    np.testing.assert_allclose(y, fit.maps["variances"], rtol=1e-9)
    np.testing.assert_allclose(raw, fit.maps["raw"], atol=1e-6)
    np.testing.assert_allclose(filtered, fit.maps["filtered"], atol=1e-6)
