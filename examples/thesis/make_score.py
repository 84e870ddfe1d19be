"""
The reproduction, measured: errors of two set-ups
=================================================

The thesis does not say what w weighs: the two techniques inside the balance heuristic,
or numbers of samples. Nor does it name its points, its numbers of samples per light,
or which scenes it renders by paths. This script renders the four scenes of its Table
4.1 with two set-ups, each with both readings of w:

* **independent**: the preset ``thesis``. Independent points, one light and one BRDF
  sample, direct light; 122 samples in the final pass. It was fixed before anything was
  rendered.
* **nearest**: the preset ``nearest``. pbrt-v2's points, as many samples as the scene
  file asks for, paths on both killeroo scenes; 128 points in the final pass, because
  pbrt-v2's sampler rounds 122 up. It was chosen knowing the thesis's errors.

Squared errors are over all pixels, mean of the channels, against two independent halves
of a reference: of linear values, and of values clipped to [0, 1].

Errors of blocks of pixels are kept in the cache folder, so that an interrupted run
continues; remove its folder ``reproduction`` to render again. A row of the table of
results (``--csv``) is a render. ``score_tables.py`` makes the tables of
docs/thesis.md from these rows alone. Without ``--setups`` and ``--rules`` all
rows of that page are made, hours of work, but those of the public files: these need
``--scene-dir``, and have a table of their own.
"""

import csv
import itertools
import sys
import time
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import ROOT, SCENES, options, show

import dmis
from dmis.base.patches import patch_spread, patch_sum
from dmis.estimator.settings import make_settings
from dmis.experiment.metrics import squared_error
from dmis.experiment.reference import cache_folder
from dmis.filter import gaussian
from dmis.fit.registry import Thesis, make_rule

BLOCK = 16
"""Side of the blocks of pixels whose errors are taken as independent."""
SPP, PILOT = 128, 6
"""Camera samples of the balance heuristic, and of the rule's pilot."""
BY_PATHS = "killeroo-diffuse", "killeroo-gold"
"""Scenes that the set-up ``nearest`` renders by paths."""
RULES = {
    "balance": "balance",
    "tilt": "thesis:patch=16,weigh=heuristic",
    "shares": "thesis:patch=16,weigh=samples",
    "power": "balance:combiner=power",
}
"""Rules by the names of the table."""
REFERENCE_SPP = {"direct": 1024, "path": 512}
"""Camera samples of each half of a reference, where its sides are a quarter of the
thesis's; half of them where they are twice as long, because there are more pixels."""


@dataclass(frozen=True)
class Setup:
    """What the thesis leaves open about its renders."""

    points: str  # independent or lowdiscrepancy
    numbers: str  # one light and one BRDF sample, or those of the scene file
    by_paths: tuple[str, ...] = ()

    def settings(self, scene: dmis.Scene, name: str) -> dmis.Settings:
        """Return the settings of a scene, which has this name in the thesis."""
        options = {
            "preset": "nearest",
            "sampler": self.points,
            "integrator": "path" if name in self.by_paths else "direct",
        }
        if self.numbers == "file":
            return dmis.Settings.as_in_file(scene, **options)
        return make_settings(**options)

    def final(self) -> int:
        """Return the camera samples of the rule's final pass."""
        return SPP - PILOT if self.points == "independent" else SPP


SETUPS = {
    "independent": Setup("independent", "one"),
    "file": Setup("independent", "file"),
    "points": Setup("lowdiscrepancy", "one"),
    "points-file": Setup("lowdiscrepancy", "file"),
    "nearest": Setup("lowdiscrepancy", "file", BY_PATHS),
}
"""The two set-ups of the page, and what is between them."""


@dataclass(frozen=True)
class Printed(Thesis):
    """The thesis's rule with Eq. 3.5 as it is printed, clipped, where dmis takes the
    best pilot because the parabola is not convex."""

    def fit_variances(self, w, s2, patch):
        """Return the weights of the pixels by the printed formula."""
        y = super().fit_variances(w, s2, patch).maps["variances"]
        raw = np.clip(
            (3 * y[0] - 4 * y[1] + y[2]) / (4 * (y[0] + y[2] - 2 * y[1])), 0, 1
        )
        raw = np.where(np.isfinite(raw), raw, 0.5)
        filtered = gaussian(raw, self.sigma, self.size // 2)
        weight = patch_spread(filtered, patch, s2.shape[1:])
        return dmis.Fit(weight, {"raw": raw, "filtered": filtered})


CHOICES = {
    "patch 4": "thesis:patch=4",
    "patch 8": "thesis:patch=8",
    "patch 32": "thesis:patch=32",
    "pilots of 4": "thesis:spp=4",
    "sigma 0.5": "thesis:sigma=0.5",
    "sigma 0.7": "thesis:sigma=0.7",
    "sigma 1.25": "thesis:sigma=1.25",
    "sigma 2": "thesis:sigma=2",
    "no filter": "thesis:filter=none",
    "mean of RGB": "thesis:channels=rgb",
    "Eq. 3.5 as printed": Printed(),
}
"""Choices of dmis where the thesis is silent, as other rules; `tilt` has the others."""
MAIN_SETUPS, MAIN_RULES = ("independent", "nearest"), ("balance", "tilt", "shares")
PLANS = (
    (MAIN_SETUPS, MAIN_RULES, 8),
    (("file", "points", "points-file"), ("balance",), 1),
    (MAIN_SETUPS, ("power",), 2),
    (("independent",), tuple(CHOICES), 1),
)
"""Set-ups, rules and numbers of seeds of docs/thesis.md."""


# %%
# Renders: sums of errors over blocks of pixels, and CPU seconds, made once.
@dataclass(frozen=True)
class Render:
    """A render of the table."""

    setup: str
    scene: str
    rule: str
    seed: int

    @property
    def file(self) -> Path:
        """File of the sums."""
        scenes = "original" if opts.scene_dir else "shipped"
        words = self.setup, scenes, given.divisor, self.scene, self.rule, self.seed
        name = "-".join(map(str, words)).replace(" ", "_")
        return cache_folder() / "reproduction" / f"{name}.npz"

    def make(self) -> None:
        """Render, and keep the errors: linear and clipped, ``(2, blocks)``, divided by
        the number of pixels, so that they add up to the mean squared error."""
        setup, scene = SETUPS[self.setup], scene_of(self.scene)
        settings = setup.settings(scene, self.scene)
        final = SPP if self.rule in ("balance", "power") else setup.final()
        rule = RULES[self.rule] if self.rule in RULES else CHOICES[self.rule]
        reference = reference_of(self.scene, settings.integrator)
        begin = time.process_time()
        result = dmis.render(
            scene,
            rule,
            final + make_rule(rule).pilot_samples(SPP),
            seed=self.seed,
            settings=settings,
            parallel=opts.threads,
            progress=show(f"{self.scene}, {self.setup}, {self.rule}, {self.seed}"),
        )
        seconds = time.process_time() - begin
        three = result.image, reference.first, reference.second
        clipped = [np.clip(image, 0, 1) for image in three]
        errors = np.stack([squared_error(*three), squared_error(*clipped)])
        sums = patch_sum(errors.astype(np.float64), BLOCK) / errors[0].size
        self.file.parent.mkdir(parents=True, exist_ok=True)
        np.savez(self.file, seconds=seconds, sums=sums.reshape(2, -1))


@cache
def scene_of(name: str) -> dmis.Scene:
    """Return a scene at the chosen size."""
    return opts.scene(name, given.divisor)


@cache
def reference_of(name: str, integrator: str) -> dmis.Reference:
    """Return the reference of a scene."""
    return dmis.make_reference(
        scene_of(name),
        min(REFERENCE_SPP[integrator], REFERENCE_SPP[integrator] * given.divisor // 4),
        integrator=integrator,
        parallel=opts.threads,
        progress=show(f"reference of {name}, {integrator}"),
    )


FIELDS = ["setup", "scenes", "divisor", "scene", "rule", "seed", "blocks", "seconds"]
MEASURES = "linear", "clipped"
MOMENTS = "mse", "own", "balance", "tilt"
FIELDS += [f"{measure} {moment}" for measure in MEASURES for moment in MOMENTS]
"""Columns of the table of results. With e the errors of the blocks of a render, which
add up to its mean squared error: Σ e² (own), and Σ e e' with those of the balance
heuristic and of the tilt at the same seed. Intervals of ratios come from these."""


def row_of(render: Render) -> dict[str, object]:
    """Return the row of a render that has been made."""
    made = np.load(render.file)
    others = [
        np.load(replace(render, rule=rule).file)["sums"]
        if replace(render, rule=rule).file.exists()
        else np.full_like(made["sums"], np.nan)
        for rule in ("balance", "tilt")
    ]
    row: dict[str, object] = {
        "setup": render.setup,
        "scenes": "original" if opts.scene_dir else "shipped",
        "divisor": given.divisor,
        "scene": render.scene,
        "rule": render.rule,
        "seed": render.seed,
        "blocks": made["sums"].shape[1],
        "seconds": f"{made['seconds']:.1f}",
    }
    for k, measure in enumerate(MEASURES):
        e = made["sums"][k]
        values = [e.sum(), *((e * other[k]).sum() for other in (made["sums"], *others))]
        pairs = zip(MOMENTS, values, strict=True)
        row |= {f"{measure} {moment}": f"{v:.6g}" for moment, v in pairs}
    return row


def write_rows(rows: list[dict[str, object]]) -> None:
    """Put rows into the table of results, in the place of those of the same renders."""
    if CSV.exists():
        with open(CSV, newline="", encoding="utf-8") as file:
            rows = [*csv.DictReader(file), *rows]
    of_renders = {tuple(str(row[f]) for f in FIELDS[:6]): row for row in rows}
    CSV.parent.mkdir(parents=True, exist_ok=True)
    with open(CSV, "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, FIELDS, lineterminator="\n")
        table.writeheader()
        table.writerows(of_renders[key] for key in sorted(of_renders))


# %%
# Make the renders that are missing, and write the rows of all.
if __name__ == "__main__":
    opts, given = options(
        __file__,
        "absolute errors and ratios of the reproduction",
        setups={"nargs": "+", "help": "set-ups (default: all of the page)"},
        rules={"nargs": "+", "help": "rules (default: all of the page)"},
        scenes={"nargs": "+", "default": list(SCENES), "help": "scenes"},
        seeds={"type": int, "default": 8, "help": "number of seeds (default 8)"},
        divisor={"type": int, "default": 4, "help": "of the thesis's side length"},
        csv={"type": Path, "help": "results (default docs/tables/reproduction.csv)"},
    )
    stem = "reproduction-original" if opts.scene_dir else "reproduction"
    CSV = given.csv or ROOT / "docs" / "tables" / f"{stem}.csv"
    plans = PLANS
    if given.setups or given.rules:
        setups = given.setups or MAIN_SETUPS
        plans = ((setups, given.rules or MAIN_RULES, given.seeds),)
    # All seeds of one come before the next of another, so that a part is of use.
    wanted = (
        turn
        for setups, rules, seeds in plans
        for turn in itertools.product(
            range(min(seeds, given.seeds)), setups, given.scenes, rules
        )
    )
    for seed, setup, scene, rule in wanted:
        render = Render(setup, scene, rule, seed)
        if not render.file.exists():
            render.make()
            row = row_of(render)
            errors = ", ".join(f"{m} {float(row[f'{m} mse']):.3e}" for m in MEASURES)
            print(
                f"{setup} {scene} {rule} {seed}: {errors}, {row['seconds']} s",
                flush=True,
            )
    made = [
        render
        for setup, scene, rule, seed in itertools.product(
            SETUPS, SCENES, [*RULES, *CHOICES], range(100)
        )
        if (render := Render(setup, scene, rule, seed)).file.exists()
    ]
    write_rows([row_of(render) for render in made])
