"""The pieces of what is published: every measured table and every picture of the pages, and the command that makes it.

`publish` makes them, and tells which are older than the renders or the scripts that decide them. A script that measures
writes rows to docs/tables; ``tables()`` in its module, or in one beside it, returns the lines of each block of a page
from these rows alone, and ``sentences()`` the fragments of prose with numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

FOUR = ("teapot-area-light", "killeroo-diffuse", "killeroo-gold", "tt")
"""Scenes of the thesis."""


@dataclass(frozen=True)
class Piece:
    """Tables and pictures that one command makes.

    Attributes
    ----------
    name
        What `publish` calls it.
    command
        Words behind ``python``, run from the root of the project; takes at most 40 minutes on two cores.
    module
        Module with ``tables()``, in benchmarks, examples or examples/thesis; empty for pictures.
    blocks
        Tables, as ``"measurements.md: steps"``: a page of docs, or README.md, and the name between the marks.
    files
        Files that the command writes, below docs: rows and pictures.
    renders
        Beginnings of the names of `frozen.configurations` that decide the result.
    script
        Script of a picture, whose code decides it, too.
    """

    name: str
    command: str
    module: str = ""
    blocks: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    renders: tuple[str, ...] = ()
    script: str = ""


def renders_of(scenes: tuple[str, ...], *rules: str) -> tuple[str, ...]:
    """Return the beginnings of names of renders of scenes by rules."""
    return tuple(f"{scene} {rule}" for scene in scenes for rule in rules)


def figure(script: str, *renders: str) -> Piece:
    """Return the piece of a picture of the gallery, such as ``explained/plot_nets``."""
    stem = script.partition("/")[2]
    command = f"examples/make_figures.py --publish docs --only {stem}"
    return Piece(stem, command, files=(f"figures/{stem}.webp",), renders=renders, script=f"examples/{script}.py")


WEIGHTS = ("bounds", "reached", "thesis", "order", "renders")
"""Blocks of docs/what-weights-save.md."""
BY_BALANCE = renders_of(FOUR, "balance")
BY_THESIS = (*BY_BALANCE, *renders_of(FOUR, "thesis"))
BY_ALL = (*BY_THESIS, *renders_of(FOUR, "auto"))
HELD_OUT = renders_of(("veach-mis", "ten-lights"), "balance integrator=direct", "auto integrator=direct")
BY_PATHS = (
    *renders_of(("cornell", "tt", "veach-mis", "ten-lights"), "balance integrator=path"),
    "cornell auto",
    "cornell second-moment",
)
BENCH = (
    *BY_ALL,
    *HELD_OUT,
    *renders_of(("cornell",), "balance", "thesis"),
    "tt second-moment",
    "tt taylor",
    "tt neyman",
)

PIECES: tuple[Piece, ...] = (
    # Measurements.
    Piece(
        "points",
        "benchmarks/make_points_table.py",
        "show_points",
        ("README.md: equal time", "measurements.md: steps", "measurements.md: losses", "tables.md: points"),
        ("tables/points.csv",),
        (*BY_BALANCE, *renders_of(FOUR, "auto"), *HELD_OUT),
    ),
    Piece(
        "field",
        "benchmarks/field.py field-scenes --seeds 5 --reference 512",
        "field",
        ("measurements.md: field",),
        ("tables/field.csv",),
        (*BY_BALANCE, *renders_of(FOUR, "auto")),
    ),
    Piece(
        "paths",
        "benchmarks/make_path_table.py",
        "show_paths",
        ("paths.md: steps by paths",),
        ("tables/paths.csv",),
        (*renders_of(FOUR, "balance", "auto"), *renders_of(("cornell", "ten-lights"), "balance", "auto")),
    ),
    Piece(
        "speed",
        "benchmarks/speed.py",
        "speed",
        ("performance.md: targets", "performance.md: speed"),
        ("tables/speed.csv", "tables/speed-targets.csv"),
        BY_BALANCE,
    ),
    Piece(
        "mitsuba-speed",
        "benchmarks/against_mitsuba.py --tables speed",
        "show_mitsuba",
        ("performance.md: mitsuba-speed",),
        ("tables/mitsuba-speed.csv",),
        BY_BALANCE,
    ),
    Piece(
        "mitsuba-errors",
        "benchmarks/against_mitsuba.py --tables errors",
        "show_mitsuba",
        ("performance.md: mitsuba-errors",),
        ("tables/mitsuba-errors.csv",),
        (*BY_BALANCE, *renders_of(FOUR, "auto")),
    ),
    Piece(
        "mitsuba-paths",
        "benchmarks/against_mitsuba.py --tables paths",
        "show_mitsuba",
        ("paths.md: mitsuba-paths",),
        ("tables/mitsuba-paths.csv",),
        BY_PATHS,
    ),
    Piece(
        "pattern-harm",
        "benchmarks/measure_pattern_harm.py",
        "measure_pattern_harm",
        ("measurements.md: pattern harm",),
        ("tables/pattern-harm.csv",),
        renders_of(FOUR, "auto"),
    ),
    Piece(
        "ladder",
        "benchmarks/make_ladder_table.py --threads 1",
        "make_ladder_table",
        ("measurements.md: ladder",),
        ("tables/ladder.csv",),
        BY_BALANCE,
    ),
    Piece(
        "simplex",
        "benchmarks/make_simplex_table.py",
        "make_simplex_table",
        ("measurements.md: simplex",),
        ("tables/simplex.csv",),
        (*BY_BALANCE, "tt simplex", "teapot-area-light fixed"),
    ),
    Piece(
        "stability",
        "benchmarks/make_stability_table.py",
        "make_stability_table",
        ("stability.md: map", "stability.md: ground", "stability.md: scenes"),
        ("tables/stability.csv",),
        (*BY_BALANCE, *renders_of(("veach-mis", "ten-lights", "cornell"), "balance")),
    ),
    Piece(
        "reproduction",
        "examples/thesis/make_score.py",
        "score_tables",
        tuple(f"reproduction.md: {mark}" for mark in ("table 4.1", "seconds", "score", "set-ups", "choices")),
        ("tables/reproduction.csv",),
        BY_THESIS,
    ),
    Piece(
        "floors",
        "examples/thesis/make_floors.py",
        "score_tables",
        ("reproduction.md: floors",),
        ("tables/floors.csv",),
        BY_THESIS,
    ),
    Piece(
        "mis-bench",
        "benchmarks/measure_weights.py",
        "show_weights",
        ("mis-bench.md: mis-bench", *(f"what-weights-save.md: {mark}" for mark in WEIGHTS)),
        (
            "tables/mis-bench.csv",
            "tables/weight-bounds.csv",
            "tables/weight-renders.csv",
            "images/what-weights-save.webp",
            "images/edges-and-resolution.webp",
        ),
        BENCH,
    ),
    Piece(
        "mis-bench-validated",
        "benchmarks/mis_bench.py --validate",
        "show_weights",
        ("mis-bench.md: validated",),
        ("tables/mis-bench-renders.csv",),
        BENCH,
    ),
    Piece(
        "literature",
        "benchmarks/make_literature_table.py",
        "make_literature_table",
        ("literature.md: literature",),
        ("tables/literature.csv",),
        BENCH,
    ),
    Piece(
        "parabola",
        "benchmarks/make_parabola_table.py",
        "make_parabola_table",
        ("thesis.md: parabola",),
        ("tables/parabola.csv",),
        BY_THESIS,
    ),
    Piece(
        "mitsuba-agreement",
        "benchmarks/agreement.py",
        "show_agreement",
        ("tables.md: mitsuba-agreement",),
        ("tables/mitsuba-agreement.csv",),
        BY_BALANCE,
    ),
    Piece(
        "cluster", "benchmarks/measure_cluster.py", "measure_cluster", ("cluster.md: cluster",), ("tables/cluster.csv",)
    ),
    Piece(
        "doctor-faults",
        "benchmarks/doctor_faults.py",
        "doctor_faults",
        ("doctor.md: faults",),
        ("tables/doctor-faults.csv",),
        (*BY_BALANCE, *HELD_OUT),
    ),
    Piece("error-time", "benchmarks/make_error_time.py", files=("tables/error-time.csv",), renders=BY_THESIS),
    Piece(
        "error-time-figures",
        "benchmarks/show_error_time.py",
        "show_error_time",
        ("error-time.md: equal-time",),
        tuple(f"images/error-time-{scene}.webp" for scene in FOUR),
        BY_ALL,
        "benchmarks/show_error_time.py",
    ),
    Piece(
        "demo",
        "benchmarks/measure_demo.py",
        "measure_demo",
        files=("tables/demo.csv", "images/demo.png"),
        renders=tuple(f"teapot-area-light {rule}" for rule in ("balance", "thesis", "auto")),
        script="examples/demo.py",
    ),
    # Pictures that are not in the gallery.
    Piece(
        "doctor-figure",
        "examples/make_doctor_figure.py --docs",
        files=("images/doctor.webp",),
        renders=(*BY_BALANCE, *HELD_OUT),
        script="examples/make_doctor_figure.py",
    ),
    Piece(
        "stability-figure",
        "examples/make_stability_figure.py --docs",
        files=("images/stability.webp",),
        renders=BY_BALANCE,
        script="examples/make_stability_figure.py",
    ),
    # Figures of the thesis.
    figure("thesis/plot_fig_2_1_variance", "teapot-area-light balance"),
    figure("thesis/plot_eq_3_1_variance_is_mse", "killeroo-diffuse balance"),
    figure("thesis/plot_fig_3_1_precomputation", "teapot-area-light balance"),
    figure("thesis/plot_fig_3_2_mse_curve_teapot", "teapot-area-light balance"),
    figure("thesis/plot_fig_3_3_mse_curve_killeroo_gold", "killeroo-gold balance"),
    figure("thesis/plot_fig_3_4_weights", *BY_THESIS),
    figure("thesis/plot_fig_3_5_filter", *BY_THESIS),
    figure("thesis/plot_fig_4_1_scenes", *BY_BALANCE),
    figure("thesis/plot_table_4_1", *BY_THESIS),
    figure("thesis/plot_fig_5_1_limitation_tt", "tt balance", "tt thesis"),
    # Figures that explain.
    figure("explained/plot_1d_mixture"),
    figure("explained/plot_1d_simplex"),
    figure("explained/plot_brdf_zoo"),
    figure("explained/plot_held_out_scenes", *HELD_OUT),
    figure("explained/plot_learned_shares", *renders_of(FOUR[2:3], "auto", "thesis")),
    figure("explained/plot_many_lights", "ten-lights balance"),
    figure("explained/plot_models", "cornell balance"),
    figure("explained/plot_nets"),
    figure("explained/plot_path_vs_direct", *BY_BALANCE),
    figure("explained/plot_rough_glass", "cornell balance"),
    figure("explained/plot_scene_plan", *BY_BALANCE),
    figure("explained/plot_shares_and_points", "tt balance"),
    figure("explained/plot_why_the_parabola_fails", *BY_THESIS),
    # Figures of measurements.
    figure("measured/plot_oracle_and_regret", *BY_ALL),
    figure("measured/plot_patch_size", *BY_ALL),
    figure("measured/plot_scale"),
)
