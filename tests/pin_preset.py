"""Block means of small images of the presets, which no later change may alter.

    python tests/pin_preset.py      renders every configuration and writes tests/data/preset_thesis.npz

Unlike the hashes of `frozen` these hold for all processors, as means over blocks of 4x4 pixels with standard errors:
other processors round differently, which flips single shadow rays. `tests/estimator/test_presets.py` compares them.
Write them anew only with a new configuration, or when the preset itself was wrong; the commit says which.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import dmis

FILE = Path(__file__).with_name("data") / "preset_thesis.npz"
RESOLUTION = (48, 36)
BLOCK = 4
SPP = 16
SEED = 7
SCENES = ("teapot-area-light", "killeroo-diffuse", "killeroo-gold", "tt", "ten-lights")
"""Those of the thesis, and one with lights of all shapes."""
PRESET = "thesis-shares"
"""It differs from ``thesis`` in what w is where a rule leaves that open."""
RULES = ("balance", "pbrt", "thesis:patch=8", "thesis:patch=8,weigh=heuristic")
"""Balance and power heuristic, and the thesis's rule."""
SAMPLERS = ("independent", "lowdiscrepancy")
INTEGRATORS = ("direct", "path")
CLOSE, SHARE, FAR = 1e-5, 0.98, 5.0
"""Relative difference, or a thousandth of the standard error, that `SHARE` of the blocks keep; z that all keep."""


def configurations(scenes: tuple[str, ...] = SCENES) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield scene, rule and options of each image."""
    for scene in scenes:
        for rule in RULES:
            for sampler in SAMPLERS:
                for integrator in INTEGRATORS:
                    yield scene, rule, {"sampler": sampler, "integrator": integrator}


def blocks(result: dmis.Result) -> np.ndarray:
    """Return means and standard errors of the blocks of an image, ``(2, rows, columns, 3)`` float32."""
    height, width = result.image.shape[:2]
    shape = height // BLOCK, BLOCK, width // BLOCK, BLOCK, 3
    mean = result.image.reshape(shape).mean(axis=(1, 3), dtype=np.float64)
    error = np.sqrt(result.variance.reshape(shape).sum(axis=(1, 3))) / BLOCK**2
    return np.stack([mean, error]).astype(np.float32)


def render_all(names: tuple[str, ...] = SCENES, step: int = 1) -> dict[str, np.ndarray]:
    """Return the blocks of every configuration of some scenes by name, or of one configuration in `step`."""
    scenes = {name: dmis.load_scene(name, resolution=RESOLUTION) for name in names}
    images = {}
    for scene, rule, options in list(configurations(names))[::step]:
        result = dmis.render(scenes[scene], rule, SPP, seed=SEED, preset=PRESET, **options)
        images[f"{scene} {rule} {options['sampler']} {options['integrator']}"] = blocks(result)
    return images


def differences(before: Mapping[str, np.ndarray], after: Mapping[str, np.ndarray]) -> Iterator[str]:
    """Yield a line for each configuration in which too many blocks differ, and for each with blocks too far off."""
    if before.keys() != after.keys():
        yield f"configurations differ: {', '.join(sorted(before.keys() ^ after.keys()))}"
        return
    for name, (old, old_error) in before.items():
        new, new_error = after[name]
        off = np.abs(new - old)
        share = float((off <= np.maximum(CLOSE * np.abs(old), 1e-3 * old_error)).all(axis=-1).mean())  # rounding
        if share < SHARE:
            yield f"{name}: {share:.1%} of the blocks agree to {CLOSE:g}, and {SHARE:.0%} must"
        if far := int((off > FAR * np.maximum(old_error, new_error) + CLOSE * np.abs(old)).sum()):
            yield f"{name}: {far} of {off.size} values are more than {FAR:g} standard errors off"


if __name__ == "__main__":
    FILE.parent.mkdir(exist_ok=True)
    np.savez_compressed(FILE, **render_all())
