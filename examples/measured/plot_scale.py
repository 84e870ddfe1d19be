"""
Pixels, samples, triangles: what more of them cost
==================================================

A bumpy ball lies on a floor under a disk light, rendered with the balance heuristic on
one thread. Images have up to 4096x4096 pixels and 4096 samples per pixel; the ball has
up to two million triangles. Time is proportional to the number of camera samples,
whether there are more pixels or more samples per pixel. Memory grows with pixels and
triangles, but not with samples. A render of 4096 samples in each of 4096x4096 pixels
would take a day; its time is extrapolated, and marked so.

Measuring takes some minutes (``--measure``). Each case runs in a separate process, so
that its peak memory can be measured. The script keeps the numbers in
``data/scale.json`` and draws them from there. ``--quick`` measures small cases and
keeps nothing.
"""

import json
import multiprocessing
import platform
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from datetime import date
from pathlib import Path

import numpy as np

import dmis
from dmis.base import malloc
from dmis.examples.gallery import in_notebook, options, print_canvas
from dmis.geometry import shapes
from dmis.geometry.mesh import vertex_normals

KEPT = Path(sys.argv[0]).resolve().parent.parent / "data" / "scale.json"
TARGET = (4096, 4096)
"""Side of the image, samples per pixel: what nobody waits for here."""


def ball(triangles):
    """A ball with bumps, of about so many triangles."""
    smooth = shapes.sphere(1.0, segments=round(np.sqrt(triangles)))
    x, y, z = 9 * smooth.vertices.T
    height = 1 + 0.04 * np.sin(x) * np.sin(y + 0.5) * np.sin(z + 1)
    vertices = smooth.vertices * height[:, None]
    return dmis.Mesh(vertices, smooth.faces, vertex_normals(vertices, smooth.faces))


def measure(case):
    """Render one case (side of the image, samples per pixel, triangles) in this
    process: CPU seconds, bytes.
    """
    side, spp, triangles = case["side"], case["spp"], case["triangles"]
    mesh = ball(triangles)
    light = dmis.DiskLight((2, -2, 4), (-0.5, 0.5, -1), 0.7, (20, 20, 20))
    floor = dmis.Part(
        shapes.quad((-6, -6, -1), (12, 0, 0), (0, 12, 0)), dmis.matte(0.5)
    )
    camera = dmis.Camera.look_at(
        (0, -4, 1.5), (0, 0, 0), fov=35, resolution=(side, side)
    )
    ball_part = dmis.Part(mesh, dmis.plastic((0.6, 0.3, 0.1), 0.3, 0.05))
    scene = dmis.Scene(
        camera, (floor, ball_part, dmis.light_part(light)), (light,), "ball"
    )
    begin = time.process_time()
    scene.prepare()
    built = time.process_time()
    # what is slow the first time
    dmis.render(scene.crop((0, 0, 8, 8)), "balance", 4, parallel=1)
    before, wall = time.process_time(), time.perf_counter()
    dmis.render(scene, "balance", spp, seed=1, parallel=1)
    seconds, wall = time.process_time() - before, time.perf_counter() - wall
    return {
        "side": side,
        "spp": spp,
        "triangles": len(mesh.faces),
        "build_seconds": built - begin,
        "seconds": seconds,
        "wall_seconds": wall,
        "peak_bytes": malloc.peak(),
    }


def cases(pick):
    """Three series, by what grows in them."""
    few, many = pick(2000, 20_000), pick(20_000, 2_000_000)
    return {
        "pixels": [
            {"side": n, "spp": 4, "triangles": few}
            for n in pick((64, 128), (256, 512, 1024, 2048, 4096))
        ],
        "spp": [
            {"side": pick(64, 128), "spp": n, "triangles": few}
            for n in pick((4, 16), (4, 16, 64, 256, 1024, 4096))
        ],
        "triangles": [
            {"side": pick(64, 512), "spp": 16, "triangles": n}
            for n in pick((few, many), (2000, 20_000, 200_000, 632_000, many))
        ],
    }


def slope(x, y):
    """Exponent of the power law through the points, by least squares."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def samples(run):
    """Camera samples of a render."""
    return run["side"] ** 2 * run["spp"]


def draw(data, opts):
    """Three panels: time against samples, memory against samples, both against
    triangles.
    """
    figure, axes = print_canvas(1, 3, 2.8)
    runs = data["runs"]
    largest = max(runs["pixels"] + runs["spp"], key=samples)
    each = largest["seconds"] / samples(largest)
    whole = TARGET[0] ** 2 * TARGET[1]
    labels = {"pixels": "more pixels", "spp": "more samples per pixel"}
    exponents = {}
    for kind, marker, colour in (("pixels", "s", "tab:blue"), ("spp", "o", "tab:red")):
        n = np.array([samples(run) for run in runs[kind]])
        seconds = np.array([run["seconds"] for run in runs[kind]])
        exponents[kind] = slope(n[-3:], seconds[-3:])
        axes[0, 0].plot(n, seconds, marker, color=colour, label=labels[kind])
        axes[0, 1].plot(
            n,
            [run["peak_bytes"] / 1e6 for run in runs[kind]],
            f"{marker}-",
            color=colour,
        )
    line = np.array([samples(runs["spp"][0]), whole], float)
    axes[0, 0].plot(line, each * line, "--", color="0.5", label="in proportion")
    axes[0, 0].plot(
        [whole],
        [each * whole],
        "*",
        markersize=9,
        markerfacecolor="white",
        color="0.3",
        label="extrapolated",
    )
    axes[0, 0].set_ylabel("seconds of one thread")
    axes[0, 1].set_ylabel("peak memory (MB)")
    for axis in axes[0, :2]:
        axis.set_xlabel("camera samples in all")
    n = np.array([run["triangles"] for run in runs["triangles"]])
    for key, marker, label in (
        ("seconds", "D", "render, more triangles"),
        ("build_seconds", "v", "build, more triangles"),
    ):
        axes[0, 2].plot(
            n,
            [run[key] for run in runs["triangles"]],
            f"{marker}-",
            color={"D": "tab:green", "v": "tab:orange"}[marker],
            label=label,
        )
    axes[0, 2].plot(
        n,
        [run["peak_bytes"] / 1e9 for run in runs["triangles"]],
        "^-",
        color="0.5",
        label="peak memory",
    )
    axes[0, 2].set_xlabel("triangles")
    axes[0, 2].set_ylabel("seconds of one thread; GB")
    for axis in axes[0]:
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.grid(alpha=0.3)
    axes[0, 1].set_ylim(bottom=50)
    figure.legend(loc="outside lower center", ncols=4)

    big, small = runs["pixels"][-1], runs["pixels"][0]
    most, least = runs["spp"][-1], runs["spp"][0]
    fine, coarse = runs["triangles"][-1], runs["triangles"][0]
    per_pixel = (big["peak_bytes"] - small["peak_bytes"]) / (
        big["side"] ** 2 - small["side"] ** 2
    )
    per_triangle = (fine["peak_bytes"] - coarse["peak_bytes"]) / (
        fine["triangles"] - coarse["triangles"]
    )
    flat = [run["peak_bytes"] / 1e6 for run in runs["spp"]]
    opts.save(
        figure,
        "Pixels, samples, triangles: what more of them cost",
        f"""Time grows with the power {exponents["pixels"]:.2f} of the number of pixels
        (images of {small["side"]} to {big["side"]} on a side, {big["spp"]} samples per
        pixel) and with the power {exponents["spp"]:.2f} of the samples per pixel
        ({least["spp"]} to {most["spp"]}, {most["side"]} on a side), over the largest
        three of each: {each * 1e9:.0f} ns per camera sample, so
        {each * whole / 3600:.1f} hours of one thread for {TARGET[0]}×{TARGET[0]} pixels
        and {TARGET[1]} samples, which is extrapolated, not measured. Peak memory is
        {min(flat):.0f} to {max(flat):.0f} MB whatever the samples per pixel; each pixel
        takes {per_pixel:.0f} bytes, each triangle {per_triangle:.0f}. From
        {coarse["triangles"]:,} to {fine["triangles"]:,} triangles rendering takes
        {fine["seconds"] / coarse["seconds"]:.1f} times as long. CPU seconds, balance
        heuristic, measured on {data["date"]}: {data["machine"]}.""",
    )


def main():
    """Measure if asked to, and draw."""
    opts, given = options(
        "plot_scale",
        __doc__,
        measure={
            "action": "store_true",
            "help": "measure, and keep the numbers in data/scale.json",
        },
    )
    if opts.size != "quick" and not given.measure and KEPT.exists():
        draw(json.loads(KEPT.read_text("utf-8")), opts)
        return
    runs = {}
    fresh = multiprocessing.get_context("forkserver")
    with ProcessPoolExecutor(1, mp_context=fresh, max_tasks_per_child=1) as pool:
        for kind, series in cases(opts.pick).items():
            runs[kind] = []
            # functions of a notebook are not known in other processes: there the peak
            # of memory is that of the kernel
            for run in (map if in_notebook() else pool.map)(measure, series):
                runs[kind].append(run)
                print(
                    f"{kind:9} {run['side']:4}² × {run['spp']:4} spp, "
                    f"{run['triangles']:9,} triangles: "
                    f"{run['seconds']:7.2f} s, built in {run['build_seconds']:.2f} s, "
                    f"{run['peak_bytes'] / 1e6:.0f} MB",
                    flush=True,
                )
    machine = (
        f"{platform.machine()}, Python {platform.python_version()}, NumPy "
        f"{np.__version__}"
    )
    data = {
        "date": str(date.today()),
        "machine": machine,
        "dmis": dmis.__version__,
        "runs": runs,
    }
    if given.measure:
        KEPT.write_text(json.dumps(data, indent=1) + "\n", "utf-8")
    draw(data, opts)


if __name__ == "__main__":
    main()
