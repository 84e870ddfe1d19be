"""Measure how often the interval of a render's mse_error has the mean error over seeds (docs/report.md).

Run: python benchmarks/error_coverage.py     (nine minutes)
"""

from __future__ import annotations

import numpy as np

import dmis
from dmis.experiment.metrics import mean_over_blocks, squared_error

SCENES = {
    "cornell": (64, 64),
    "killeroo-diffuse": (64, 48),
    "killeroo-gold": (64, 48),
    "teapot-area-light": (64, 64),
    "tt": (75, 42),
}
"""Scenes that are not held out, and their resolutions."""
SEEDS = 40
"""Renders of each budget; a coverage has a standard error of at most 8 %."""


def coverage(scene: dmis.Scene, rule: str, spp: int, reference: dmis.Reference, integrator: str) -> tuple[float, float]:
    """Return the share of seeds whose interval has the mean, and the root mean square of the errors over the spread."""
    images = [dmis.render(scene, rule, spp, seed=seed, integrator=integrator).image for seed in range(SEEDS)]
    means, errors = np.array([mean_over_blocks(squared_error(image, reference)) for image in images]).T
    covered = np.abs(means - means.mean()) < 1.96 * errors
    return float(covered.mean()), float(np.sqrt(np.mean(errors**2)) / means.std(ddof=1))


if __name__ == "__main__":
    print(f"{'scene':18} {'integrator':10} {'rule':8} spp  covered  rms error / spread")
    for name, resolution in SCENES.items():
        scene = dmis.load_scene(name, resolution=resolution)
        for integrator in ("direct", "path"):
            reference = dmis.make_reference(scene, 2048, integrator=integrator)
            for rule in ("balance", "auto", "thesis"):
                for spp in (16, 64):
                    covered, ratio = coverage(scene, rule, spp, reference, integrator)
                    print(f"{name:18} {integrator:10} {rule:8} {spp:3}  {covered:7.0%}  {ratio:.2f}", flush=True)
