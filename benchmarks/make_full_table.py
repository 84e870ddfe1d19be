"""
The rules at the thesis's resolution
====================================

The thesis's rule with w a share, the second-moment rule and auto against the balance heuristic with one light and one
BRDF sample, at the size that the thesis rendered (``--full``): at equal camera samples (128, pilot included; auto:
equal shading samples), with the time of that one render beside it. Samples are independent. A quarter of an hour, and
some minutes for the references, which are kept; the result is kept with the project.
"""

import sys
from datetime import date
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, SCENES, Errors, bold, machine, options, replace_table, show

from dmis.examples.gallery import on_cpu
from dmis.experiment.runs import measure, median_seconds

opts, given = options(
    __file__,
    "the rules against the balance heuristic at the thesis's resolution",
    seeds={"type": int, "default": 1, "help": "number of seeds (default 1)"},
    page={"type": Path, "default": ROOT / "docs" / "measurements.md", "help": "the page whose table is replaced"},
)
BASE, *RULES = "balance", "thesis:weigh=samples", "second-moment", "auto"

# %%
# A million pixels need no second seed: the spread of their squared errors, in blocks that learn together, tells how
# well the mean is known. Seconds are the processor's, of one thread.
lines = [
    "| scene | balance: s | " + " | ".join(f"{rule} | time" for rule in RULES) + " |",
    "|---|---|" + "---|---|" * len(RULES),
]
for name in SCENES:
    scene = opts.scene(name, opts.pick(32, 8, 1))
    reference = opts.reference(scene, opts.pick(16, 128, 128))
    budgets = [(rule, opts.spp) for rule in (BASE, *RULES)]
    errors = Errors(reference)
    more = {"sampler": "independent", "parallel": 1, "progress": show(name), "record": errors.record}
    runs = measure(scene, budgets, range(given.seeds), reference, **more)
    base = runs[BASE, opts.spp]
    width, height = scene.camera.resolution
    cells = [f"{scene.name} {width}×{height}", f"{median_seconds(on_cpu(base)):.1f}"]
    for rule in RULES:
        own = runs[rule, opts.spp]
        value, half = errors.ratio((rule, opts.spp), (BASE, opts.spp))
        time = median_seconds(on_cpu(own)) / median_seconds(on_cpu(base))
        cells += [bold(value, half), f"× {time:.2f}"]
    lines.append("| " + " | ".join(cells) + " |")
    print(lines[-1], flush=True)

# %%
# The table goes between two marks in the page.
kind = "thesis's resolution" if opts.scene_dir is None else "thesis's resolution, original"
seeds = f"{given.seeds} seed{'s' * (given.seeds > 1)}"
about = f"Made on {date.today()} with {seeds} at {opts.spp} spp, on {machine()}."
replace_table(given.page, kind, about, "", *lines)
