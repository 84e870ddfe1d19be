"""
What w weighs: every reading of the thesis, scored
==================================================

The thesis does not say what w weighs: numbers of samples, or the two techniques inside
the balance heuristic. Nor does it name its points, or its samples per light. This
script scores every combination on the four scenes of the thesis's Table 4.1, at half of
its side length, with

    score = sqrt(mean over scenes of ln(our ratio / the thesis's ratio)²),

where a ratio is the mean squared error of the rule over that of the balance heuristic,
over all pixels and channels, with as many samples. A score of 0 is the thesis's table,
0.1 is off by a tenth. Measure and set-ups were fixed before anything was rendered.

With independent points few samples are enough, because errors fall as 1 / spp. Sums of
errors over blocks of pixels are kept, so that an interrupted run continues, and rows
are printed as far as there are renders.

Set-ups: *numbers* are one light and one BRDF sample, or as many of each as the public
pbrt-v2 file asks for its light. Points are independent, or pbrt-v2's low-discrepancy
points, 122 for the final pass. Patches have 16 pixels; in a second column each scene
has the size of least error. With the numbers of the file, up to 32 samples at a point,
one seed is rendered, and with low-discrepancy points patches of 16 pixels alone.
"""

import itertools
import sys
from collections.abc import Sequence
from datetime import date
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from common import SCENES, machine, options, replace_table, show

import dmis
from dmis.base.patches import patch_sum
from dmis.experiment.metrics import squared_error
from dmis.experiment.reference import cache_folder
from dmis.fit.registry import make_rule

opts, given = options(
    __file__,
    "every reading of the thesis, scored",
    seeds={"type": int, "default": 3, "help": "number of seeds (default 3)"},
    setups={
        "nargs": "+",
        "help": "only these: weigh-points-numbers, such as heuristic-independent-one",
    },
    large={
        "type": int,
        "default": 0,
        "help": "seeds of the best set-ups at the thesis's resolution (default 0)",
    },
    pilots={"action": "store_true", "help": "also pilots of four samples a weight"},
    finished={"action": "store_true", "help": "render nothing"},
    page={"type": Path, "help": "gets the table between its marks 'score'"},
)
if opts.scene_dir is not None:
    sys.exit(
        "kept errors are named by scenes that come with dmis; got the scene folder"
        f" {opts.scene_dir}. Unset DMIS_PBRT_SCENES, and leave out --scene-dir."
    )
PATCHES = (4, 8, 16, 32)
BLOCK = 32
"""Side of the blocks of pixels that the bootstrap draws."""
SPP = 128
"""Camera samples of all passes."""
LIGHT_SAMPLES = {
    "teapot-area-light": 16,
    "killeroo-diffuse": 4,
    "killeroo-gold": 4,
    "tt": 8,
}
"""``nsamples`` of the public pbrt-v2 files; KILLEROO DIFFUSE has no file and takes that
of KILLEROO GOLD.
"""
WEIGHS, POINTS = ("heuristic", "samples"), ("independent", "lowdiscrepancy")
NUMBERS = ("one", "file")
SETUPS = given.setups or [
    "-".join(s) for s in itertools.product(WEIGHS, POINTS, NUMBERS)
]
MEASURED = {("independent", "one"): 32, ("independent", "file"): 8}
"""Camera samples of a final pass whose error is known to fall as 1 / spp."""
SHRINK = {"independent": 2, "lowdiscrepancy": 4}
"""Divisors of the thesis's side length by points: the second take whole renders."""
FOLDER = cache_folder() / "score"
DRAWS = 2000
"""Number of draws of the bootstrap."""


# %%
# Renders, made once.
def kept(name: str, size: str, what: str, make) -> np.ndarray:
    """Return the array of a file, made and kept at the first call."""
    path = FOLDER / f"{name}-{size}-{what}.npy"
    if not path.exists():
        if given.finished:
            raise FileNotFoundError(path)
        FOLDER.mkdir(parents=True, exist_ok=True)
        np.save(path, make())
    return np.load(path)


class Setup:
    """One reading of the thesis for one scene and seed."""

    def __init__(self, setup: str, name: str, seed: int, shrink: int = 0) -> None:
        self.weigh, self.points, self.numbers = setup.split("-")
        self.name, self.seed = name, seed
        self.shrink = opts.pick(32, shrink or SHRINK[self.points])
        width, height = SCENES[name].size
        self.resolution = round(width / self.shrink), round(height / self.shrink)

    def render(self, rule: str, spp: int) -> dmis.Result:
        """Render with the settings of this reading."""
        lights = LIGHT_SAMPLES[self.name] if self.numbers == "file" else 1
        return dmis.render(
            self.scene(),
            rule,
            spp,
            seed=self.seed,
            preset="thesis",
            integrator="direct",
            sampler=self.points,
            shading_samples=2 * lights,
            parallel=opts.threads,
            progress=show(f"{self.name}, {rule}"),
        )

    def scene(self) -> dmis.Scene:
        """Return the scene at the size of this reading."""
        return scene_of(self.name, self.shrink)

    def blocks(self, options: Sequence[str]) -> np.ndarray:
        """Return the errors of the balance heuristic and of the rule with each of the
        options, sums over blocks, ``(1 + options, blocks)``.
        """
        rules = [f"thesis:{words},weigh={self.weigh}" for words in options]
        return np.stack([self.errors("balance"), *map(self.errors, rules)])

    def errors(self, rule: str) -> np.ndarray:
        """Return the squared errors of a rule, sums over blocks, ``(blocks,)``."""
        pilot = make_rule(rule).pilot_samples(SPP)
        final = measured = SPP - pilot
        if self.shrink > 1:
            measured = MEASURED.get((self.points, self.numbers), final)

        def make() -> np.ndarray:
            result = self.render(rule, pilot + measured)
            reference = reference_of(self.name, self.shrink)
            error = squared_error(result.image, reference) * (measured / final)
            return patch_sum(error, BLOCK).astype(np.float32)

        what = f"{self.points}-{self.numbers}-{rule}-{measured}-{self.seed}"
        return kept(self.name, "{}x{}".format(*self.resolution), what, make).ravel()


@cache
def scene_of(name: str, shrink: int) -> dmis.Scene:
    """Return a scene at the thesis's side length over `shrink`."""
    return opts.scene(name, shrink)


@cache
def reference_of(name: str, shrink: int) -> dmis.Reference:
    """Return the reference of a scene."""
    scene, progress = scene_of(name, shrink), show(f"reference of {name}")
    settings = dmis.Settings(integrator="direct")
    return dmis.make_reference(
        scene,
        opts.pick(256, 256 if shrink > 1 else 64),
        settings=settings,
        parallel=opts.threads,
        progress=progress,
    )


# %%
# The score of a set-up, with the interval of a bootstrap over seeds and blocks. Set-ups
# of equal sizes draw the same seeds and blocks, so that differences are paired.
def draws(data: list[np.ndarray]) -> np.ndarray:
    """Return the ratio of each scene and its draws, ``(scenes, 1 + DRAWS)``, from the
    errors of balance and rule in the blocks, ``(seeds, 2, blocks)`` each.
    """
    ratios = []
    for number, pair in enumerate(data):
        rng = np.random.default_rng(number)
        seeds, _, count = pair.shape
        drawn = np.zeros((1 + DRAWS, 2))
        drawn[0] = pair.sum(axis=(0, 2))
        for k in range(1, 1 + DRAWS):
            chosen = pair[rng.integers(seeds, size=seeds)]
            drawn[k] = chosen[:, :, rng.integers(count, size=count)].sum(axis=(0, 2))
        ratios.append(drawn[:, 1] / drawn[:, 0])
    return np.array(ratios)


def scores(ratios: np.ndarray) -> np.ndarray:
    """Return the scores of ratios ``(scenes, ...)``."""
    told = np.array([about.equal_samples for about in SCENES.values()])
    return np.sqrt((np.log(ratios / told[:, None]) ** 2).mean(axis=0))


def publish(marks: str, about: str, lines: list[str]) -> None:
    """Print a table, and put it into the page."""
    about = f"Made on {date.today()} on {machine()}: {about}"
    print("", about, "", *lines, sep="\n", flush=True)
    if given.page is not None:
        replace_table(given.page, marks, about, "", *lines)


def interval(values: np.ndarray) -> str:
    """Return a value, the first, and the 95 % interval of its draws, the others."""
    low, high = np.quantile(values[1:], (0.025, 0.975))
    return f"{values[0]:.3f} ({low:.3f} – {high:.3f})"


def rendered(setup: str, words: Sequence[str], seeds: int, shrink: int) -> list | None:
    """Return the errors of each scene with each of the rule's options, ``(seeds, 1 +
    options, blocks)``; None if one of them is not finished.
    """
    try:
        return [
            np.stack([Setup(setup, s, k, shrink).blocks(words) for k in range(seeds)])
            for s in SCENES
        ]
    except FileNotFoundError:
        return None


def row(
    label: str, setup: str, errors: list[np.ndarray], shrink: int = 0
) -> tuple[str, np.ndarray]:
    """Return the line of errors ``(seeds, 2, blocks)`` of each scene, and its score."""
    ratios, cells = draws(errors), []
    for name, error, ratio in zip(SCENES, errors, ratios, strict=True):
        width, height = Setup(setup, name, 0, shrink).resolution
        mse = error[:, 0].sum() / len(error) / (width * height)
        cells.append(f"{ratio[0]:.3f} ± {1.96 * ratio[1:].std():.3f} ({mse:.1e})")
    score = scores(ratios)
    return f"| {label} | {' | '.join(cells)} | {interval(score)} |", score


def header(*more: str) -> list[str]:
    """Return the head of a table, and the row of the thesis."""
    told = [f"{about.equal_samples:.3f}" for about in SCENES.values()]
    return [
        f"| weigh, points, numbers | {' | '.join([*SCENES, 'score', *more])} |",
        "|---" * (2 + len(SCENES) + len(more)) + "|",
        f"| thesis | {' | '.join([*told, '0', *[''] * len(more)])} |",
    ]


lines, found = header("patches of least error", "their score"), {}
for setup in SETUPS:
    seeds = 1 if setup.endswith("file") else given.seeds
    patches = (16,) if setup.endswith("lowdiscrepancy-file") else PATCHES
    errors = rendered(setup, [f"patch={p}" for p in patches], seeds, 0)
    if errors is None:
        continue
    words = setup.replace("-", ", ")
    of_16 = [e[:, [0, 1 + patches.index(16)]] for e in errors]
    line, found[setup] = row(words, setup, of_16)
    best = [1 + int(e.sum(axis=(0, 2))[1:].argmin()) for e in errors]
    own = scores(draws([e[:, [0, k]] for e, k in zip(errors, best, strict=True)]))
    sizes = ", ".join(str(patches[k - 1]) for k in best)
    cells = ("–", "–") if len(patches) == 1 else (sizes, interval(own))
    lines.append(f"{line} {' | '.join(cells)} |")
    print(lines[-1], flush=True)
about = f"{given.seeds} seeds at half of the thesis's side length"
smaller = "; low-discrepancy points at a quarter, the file's numbers with one seed"
publish("score", f"{about}{smaller}. In brackets the MSE of balance.", lines)

# %%
# Pilots of two and of four samples for each of the three weights.
lines = header()
for weigh in WEIGHS if given.pilots else ():
    for words in ("patch=16", "patch=16,spp=4"):
        setup = f"{weigh}-independent-one"
        errors = rendered(setup, [words], given.seeds, 0)
        if errors is not None:
            lines.append(row(f"{setup}, {words}".replace("-", ", "), setup, errors)[0])
if given.pilots:
    publish("pilots", f"{about}.", lines)

# %%
# The verdict: the best set-up of each reading, at the thesis's resolution.
lines, final = header(), {}
for weigh in WEIGHS if given.large else ():
    tried = [setup for setup in found if setup.startswith(weigh)]
    if not tried:
        continue
    setup = min(tried, key=lambda setup: found[setup][0])
    errors = rendered(setup, ["patch=16"], given.large, 1)
    if errors is not None:
        line, final[weigh] = row(setup.replace("-", ", "), setup, errors, 1)
        lines.append(line)
if len(final) == len(WEIGHS):
    word = "seed" if given.large == 1 else "seeds"
    difference = final["heuristic"] - final["samples"]
    lines += ["", f"Score of `heuristic` minus `samples`: {interval(difference)}."]
    publish(
        "verdict", f"{given.large} {word} at the thesis's resolution, patch 16.", lines
    )
