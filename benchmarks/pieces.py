"""The pieces of what is published: every measured table and every picture of the pages, and the command that makes it.

`publish` makes them, and tells which are older than the renders or the scripts that decide them. A script that measures
writes rows to docs/tables; ``tables()`` in its module, or in one beside it, returns the lines of each block of a page
from these rows alone, and ``sentences()`` the fragments of prose with numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

GALLERY = "examples/make_figures.py --publish docs --only"
"""Command that draws pictures of the gallery, without their names."""
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
        Words behind ``python``, run from the root of the project; takes at most two hours on two cores.
    module
        Module with ``tables()``, in benchmarks, examples or examples/thesis; empty for pictures.
    renders
        Beginnings of the names of `frozen.configurations` that decide the result.
    files
        Files that the command writes, below docs: rows and pictures. Default: the rows that have its name.
    script
        Script of a picture, whose code decides it, too.
    """

    name: str
    command: str
    module: str = ""
    renders: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    script: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "files", self.files or (f"tables/{self.name}.csv",))


def renders_of(scenes: tuple[str, ...], *rules: str) -> tuple[str, ...]:
    """Return the beginnings of names of renders of scenes by rules."""
    return tuple(f"{scene} {rule}" for scene in scenes for rule in rules)


def picture(name: str, script: str, *renders: str) -> Piece:
    """Return the piece of a picture that a script draws for docs/images."""
    return Piece(f"{name}-figure", f"{script} --docs", "", renders, (f"images/{name}.webp",), script)


def figure(script: str, *renders: str) -> Piece:
    """Return the piece of a picture of the gallery, such as ``explained/plot_nets``."""
    stem = script.partition("/")[2]
    return Piece(stem, f"{GALLERY} {stem}", "", renders, (f"figures/{stem}.webp",), f"examples/{script}.py")


BALANCE = renders_of(FOUR, "balance")
THESIS = (*BALANCE, *renders_of(FOUR, "thesis"))
AUTO = (*BALANCE, *renders_of(FOUR, "auto"))
ALL = (*THESIS, *renders_of(FOUR, "auto"))
INTERIORS = ("interior", "interior-glasses", "interior-door")
DIRECT = ("balance integrator=direct", "auto integrator=direct")
PLATES_AND_ROOM = renders_of(("veach-mis", "ten-lights"), *DIRECT)
HELD_OUT = (*PLATES_AND_ROOM, *renders_of(INTERIORS, *DIRECT))
PATHS = (*renders_of(("cornell", "ten-lights"), "balance", "auto"), *AUTO)
BY_PATHS = renders_of(("cornell", "tt", "veach-mis", "ten-lights"), "balance integrator=path")
OTHER_BALANCE = renders_of(("veach-mis", "ten-lights", "cornell"), "balance")
OTHER_RULES = renders_of(("tt",), "second-moment", "taylor", "neyman")
BENCH = (*ALL, *PLATES_AND_ROOM, *renders_of(("cornell",), "balance", "thesis"), *OTHER_RULES)
WEIGHTS = "tables/mis-bench.csv", "tables/weight-bounds.csv", "tables/weight-renders.csv"
WEIGHT_FIGURES = "images/what-weights-save.webp", "images/edges-and-resolution.webp"
ERROR_TIME = tuple(f"images/error-time-{scene}.webp" for scene in (*FOUR, "veach-mis", "ten-lights", *INTERIORS))
DEMO = renders_of(FOUR[:1], "balance", "thesis", "auto")

PIECES: tuple[Piece, ...] = (
    # Measurements.
    Piece("points", "benchmarks/make_points_table.py", "show_points", (*ALL, *HELD_OUT)),
    Piece("paths", "benchmarks/make_path_table.py", "show_paths", PATHS),
    Piece("speed", "benchmarks/speed.py", "speed", BALANCE, ("tables/speed.csv", "tables/speed-targets.csv")),
    Piece("mitsuba-speed", "benchmarks/against_mitsuba.py --tables speed", "show_mitsuba", BALANCE),
    Piece("mitsuba-errors", "benchmarks/against_mitsuba.py --tables errors", "show_mitsuba", BALANCE),
    Piece("mitsuba-paths", "benchmarks/against_mitsuba.py --tables paths", "show_mitsuba", BY_PATHS),
    Piece("stability", "benchmarks/make_stability_table.py", "make_stability_table", (*AUTO, *OTHER_BALANCE)),
    Piece("reproduction", "examples/thesis/make_score.py", "score_tables", THESIS),
    Piece("floors", "examples/thesis/make_floors.py", "score_tables", THESIS),
    Piece("mis-bench", "benchmarks/measure_weights.py", "show_weights", BENCH, (*WEIGHTS, *WEIGHT_FIGURES)),
    Piece(
        "mis-bench-validated",
        "benchmarks/mis_bench.py --validate",
        "show_weights",
        BENCH,
        ("tables/mis-bench-renders.csv",),
    ),
    Piece("parabola", "benchmarks/make_parabola_table.py", "make_parabola_table", THESIS),
    Piece("mitsuba-agreement", "benchmarks/agreement.py", "agreement", BALANCE),
    Piece("doctor-faults", "benchmarks/doctor_faults.py", "doctor_faults", (*BALANCE, *PLATES_AND_ROOM)),
    Piece(
        "error-time-figures",
        "benchmarks/show_error_time.py",
        "show_error_time",
        ALL,
        ERROR_TIME,
        "benchmarks/show_error_time.py",
    ),
    Piece(
        "demo",
        "benchmarks/measure_demo.py",
        "measure_demo",
        DEMO,
        ("tables/demo.csv", "images/demo.png"),
        "examples/demo.py",
    ),
    # Pictures that are not in the gallery.
    picture("doctor", "examples/make_doctor_figure.py", *BALANCE, *PLATES_AND_ROOM),
    picture("errors", "examples/make_errors_figure.py", "teapot-area-light balance"),
    picture("stability", "examples/make_stability_figure.py", *BALANCE),
    # Figures of the thesis.
    figure("thesis/plot_fig_2_1_variance", "teapot-area-light balance"),
    figure("thesis/plot_eq_3_1_variance_is_mse", "killeroo-diffuse balance"),
    figure("thesis/plot_fig_3_1_precomputation", "teapot-area-light balance"),
    figure("thesis/plot_fig_3_2_mse_curve_teapot", "teapot-area-light balance"),
    figure("thesis/plot_fig_3_3_mse_curve_killeroo_gold", "killeroo-gold balance"),
    figure("thesis/plot_fig_3_4_weights", *THESIS),
    figure("thesis/plot_fig_3_5_filter", *THESIS),
    figure("thesis/plot_fig_4_1_scenes", *BALANCE),
    figure("thesis/plot_table_4_1", *THESIS),
    figure("thesis/plot_fig_5_1_limitation_tt", "tt balance", "tt thesis"),
    # Figures that explain.
    figure("explained/plot_1d_mixture"),
    figure("explained/plot_1d_simplex"),
    figure("explained/plot_brdf_zoo"),
    figure("explained/plot_held_out_scenes", *HELD_OUT),
    figure("explained/plot_learned_shares", "killeroo-gold auto", "killeroo-gold thesis"),
    figure("explained/plot_many_lights", "ten-lights balance"),
    figure("explained/plot_models", "cornell balance"),
    figure("explained/plot_nets"),
    figure("explained/plot_path_vs_direct", *BALANCE),
    figure("explained/plot_rough_glass", "cornell balance"),
    figure("explained/plot_scene_plan", *BALANCE),
    figure("explained/plot_shares_and_points", "tt balance"),
    figure("explained/plot_why_the_parabola_fails", *THESIS),
    # Figures of measurements.
    figure("measured/plot_oracle_and_regret", *ALL),
    figure("measured/plot_patch_size", *ALL),
    figure("measured/plot_scale"),
)
