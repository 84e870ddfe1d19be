"""Integrator and depth that scene files ask for."""

from dataclasses import replace

import pytest

import dmis
from dmis.pipeline.fingerprint import fingerprint


def test_fingerprint_has_the_depth() -> None:
    """References of scenes that suggest other depths differ."""
    scene = dmis.load_scene("cornell", resolution=(8, 8))
    assert fingerprint(replace(scene, suggested=replace(scene.suggested, max_depth=2))) != fingerprint(scene)


@pytest.mark.parametrize("integrator", ["bdpt", "auto", 0])
def test_integrators_that_are_none(integrator: object) -> None:
    with pytest.raises(ValueError, match=f"integrator must be direct or path, or None; got {integrator!r}"):
        dmis.Suggestions(integrator)  # type: ignore[arg-type]


@pytest.mark.parametrize("depth", [0, 0.5, "auto"])
def test_depths_that_are_none(depth: object) -> None:
    with pytest.raises(ValueError, match=f"max_depth must be a whole number from 1 to 10000, or None; got {depth!r}"):
        dmis.Suggestions("path", depth)  # type: ignore[arg-type]


def test_scenes_take_suggestions_only() -> None:
    with pytest.raises(ValueError, match=r"suggested must be dmis\.Suggestions, such as those of a file; got 'path'"):
        replace(dmis.load_scene("cornell", resolution=(8, 8)), suggested="path")
