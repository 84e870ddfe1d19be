"""
Error against run time of the rules that learn
==============================================

Measures the thesis's rule, both meanings of its weight, and `second-moment` on the thesis's four scenes at four
budgets, pilot included: the lines of the figure *Error against time* that `make_points_table` does not render. The
thesis's rule has independent points and no sky compensation, `second-moment` Sobol points and compensation.

One thread, CPU seconds, all rules in turns. Each render is a row of docs/tables/error-time.csv, written as soon as it
is made; an interrupted run continues after the last. Remove the file to measure again: some 20 minutes.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from common import ROOT, TABLES, options
from make_points_table import run_plans

CSV = ROOT / "docs" / "tables" / "error-time.csv"
BUDGETS = (128, 64, 32, 16)
RULES = (
    "thesis:weigh=heuristic,sampler=independent",
    "thesis:weigh=samples,sampler=independent",
    "second-moment:sampler=sobol",
)


def main() -> None:
    """Measure."""
    opts, given = options(
        __file__,
        "error against time of the thesis's rule and of second-moment",
        seeds={"type": int, "default": 5, "help": "number of seeds (default 5)"},
        scenes={"nargs": "+", "choices": list(TABLES), "default": list(TABLES), "help": "scenes (default: all)"},
        csv={"type": Path, "default": CSV, "help": "rows of results (default docs/tables/error-time.csv)"},
    )
    for name in given.scenes:
        scene = opts.scene(name, TABLES[name] * opts.pick(12, 1))
        run_plans(name, scene, [(RULES, spp, given.seeds) for spp in BUDGETS], given.csv, opts.pick(16, 1024))


if __name__ == "__main__":
    main()
