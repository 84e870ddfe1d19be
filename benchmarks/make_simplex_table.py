"""
Several techniques: a table of docs/results.md
==============================================

Does a third technique pay? Light, BRDF and resampled light samples with shares that are learned, or given, against the
balance heuristic and the second-moment rule, which mix the first two: at equal camera samples, and in equal time, where
the error of independent samples is in proportion to 1 / time. Takes five minutes; rows go to docs/tables/simplex.csv.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

import numpy as np
from common import ROOT, bold, options, show
from pieces import FOUR
from rows import markdown, read_runs, writer

from dmis.base.plugins import load_plugin
from dmis.experiment.metrics import ratio
from dmis.experiment.runs import measure

CSV = ROOT / "docs" / "tables" / "simplex.csv"
SHRINK = {"teapot-area-light": 6, "killeroo-diffuse": 9, "killeroo-gold": 9, "tt": 10}
"""The thesis's side lengths are divided by these."""
SPP = 64
RULES = (
    "second-moment",
    "simplex:light+brdf",
    "simplex:light+brdf+resampled",
    "simplex:light+brdf+resampled,cost=no",
    "simplex:light+brdf+uniform",
    "fixed:light=0.25,brdf=0.25,resampled=0.5",
)


def tables() -> dict[str, list[str]]:
    """Return the lines of the block: MSE over that of balance, and in brackets times the ratio of CPU seconds."""
    scenes = sorted(read_runs(CSV).items(), key=lambda item: FOUR.index(item[0].split()[0]))
    rows = []
    for rule in RULES:
        cells = []
        for _, runs in scenes:
            values = {
                name: np.array([(run.mse, run.cpu_seconds) for run in runs if run.rule == name]).T
                for name in (rule, "balance")
            }
            (mse, seconds), (base_mse, base_seconds) = values[rule], values["balance"]
            time = mse.mean() / base_mse.mean() * np.median(seconds) / np.median(base_seconds)
            cells.append(f"{bold(*ratio(mse, base_mse))} ({time:.2f})")
        rows.append([f"`{rule}`", *cells])
    return {"results.md: simplex": markdown(["rule", *(name for name, _ in scenes)], rows)}


def main() -> None:
    """Measure."""
    load_plugin("simplex")
    opts, given = options(
        __file__,
        "learned and given shares of three techniques",
        seeds={"type": int, "default": 4, "help": "number of seeds (default 4)"},
        csv={"type": Path, "default": CSV, "help": "rows of results"},
    )
    for name, shrink in SHRINK.items():
        scene = opts.scene(name, shrink * opts.pick(4, 1))
        title = "{} {}×{}".format(name, *scene.camera.resolution)
        write = writer(given.csv, title)
        measure(
            scene,
            [(rule, opts.pick(16, SPP)) for rule in ("balance", *RULES)],
            range(given.seeds),
            opts.reference(scene, opts.pick(64, 1024)),
            done=read_runs(given.csv).get(title, []),
            record=lambda run, _, write=write: write(run),
            sampler="independent",
            parallel=1,
            progress=show(name),
        )


if __name__ == "__main__":
    main()
