"""Measure what a constant of the package, or a setting, is worth: error times CPU seconds over that of its first value.

One thread, values in turns with the same seeds, relMSE and MSE with 95 % intervals. For example the bounce from which
on paths may end at random, and the compensation of skies:

    python benchmarks/vary.py dmis.estimator.path.ROULETTE 3 2 4 5 --scenes cornell tt
    python benchmarks/vary.py compensation 0.9 0.95 0.99 1 --scenes tt --integrator direct --rule auto

A scene takes some two minutes; references are kept in memory only.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import defaultdict
from importlib import import_module
from typing import Any

import numpy as np

import dmis
from dmis.experiment.metrics import mse, ratio, relmse

SIZES = {
    "cornell": (128, 128),
    "teapot-area-light": (128, 128),
    "killeroo-diffuse": (152, 114),
    "killeroo-gold": (152, 114),
    "tt": (200, 111),
    "tt-overcast": (200, 111),
    "veach-mis": (160, 120),
    "ten-lights": (136, 102),
}
"""Resolutions of scenes; others have 128 x 96 pixels."""


def set_constant(path: str, value: Any) -> None:
    """Set a constant ``module.NAME``, also in modules that have imported its name."""
    module, _, name = path.rpartition(".")
    old = getattr(import_module(module), name)
    for other, loaded in list(sys.modules.items()):
        if other.startswith("dmis") and getattr(loaded, name, None) is old:
            setattr(loaded, name, value)


def number(text: str) -> float | int:
    """Return a number, whole if it is written so."""
    return int(text) if text.lstrip("-").isdigit() else float(text)


def measure(scene: dmis.Scene, given: argparse.Namespace) -> dict[float, np.ndarray]:
    """Return relMSE, MSE, each times CPU seconds, and CPU seconds of each value and seed, ``(seeds, 5)``."""
    about: dict[str, Any] = {"integrator": given.integrator, "sampler": "sobol"}
    if given.integrator == "path":
        about["max_depth"] = given.max_depth
    reference = dmis.make_reference(scene, given.reference, settings=dmis.Settings(**about))
    found = defaultdict(list)
    for seed in range(1, given.seeds + 1):
        for turn in range(len(given.values)):
            value = given.values[(turn + seed) % len(given.values)]
            setting = {} if "." in given.constant else {given.constant: value}
            if not setting:
                set_constant(given.constant, value)
            begin = time.process_time()
            image = dmis.render(scene, given.rule, given.spp, seed=seed, parallel=1, **about, **setting).image
            seconds = time.process_time() - begin
            errors = relmse(image, reference), mse(image, reference)
            found[value].append([*errors, errors[0] * seconds, errors[1] * seconds, seconds])
    return {value: np.array(rows) for value, rows in found.items()}


def main() -> None:
    """Print one table of a row for each scene and value."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("constant", help="module.NAME, or the name of a setting")
    parser.add_argument("values", nargs="+", type=number, help="its values; the first is the baseline")
    parser.add_argument("--scenes", nargs="+", default=["cornell", "killeroo-gold", "killeroo-diffuse", "tt"])
    parser.add_argument("--rule", default="balance")
    parser.add_argument("--integrator", default="path", choices=("path", "direct"))
    parser.add_argument("--max-depth", type=int, default=5)
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--reference", type=int, default=1024, help="samples per pixel of each half of the reference")
    given = parser.parse_args()
    print("| scene | value | relMSE | MSE | relMSE × CPU | MSE × CPU | CPU |", "|---" * 7 + "|", sep="\n")
    for name in given.scenes:
        found = measure(dmis.load_scene(name, resolution=SIZES.get(name, (128, 96))), given)
        baseline = found[given.values[0]]
        for value in given.values[1:]:
            ratios = (ratio(found[value][:, column], baseline[:, column]) for column in range(4))
            cells = [f"{mean:.3f} ± {half:.3f}" for mean, half in ratios]
            cpu = np.median(found[value][:, 4]) / np.median(baseline[:, 4])
            print(f"| {name} | {value:g} |", " | ".join(cells), f"| {cpu:.3f} |", flush=True)


if __name__ == "__main__":
    main()
