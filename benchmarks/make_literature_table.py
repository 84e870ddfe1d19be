"""Score the rules of examples/literature on MIS-Bench, and write their table (docs/literature.md).

Run: python benchmarks/make_literature_table.py    (a minute, with the data that mis_bench.py makes)

The scores of each scene and seed are in docs/tables/literature.csv, and their means in the table of the page.
"""

import csv
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))
from common import ROOT, replace_table

from dmis.base.plugins import load_plugin
from dmis.experiment.bench.judge import COLUMNS, score

FILES = ("hua2025", "grittmann2019", "inverse_moments", "grittmann2022")
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


def main() -> None:
    """Score all rules, write the CSV file, and replace the table of the page."""
    for name in FILES:
        load_plugin(ROOT / "examples" / "literature" / f"{name}.py")
    scores = {name: score(rule) for name, rule in RULES.items()}
    with open(ROOT / "docs" / "tables" / "literature.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["rule", "scene", "seed", *COLUMNS])
        for name, result in scores.items():
            for scene, values in result.values.items():
                writer.writerows([name, scene, seed, *(f"{x:.4g}" for x in row)] for seed, row in enumerate(values))
    rows = [["geometric mean of all scenes", "absolute", "relative"]]
    for name, result in scores.items():
        seeds = result.over_scenes()[:, :2]
        # t quantile of four seeds, over the root of their number
        half = 3.182 * seeds.std(axis=0, ddof=1) / np.sqrt(len(seeds))
        rows.append([name, *(f"{m:.2f} ± {h:.2f}" for m, h in zip(seeds.mean(axis=0), half))])
    lines = [f"| {' | '.join(row)} |" for row in rows]
    lines.insert(1, f"|{'---|' * len(rows[0])}")
    replace_table(ROOT / "docs" / "literature.md", "literature", *lines)


if __name__ == "__main__":
    main()
