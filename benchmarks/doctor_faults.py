"""Plant faults of multiple importance sampling in tables of dmis, and measure whether the doctor finds them.

Writes docs/tables/doctor-faults.csv: for each fault and scene z, the cause that is named with its factor and interval,
and the rows that z = 5 would take. False alarms: doctor_alarms.py.

Run: python benchmarks/doctor_faults.py               (six minutes)
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rows import markdown, read_rows, write_rows

import dmis
from dmis.doctor.causes import Cause
from dmis.doctor.diagnosis import UNEXPLAINED

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "examples" / "exporters"))
import dmis_table  # type: ignore[import-not-found]

CSV = ROOT / "docs" / "tables" / "doctor-faults.csv"
SCENES = {
    "density": ("teapot-area-light", "veach-mis"),
    "area": ("teapot-area-light", "veach-mis"),
    "cosine": ("teapot-area-light", "cornell"),
    "lights": ("ten-lights", "veach-mis"),
    "twice": ("teapot-area-light", "tt"),
    "sine": ("tt", "tt-overcast"),
    "two-sided": ("teapot-area-light", "killeroo-diffuse"),
    "normals": ("teapot-area-light", "tt"),
    "lobe": ("tt", "cornell"),
    "light's cosine": ("teapot-area-light", "cornell"),
    "divided": ("teapot-area-light", "tt"),
    "missing": ("ten-lights", "veach-mis"),
    "exchanged": ("teapot-area-light", "cornell"),
    "sampling": ("teapot-area-light", "cornell"),
}
"""Scenes that each fault is planted in."""
SPP = {"normals": 256}
"""Camera samples per pixel, 64 for others: normals of smooth meshes differ little."""
LOOKS = {
    "density": ("no visible change", "two different formulas for one density"),
    "area": ("bright and noisy pixels wherever the lamp shines", "a density per area: times d² / cos"),
    "cosine": ("slightly dark pixels, darkest under grazing light", "a cosine forgotten in one pdf"),
    "lights": ("dark pixels near lamps and in reflections", "probability 1/N of picking a lamp missing, N = 8"),
    "twice": ("reflections of large lamps up to twice as bright", "an emitter counted twice"),
    "sine": ("too bright below the sky's pole", "sine of the polar angle forgotten"),
    "two-sided": ("half the brightness", "a lamp sampled on both sides"),
    "normals": ("no change on smooth meshes", "shading normal confused with geometric normal"),
    "lobe": ("one material too dark", "a lobe's probability missing"),
    "light's cosine": ("slightly bright pixels near lamps seen from aside", "p_l = d² / A, without the lamp's cosine"),
    "divided": ("wrong brightness everywhere", "f divided by a density before it is divided by it"),
    "missing": ("one lamp too dark", "light samples of one lamp are never drawn"),
    "exchanged": ("bright and noisy pixels", "one branch writes p_b as p_l and p_l as p_b"),
    "sampling": ("wrong brightness that no noise explains", "samples do not follow their pdf: radius = u for sqrt(u)"),
}
"""How an image with a fault looks, and what the fault is."""
NAMES: dict[str, tuple[str, str, str] | None] = {
    "density": ("p_b", "light", ""),
    "area": ("p_l", "BRDF", "cos/d^2"),
    "cosine": ("p_b", "light", "cos"),
    "lights": ("p_l", "BRDF", ""),
    "twice": ("f", "BRDF", ""),
    "sine": ("p_l", "all", "sin z"),
    "two-sided": ("p_l", "all", ""),
    "normals": ("p_b", "light", "normals"),
    "lobe": ("p_b", "all", ""),
    "light's cosine": ("p_l", "BRDF", "cos_light"),
    "divided": ("f", "all", "pdf"),
    "missing": ("p_l", "BRDF", "missing"),
    "exchanged": ("p_l and p_b", "light", "ratio"),
    "sampling": None,
}
"""Column, rows and measure of the cause that each fault is; none of a fault that no single factor explains."""


def plant(fault: str, table: dict[str, Any], seed: int = 0) -> dict[str, Any]:
    """Return a table of `examples/exporters/dmis_table.py` as a renderer with a fault would write it.

    Parameters
    ----------
    fault
        A name of `SCENES`.
    """
    out = dict(table)
    is_light = table["technique"] == 0
    sky = np.isinf(table["distance"])
    cos = np.abs((table["normal"] * table["direction"]).sum(axis=1))
    both = table["p_l"], table["p_b"]
    if fault == "density":
        out["p_b"] = np.where(is_light, 0.93 * table["p_b"], table["p_b"])
    elif fault == "area":
        cos_light = np.abs((table["light_normal"] * table["direction"]).sum(axis=1))
        per_area = table["p_l"] * cos_light / np.where(sky, 1, np.minimum(table["distance"], 1e18)) ** 2
        out["p_l"] = np.where(is_light | sky, table["p_l"], per_area)
    elif fault == "cosine":
        out["p_b"] = np.where(is_light, table["p_b"] / np.maximum(cos, 1e-6), table["p_b"])
    elif fault == "lights":
        number = len(np.unique(table["light"]))
        out["p_l"] = np.where(is_light, table["p_l"], number * table["p_l"])
    elif fault == "twice":
        out["f"] = np.where(is_light, 1, 2)[:, None] * table["f"]
    elif fault == "sine":
        y = table["direction"][:, 2]
        out["p_l"] = np.where(sky, table["p_l"] * np.sqrt(np.maximum(1 - y * y, 1e-6)), table["p_l"])
    elif fault == "light's cosine":
        cos_light = np.abs((table["light_normal"] * table["direction"]).sum(axis=1))
        out["p_l"] = np.where(is_light | sky, table["p_l"], table["p_l"] * cos_light)
    elif fault == "divided":
        out["f"] = table["f"] / np.where(is_light, table["p_l"], table["p_b"])[:, None]
    elif fault == "exchanged":
        out |= {"p_l": np.where(is_light, *both[::-1]), "p_b": np.where(is_light, *both)}
    elif fault in ("two-sided", "missing", "sampling"):
        coins = np.random.default_rng((seed, 2)).random(len(is_light))
        kept = ~is_light | (coins < 0.5)
        if fault == "missing":
            lamp = np.bincount(table["light"][~is_light & (table["p_l"] > 0)]).argmax()
            kept = ~is_light | (table["light"] != lamp)
        if fault == "sampling":  # the more to one side of a lamp, the fewer
            order = np.lexsort((table["direction"][:, 0], table["light"], table["pixel"], ~is_light))
            group = np.stack([table["light"], table["pixel"], ~is_light])[:, order]
            starts = np.flatnonzero(np.append(True, (np.diff(group) != 0).any(axis=0)))
            counts = np.diff(starts, append=len(order))
            rank = np.empty(len(order))
            rank[order] = (np.arange(len(order)) - np.repeat(starts, counts) + 0.5) / np.repeat(counts, counts)
            kept = ~is_light | (coins > rank)
            out["light_samples"] = table["light_samples"] / 2
        out |= {name: column[kept] for name, column in table.items() if np.ndim(column) and name != "shape"}
    elif fault == "normals":
        geometric = np.abs((table["geometric_normal"] * table["direction"]).sum(axis=1))
        out["p_b"] = np.where(is_light, table["p_b"] * geometric / np.maximum(cos, 1e-6), table["p_b"])
    elif fault == "lobe":
        out["p_b"] = np.where(table["lobe"] == 2, 2, 1) * table["p_b"]
    return out


def named(fault: str, causes: Sequence[Cause]) -> bool:
    """Whether a fault is the likeliest cause, or one that gives the same table as that."""
    right = [c for c in causes if (c.column, c.rows, c.measure) == NAMES[fault]]
    return any(cause.misfit < causes[0].misfit + 1 for cause in right)


def small(name: str, side: int) -> dmis.Scene:
    """Return a shipped scene of about `side` pixels along its longer side."""
    width, height = dmis.load_scene(name).camera.resolution
    scale = side / max(width, height)
    return dmis.load_scene(name, (round(width * scale), round(height * scale)))


def table_of_faults(side: int = 96, seed: int = 3) -> list[dict[str, Any]]:
    """Return the rows of the table: each fault on its scenes."""
    lines = []
    for fault, scenes in SCENES.items():
        for scene in scenes:
            table = plant(fault, dmis_table.table(small(scene, side), SPP.get(fault, 64), seed))
            result = dmis.diagnose(table)
            explained = [cause for cause in result.causes if cause.p >= UNEXPLAINED]
            right = [c for c in explained if (c.column, c.rows, c.measure) == NAMES[fault]]
            cause = next(iter(right + explained), None)
            z_of_means = max(abs(test.z) for test in result.tests if test.trusted)
            line = {"fault": fault, "scene": scene, "rows": sum(result.rows), "found": not result.healthy}
            line |= {"named": named(fault, result.causes), "z_of_means": f"{z_of_means:.1f}"}
            if cause is not None:
                line |= {"z": f"{cause.z:.1f}"}
                if cause.measure not in ("missing", "pdf", "ratio"):  # these have no factor
                    line |= {"factor": f"{cause.factor:.3f}", "low": f"{cause.low:.3f}", "high": f"{cause.high:.3f}"}
                line |= {"causes": len(result.causes), "cause": str(cause)}
                line["rows_for_z_5"] = round(sum(result.rows) * min(1, 25 / max(cause.z, 0.1) ** 2), -2)
            line.setdefault("cause", "no fault was found" if result.healthy else "no single factor explains it")
            lines.append(line)
            print(line, flush=True)
    return lines


def tables() -> dict[str, list[str]]:
    """Return the lines of the block: what the doctor says in the first scene of each fault."""
    said: dict[str, str] = {}
    for row in reversed(read_rows(CSV)):
        cause = re.sub(r" \([\d.]+ to [\d.]+\)", "", row["cause"]).removesuffix(" times what it should be")
        said[row["fault"]] = cause.replace(" x ", " × ")
    rows = [[fault, look, said[fault], why] for fault, (look, why) in LOOKS.items()]
    return {"doctor.md: faults": markdown(["fault", "what you see", "what the doctor says", "why"], rows)}


def sentences() -> dict[str, list[str]]:
    """Return how many faults are found and named."""
    rows = read_rows(CSV)
    found, named = (sum(row[column] == "True" for row in rows) for column in ("found", "named"))
    all_found = "all " if found == len(rows) else f"{found} of "
    return {"doctor.md": [f"The doctor detects {all_found}{len(rows)} planted faults and names {named}."]}


if __name__ == "__main__":
    faults = table_of_faults()
    write_rows(CSV, faults, list(dict.fromkeys(key for line in faults for key in line)))
