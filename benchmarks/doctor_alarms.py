"""Measure the false alarms of the doctor: 1,000 small right tables of ten kinds, and 300 of random scenes of dmis.

Nine kinds are samples of a floor under square lamps, the tenth is `dmis.samples` of shipped scenes. Sizes, lamps and
lobes vary by the seed. Prints the share of alarms of each kind, and of all with its 95 % interval (Wilson).

Run: python benchmarks/doctor_alarms.py [PER_KIND [SCENES]]               (100 and 300: twelve minutes of CPU)
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from doctor_faults import small

import dmis
from dmis.geometry.shapes import quad, sphere
from dmis.geometry.transforms import translate

sys.path.insert(0, str(Path(__file__).parent.parent / "examples" / "exporters"))
import dmis_table  # type: ignore[import-not-found]

KINDS: dict[str, dict[str, Any]] = {
    "one lamp": {"spp": 128},
    "many lamps": {"lamps": 9, "spp": 48},
    "one of the lamps is picked": {"lamps": 9, "picks": True, "spp": 64},
    "few BRDF rows": {"pixels": 4, "spp": 200, "size": (0.03, 1), "gloss": 0},
    "few light rows": {"pixels": 12, "spp": 64, "size": (2, 6), "exponent": (10, 1e5)},
    "unequal counts": {"lamps": 4, "counts": (4, 0.25), "spp": 96},
    "columns that must be there": {
        "lamps": 4, "picks": True, "spp": 96, "columns": ("pixel", "camera_sample", "technique", "f", "p_l", "p_b"),
    },
    "few camera samples": {"pixels": 3, "spp": 12, "lamps": 4, "counts": (64, 64), "size": (0.6, 3)},
    "fireflies": {"lamps": 9, "bright": 4, "spp": 48},
}  # fmt: skip
"""Arguments of `floor`."""


def direction_about(axis: np.ndarray, cos: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return unit vectors at an angle to unit vectors ``(N, 3)``."""
    across = np.cross(axis, np.where(np.abs(axis[:, :1]) < 0.6, [[1, 0, 0]], [[0, 1, 0]]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    turned = np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * np.cross(axis, across)
    return cos[:, None] * axis + np.sqrt(np.maximum(1 - cos**2, 0))[:, None] * turned


def floor(
    seed: int,
    pixels: int = 16,
    spp: int = 16,
    lamps: int = 1,
    picks: bool = False,
    size: tuple[float, float] = (0.3, 3),
    exponent: tuple[float, float] = (5, 1e4),
    gloss: float = 0.5,
    counts: tuple[float, float] = (1, 1),
    bright: float = 1,
    columns: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Return a right table of a floor of matte and glossy squares under square lamps at height 1, 9 at most.

    Light samples are of each lamp, or `picks` one of them; `gloss` is the share of camera samples with a Phong lobe,
    whose `exponent`, as the lamps' width, is between limits; `bright` the standard deviation of log radiance.
    """
    rng = np.random.default_rng(seed)
    width, power = (np.exp(rng.uniform(*np.log(limits))) for limits in (size, exponent))
    width /= 3 if lamps > 1 else 1  # lamps do not overlap
    centre = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2)[:lamps] * 1.2 * width
    radiance, chance = np.exp(bright * rng.normal(size=lamps)), rng.dirichlet(np.full(lamps, 3))
    n = pixels * pixels * spp
    place = np.c_[rng.uniform(-1, 1, (n, 2)) * max(1, width), np.zeros(n)]
    shiny = np.arange(n) // spp % 16 < 16 * gloss
    mirrored = place - [0, -4, 2]  # seen from (0, -4, 2)
    mirrored *= [1, 1, -1] / np.linalg.norm(mirrored, axis=1, keepdims=True)

    def rows(sample: np.ndarray, technique: int, lamp: np.ndarray | None, met: np.ndarray) -> dict[str, np.ndarray]:
        """Return rows of directions from camera samples to points of the lamps' plane, `met`."""
        to = met - place[sample]
        distance = np.linalg.norm(to, axis=1)
        wi = to / distance[:, None]
        inside = (np.abs(met[:, None, :2] - centre) <= width / 2).all(axis=2)
        lamp = inside.argmax(axis=1) if lamp is None else lamp
        q = chance[lamp] if picks else 1
        cos = np.maximum(wi[:, 2], 1e-6)
        p_l = np.where(inside[np.arange(len(met)), lamp], q * distance**2 / (cos * width**2), 0)
        about = np.clip((wi * mirrored[sample]).sum(axis=1), 0, 1)
        p_b = np.where(shiny[sample], (power + 1) / (2 * np.pi) * about**power, cos / np.pi)
        seen = np.cos(5 * met[:, 0] + 3 * place[sample, 1]) > -0.5
        f = p_b * radiance[lamp] * seen * (p_l > 0) * np.exp(bright * np.sin(9 * met[:, 1]))
        up = np.broadcast_to([0.0, 0.0, 1.0], wi.shape)
        table = {
            "pixel": sample // spp, "camera_sample": sample % spp, "technique": np.full(len(sample), technique),
            "f": f, "p_l": p_l, "p_b": p_b, "light": lamp, "lobe": shiny[sample].astype(int), "direction": wi,
            "normal": up, "geometric_normal": up, "light_normal": -up, "distance": distance,
        }  # fmt: skip
        kept = (p_l > 0) & (p_b > 0)
        return {name: column[kept] for name, column in table.items() if not columns or name in columns}

    def drawn(count: float, times: int) -> np.ndarray:
        """Return camera samples, each `count` times on average, and that `times`."""
        return np.repeat(np.tile(np.arange(n), times), rng.binomial(1, count, n * times) if count < 1 else int(count))

    sample = drawn(counts[0], 1 if picks else lamps)
    lamp = rng.choice(lamps, len(sample), p=chance) if picks else np.arange(len(sample)) * lamps // len(sample)
    met = np.c_[centre[lamp] + width * rng.uniform(-0.5, 0.5, (len(sample), 2)), np.ones(len(sample))]
    of_light = rows(sample, 0, lamp, met)
    sample = drawn(counts[1], 1)
    u = rng.random(len(sample))
    axis = np.where(shiny[sample, None], mirrored[sample], [0, 0, 1])
    cos = np.where(shiny[sample], u ** (1 / (power + 1)), np.sqrt(u))
    wi = direction_about(axis, cos, 2 * np.pi * rng.random(len(sample)))
    up = wi[:, 2] > 1e-6
    of_brdf = rows(sample[up], 1, None, place[sample[up]] + wi[up] / wi[up, 2:])
    table = {name: np.concatenate([column, of_brdf[name]]) for name, column in of_light.items()}
    header = {"version": 1, "light_samples": counts[0], "brdf_samples": counts[1]}
    return table | header | ({} if columns else {"shape": (pixels, pixels)})


def shipped(seed: int) -> dmis.Scene:
    """Return a shipped scene of 8 to 32 pixels across."""
    return small(dmis.SHIPPED[seed % len(dmis.SHIPPED)], 8 + seed * 7 % 25)


def random_scene(seed: int) -> dmis.Scene:
    """Return a floor and balls of random materials, with lamps of three kinds and sometimes a sky."""
    rng = np.random.default_rng(seed)
    colour, rough = rng.uniform(0.1, 0.8, (9, 3)), np.exp(rng.uniform(-6, 0, 9))
    models: tuple[Any, ...] = dmis.matte, dmis.plastic, dmis.metal, dmis.substrate, dmis.shiny_metal
    lamps: list[Any] = []
    for k in range(rng.integers(1, 7)):
        centre: Any = rng.uniform([-2, -2, 0.8], [2, 2, 3])
        radius, tint = np.exp(rng.uniform(-4, 0)), tuple(rng.uniform(0.1, 9, 3))
        if k % 3 == 0:
            normal: Any = rng.normal(size=3) - [0, 0, 2]
            lamps.append(dmis.DiskLight(centre, normal, radius, tint))
        elif k % 3 == 1:
            lamps.append(dmis.SphereLight(centre, radius / 2, tint))
        else:
            lamps.append(dmis.QuadLight(centre, (radius, 0, 0), (0, -radius, 0.3 * radius), tint))
    parts = [dmis.light_part(lamp) for lamp in lamps]
    for k in range(rng.integers(1, 6)):
        kind = models[rng.integers(4 + seed % 2)]  # the exporter's labels do not tell mirrored light apart
        material = kind(colour[k]) if kind is dmis.matte else kind(colour[k], colour[-k - 1] / 2, rough[k])
        if kind is dmis.metal:
            material = kind((0.2, 0.9, 1.1), (3.9, 2.5, 2.1), rough[k])
        if k:
            mesh = sphere(rng.uniform(0.2, 0.6), 16).transformed(translate(rng.uniform([-1, -1, 0], [1, 1, 1])))
        else:
            mesh = quad((-3, -3, 0), (6, 0, 0), (0, 6, 0))
        parts.append(dmis.Part(mesh, material))
    if rng.random() < 0.4:
        lamps.append(dmis.EnvironmentLight(np.exp(2 * rng.normal(size=(8, 16, 3))).astype(np.float32)))
    size = tuple(rng.integers(6, 33, 2).tolist())
    camera = dmis.Camera.look_at((0, -4, rng.uniform(1, 3)), (0, 0, 0.3), fov=50, resolution=size)
    return dmis.Scene(camera, tuple(parts), tuple(lamps))


def trial(kind: str, seed: int) -> tuple[bool, int, str]:
    """Return whether a right table alarms, 1 if it has enough rows for a test and 2 with the joint test, and why."""
    rng = np.random.default_rng((seed, 7))
    spp = int(2 ** rng.integers(3, 8))
    table: Any
    if kind in KINDS:
        table = floor(seed, **KINDS[kind])
    elif kind == "samples of dmis":
        table = dmis.samples(shipped(seed), spp=spp, seed=seed, weight=rng.uniform(0.1, 0.9))
    elif seed % 2:
        paths: dict[str, Any] = {"integrator": "path", "max_depth": 3} if seed % 4 == 1 else {}
        table = dmis.samples(random_scene(seed), spp=spp, seed=seed, **paths)
    else:
        table = dmis_table.table(random_scene(seed), spp, seed)
    try:
        diagnosis = dmis.diagnose(table)
    except ValueError as error:
        if "both can draw" not in str(error):
            raise
        return False, 0, ""
    beyond = [f"{t.name} {t.where} {t.z:.1f}" for t in diagnosis.tests if t.trusted and abs(t.z) > diagnosis.limit]
    depth = any(test.trusted for test in diagnosis.tests) + (diagnosis.joint == diagnosis.joint)
    return not diagnosis.healthy, depth, f"{kind} {seed}: p {diagnosis.joint}, {', '.join(beyond[:3])}"


def run() -> None:
    """Print the shares of alarms."""
    counts = [int(a) for a in sys.argv[1:]] or [100, 300]
    per_kind, scenes = [*counts, 0][:2]
    alarms, tables, tested = 0, 0, 0
    for kind in (*KINDS, "samples of dmis", "random scenes"):
        begin = time.process_time()
        results = [trial(kind, seed) for seed in range(scenes if kind == "random scenes" else per_kind)]
        said, depths = [text for wrong, _, text in results if wrong], np.array([depth for _, depth, _ in results])
        alarms, tables, tested = alarms + len(said), tables + len(results), tested + int(np.count_nonzero(depths))
        tests = f"{np.count_nonzero(depths)} tested, {np.count_nonzero(depths == 2)} jointly"
        line = f"{kind}: {len(said)} of {len(results)}, {tests}, {time.process_time() - begin:.0f} s"
        print(line, *said[:9], sep="\n  ", flush=True)
    print(f"{tested} of {tables} have enough rows for a test")
    share, z = alarms / tables, 1.96
    middle = (share + z * z / 2 / tables) / (1 + z * z / tables)
    half = z * np.sqrt(share * (1 - share) / tables + (z / 2 / tables) ** 2) / (1 + z * z / tables)
    print(f"{alarms} of {tables} right tables alarm: {share:.1%} ({middle - half:.1%} to {middle + half:.1%})")


if __name__ == "__main__":
    run()
