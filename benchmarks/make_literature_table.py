"""Score the rules of examples/literature on MIS-Bench, for docs/literature.md.

Run: python benchmarks/make_literature_table.py    (a minute, with the data that mis_bench.py makes)

The scores of each scene and seed are in docs/tables/literature.csv; rules that are there are not scored again.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from rows import markdown, read_rows, write_rows

from dmis.bench.judge import COLUMNS, Score, interval

ROOT = Path(__file__).resolve().parents[1]
CSV = ROOT / "docs" / "tables" / "literature.csv"
FIELDS = ("rule", "scene", "seed", *COLUMNS)
PLUGINS = ("hua2025", "grittmann2019", "inverse_moments", "grittmann2022")
RULES = {
    "Hua et al. 2025": "hua2025",
    "Hua et al. 2025, sky": "hua2025:sky=yes",
    "Grittmann et al. 2019": "grittmann2019",
    "inverse second moments": "inverse-moments",
    "power heuristic": "pbrt",
    "thesis": "thesis",
    "Grittmann et al. 2022 (shares)": "grittmann2022",
    "`second-moment` (shares)": "second-moment",
    "best shares (oracle)": "oracle",
}
"""Rules of the table by their names there."""


def scores() -> dict[str, Score]:
    """Return the scores of all rules by their names."""
    values: dict[str, dict[str, list[list[float]]]] = {}
    for row in read_rows(CSV):
        columns = [float(row[column]) for column in COLUMNS]
        values.setdefault(row["rule"], {}).setdefault(row["scene"], []).append(columns)
    return {
        rule: Score(rule, {scene: np.array(columns) for scene, columns in scenes.items()})
        for rule, scenes in values.items()
    }


def tables() -> dict[str, list[str]]:
    """Return the lines of the block: geometric means over scenes, with intervals over seeds."""
    rows = []
    for name, score in scores().items():
        pairs = [interval(column, False) for column in score.over_scenes()[:, :2].T]
        rows.append([name, *(f"{mean:.2f} ± {half:.2f}" for mean, half in pairs)])
    return {"literature.md: literature": markdown(["geometric mean of all scenes", "absolute", "relative"], rows)}


def main() -> None:
    """Score all rules."""
    from dmis.base.plugins import load_plugin
    from dmis.bench.judge import score

    for name in PLUGINS:
        load_plugin(name)
    rows: list[Mapping[str, object]] = [*read_rows(CSV)]
    present = {row["rule"] for row in rows}
    for name, rule in RULES.items():
        if name not in present:
            for scene, values in score(rule).values.items():
                texts = [[f"{x:.4g}" for x in columns] for columns in values]
                rows += [dict(zip(FIELDS, (name, scene, n, *text), strict=True)) for n, text in enumerate(texts)]
            write_rows(CSV, rows, FIELDS)
            print(name, flush=True)


if __name__ == "__main__":
    main()
