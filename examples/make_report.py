"""
A report on the four scenes
===========================

Error against time of five rules on the four scenes, in one page that can be sent around: ``figures/report.html``. What
is measured is kept in ``figures/report/``, a folder for each scene, so that an interrupted run goes on where it was,
and a second one with more seeds renders only those. Made to take less than ten minutes on two quiet cores.
"""

import time
from pathlib import Path

from thesis import SCENES, options, show

from dmis.compare import compare, summary
from dmis.oracle import make_oracle
from dmis.report import write_report

opts, given = options(
    __file__,
    __doc__,
    seeds={"type": int, "default": 3, "help": "number of seeds (default 3)"},
    page={"type": Path, "help": "the page to write (default report.html beside the folder)"},
)
RULES = ("balance", "pbrt", "thesis", "second-moment", "auto")
BUDGETS = opts.pick((8, 16, 32), (16, 32, 64, 128))
SIZES = {"teapot-area-light": 4, "killeroo-diffuse": 6, "killeroo-gold": 6, "tt": 5}
"""The thesis's size is divided by this: 200x200, 228x171, 228x171 and 300x167 pixels."""
folder = opts.output.parent / "report"
page = given.page or opts.output.parent / "report.html"

# %%
# References and oracles are rendered once and kept. Each scene's folder also has a page of its own.
begun = time.perf_counter()
comparisons = []
for name, shrink in SIZES.items():
    scene = opts.scene(name, shrink * opts.pick(4, 1))
    reference = opts.reference(scene, opts.pick(64, 512))
    oracle = make_oracle(scene, opts.pick(64, 256), threads=opts.threads, progress=show(f"oracle of {name}"))
    comparison = compare(
        scene,
        RULES,
        BUDGETS,
        range(given.seeds),
        reference,
        folder / name,
        oracle=oracle,
        threads=opts.threads,
        progress=show(SCENES[name].title),
    )
    comparisons.append(comparison)
    print(f"{SCENES[name].title}, {time.perf_counter() - begun:.0f} s\n{summary(comparison.runs)}\n", flush=True)

# %%
# One page for all.
write_report(comparisons, page, "Error against time, on four scenes")
print(page)
