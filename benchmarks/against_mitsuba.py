"""
dmis beside Mitsuba 3
=====================

Speed and error against Mitsuba's `direct` integrator: the same camera, meshes, lights and materials, one thread each.
All contestants take turns, seed by seed, so that whatever slows the machine down slows all of them; times are medians,
wall and CPU. Loading, compiling (Mitsuba's kernels, by a first render) and building are not part of any time.

*Speed*: the light that MIS samples, alone, so that the work is the same: one light and one BRDF sample per camera
sample, balance heuristic in dmis, power heuristic in Mitsuba. ``LLVM`` has the lobes of dmis (`mitsuba_lobes`), ``own``
has the nearest of Mitsuba's BSDFs, which makes another image; ``scalar`` has these too.

*Error*: dmis's default rule, pilot and fit included, against Mitsuba ``LLVM``, which gets as many samples as take it
the same CPU time. Both are unbiased and converge to the same image (`agreement.py` tests that), so the mean squared
error is the variance over seeds, and no reference is needed. With all lights of a scene, Mitsuba picks one for each
sample.

Needs ``pip install mitsuba``; the LLVM columns also an LLVM library that it can find (Debian: libllvm19).
"""

import argparse
import platform
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "examples"))
mi.set_variant("scalar_rgb")
dr.set_thread_count(1)

import mitsuba_scene
from common import SCENES, TABLES, replace_table

import dmis
from dmis.experiment.metrics import ratio

PAGE = ROOT / "docs" / "performance.md"
Render = Callable[[int, int], np.ndarray]
"""``render(spp, seed)`` gives an image ``(H, W, 3)``."""


def ours(scene: dmis.Scene, rule: str) -> Render:
    """dmis on one thread."""
    return lambda spp, seed: dmis.render(scene, rule, spp, seed=seed, parallel=1).image


def theirs(scene: dmis.Scene, variant: str, exact: bool) -> Render:
    """Mitsuba on one thread."""
    mi.set_variant(variant)
    world, camera = mitsuba_scene.translate(scene, exact=exact), mitsuba_scene.sensor(scene.camera)
    integrator = mitsuba_scene.direct()

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
    """An image; its wall and CPU seconds ``(2,)``."""
    wall, cpu = time.perf_counter(), time.process_time()
    image = render(spp, seed)
    return image, np.array([time.perf_counter() - wall, time.process_time() - cpu])


def speed(scene: dmis.Scene, contestants: dict[str, Render], spp: dict[str, int], repeats: int) -> str:
    """A line of the first table: samples per second of wall and of CPU time."""
    pixels = scene.camera.resolution[0] * scene.camera.resolution[1]
    rates: dict[str, list[np.ndarray]] = {name: [] for name in contestants}
    for render in contestants.values():
        render(4, 0)
    for seed in range(1, repeats + 1):
        for name, render in contestants.items():
            _, seconds = timed(render, spp[name], seed)
            rates[name].append(pixels * spp[name] / seconds / 1e6)
    cells = []
    for runs in rates.values():
        wall, cpu = np.median(runs, axis=0)
        cells.append(f"{wall:.2f} ({cpu:.2f})")
    for name in [name for name in ("LLVM", "own") if name in rates]:
        wall, cpu = np.median(np.array(rates["dmis"]) / np.array(rates[name]), axis=0)
        cells.append(f"{wall:.2f} ({cpu:.2f})")
    return f"| {scene.name} | {' | '.join(cells)} |"


def error(scene: dmis.Scene, lights: str, mine: Render, other: Render, spp: int, repeats: int) -> str:
    """A line of the second table: mean squared errors in the same time."""
    mine(16, 0), other(16, 0)
    (_, budget), (_, same) = timed(mine, spp, 0), timed(other, spp, 0)
    other_spp = max(1, round(spp * budget[1] / same[1]))
    images: list[tuple[np.ndarray, np.ndarray]] = []
    seconds = []
    for seed in range(1, repeats + 1):
        (a, time_a), (b, time_b) = timed(mine, spp, seed), timed(other, other_spp, seed)
        images.append((a, b))
        seconds.append((time_a, time_b))
    errors = [variances(np.array(side, np.float64)) for side in zip(*images)]
    wall, cpu = np.median(seconds, axis=0).T
    value, half = (x * cpu[0] / cpu[1] for x in ratio(errors[0], errors[1]))  # error is inversely as time
    return (
        f"| {scene.name} | {lights} | {spp} | {other_spp} | {wall[0]:.2f} ({cpu[0]:.2f}) | {wall[1]:.2f} ({cpu[1]:.2f})"
        f" | {errors[0].mean():.2e} | {errors[1].mean():.2e} | {value:.3f} ± {half:.3f} |"
    )


def variances(images: np.ndarray) -> np.ndarray:
    """Mean squared error of each of K independent images ``(K, H, W, 3)``, from their spread, ``(K,)``."""
    return ((images - images.mean(axis=0)) ** 2).mean(axis=(1, 2, 3)) * len(images) / (len(images) - 1)


def main() -> None:
    """Measure, print the tables, and put them into the page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[1])
    parser.add_argument("--quick", action="store_true", help="small images: no page is written")
    parser.add_argument("--repeats", type=int, default=5, help="seeds of each contestant (default 5)")
    parser.add_argument("--spp", type=int, default=64, help="of speeds; of errors twice as many (default 64)")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES), help="default: all four")
    parser.add_argument("--page", type=Path, default=PAGE, help="the page whose tables are replaced")
    given = parser.parse_args()
    found = llvm()
    names = ["dmis", *(["LLVM", "own"] if found else []), "scalar"]
    more = ["dmis / LLVM", "dmis / own"] if found else []
    speeds = [f"| scene | {' | '.join(names + more)} |", "|---" * (1 + len(names + more)) + "|"]
    errors = [
        "| scene | lights | spp | spp of Mitsuba | seconds | of Mitsuba | MSE | of Mitsuba | ratio |",
        "|---" * 9 + "|",
    ]
    for name in given.scenes:
        width, height = SCENES[name].size
        shrink = TABLES[name] * (4 if given.quick else 1)
        whole = dmis.load_scene(name, (width // shrink, height // shrink))
        alone = replace(whole, lights=whole.plan.sampled)
        contestants = {"dmis": ours(alone, "balance")}
        if found:
            contestants["LLVM"] = theirs(alone, "llvm_ad_rgb", True)
            contestants["own"] = theirs(alone, "llvm_ad_rgb", False)
        contestants["scalar"] = theirs(alone, "scalar_rgb", False)
        spp = {key: given.spp // 4 if key == "scalar" else given.spp for key in contestants}
        speeds.append(speed(alone, contestants, spp, given.repeats))
        print(speeds[-1], flush=True)
        if found:
            pairs = [("one", alone, contestants["LLVM"])]
            if len(whole.lights) > len(alone.lights):
                pairs.append(("all", whole, theirs(whole, "llvm_ad_rgb", True)))
            for lights, scene, other in pairs:
                errors.append(error(scene, lights, ours(scene, "auto"), other, 2 * given.spp, given.repeats))
                print(errors[-1], flush=True)
    lines = [
        f"Made on {date.today()} with `benchmarks/against_mitsuba.py`: Mitsuba {mi.__version__}, {platform.machine()}, "
        f"{given.repeats} seeds. Millions of camera samples per second of wall (CPU) time:",
        *("", *speeds),
    ]
    if found:
        lines += [
            "",
            "Mean squared error in equal CPU time; ratio times that of the seconds, with its 95 % confidence interval:",
            "",
            *errors,
        ]
    print("\n".join(lines))
    if not given.quick:
        replace_table(given.page, "mitsuba-speed", *lines)


if __name__ == "__main__":
    main()
