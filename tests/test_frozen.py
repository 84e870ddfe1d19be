"""The developer's tool that freezes images before a refactoring."""

from __future__ import annotations

import frozen
import numpy as np
import pytest


def test_every_scene_and_feature_is_among_the_configurations() -> None:
    table = frozen.configurations()
    assert len(table) >= 81
    scenes = {configuration["scene"] for configuration in table.values()}
    features = {f"teapot-area-light with {feature}" for feature in frozen.FEATURES}
    assert scenes == {*frozen.SCENES, *frozen.INTERIORS, *frozen.FLAT, "tt-overcast", *features}


@pytest.mark.parametrize("feature", frozen.FEATURES)
def test_each_feature_changes_the_image(feature: str, monkeypatch) -> None:
    monkeypatch.setattr(frozen, "RESOLUTION", (8, 8))
    table = frozen.configurations()
    configuration = next(item for item in table.values() if item["scene"].endswith(f"with {feature}"))
    image = frozen.render(configuration, {})["image"]
    assert (image != frozen.render({**configuration, "scene": "teapot-area-light"}, {})["image"]).any()


def test_a_changed_bit_is_found(tmp_path, monkeypatch, capsys) -> None:
    name, configuration = next(iter(frozen.configurations().items()))
    monkeypatch.setattr(frozen, "configurations", lambda: {name: configuration})
    monkeypatch.setattr(frozen, "RESOLUTION", (8, 8))
    file = tmp_path / "before.npz"
    assert frozen.main(["write", str(file)]) == 0
    assert frozen.main(["compare", str(file)]) == 0
    with np.load(file) as stored:
        arrays = dict(stored)
    image = arrays[f"{name}|image"]
    image[3, 4, 1] = np.nextafter(image[3, 4, 1], np.float32(np.inf))
    np.savez(file, **arrays)
    capsys.readouterr()
    assert frozen.main(["compare", str(file)]) == 1
    assert "image: 1 of 192 entries differ, by at most 1 ulp" in capsys.readouterr().out


def test_each_number_of_a_fingerprint_counts() -> None:
    """A number that differs by twice the tolerance is seen, one by half of it is not; nothing else is alike."""
    rng = np.random.default_rng(0)
    shape = frozen.RESOLUTION[::-1]
    arrays = {name: rng.random(shape) for name in ("deviation", "weight", "samples")}
    arrays |= {"image": rng.random((*shape, 3)), "rays": np.array([["brdf", "3"], ["camera", "1920"]], "U32")}
    numbers = frozen.fingerprint(arrays)
    assert numbers["rays"] == 1923 and len(numbers) == 9
    for name, value in numbers.items():
        for factor, same in ((2, False), (0.5, True)):
            other = {**numbers, name: value * (1 + factor * frozen.TOLERANCE)}
            assert frozen.agree(numbers, other) == frozen.agree(other, numbers) == same, name
    assert not frozen.agree({}, numbers)
    swapped = {**arrays, "weight": arrays["weight"][::-1]}
    assert frozen.fingerprint(swapped)["weight by number"] != numbers["weight by number"]
