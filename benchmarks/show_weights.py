"""Tables of docs/mis-bench.md and of bounds in docs/results.md, and the figure of bounds, from docs/tables alone."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from functools import cache
from pathlib import Path

import numpy as np
from rows import markdown, read_rows

from dmis.base.vectors import Array
from dmis.bench.judge import COLUMNS, Score, interval

TABLES = Path(__file__).resolve().parents[1] / "docs" / "tables"
SCORES_CSV, BOUNDS_CSV, RENDERS_CSV = (TABLES / f"{n}.csv" for n in ("mis-bench", "weight-bounds", "weight-renders"))
VALIDATED_CSV = TABLES / "mis-bench-renders.csv"
SCORE_FIELDS = ("rule", "scene", "part", *COLUMNS)
"""`part` is a seed of small images, and a group of blocks that is left out of large ones."""
BOUND_FIELDS = ("scene", "size", "width", "height", "measure", "bound", "value", "half")
RENDER_FIELDS = ("scene", "bound", "w", "value", "half")
MEASURES = ("absolute", "relative")
VALIDATED_FIELDS = ("scene", "rule", *(f"{kind} {m}" for kind in ("predicted", "measured", "s.e.") for m in MEASURES))
REQUIRED = ("fixed:0.25", "balance", "fixed:0.75", "random", "thesis")
"""Rules whose predictions are validated; those of `OTHERS` with less precision, for the order of all ten."""
OTHERS = ("thesis:weigh=samples", "second-moment", "auto", "pbrt", "fixed:1")
LITERATURE = {
    "Hua et al. 2025": "hua2025",
    "Grittmann et al. 2019": "grittmann2019",
    "inverse second moments": "inverse-moments",
    "Grittmann et al. 2022 (shares)": "grittmann2022",
    **{name: name for name in ("taylor", "inverse-variance", "neyman", "representativity", "kl", "tsallis")},
}
"""Rules of examples/literature, by their names in tables."""
FILES = {rule: rule.replace("-", "_") for rule in list(LITERATURE.values())[:4]}
"""Files of examples/literature by rule; rules that are not here are in objectives.py."""
TILTS_OF_PATCHES = "best tilts"
"""Name of the best tilt of each patch among the scores."""
KINDS = (
    "camera samples",
    "one tilt",
    "tilt per patch",
    "one share",
    "share per patch",
    "share and tilt",
    "counts",
    "counts and shares",
    "counts, shares and tilts",
)
"""The part of the variance at w = 1/2 that comes from where camera samples meet the scene; `weight_bounds.BOUNDS`."""
AUTO = "shares of auto"
TILTS = ("thesis", "Hua et al. 2025", "Grittmann et al. 2019")
SHARES = ("light only", "second-moment", AUTO)
"""Rules whose distance to the best tilts, and to the best shares, the page shows."""
SHOWN = {"thesis": "s", "Hua et al. 2025": "D", "second-moment": "^", "shares of auto": "v"}
"""Rules of the figure, and their marks."""
Rows = list[list[str]]
Scores = Mapping[str, Score]


# Scores -------------------------------------------------------------------------------------------------------------


@cache
def scores(full: bool) -> dict[str, Score]:
    """Return the scores of all rules at one size, by their names; scenes are without the prefix of the size."""
    values: dict[str, dict[str, list[list[float]]]] = {}
    for row in read_rows(SCORES_CSV):
        if row["scene"].startswith("full-") == full:
            scene = row["scene"].removeprefix("full-")
            columns = [float(row[column]) for column in COLUMNS]
            values.setdefault(row["rule"], {}).setdefault(scene, []).append(columns)
    return {
        rule: Score(rule, {scene: np.array(columns) for scene, columns in of_rule.items()}, full)
        for rule, of_rule in values.items()
    }


def rules(large: Scores) -> list[str]:
    """Return the names of the rules, without that of the best tilts."""
    return [name for name in large if name != TILTS_OF_PATCHES]


def means(name: str) -> list[str]:
    """Return geometric means of the scenes: absolute and relative error of a rule at full size, and in small images."""
    of = [scores(full)[name] for full in (True, False)]
    return [cell(*interval(score.over_scenes()[:, measure], score.blocks)) for score in of for measure in (0, 1)]


def literature_rows() -> Rows:
    """Return the rows of the rules of examples/literature, with links to their files."""
    rows = []
    for name, rule in LITERATURE.items():
        learns = "weights" if name in list(LITERATURE)[:3] else "shares"
        link = f"[{name.removesuffix(' (shares)')}](../examples/literature/{FILES.get(rule, 'objectives')}.py)"
        rows.append([link, f"`{rule}`", learns, *means(name)])
    return rows


def reached_rows(large: Scores) -> Rows:
    """Return by scene the absolute error of rules over that of the best tilts, or shares, of the same blocks."""
    rows, logs = [], []
    for scene in large["balance"].values:
        least = {name: large[name].values[scene][:, 0] for name in (TILTS_OF_PATCHES, "oracle")}
        ratios = [large[name].values[scene][:, 0] / least[TILTS_OF_PATCHES] for name in TILTS]
        ratios += [large[name].values[scene][:, 0] / least["oracle"] for name in SHARES]
        logs.append(np.log(ratios))
        rows.append([scene, *(cell(*interval(ratio, True)) for ratio in ratios)])
    means = np.exp(np.mean(logs, axis=0))
    return [*rows, ["geometric mean", *(cell(*interval(ratio, True)) for ratio in means)]]


def order_rows(large: Scores, small: Scores) -> Rows:
    """Return by scene how many pairs of rules have a sure order at both sizes, and how many of these differ.

    An order is sure if the interval of the logarithm of the ratio, of the same seeds or blocks, excludes 0.
    """
    rows = []
    names = [name for name in rules(large) if "oracle" not in name]
    for scene in large["balance"].values:
        sure, differ = 0, 0
        for i, first in enumerate(names):
            for second in names[i + 1 :]:
                signs = [order(of[first], of[second], scene) for of in (small, large)]
                sure += all(signs)
                differ += signs[0] * signs[1] < 0
        rows.append([scene, str(sure), str(differ)])
    return rows


def order(first: Score, second: Score, scene: str) -> int:
    """Return -1 or 1 if the interval of the absolute error over the other rule's is below or above 1, else 0."""
    ratio = np.log(first.values[scene][:, 0] / second.values[scene][:, 0])
    mean, half = interval(ratio, first.blocks)
    return int(np.sign(mean)) if abs(mean) > max(half, 1e-3) else 0


# Bounds -------------------------------------------------------------------------------------------------------------


@cache
def bounds(scene: str, size: str, measure: str) -> Array:
    """Return the values of `KINDS`, and halves of their intervals, ``(2, kinds)``."""
    key = {"scene": scene, "size": size, "measure": measure}
    rows = {row["bound"]: row for row in read_rows(BOUNDS_CSV) if key.items() <= row.items()}
    return np.array([[float(rows[kind][column]) for kind in KINDS] for column in ("value", "half")])


def sizes() -> dict[str, tuple[str, str]]:
    """Return by scene width and height at full size."""
    return {row["scene"]: (row["width"], row["height"]) for row in read_rows(BOUNDS_CSV) if row["size"] == "full"}


def bound_rows() -> Rows:
    """Return by scene the absolute bounds at full size (at a quarter of the side), and means of both measures."""

    def cells(large: Array, small: Array) -> list[str]:
        return [f"{a:.2f} ({b:.2f})" for a, b in zip(large[:-1], small[:-1], strict=True)]

    rows = []
    for name, (width, height) in sizes().items():
        rows.append([name, f"{width}x{height}", *cells(*(bounds(name, size, "absolute")[0] for size in SIZES))])
    for measure in MEASURES:
        means = [np.exp(np.mean([np.log(bounds(n, size, measure)[0]) for n in sizes()], axis=0)) for size in SIZES]
        rows.append(["*mean*", measure, "", *cells(*means)[1:]])
    return rows


SIZES = ("full", "quarter")


def renders_differ() -> float:
    """Return the largest difference between a bound of one weight for the image and renders with this weight."""
    return max(
        abs(float(row["value"]) - bounds(row["scene"], "full", "absolute")[0, KINDS.index(row["bound"])])
        for row in read_rows(RENDERS_CSV)
    )


# Predicted and measured errors ---------------------------------------------------------------------------------------


@cache
def validated() -> dict[str, dict[str, Array]]:
    """Return by scene and rule predicted and measured error times cost and its relative error, ``(3, 2 measures)``."""
    found: dict[str, dict[str, Array]] = {}
    for row in read_rows(VALIDATED_CSV):
        values = [
            [float(row[f"{kind} {measure}"]) for measure in MEASURES] for kind in ("predicted", "measured", "s.e.")
        ]
        found.setdefault(row["scene"], {})[row["rule"]] = np.array(values)
    return found


def validated_rows() -> Rows:
    """Return by scene predicted over measured error: the least and largest of rules, and those of random shares."""
    rows = []
    for scene, of_scene in validated().items():
        ratios = {rule: predicted / measured for rule, (predicted, measured, _) in of_scene.items() if rule in REQUIRED}
        random = ratios.pop("random")
        ends = np.array([np.min(list(ratios.values()), axis=0), np.max(list(ratios.values()), axis=0)]).T
        texts = [f"{low:.2f}" if f"{low:.2f}" == f"{high:.2f}" else f"{low:.2f}–{high:.2f}" for low, high in ends]
        rows.append([scene, *texts, ", ".join(f"{x:.2f}" for x in random)])
    return rows


def ordered_pairs(scenes: Iterable[str], chosen: Collection[str]) -> tuple[Array, Array]:
    """Return the numbers of pairs of rules with disjoint intervals, and of those in the predicted order, by measure."""
    pairs, agreeing = np.zeros((2, 2), int)
    for scene in scenes:
        rows = np.array([values for rule, values in validated()[scene].items() if rule in chosen])
        predicted, value, error = np.moveaxis(rows, 1, 0)
        i, j = np.triu_indices(len(rows), 1)
        apart = np.abs(value[i] - value[j]) > 1.96 * (error * value)[i] + 1.96 * (error * value)[j]
        same = np.sign(value[i] - value[j]) == np.sign(predicted[i] - predicted[j])
        pairs, agreeing = pairs + apart.sum(axis=0), agreeing + (apart & same).sum(axis=0)
    return pairs, agreeing


# Tables and figure --------------------------------------------------------------------------------------------------


def cell(value: float, half: float) -> str:
    """Return a value and half of its interval, none if that is below 0.0005."""
    digits = 2 if half >= 5e-3 else 3
    return f"{value:.{digits}f}" if half < 5e-4 else f"{value:.{digits}f}±{half:.{digits}f}"


def tables() -> dict[str, list[str]]:
    """Return the lines of the blocks."""
    sizes = ["full size, absolute", "relative", "100x75, absolute", "relative"]
    other = [[name, *means(name)] for name in rules(scores(True)) if name not in LITERATURE]
    return {
        "mis-bench.md: validated": markdown(["scene", *MEASURES, "random shares"], validated_rows()),
        "mis-bench.md: mis-bench": markdown(["rule", *sizes], other),
        "results.md: bounds": markdown(["scene", "pixels", *KINDS[:-1]], bound_rows()),
        "results.md: reached": markdown(["scene", *TILTS, *SHARES], reached_rows(scores(True))),
        "results.md: literature": markdown(["rule", "name", "learns", *sizes], literature_rows()),
    }


def saved(ratio: float) -> str:
    """Return what a ratio of errors saves, in percent."""
    return f"{100 * (1 - ratio):.0f} %"


def sentences() -> dict[str, list[str]]:
    """Return fragments of prose with numbers."""
    full, quarter = ({name: bounds(name, size, "absolute")[0] for name in sizes()} for size in SIZES)

    def of(kind: str, name: str = "", values: dict[str, Array] = full) -> float:
        """Return a bound of a scene, or the geometric mean of all."""
        column = {scene: float(row[KINDS.index(kind)]) for scene, row in values.items()}
        return column[name] if name else float(np.exp(np.mean(np.log(list(column.values())))))

    diffuse, pot = "killeroo-diffuse", "teapot-area-light"
    tilts = [saved(of("tilt per patch", name)) for name in (diffuse, "veach-mis", pot, "tt")]
    shares = sorted(1 - of("share per patch", name) for name in sizes())
    edges = [f"{of('camera samples', name, values):.2f}" for name in (pot, diffuse) for values in (quarter, full)]
    best = [saved(of("share per patch", name, values)) for name in (pot, diffuse) for values in (full, quarter)]
    reference = [means(name)[0].partition("±")[0] for name in ("thesis", "second-moment", "oracle")]
    pairs, differ = np.sum([[int(n) for n in row[1:]] for row in order_rows(scores(True), scores(False))], axis=0)
    reached = reached_rows(scores(True))[-1][1 : 1 + len(TILTS)]
    over = sorted(round(100 * float(text.partition("±")[0])) - 100 for text in reached)
    autos = [scores(size)[AUTO].values for size in (True, False)]
    harm = [max(100 * of_scene[:, COLUMNS.index("harm")].mean() for of_scene in auto.values()) for auto in autos]
    lost = cell(*interval(autos[0]["ten-lights"][:, 0], True)).replace("±", " ± ")
    gold, tt = (1 - of("tilt per patch", name) for name in ("killeroo-gold", "tt"))
    apart, agreeing = ordered_pairs(validated(), (*REQUIRED, *OTHERS))
    right = "all these pairs is right" if (apart == agreeing).all() else f"{agreeing} of these pairs is right"
    return {
        "README.md": [
            f"save {tilts[2]} of the MSE on the teapot, {tilts[0]} on KILLEROO DIFFUSE and at most "
            f"{100 * max(gold, tt):.0f} % on KILLEROO GOLD and TT.",
            f"the best weights save {saved(of('tilt per patch'))}.",
        ],
        "mis-bench.md": [f"of {apart[0]} pairs of rules (absolute) and of {apart[1]} pairs (relative)", right],
        "results.md": [
            "save {} on killeroo-diffuse, {} on veach-mis, {} on the teapot, {} on tt".format(*tilts),
            f"save {100 * shares[0]:.0f} to {100 * shares[-1]:.0f} %; "
            f"in the geometric mean they save {saved(of('share per patch'))}.",
            f"One share for the image saves {saved(of('one share'))} in the geometric mean.",
            f"**Numbers of camera samples** save {saved(of('counts'))} in the geometric mean.",
            f"At full size the shares of `auto` raise variance × cost by more than 2 % in at most {harm[0]:.0f} %",
            f"in small images in at most {harm[1]:.0f} %",
            f"these shares have {lost} times the error × cost of `balance` on `ten-lights`",
            f"agree with the bounds within {renders_differ():.2f}",
            "from {} to {} of the variance on the teapot and from {} to {} on killeroo-diffuse".format(*edges),
            "{} instead of {} on the teapot, and {} instead of {} on killeroo-diffuse.".format(*best),
            f"Rules with tilts are {over[0]} to {over[-1]} % above their bound in the geometric mean.",
            f"For {pairs} pairs of rules, the interval of their ratio excludes 1 at both sizes; "
            f"{differ} of these pairs ({100 * differ / pairs:.0f} %) have the opposite order",
            "{} for `thesis`, {} for `second-moment` and {} for the best shares".format(*reference),
        ],
    }


def draw_bounds() -> None:
    """Draw a panel per scene: bounds at both sizes, and what rules reach at full size."""
    from common import print_canvas
    from weights_figures import write

    large, shown = scores(True), KINDS[1:-1]
    figure, axes = print_canvas(2, 4, 5, sharey=True, sharex=True)
    for axis, name in zip(axes.flat, sizes(), strict=False):
        for size, colour, shift in (("quarter", "C1", -0.15), ("full", "C0", 0.15)):
            value, half = bounds(name, size, "absolute")[:, 1:-1]
            rows = np.arange(len(shown)) + shift
            axis.errorbar(value, rows, xerr=half, fmt=".", color=colour, label=f"best weights, {size} size")
        for row, (rule, mark) in enumerate(SHOWN.items(), len(shown)):
            if name in large[rule].values:
                mean, half = interval(large[rule].values[name][:, 0], True)
                axis.errorbar(min(mean, 1.45), row, xerr=half, fmt=mark, markersize=3, color="black")
        axis.axvline(1, color="grey", linewidth=0.8)
        axis.set_yticks(range(len(shown) + len(SHOWN)), [*shown, *SHOWN])
        axis.set_title(name)
        axis.set_xlim(0, 1.5)
    axes[0, 0].invert_yaxis()
    figure.supxlabel("MSE × cost, over balance", fontsize="medium")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    write(figure, "what-weights-save")
