"""
Why is this pixel noisy?
========================

A pilot of one pixel at w = 1/2 measures the variance V of a camera sample at every
share w, and which light, technique and surface of the path causes it. Given the point y
that a camera ray hits, two halves of its shading samples are independent. Let L_1 and
L_2 be their estimates, and c one light, technique and surface:

    V_c = Cov(L_1c, L_1),  P_c = Cov(L_1c, L_2),  sum_c V_c = V(1/2),  sum_c P_c = P.

P is the variance among points y, which no share changes. What no technique estimates is
apart: direct lighting has SEEN, such as a lamp's edge; paths add FURTHER, as caustics.
"""

from collections import defaultdict
from dataclasses import replace

import numpy as np

import dmis
from dmis.base.vectors import dot, frame, take
from dmis.estimator.settings import make_settings
from dmis.examples.gallery import options, print_canvas
from dmis.fit.fixed import Fixed
from dmis.pipeline.job import budget_of, resolve
from dmis.pipeline.tile import make_tiles, render_tile
from dmis.variance.curves import GRID, HALF, Curves

RULES = "thesis:weigh=samples", "auto"
SEEN = ("seen emission, delta lights", "", 0)
FURTHER = ("emission, delta lights further on", "", 0)


class Samples(Curves):
    """Variance curves of one pixel, and all records of its shading samples."""

    wants = dmis.Wants(directions=True)

    def __init__(self, pixels, shading_samples):
        super().__init__(pixels, shading_samples)
        self.records, self.radiance = [], np.zeros(0)

    def add(self, records, radiance, count):
        """Keep records with the numbers of their camera samples."""
        numbers = len(self.radiance) + np.arange(count)
        super().add(records, radiance, count)
        self.records += [replace(r, sample=take(numbers, r.sample)) for r in records]
        self.radiance = np.append(self.radiance, radiance.mean(axis=0, dtype=float))

    def unsampled(self):
        """Return the radiance of camera samples that no technique estimates, (N,)."""
        rest = self.radiance.copy()
        for r in self.records:
            rest[r.sample] -= r.value.mean(axis=0) / (2 * self._s)
        return np.where(np.abs(rest) < 1e-6 * self.radiance, 0, rest)  # rounding errors


def pilot(pixel, spp, seed, settings):
    """Render a scene of one pixel at w = 1/2; return the job and its samples."""
    job = resolve(pixel, Fixed(0.5), spp, seed, settings).alone
    samples = Samples(1, 2 * job.settings.shading_samples)
    rounds = budget_of(job).pilot(0.5, 2 * spp, lambda *_: samples)
    for tile in make_tiles((1, 1), seed, 0, rounds):
        render_tile(job.scene, tile)
    return job, samples


def light_name(job, record):
    """Return the name of the light that a record samples."""
    plan, settings = job.scene.plan, job.settings
    selects = settings.integrator == "path" and plan.selects_deeper(settings.lights)
    for selection in (settings.lights, "tree"):
        lights = plan.sampled_lights(selection, settings.sky_compensation)
        beyond, number = divmod(record.key[-1], len(lights) + len(plan.deltas))
        light = (*lights, *plan.deltas)[number]
        if selection == "tree" or not selects or len(record.key) == 1:
            break
        # a tree selects among lamps where a path has scattered, but not behind mirrors
        seen = light.seen_from(record.surface.ng) if light.needs_normals else light
        p_l = seen.hit(record.p, record.wi).pdf
        if np.isclose(p_l, record.pdf[0], rtol=1e-3).mean() > 0.5:
            break
    return f"{type(light).__name__} {number}{' from behind' if beyond else ''}"


def explain(scene, pixel, spp=4096, rules=RULES, seed=0, **settings):
    """Return what makes the noise of a pixel, (column, row), by name."""
    settings, (x, y) = make_settings(None, **settings), pixel
    resolve(scene, "second-moment", None, seed, settings)  # refuses what has no curves
    alone = scene.crop((x, y, x + 1, y + 1))
    job, samples = pilot(alone, spp, seed, settings)
    _, direct = pilot(alone, spp, seed, replace(settings, integrator="direct"))
    # V(w), and the shares that rules learn at 64 samples per pixel
    sums, marks = samples.sums(), {"balance": 0.5}
    variance = (sums["curve"] + np.maximum(sums["position"], 0))[:, 0] * job.gain**2
    for rule in rules:
        result = dmis.render(scene, rule, 64, seed=seed, settings=settings)
        marks[rule.partition(":")[0]] = float(result.weight[y, x])
    marks["oracle"] = float(GRID[variance.argmin()])
    # the estimates L_1c and L_2c, and the largest sample, of each c
    settings, largest = job.settings, {}
    halves = defaultdict(lambda: np.zeros((2, len(samples.radiance))))
    for r in samples.records:
        value, technique = r.value.mean(axis=0), settings.techniques[r.technique_index]
        c = light_name(job, r), technique, len(r.key)
        halves[c][r.sample_index % 2, r.sample] += value / settings.shading_samples
        if value.max(initial=0) * job.gain > largest.get(c, {"value": 0})["value"]:
            largest[c] = steps(job, r, int(value.argmax()))
    rest = samples.unsampled()
    share = min(1, direct.unsampled().var() / rest.var()) if rest.var() else 1
    halves[SEEN] = np.stack([rest, rest]) * share
    halves[FURTHER] = np.stack([rest, rest]) * (1 - share)
    estimates = sum(halves.values())
    deviation = estimates - estimates.mean(axis=1, keepdims=True)
    # V_c = Cov(L_1c, L_1) and P_c = Cov(L_1c, L_2), over V
    both = np.stack([deviation, deviation[::-1]]) / max((deviation**2).mean(), 1e-300)
    sources = {c: (a * both).mean(axis=(1, 2)).tolist() for c, a in halves.items()}
    squares = np.sort(deviation[0] ** 2)[::-1].cumsum()
    return {
        "pixel": pixel, "mean": samples.radiance.mean() * job.gain,
        "variance": variance, "marks": marks, "records": samples.records,
        "sources": dict(sorted(sources.items(), key=lambda item: -item[1][0])),
        "rare": (np.searchsorted(squares, squares[-1] / 2) + 1) / len(squares),
        "largest": sorted(largest.items(), key=lambda item: -item[1]["value"])[:3],
    }  # fmt: skip


def steps(job, record, k):
    """Return the steps of sample k of a record; f has the throughput of the path."""
    origin, length, gain = job.given_scene.units
    p_l, p_b = record.pdf[:, k].tolist()
    return {
        "point": record.p[:, k] * length + origin, "wi": record.wi[:, k],
        "f": record.value[:, k] * ((p_l + p_b) / 2 * gain), "p_l": p_l, "p_b": p_b,
        "W": (p_l, p_b)[record.technique_index] / (p_l + p_b),
        "value": float(record.value[:, k].mean() * gain),
    }  # fmt: skip


def show(why):
    """Print causes, V(w), sources, and the largest samples."""
    half, sources = max(why["variance"][HALF], 1e-300), why["sources"]
    seen, further = sources[SEEN][1], sources[FURTHER][1]
    among = sum(p for _, p in sources.values()) - seen - further
    at_y = sum(v - p for v, p in sources.values())
    print(f"pixel {why['pixel']}: mean {why['mean']:.4g}, variance {half:.3g}")
    print(f"  {seen:.1%} of V: emission that is seen, delta lights; no technique helps")
    print(f"  {further:.1%} of V: caustics, and other light that no technique samples")
    print(f"  {among:.1%} of V: edges, textures, shadows and paths; no w helps")
    print(f"  {at_y:.1%} of V: light and BRDF samples at a point")
    print(f"  half of V is in {why['rare']:.2%} of the camera samples")
    print("V(w) / V(1/2) at shares w of light samples, and where rules are:")
    for name, w in [*(("", w) for w in GRID), *why["marks"].items()]:
        print(f"  {w:5.2f} {np.interp(w, GRID, why['variance']) / half:8.3g} {name}")
    print("V_c / V, P_c / V, and c, which is light, technique and surface:")
    for c, (v, p) in sources.items():
        print(f"  {v:7.1%} {p:7.1%} ", *c)
    for c, sample in why["largest"]:
        print("largest sample of", *c)
        for name, value in sample.items():
            print(f"  {name:5} {np.array2string(np.array(value), precision=3)}")


def draw(why):
    """Return the figure: directions of samples, V(w), and sources of V."""
    figure, ((directions, curve, bars),) = print_canvas(1, 3, 2.6)
    for r in (r for r in why["records"] if len(r.key) == 1):
        n, (s, t) = r.surface.n, frame(r.surface.n)
        x, y = np.stack([dot(s, r.wi), dot(t, r.wi)]) / np.sqrt(1 + dot(n, r.wi))
        directions.plot(x, y, ("b.", "r.")[r.technique_index], markersize=1)
    directions.set(title="light (blue), BRDF samples", aspect=1)
    half = max(why["variance"][HALF], 1e-300)
    curve.semilogy(GRID, why["variance"] / half, "k.-")
    for name, w in why["marks"].items():
        curve.plot(w, np.interp(w, GRID, why["variance"]) / half, "o", label=name)
    curve.set(title="V(w) / V(1/2)", xlabel="share of light samples w")
    curve.legend()
    for row, (c, (v, p)) in enumerate([*why["sources"].items()][:6]):
        bars.barh([row, row], [v, p], color=["lightblue", "0.7"])
        bars.text(0, row, " ".join(map(str, c)), va="center")
    bars.set(title="V_c (blue), P_c (grey), over V", yticks=[])
    return figure


if __name__ == "__main__":
    two = {"type": int, "nargs": 2, "metavar": ("X", "Y")}
    arguments = {
        "scene": {"default": "killeroo-gold", "help": "pbrt file, model or name"},
        "pixel": two | {"default": (60, 80), "help": "column and row"},
        "resolution": two | {"default": (200, 150)},
    }
    opts, given = options("why_is_this_pixel_noisy", __doc__, **arguments)
    size, pixel = np.array([given.resolution, given.pixel]) // opts.pick(4, 1)
    scene = dmis.load_scene(given.scene, resolution=tuple(size.tolist()))
    why = explain(scene, tuple(pixel.tolist()), opts.pick(256, 4096))
    show(why)
    caption = """Directions of samples; V(w) and the shares of rules; parts V_c of V by
        light, technique and surface, with P_c, which is among points of the pixel."""
    opts.save(draw(why), f"Why pixel {why['pixel']} of {given.scene} is noisy", caption)
