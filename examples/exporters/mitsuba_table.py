"""Write the doctor's table of a scene of Mitsuba 3: ``python mitsuba_table.py scene.xml table.npz --spp 16``.

Direct light at the first surface, with one light sample and one BSDF sample for each camera sample, as Mitsuba's
``direct`` integrator takes them; Mitsuba picks one emitter, and p_l has the probability of that. Only what the lamps
reach is written, of both techniques. Needs ``pip install mitsuba``; the scalar variant takes about 0.1 ms per row, so
that an image of at most `side` pixels across is taken. To examine an integrator of your own, write the lines of its two
branches into `shading_samples`; to examine your plugins, register them before you call `table`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

COLUMNS = "pixel camera_sample technique f p_l p_b light lobe direction normal geometric_normal distance light_normal"
Row = tuple[Any, ...]


def table(scene: Any, spp: int = 16, seed: int = 0, side: int = 64) -> dict[str, Any]:
    """Return the columns of the table by name, of an image whose longer side has at most `side` pixels."""
    sensor = scene.sensors()[0]
    size = sensor.film().size()
    width, height = (max(1, round(pixels * min(1, side / max(size)))) for pixels in size)
    sampler = mi.load_dict({"type": "independent", "sample_count": spp})
    sampler.seed(seed)
    emitters = {str(emitter): number for number, emitter in enumerate(scene.emitters())}
    shapes = {str(shape.bsdf()): number for number, shape in enumerate(scene.shapes())}
    rows = []
    for pixel in range(width * height):
        for camera_sample in range(spp):
            place = mi.Point2f(pixel % width, pixel // width) + sampler.next_2d()
            scaled = mi.Point2f(place.x / width, place.y / height)
            ray, _ = sensor.sample_ray(0, sampler.next_1d(), scaled, sampler.next_2d())
            si = scene.ray_intersect(ray)
            if si.is_valid():
                lobe = shapes[str(si.bsdf())]
                for technique, ds, wo, f, p_l, p_b in shading_samples(scene, si, sampler):
                    light = emitters[str(ds.emitter)]
                    at_infinity = ds.emitter.is_environment()
                    place = (si.sh_frame.n, si.n, np.inf if at_infinity else ds.dist, -wo if at_infinity else ds.n)
                    rows.append((pixel, camera_sample, technique, f, p_l, p_b, light, lobe, wo, *place))
    columns = {name: np.array(column) for name, column in zip(COLUMNS.split(), zip(*rows, strict=True), strict=True)}
    header = {"version": 1, "light_samples": 1, "brdf_samples": 1, "visible_only": 1, "shape": (height, width)}
    return {name: a.astype(np.float32) if a.dtype.kind == "f" else a for name, a in columns.items()} | header


def shading_samples(scene: Any, si: Any, sampler: Any) -> Iterator[Row]:
    """Yield technique, direction sample of the emitter, direction, f, p_l and p_b of a light and of a BSDF sample."""
    context, bsdf = mi.BSDFContext(), si.bsdf()

    # a direction towards an emitter; f = BSDF cosine radiance, of the emitter's weight radiance / p_l
    ds, weight = scene.sample_emitter_direction(si, sampler.next_2d(), True)
    if ds.pdf > 0 and not ds.delta and max(weight) > 0:
        wo = si.to_local(ds.d)
        value, p_b = bsdf.eval_pdf(context, si, wo)
        yield 0, ds, np.array(ds.d), np.array(value) * np.array(weight) * ds.pdf, ds.pdf, p_b

    # a direction of the BSDF, and the emitter that it meets
    bs, _ = bsdf.sample(context, si, sampler.next_1d(), sampler.next_2d())
    if bs.pdf > 0 and not mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta):
        hit = scene.ray_intersect(si.spawn_ray(si.to_world(bs.wo)))
        emitter = hit.emitter(scene)
        if emitter is not None:
            ds = mi.DirectionSample3f(scene, hit, si)
            p_l = scene.pdf_emitter_direction(si, ds)
            f = np.array(bsdf.eval(context, si, bs.wo)) * np.array(emitter.eval(hit))
            yield 1, ds, np.array(ds.d), f, p_l, bs.pdf


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene")
    parser.add_argument("output")
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--side", type=int, default=64, help="largest number of pixels across")
    options = parser.parse_args()
    columns = table(mi.load_file(options.scene), options.spp, side=options.side)
    np.savez(options.output, **columns)
    print(f"{options.output}: {len(columns['f']):,} rows of {columns['shape']} pixels")
