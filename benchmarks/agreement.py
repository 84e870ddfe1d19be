"""
Do dmis and Mitsuba 3 converge to the same images?
==================================================

Both render each case with several seeds. Their means over the image must agree within the standard error over seeds,
and the means of blocks of 8x8 pixels too: z is the difference of a block over its standard error; were there no
difference but noise, its root mean square would be that of Student's distribution, given in brackets. Needs ``pip
install mitsuba`` and an LLVM library that it can find (Debian: libllvm19). Takes half an hour, most of it for KILLEROO
GOLD, whose highlights are noisy; ``--quick`` one minute.

What is compared: the four scenes as they are, with the lobes of dmis written for Mitsuba (`mitsuba_lobes`); all their
surfaces matte, with Mitsuba's own BSDF; and a teapot of mirror, glass and GGX. ``flat`` leaves interpolated normals
out: with them, dmis goes by pbrt's rule for directions between the shading and the geometric horizon, and Mitsuba by
its own.
"""

import argparse
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "examples"))

from common import SCENES, show
from rows import read_rows, write_rows

import dmis
from dmis.base.patches import patch_mean
from dmis.base.vectors import Array
from dmis.brdf.fresnel import ExactConductor
from dmis.brdf.materials import Material, glass, matte, mirror
from dmis.brdf.models import ggx

CSV = ROOT / "docs" / "tables" / "mitsuba-agreement.csv"
FIELDS = ("scene", "surfaces", "light", "seeds", "mean", "s.e.", "l2", "noise", "z")
"""Relative difference of the means over the image and its standard error, of the means of blocks and that of noise, and
root mean square of z over blocks."""
GOLD = ExactConductor((0.143124, 0.3749396, 1.442507), (3.983175, 2.385725, 1.603214))


@dataclass(frozen=True)
class Case:
    """A scene, what is changed in it, and how it is rendered; `depth` None is direct lighting."""

    title: str
    scene: str
    change: Callable[[dmis.Scene], dmis.Scene] = lambda scene: scene
    depth: int | None = None
    own: bool = False  # by Mitsuba's own BSDFs
    times: int = 1  # as many samples, where there is much noise

    def key(self) -> tuple[str, str, str]:
        """Return scene, surfaces and light, as in the rows."""
        return self.scene, self.title, "direct" if self.depth is None else f"path, {self.depth}"


def flat(scene: dmis.Scene) -> dmis.Scene:
    """No interpolated normals."""
    return replace(scene, parts=tuple(replace(part, mesh=replace(part.mesh, normals=None)) for part in scene.parts))


def all_matte(scene: dmis.Scene) -> dmis.Scene:
    """Every reflecting surface matte, in one of three colours."""
    colours = [matte((0.7, 0.5, 0.3)), matte(0.5), matte((0.2, 0.4, 0.8))]
    parts = [replace(p, material=colours[k % 3] if p.material.lobes else p.material) for k, p in enumerate(scene.parts)]
    return replace(scene, parts=tuple(parts))


def pot_of(material: Material) -> Callable[[dmis.Scene], dmis.Scene]:
    """The last part, which is the teapot, of another material."""
    return lambda scene: replace(scene, parts=(*scene.parts[:-1], replace(scene.parts[-1], material=material)))


def cases() -> list[Case]:
    """All that is compared."""
    found = []
    for name in SCENES:
        times = 16 if name == "killeroo-gold" else 1  # its highlights are noisy
        found.append(Case("as it is", name, times=times))
        found += [Case("as it is", name, depth=depth, times=times) for depth in ((1, 3) if name == "tt" else (3,))]
        if name != "killeroo-gold":  # that is killeroo-diffuse, when it is matte
            found.append(Case("matte, flat", name, lambda scene: flat(all_matte(scene)), 3, own=True))
            found.append(Case("matte", name, all_matte, 3, own=True))
    pot = "teapot-area-light"
    found.append(Case("mirror", pot, pot_of(mirror((0.9, 0.8, 0.7))), 4))
    found.append(Case("glass", pot, pot_of(glass((0.9, 0.9, 0.9), (0.7, 0.9, 0.8))), 8))
    found.append(Case("GGX gold, alpha 0.2", pot, pot_of(ggx(alpha=0.2, fresnel=GOLD)), 3))
    return found


def compare(case: Case, shrink: int, spp: int, seeds: int) -> dict[str, object]:
    """Return the row of a case."""
    import mitsuba  # here, so that the table is made without it

    mitsuba.set_variant("llvm_ad_rgb")
    import mitsuba_scene

    width, height = SCENES[case.scene].size
    scene = case.change(dmis.load_scene(case.scene, (width // shrink // 8 * 8, height // shrink // 8 * 8)))
    settings = dmis.Settings(sampler="independent")  # as Mitsuba's, so that the two variances are alike
    integrator = mitsuba_scene.direct()
    if case.depth is not None:
        settings = replace(settings, integrator="path", max_depth=case.depth)
        integrator = mitsuba_scene.path(case.depth)
    other, camera = mitsuba_scene.translate(scene, exact=not case.own), mitsuba_scene.sensor(scene.camera)
    ours, theirs = [], []
    spp *= case.times
    progress = show(f"{case.scene}, {case.title}")
    for seed in range(seeds):
        ours.append(dmis.render(scene, "balance", spp, seed=seed, settings=settings).image)
        theirs.append(mitsuba_scene.render(other, camera, integrator, spp, seed))
        if progress:
            progress("seeds", seed + 1, seeds)
    a, b = np.array(ours, float), np.array(theirs, float)
    mean, error = a.mean() / b.mean() - 1, _error(a.mean((1, 2, 3)), b.mean((1, 2, 3))) / b.mean()
    blocks = [x.reshape(seeds, x.shape[1] // 8, 8, x.shape[2] // 8, 8, 3).mean((2, 4, 5)) for x in (a, b)]
    spread = _error(*blocks)
    noise = np.sqrt((spread**2).sum() / (blocks[1].mean(0) ** 2).sum())
    z = (blocks[0].mean(0) - blocks[1].mean(0))[spread > 0] / spread[spread > 0]
    l2 = block_error(a.mean(0), b.mean(0))
    numbers = mean, error, l2, noise, np.sqrt((z * z).mean())
    cells = (*case.key(), seeds, *(f"{number:.5g}" for number in numbers))
    return dict(zip(FIELDS, cells, strict=True))


def block_error(image: Array, reference: Array, size: int = 8) -> float:
    """Return the relative L2 difference of the means over blocks, ``sqrt(sum (A - R)^2 / sum R^2)``.

    Ragged borders are left out.
    """
    size = min(size, *image.shape[:2])
    height, width = (n // size * size for n in image.shape[:2])
    whole = (np.moveaxis(np.asarray(x, np.float64)[:height, :width], 2, 0) for x in (image, reference))
    a, r = (patch_mean(x, size) for x in whole)
    return float(np.sqrt(((a - r) ** 2).sum() / (r * r).sum()))


def _error(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Standard error of the difference of two means over seeds, the first axis."""
    return np.sqrt((a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)) / len(a))


def tables() -> dict[str, list[str]]:
    """Return no tables: a page has the extremes of the rows in a sentence."""
    return {}


def sentences() -> dict[str, list[str]]:
    """Return fragments of prose with numbers, by page."""
    rows = read_rows(CSV)
    largest = max(rows, key=lambda row: abs(float(row["mean"])))
    mean, error = (100 * abs(float(largest[field])) for field in ("mean", "s.e."))
    z = [float(row["z"]) for row in rows]
    return {
        "performance.md": [
            f"In [{len(rows)} set-ups]",
            f"differ by at most {mean:.3f} ± {error:.3f} %",
            f"these differences have a root mean square of {min(z):.2f} to {max(z):.2f}",
        ]
    }


def main() -> None:
    """Compare, and write rows; cases that are there are not measured again."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[1])
    parser.add_argument("--quick", action="store_true", help="smaller images, fewer samples")
    parser.add_argument("--spp", type=int, help="camera samples per pixel and seed (default 64)")
    parser.add_argument("--seeds", type=int, default=8, help="default 8")
    parser.add_argument("--only", default="", help="cases whose scene or title has this in it")
    parser.add_argument("--csv", type=Path, default=CSV, help="rows of results")
    given = parser.parse_args()
    if given.quick and given.csv == CSV:
        parser.error(f"--quick needs another --csv: small images are not for {CSV}")
    shrink, spp = (16, 16) if given.quick else (8, 64)
    rows: list[Mapping[str, object]] = [*read_rows(given.csv)]
    present = {tuple(row[field] for field in FIELDS[:3]) for row in rows}
    for case in cases():
        if given.only in f"{case.scene} {case.title}" and case.key() not in present:
            rows.append(compare(case, shrink, given.spp or spp, given.seeds))
            print(*rows[-1].values(), flush=True)
            write_rows(given.csv, rows, FIELDS)


if __name__ == "__main__":
    main()
