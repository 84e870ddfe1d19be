"""
The table of docs/rules.md
==========================

What the second-moment rule and auto save on each scene: with equal camera samples (128, pilot included), in equal time
by measurement, and beside the oracle, which knows the best weights. Baseline is one light and one BRDF sample with the
balance heuristic. Takes half an hour; the result is kept with the project, once for the scenes that come with dmis, and
once (``--scene-dir``) for the original ones.
"""

import sys
from datetime import date
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import IN_TIME, ROOT, TABLES, cell, in_time, machine, options, replace_table, show

import dmis
from dmis.experiment.oracle import make_oracle
from dmis.experiment.runs import measure, median_seconds, on_cpu, spp_in_time

PAGE = ROOT / "docs" / "rules.md"
NOISY = {"killeroo-gold": 4, "env": 4}
"""Scenes whose error is that of a few bright pixels, and how many times the seeds they get."""

opts, given = options(
    __file__,
    "the second-moment rule and auto against the balance heuristic and the oracle",
    seeds={"type": int, "default": 5, "help": "number of seeds (default 5)"},
    sampler={"default": "independent", "help": "of all rules (default independent)"},
    page={"type": Path, "default": PAGE, "help": "the page whose table is replaced"},
)
BASE = f"balance:sampler={given.sampler}"

# %%
# Ratios of mean squared errors over the same seeds, with 95 % confidence intervals; bold where the rule wins. Equal
# samples tell how many samples fit in the time of the balance heuristic; with that number they are measured again, and
# error times time is compared. Time is the processor's, of one thread.
lines = [
    "| scene | oracle, weights only | the same, equal time | second-moment:cost=no, equal samples | saving / oracle's "
    "| harm | second-moment, equal time | auto, equal shading samples | auto, equal time |",
    "|---|---|---|---|---|---|---|---|---|",
]
for name, shrink in TABLES.items():
    scene = opts.scene(name, shrink * opts.pick(4, 1))
    seeds = range(given.seeds * NOISY.get(scene.name, 1))
    reference = opts.reference(scene, opts.pick(64, 1024))
    known = {"parallel": opts.threads, "progress": show("oracle")}
    oracle = make_oracle(scene, opts.pick(64, 1024), **known)
    weights, costly, auto = (
        f"{rule},sampler={given.sampler}"
        for rule in ("second-moment:cost=no", "second-moment:cost=yes", "auto:cost=yes")
    )
    more = {"parallel": 1, "progress": show(name)}
    runs = measure(scene, [(rule, opts.spp) for rule in (BASE, weights, costly, auto)], seeds, reference, **more)
    base = runs[BASE, opts.spp]
    timed = dict.fromkeys((costly, auto), opts.spp)
    found = runs
    for some in (seeds[:2], seeds[:2], seeds):  # twice to find the numbers, which are then as good as times are
        seconds = median_seconds(on_cpu(found[BASE, opts.spp]))
        timed = {rule: spp_in_time(seconds, on_cpu(found[rule, spp])) for rule, spp in timed.items()}
        found = measure(scene, [(BASE, opts.spp), *timed.items()], some, reference, **more)
    fair, texts = [], in_time([found[budget] for budget in timed.items()], found[BASE, opts.spp])
    for budget, text in zip(timed.items(), texts):
        share = median_seconds(on_cpu(found[budget])) / median_seconds(on_cpu(found[BASE, opts.spp]))
        fair.append(f"{text} ({budget[1]} spp, time × {share:.2f})")
    saved, harmed = [], []
    for rule in (weights, costly):
        for seed in seeds:
            result = dmis.render(scene, rule, 8, seed=seed, parallel=opts.threads)
            combined = make_oracle(scene, opts.pick(64, 1024), combiner=result.provenance["combiner"], **known)
            saved.append(oracle.saving(result.weight, combined))
            harmed.append(oracle.harm(result.weight, combined)[0])
    saving = np.mean(saved[: len(seeds)])
    harm = " / ".join(f"{each:.1%}" for each in np.reshape(harmed, (2, -1)).mean(axis=1))
    width, height = scene.camera.resolution
    times = f", {len(seeds)} seeds" if scene.name in NOISY else ""
    lines.append(
        f"| {scene.name} {width}×{height}{times} | {oracle.limit():.3f} | {oracle.limit(costly=True):.3f} "
        f"| {cell(runs[weights, opts.spp], base)} | {saving:.0%} | {harm} "
        f"| {fair[0]} | {cell(runs[auto, opts.spp], base)} | {fair[1]} |"
    )
    print(lines[-1], flush=True)

# %%
# The table goes between two marks in the page.
kind = f"{'original' if opts.scene_dir else 'shipped'} {given.sampler}"
about = f"Made on {date.today()} with {given.seeds} seeds, {given.sampler} camera samples, on {machine()}; one thread."
about += f" {IN_TIME}"
replace_table(given.page, kind, about, "", *lines)
