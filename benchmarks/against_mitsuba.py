"""
dmis beside Mitsuba 3
=====================

Speed and error against Mitsuba's `direct` and `path` integrators: the same camera, meshes, lights and materials, one
thread each. All contestants take turns, seed by seed, so that whatever slows the machine down slows all of them; times
are medians, wall and CPU. Loading, compiling (Mitsuba's kernels, by a first render) and building are not part of any
time.

*Speed*: the light that MIS samples, alone, so that the work is the same: one light and one BRDF sample per camera
sample, balance heuristic in dmis, power heuristic in Mitsuba. ``LLVM`` has the lobes of dmis (`mitsuba_lobes`), ``own``
has the nearest of Mitsuba's BSDFs, which makes another image; ``scalar`` has these too.

*Error*: relMSE and MSE times CPU seconds of the balance heuristic of dmis over those of the best set-ups of Mitsuba
``LLVM``: a sampler, lights picked evenly or by power, an environment map with `mis_compensation` or without. All lights
of the scene shine; Mitsuba picks one for each sample, dmis samples all. First every set-up of Mitsuba renders with two
seeds. The best then takes turns with Mitsuba's default and dmis, with other seeds. Mitsuba's independent sampler gets
as many samples as take the CPU time of dmis's balance heuristic with Sobol points, the others the nearest number that
they allow. ``--tables paths`` has the same by paths. Rows go to docs/tables, from which `show_mitsuba` makes the
tables; a scene that has rows is not measured again.

Needs ``pip install mitsuba``; the LLVM columns also an LLVM library that it can find (Debian: libllvm19).
"""

import argparse
import itertools
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "examples"))
mi.set_variant("scalar_rgb")
dr.set_thread_count(1)

import mitsuba_scene
from common import SCENES, TABLES
from rows import read_rows, write_rows
from show_mitsuba import DEFAULT as OVER_DEFAULT
from show_mitsuba import ERROR_FIELDS, ERRORS, PATHS, SPEED, SPEED_FIELDS

import dmis
from dmis.experiment.convergence import MEASURES, Measure
from dmis.experiment.metrics import ratio_over_blocks, squared_error
from dmis.light.environment import EnvironmentLight

FILES = {"speed": SPEED, "errors": ERRORS, "paths": PATHS}
"""Rows of each table."""
SIZES = {name: tuple(round(n / TABLES[name]) for n in about.size) for name, about in SCENES.items()}
SIZES |= {"veach-mis": (240, 180), "cornell": (200, 200)}
"""Scenes and their resolutions; ten-lights has a spot light that Mitsuba has not."""
BY_PATHS = ("cornell", "killeroo-gold", "tt", "killeroo-diffuse")
DEPTH = 5
"""Surfaces of a path."""
SCREENING_SEED = 1000
"""First seed of the renders that Mitsuba's best set-up is chosen by."""
Render = Callable[[int, int], np.ndarray]
"""``render(spp, seed)`` gives an image ``(H, W, 3)``."""
Contestant = tuple[Callable[[], Render], int]
"""Function that gives the `Render`, and samples per pixel."""


class Setup(NamedTuple):
    """Set-up of Mitsuba."""

    sampler: str = "independent"
    by_power: bool = False
    compensated: bool = False

    def __str__(self) -> str:
        """Return the words of a table."""
        return self.sampler + ", by power" * self.by_power + ", compensated" * self.compensated


DEFAULT = Setup()
"""Mitsuba's own default."""


def setups(scene: dmis.Scene) -> list[Setup]:
    """Return the set-ups of Mitsuba that differ in `scene`."""
    skies = any(isinstance(light, EnvironmentLight) for light in scene.lights)
    choices = itertools.product(mitsuba_scene.SAMPLERS, (False, True)[: len(scene.lights)], (False, True)[: 1 + skies])
    return [Setup(*choice) for choice in choices]


def ours(scene: dmis.Scene, rule: str, sampler: str = "independent", depth: int | None = None) -> Render:
    """Return dmis on one thread: by paths of `depth` surfaces, or in direct light."""
    of_paths = {"integrator": "direct"} if depth is None else {"integrator": "path", "max_depth": depth}
    return lambda spp, seed: dmis.render(scene, rule, spp, seed=seed, sampler=sampler, parallel=1, **of_paths).image


@lru_cache(maxsize=4)
def translated(scene: dmis.Scene, variant: str, exact: bool, by_power: bool, compensated: bool) -> Any:
    """Return the Mitsuba scene of the selected variant; the last four are kept."""
    return mitsuba_scene.translate(scene, exact=exact, by_power=by_power, compensated=compensated)


def theirs(
    scene: dmis.Scene,
    variant: str = "llvm_ad_rgb",
    exact: bool = True,
    setup: Setup = DEFAULT,
    depth: int | None = None,
) -> Render:
    """Return Mitsuba on one thread: by paths of `depth` surfaces, or in direct light."""
    mi.set_variant(variant)
    world = translated(scene, variant, exact, *setup[1:])
    camera = mitsuba_scene.sensor(scene.camera, setup.sampler)
    integrator = mitsuba_scene.direct() if depth is None else mitsuba_scene.path(depth)

    def render(spp: int, seed: int) -> np.ndarray:
        mi.set_variant(variant)
        return mitsuba_scene.render(world, camera, integrator, spp, seed)

    return render


def llvm() -> bool:
    """Whether Mitsuba finds an LLVM library."""
    try:
        mi.set_variant("llvm_ad_rgb")
    except ImportError as error:
        print(f"only the scalar variant is measured: {error}", file=sys.stderr)
        return False
    return True


def timed(render: Render, spp: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return an image, and its wall and CPU seconds ``(2,)``.

    A render that compiles a kernel is done again: Mitsuba has one for each number of samples of most samplers.
    """
    dr.set_flag(dr.JitFlag.KernelHistory, True)
    for _ in range(2):
        dr.kernel_history_clear()
        wall, cpu = time.perf_counter(), time.process_time()
        image = render(spp, seed)
        seconds = np.array([time.perf_counter() - wall, time.process_time() - cpu])
        if all(kernel.get("cache_hit", True) for kernel in dr.kernel_history()):
            break
    return image, seconds


def speed(
    scene: dmis.Scene, contestants: dict[str, Render], spp: dict[str, int], repeats: int
) -> list[dict[str, object]]:
    """Return rows of the table of speeds."""
    pixels = scene.camera.resolution[0] * scene.camera.resolution[1]
    rows: list[dict[str, object]] = []
    for render in contestants.values():
        render(4, 0)
    for seed in range(1, repeats + 1):
        for name, render in contestants.items():
            _, seconds = timed(render, spp[name], seed)
            rates = [f"{rate:.4g}" for rate in pixels * spp[name] / seconds / 1e6]
            rows.append(dict(zip(SPEED_FIELDS, (scene.name, name, seed, *rates), strict=True)))
    return rows


@dataclass(frozen=True)
class Turns:
    """Renders of several contestants, seed by seed.

    Attributes
    ----------
    images
        By contestant ``(K, H, W, 3)``, one image per seed.
    seconds
        By contestant ``(K,)``, CPU seconds.
    """

    images: dict[str, np.ndarray]
    seconds: dict[str, np.ndarray]

    def errors(self, name: str, reference: dmis.Reference, measure: Measure) -> np.ndarray:
        """Return the errors of each pixel ``(H, W)``, mean over seeds."""
        return np.mean([pixel_errors(x, reference, measure) for x in self.images[name]], axis=0)

    def cost(self, name: str, reference: dmis.Reference, measure: Measure) -> float:
        """Return the error times the median of the CPU seconds."""
        return float(self.errors(name, reference, measure).mean() * np.median(self.seconds[name]))

    def ratio(self, name: str, anchor: str, reference: dmis.Reference, measure: Measure) -> tuple[float, float]:
        """Return error times CPU seconds over that of `anchor`, and half of its 95 % confidence interval.

        That of the errors is over blocks of pixels, all seeds together; that of the seconds over seeds.
        """
        from scipy.stats import t  # imported where used: scipy.stats takes half a second

        of_both = (self.errors(contestant, reference, measure) for contestant in (name, anchor))
        value, half = ratio_over_blocks(*of_both)
        logs = np.log(self.seconds[name] / self.seconds[anchor])
        error = t.ppf(0.975, len(logs) - 1) * logs.std(ddof=1) / np.sqrt(len(logs)) if len(logs) > 1 else np.nan
        value, relative = value * np.exp(logs.mean()), half / value
        return float(value), float(abs(value) * np.hypot(relative, error))

    def common(self, name: str, reference: dmis.Reference) -> float:
        """Return the share of the mean squared error that all seeds have in common, 0 without bias; it needs two."""
        images = np.asarray(self.images[name], float)
        one, k = self.errors(name, reference, "mse").mean(), len(images)
        mean = pixel_errors(images.mean(axis=0), reference, "mse").mean()
        return float((mean - one / k) / (1 - 1 / k) / one)


def pixel_errors(image: np.ndarray, reference: dmis.Reference, measure: Measure) -> np.ndarray:
    """Return the errors of the pixels of an image, ``(H, W)``, whose mean is the measure."""
    if measure == "mse":
        return squared_error(image, reference.first, reference.second)
    difference = (image - reference.first) * (image - reference.second)
    return (difference / (np.square(reference.mean) + 0.01)).mean(axis=2)


def take_turns(contestants: Mapping[str, Contestant], seeds: Iterable[int]) -> Turns:
    """Return renders of all contestants, by name, with each seed."""
    turns = [[timed(make(), spp, seed) for make, spp in contestants.values()] for seed in seeds]
    images, seconds = (np.stack([[one[k] for one in of_seed] for of_seed in turns], axis=1) for k in (0, 1))
    return Turns(dict(zip(contestants, images)), dict(zip(contestants, seconds[..., 1])))


def screen(
    scene: dmis.Scene, spp: int, depth: int | None, reference: dmis.Reference
) -> tuple[dict[str, Contestant], list[str]]:
    """Return Mitsuba's default and best set-ups as contestants, and the names of the best.

    By each measure these are the best with lights picked evenly, the best with lights picked by power or evenly, and
    the best of all, which may have `mis_compensation`; often some of them are the same.
    """
    first = range(SCREENING_SEED, SCREENING_SEED + 2)
    pair: dict[str, Contestant] = {
        "dmis": (lambda: ours(scene, "balance", "sobol", depth), spp),
        str(DEFAULT): (lambda: theirs(scene, depth=depth), spp),
    }
    seconds = {name: np.median(x) for name, x in take_turns(pair, first).seconds.items()}
    equal_time = max(1, round(spp * seconds["dmis"] / seconds[str(DEFAULT)]))
    contestants: dict[Setup, Contestant] = {
        setup: (partial(theirs, scene, setup=setup, depth=depth), mitsuba_scene.nearest_spp(setup.sampler, equal_time))
        for setup in setups(scene)
    }
    turns = take_turns({str(setup): x for setup, x in contestants.items()}, first)
    best = []
    for measure in MEASURES:
        costs = {setup: turns.cost(str(setup), reference, measure) for setup in contestants}
        for setup in sorted(costs, key=costs.__getitem__):
            print(
                f"    {measure} {setup}, {contestants[setup][1]} spp: {costs[setup] / costs[DEFAULT]:.3f}", flush=True
            )
        best += [
            min((x for x in costs if x.by_power <= power and x.compensated <= sky), key=costs.__getitem__)
            for power, sky in ((False, False), (True, False), (True, True))
        ]
    return {str(setup): contestants[setup] for setup in (DEFAULT, *best)}, [str(setup) for setup in dict.fromkeys(best)]


def compare_errors(
    scene: dmis.Scene, spp: int, seeds: int, depth: int | None, reference: dmis.Reference
) -> list[dict[str, object]]:
    """Return rows of a table of errors, four for each best set-up of Mitsuba.

    `spp` are camera samples per pixel of dmis.
    """
    contestants, anchors = screen(scene, spp, depth, reference)
    contestants["balance"] = (partial(ours, scene, "balance", "sobol", depth), spp)
    turns = take_turns(contestants, range(1, seeds + 1))
    noise = reference.mse / min(float(turns.errors(name, reference, "mse").mean()) for name in contestants)
    rows: list[dict[str, object]] = []
    for anchor in anchors:
        if seeds > 1:
            print(f"    {anchor}: error common to all seeds: {turns.common(anchor, reference):.1%}", flush=True)
        pairs = [(OVER_DEFAULT, anchor, str(DEFAULT), measure) for measure in MEASURES]
        pairs += [("balance", "balance", anchor, measure) for measure in MEASURES]
        for compared, name, base, measure in pairs:
            ratio = [f"{value:.4g}" for value in (*turns.ratio(name, base, reference, measure), noise)]
            about = (scene.name, seeds, spp, anchor, contestants[anchor][1], compared, measure)
            rows.append(dict(zip(ERROR_FIELDS, (*about, *ratio), strict=True)))
    return rows


def error_rows(scene: dmis.Scene, given: argparse.Namespace, depth: int | None) -> list[dict[str, object]]:
    """Return rows of errors of a scene, by paths of `depth` surfaces or in direct light."""
    of_paths = {"integrator": "direct"} if depth is None else {"integrator": "path", "max_depth": depth}
    reference = dmis.make_reference(scene, given.reference_spp, **of_paths)
    return compare_errors(scene, given.spp, given.repeats, depth, reference)


def speed_rows(scene: dmis.Scene, given: argparse.Namespace) -> list[dict[str, object]]:
    """Return rows of speeds of a scene."""
    alone, spp = replace(scene, lights=scene.plan.sampled), given.spp // 2
    contestants = {"dmis": ours(alone, "balance"), "LLVM": theirs(alone), "own": theirs(alone, exact=False)}
    contestants["scalar"] = theirs(alone, "scalar_rgb", exact=False)
    counts = {key: max(1, spp // 4) if key == "scalar" else spp for key in contestants}
    return speed(alone, contestants, counts, given.repeats)


def main() -> None:
    """Measure, and write rows."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[1])
    parser.add_argument("--quick", action="store_true", help="small images, rows to --folder")
    parser.add_argument("--tables", nargs="+", choices=list(FILES), default=list(FILES))
    parser.add_argument("--repeats", type=int, default=6, help="seeds of each contestant (default 6)")
    parser.add_argument("--spp", type=int, help="of dmis (default 128, by paths 64); speeds take half of it")
    parser.add_argument("--reference-spp", type=int, default=1024, help="of each half of a reference (default 1024)")
    parser.add_argument("--scenes", nargs="+", choices=list(SIZES), default=list(SIZES))
    parser.add_argument("--folder", type=Path, default=ROOT / "docs" / "tables", help="of the rows")
    given = parser.parse_args()
    if given.quick and given.folder.is_relative_to(ROOT / "docs"):
        parser.error(f"--quick needs another --folder: small images are not for {given.folder}")
    if not llvm():
        sys.exit("Mitsuba's LLVM variant is needed: DRJIT_LIBLLVM_PATH names the LLVM library")
    measured: dict[str, tuple[Any, Any, Any]] = {
        "speed": (SCENES, SPEED_FIELDS, speed_rows),
        "errors": ([name for name in SIZES if name != "cornell"], ERROR_FIELDS, partial(error_rows, depth=None)),
        "paths": (BY_PATHS, ERROR_FIELDS, partial(error_rows, depth=DEPTH)),
    }
    chosen, shrink = given.spp, 4 if given.quick else 1
    for kind in given.tables:
        csv, given.spp = given.folder / FILES[kind].name, chosen or (64 if kind == "paths" else 128)
        names, fields, rows_of = measured[kind]
        rows: list[Any] = read_rows(csv)
        present = {row["scene"] for row in rows}  # these are not measured again
        for name in (name for name in given.scenes if name in names and name not in present):
            scene = dmis.load_scene(name, tuple(round(n / shrink) for n in SIZES[name]))
            rows += rows_of(scene, given)
            write_rows(csv, rows, fields)
            print(kind, name, "done", flush=True)


if __name__ == "__main__":
    main()
