"""
The tables of docs/paths.md
===========================

What each step saves in path tracing, five surfaces deep: low-discrepancy points, sky
compensation, Russian roulette, a light tree at scattered vertices, numbers of samples
(`counts`), and shares (`auto`). The first baseline is the balance heuristic with
independent points and none of these.

One thread, CPU seconds, rules in turns, two scenes at once. Each render is a row of
docs/tables/paths.csv, written as soon as it is made: an interrupted run continues.
Takes some 20 minutes.
"""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, TABLES, options, show
from make_points_table import scene_of
from rows import read_runs, two_at_once, writer
from show_points import SKY
from vary import set_constant

import dmis
from dmis.experiment.runs import measure

CSV = ROOT / "docs" / "tables" / "paths.csv"
SPP = 64
FEWER = 16, 32
"""More budgets of the thesis's scenes, for the figures of error against time."""
DEPTH = 5
SCENES = ("cornell", *TABLES, "ten-lights")
REFERENCE = 512
"""Samples per pixel of each half of a reference."""
MORE_SEEDS = {"cornell": 3, "killeroo-gold": 3}
"""Seeds more than for other scenes, where few paths have most of the error."""
LAMPS = ("ten-lights",)
"""Scenes with lamps enough for a light tree."""
ROULETTE, TREE = "dmis.estimator.path.ROULETTE", "dmis.scene.plan.DEEPER_LIGHTS"
"""Constants of the steps: first depth of Russian roulette, and least number of lamps for a tree."""


@dataclass(frozen=True)
class Variant:
    """A rule, and what is switched off."""

    label: str
    rule: str
    roulette: bool = True
    tree: bool = True

    @contextmanager
    def constants(self) -> Iterator[None]:
        """Set the constants, and put them back."""
        off = [name for name, on in ((ROULETTE, self.roulette), (TREE, self.tree)) if not on]
        old = {ROULETTE: 4, TREE: 4}
        try:
            for name in off:
                set_constant(name, 1000)
            yield
        finally:
            for name in off:
                set_constant(name, old[name])


PLAIN = "sampler=independent,compensation=0"
VARIANTS = (
    Variant("independent", f"balance:{PLAIN}", roulette=False, tree=False),
    Variant("points", "balance:sampler=sobol,compensation=0", roulette=False, tree=False),
    Variant("compensation", "balance:sampler=sobol", roulette=False, tree=False),
    Variant("roulette", "balance:sampler=sobol", tree=False),
    Variant("lights", "balance:sampler=sobol"),
    Variant("counts", "counts:sampler=sobol"),
    Variant("counts, absolute", "counts:sampler=sobol,error=absolute"),
    Variant("auto", "auto:sampler=sobol"),
    Variant("auto, absolute", "auto:sampler=sobol,error=absolute"),
)
"""Steps in their order; where the MSE is measured, numbers and shares make it least."""


def concerns(variant: Variant, scene: str) -> bool:
    """Return whether a variant renders another image than the step before."""
    return {"compensation": scene in SKY, "lights": scene in LAMPS}.get(variant.label, True)


def run_scene(
    name: str,
    scene: dmis.Scene,
    csv: Path,
    seeds: int,
    spp: int,
    reference_spp: int,
    variants: Sequence[Variant] = VARIANTS,
    fewer: Sequence[int] = FEWER,
) -> None:
    """Render what the file does not have yet, with `fewer` samples, too, on the thesis's scenes."""
    width, height = scene.camera.resolution
    title = f"{name} {width}×{height}"
    done = {(run.rule, run.spp, run.seed) for run in read_runs(csv).get(title, [])}
    write = writer(csv, title)
    settings = dmis.Settings(integrator="path", max_depth=DEPTH)
    about = {"settings": settings, "parallel": 1}
    wanted = [
        (variant, budget, seed)
        for budget in (spp, *(n for n in fewer if n < spp and name in TABLES))
        for seed in range(seeds + (MORE_SEEDS.get(name, 0) if budget == spp else 0))
        for variant in variants
        if concerns(variant, name) and (budget == spp or variant.label in ("independent", "roulette", "auto"))
    ]
    wanted = [turn for turn in wanted if (turn[0].label, turn[1], turn[2]) not in done]
    if not wanted:
        return
    reference = dmis.make_reference(scene, reference_spp, progress=show(f"reference of {name}"), **about)
    for k, (variant, budget, seed) in enumerate(wanted):
        with variant.constants():
            fresh = (
                dmis.load_scene(name, resolution=scene.camera.resolution)
                if name in LAMPS and not variant.tree
                else scene
            )
            runs = measure(fresh, [(variant.rule, budget)], [seed], reference, **about)
        run = replace(runs[variant.rule, budget][0], rule=variant.label)
        write(run)
        print(
            f"{k + 1}/{len(wanted)} {title} {variant.label} {budget} {seed}: relMSE {run.relmse:.3e}, "
            f"MSE {run.mse:.3e}, {run.cpu_seconds:.2f} s",
            flush=True,
        )


def main() -> None:
    """Measure."""
    opts, given = options(
        __file__,
        "what each step saves in path tracing",
        seeds={"type": int, "default": 5, "help": "number of seeds (default 5)"},
        scenes={"nargs": "+", "default": list(SCENES), "help": "scenes (default: all)"},
        csv={"type": Path, "default": CSV, "help": "rows of results"},
    )
    writer(given.csv, "")  # the head of the file
    budgets = opts.pick(8, SPP), opts.pick(32, REFERENCE)
    turns = [(name, scene_of(name, opts.pick(8, 1)), given.csv, given.seeds, *budgets) for name in given.scenes]
    list(two_at_once(run_scene, turns))


if __name__ == "__main__":
    main()
