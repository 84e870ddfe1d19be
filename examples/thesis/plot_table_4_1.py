"""
Table 4.1: the thesis's rule against the balance heuristic
==========================================================

The main result of the thesis, scene by scene: the mean squared error of its rule over
that of the balance heuristic. The first comparison has equal numbers of samples (128,
of which 6 are the pilot's). The second has equal time, so pilot and fit leave time for
fewer samples. The thesis took 125 = 6 + 119 samples there; here the number is measured.

The rule ``thesis`` takes its steps in one call here, so that their time is measured
together: pilot, variance, fit w = -a₁ / (2 a₂), filter, final pass. Figure 3.5 takes
them one by one, with a formula for each.

Both take one light and one BRDF sample per camera sample; w only weighs them. Small
images change the ratios, so ``--full`` measures them at the thesis's resolution, in
an hour, and keeps them in ``data/table_4_1.json``. Without an option the figure is
drawn from there. ``--quick`` measures tiny images and keeps nothing.
"""

import json
import sys
from pathlib import Path

import numpy as np

import dmis
from dmis.examples.gallery import (
    SCENES,
    Errors,
    on_cpu,
    options,
    print_canvas,
    spp_in_time,
)
from dmis.experiment.runs import median_seconds

opts, _ = options("plot_table_4_1", __doc__)
KEPT = Path(sys.argv[0]).resolve().parent.parent / "data" / "table_4_1.json"
OURS = "thesis:patch=16"
SPP = opts.spp


# %%
# Compare at equal samples first. The times say how many samples fit into the time of
# the balance heuristic. Render with that number, again beside the balance heuristic,
# and compare the times. If they differ, correct the number once; the remaining
# difference is printed beside the ratio. Time is CPU time of one thread, because wall
# time also depends on other programs.
def measure(name):
    """Compare the rule and the balance heuristic on one scene: a row of the table."""
    scene = opts.scene(name)
    reference = opts.reference(scene, 64 if opts.size == "full" else None)
    errors = Errors(reference)
    more = {
        "preset": "thesis",
        "parallel": 1,
        "progress": opts.progress,
        "record": errors.record,
    }
    base, same = ("balance", SPP), (OURS, SPP)
    runs = {
        key: on_cpu(of)
        for key, of in dmis.measure(
            scene, [base, same], range(1), reference, **more
        ).items()
    }
    rates, equal = runs, errors.ratio(same, base)
    for _ in range(2):
        spp = spp_in_time(median_seconds(rates[base]), rates[list(rates)[1]])
        errors.clear()
        again = dmis.measure(scene, [base, (OURS, spp)], range(1), reference, **more)
        rates = timed = {key: on_cpu(of) for key, of in again.items()}
        share = median_seconds(timed[OURS, spp]) / median_seconds(timed[base])
        if abs(share - 1) < 0.05:
            break
    return {
        "scene": name,
        "resolution": scene.camera.resolution,
        "seconds": median_seconds(runs[base]),
        "mse": np.mean([run.mse for run in runs[base]]),
        "equal samples": equal,
        "overhead": median_seconds(runs[same]) / median_seconds(runs[base]) - 1,
        "spp": spp,
        "equal time": errors.ratio((OURS, spp), base),
        "time": share,
    }


if opts.size == "default" and KEPT.exists():
    rows = json.loads(KEPT.read_text("utf-8"))
else:
    rows = [measure(name) for name in SCENES]
if opts.size == "full" and opts.scene_dir is None:
    KEPT.write_text(json.dumps(rows, indent=1) + "\n", "utf-8")

# %%
# Write the table, with the thesis's numbers in parentheses.
lines = [
    (
        "| scene | balance: s (thesis) | MSE | ours / balance, equal samples (thesis) |"
        " more time (thesis) | spp for equal time (thesis) | ours / balance at that spp"
        " (thesis) | time / balance |"
    ),
    "|---" * 8 + "|",
]
for row in rows:
    about, equal, fair = SCENES[row["scene"]], row["equal samples"], row["equal time"]
    width, height = row["resolution"]
    lines.append(
        f"| {row['scene']} {width}x{height} | {row['seconds']:.1f} ({about.seconds}) |"
        f" {row['mse']:.3e} |"
        f" {equal[0]:.3f} ± {equal[1]:.3f} ({about.equal_samples:.3f}) |"
        f" {row['overhead']:+.1%} ({about.overhead:+.1%}) | {row['spp']} (125) |"
        f" {fair[0]:.3f} ± {fair[1]:.3f} ({about.equal_time:.3f}) | {row['time']:.3f} |"
    )
print("", *lines, "1 seed.", "", sep="\n")

# %%
# Draw the same numbers: below 1 the rule wins.
figure, axes = print_canvas(1, 2, 3.1)
places = np.arange(len(rows))
axis = axes[0, 0]
for shift, key, told, colour in (
    (-0.12, "equal samples", "equal_samples", "tab:blue"),
    (0.12, "equal time", "equal_time", "tab:red"),
):
    values, halves = np.transpose([row[key] for row in rows])
    thesis = [getattr(about, told) for about in SCENES.values()]
    axis.errorbar(
        places + shift, values, halves, fmt="o", capsize=3, color=colour, label=key
    )
    axis.plot(
        places + shift,
        thesis,
        "D",
        fillstyle="none",
        markersize=7,
        color=colour,
        label=f"thesis, {key}",
    )
axis.axhline(1, color="0.35", linestyle="--", linewidth=0.8)
axis.set_ylabel("MSE / MSE of the balance heuristic")
axis = axes[0, 1]
axis.bar(
    places - 0.2,
    [about.seconds for about in SCENES.values()],
    0.4,
    color="0.75",
    label="thesis, 2014",
)
axis.bar(
    places + 0.2, [row["seconds"] for row in rows], 0.4, color="tab:green", label="here"
)
axis.set_ylabel("seconds of the balance heuristic")
for axis in axes[0]:
    axis.set_xticks(
        places, [about.title.replace(" ", "\n") for about in SCENES.values()]
    )
    axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1), ncols=2)
where = "tiny images" if opts.size == "quick" else "the thesis's resolution"
opts.save_for_print(
    figure,
    "Table 4.1: the thesis's rule against the balance heuristic",
    f"""Left: MSE of the thesis's rule over that of the balance heuristic, {SPP} camera
    samples per pixel, {where}, 1 seed, with 95 % intervals over blocks of pixels.
    Diamonds: the thesis's numbers. Right: CPU seconds of the balance heuristic on one
    thread, and the thesis's seconds.""",
)
