"""Why a pixel is noisy: its variance at every share w, where the variance comes from, and its largest samples.

One pilot of the pixel alone, at w = 1/2 with pairs of shading samples, gives all of it. Its two halves of S shading
samples are independent at the point y where a camera sample meets the scene. With L_1 and L_2, what they make of the
camera sample, and the part c of a light, technique and surface,

    V_c = Cov(L_1c, L_1),    P_c = Cov(L_1c, L_2),    sum_c V_c = V(1/2),    sum_c P_c = P:

P is the variance among places y, which no share changes, and the rest of V that of the shading samples at a place,
``A / S`` (docs/measurements.md). What no technique estimates, such as a lamp that the camera sees, is a part apart.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dmis.base.validate import pair, whole
from dmis.base.vectors import Array, take
from dmis.estimator.records import Record
from dmis.estimator.settings import Settings, make_settings
from dmis.fit.fixed import Fixed
from dmis.pipeline.job import Job, resolve
from dmis.pipeline.render import render
from dmis.pipeline.tile import make_tiles, render_tile
from dmis.scene.scene import Scene
from dmis.scene.shading_points import ShadingPoints
from dmis.variance.curves import GRID, HALF, Curves

REACH, RULE_SPP = 48, 64
"""Pixels around a pixel from which rules learn its share, and their camera samples per pixel."""
LARGEST = 3
"""Number of sources whose largest sample is shown step by step."""
LITTLE = 0.05
"""Share of the variance below which a cause is not named."""
Source = tuple[str, str, int]
"""Where variance comes from: light, technique, and surface of the path, 1 for the first."""
SEEN: Source = ("seen emission, delta lights", "", 0)
"""What no technique estimates, as direct lighting has it."""
FURTHER: Source = ("emission, delta lights further on", "", 0)
"""What no technique estimates on paths that a BRDF has scattered."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """Why a pixel is noisy, see `explain`; radiance is the mean of the channels, in units of the scene.

    Attributes
    ----------
    job, spp
        The render of the pixel alone, and its camera samples.
    pixel, mean
        Column and row; radiance.
    variance
        V(w) of a camera sample at the shares of `dmis.variance.curves.GRID`, ``(G,)``.
    marks
        Shares w of light samples by name: of balance, of rules that learn, and of the oracle, where V is least.
    sources
        V_c and P_c over V, by `Source`: their sums are 1 and P / V.
    rare
        Share of the camera samples that have half of the variance.
    largest
        Steps of the largest shading sample of each of `LARGEST` sources: ``camera_sample``, ``path``, ``lobes``,
        ``source``, ``wi``, ``p_l``, ``p_b``, ``f`` with the path's throughput, ``W``, ``value``, ``W f / (w_k p_k)``.
    vertex
        Surface point and light of the first of these, and the directions of samples there by technique, those of later
        surfaces left out, for `figure`; None if no sample meets a light.
    """

    job: Job = field(repr=False)
    spp: int
    pixel: tuple[int, int]
    mean: float
    variance: Array
    marks: Mapping[str, float]
    sources: Mapping[Source, tuple[float, float]]
    rare: float
    largest: tuple[Mapping[str, Any], ...]
    vertex: tuple[ShadingPoints, Any, list[Array]] | None = field(repr=False)

    @property
    def causes(self) -> list[str]:
        """Sentences that say what makes the variance, the largest part first."""
        if not self.variance[HALF] > 0:
            return ["all camera samples of this pixel are equal: it has no noise"]
        seen = self.sources.get(SEEN, (0.0, 0.0))[1]
        further = self.sources.get(FURTHER, (0.0, 0.0))[1]
        among = sum(p for _, p in self.sources.values()) - seen - further
        left = float(self.variance.min() / self.variance[HALF])
        best = f"w = {self.marks['oracle']:.2g} leaves {left:.0%} of V" if left < 1 - LITTLE else "no w is much better"
        settings, plan = self.job.settings, self.job.scene.plan
        delta_lights = "delta lights, picked at random" if settings.one_light else "delta lights"
        emission = f"emission that is seen and light of {delta_lights}" if plan.deltas else "emission that is seen"
        others = ", and which light is picked" if settings.one_light else ""
        others += ", and what paths meet further on" if settings.integrator == "path" else ""
        parts = [
            (seen, f"is {emission}: an edge in the pixel's square, such as a lamp's, which no technique estimates"),
            (among, f"is among places of the square: edges, textures, borders of shadows{others}; no w changes it"),
            (further, "is light of paths that no technique estimates: lamps through glass or mirrors, or delta lights"),
            (1 - seen - further - among, f"is noise of light and BRDF samples at a place; {best}"),
        ]
        named = [f"{min(share, 1):.1%} of the variance {text}" for share, text in sorted(parts)[::-1] if share > LITTLE]
        return [*named, f"half of the variance is in {self.rare:.2%} of the camera samples"]

    def text(self) -> str:
        """Return a page of text: causes, V(w), sources and the largest samples."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        """Yield the lines of the text."""
        half = max(float(self.variance[HALF]), 0.0)
        yield f"pixel {self.pixel}: mean {self.mean:.4g}, standard deviation of a camera sample {half**0.5:.3g}"
        yield from (f"  {sentence}" for sentence in self.causes)
        if not half:
            return
        yield "V(w), variance of a camera sample with the share w of light samples, over V(1/2):"
        yield "  w " + "".join(f"{w:7.2f}" for w in GRID)
        yield "  V " + "".join(f"{v:7.2f}" if v < 1000 else f"{v:7.0e}" for v in self.variance / half)
        for name, w in self.marks.items():
            yield f"  {name:8} w = {w:.2f}, V = {np.interp(w, GRID, self.variance) / half:.2f}"
        yield "share of the variance, of it among places of the square, and where it comes from:"
        for (light, technique, surface), (v, p) in sorted(self.sources.items(), key=lambda item: -item[1][0]):
            yield f"  {v:7.1%} {p:7.1%}  {light}" + (f", {technique}, surface {surface}" if technique else "")
        for sample in self.largest:
            light, technique, surface = sample["source"]
            yield f"camera sample {sample['camera_sample']}: hits {' -> '.join(map(_vector, sample['path']))}"
            yield f"  {', '.join(sample['lobes'])} at surface {surface}: {technique} picks wi = {_vector(sample['wi'])}"
            densities = f"p_l = {sample['p_l']:.3g}, p_b = {sample['p_b']:.3g}, W = {sample['W']:.3f}"
            alone = f"it alone estimates {sample['value'] / self.mean:.3g} times the pixel"
            yield f"  towards {light}: f = {_vector(sample['f'])}, {densities}; {alone}"

    def figure(self, w: float = 0.5) -> Any:
        """Return a matplotlib figure: f, p_l, p_b and f / p_w over a hemisphere with the samples, V(w), and sources.

        ``ipywidgets.interact(explanation.figure, w=(0.0, 1.0))`` gives a notebook a slider.
        """
        from dmis.experiment.report.pixel_figure import pixel_figure

        return pixel_figure(self, w)


def explain(
    scene: Scene,
    pixel: tuple[int, int],
    spp: int = 4096,
    *,
    rules: Sequence[str] = ("thesis:weigh=samples", "auto"),
    seed: int = 0,
    settings: Settings | None = None,
    **options: Any,
) -> Explanation:
    """Return why a pixel is noisy: ``print(dmis.explain(scene, (120, 80)).text())``.

    Parameters
    ----------
    pixel, spp
        Column and row; camera samples of the pixel, which are independent, and the same again with the same seed.
    rules
        Rules whose share of the pixel is marked; they learn it from the pixels around (`REACH`).
    seed, settings, options
        See `dmis.pipeline.render.render`.

    Raises
    ------
    ValueError
        If the pixel is not in the image, or the settings do not suit a rule that learns from variances.
    """
    settings = make_settings(settings, **options)
    resolve(scene, "second-moment", None, seed, settings)  # refuses what curves cannot be learned from
    (x, y), (width, height) = pair("pixel", pixel, whole), scene.camera.resolution
    if not (0 <= x < width and 0 <= y < height):
        raise ValueError(f"pixel must be (column, row), from (0, 0) to {width - 1, height - 1}; got {x, y}")
    alone = scene.crop((x, y, x + 1, y + 1)), whole("spp", spp, 2), seed
    job, recorder = _record(*alone, settings)
    _, direct = _record(*alone, replace(settings, integrator="direct"))
    marks, sums = {"balance": 0.5}, recorder.sums()
    (left, right), (top, bottom) = (
        (max(0, at - REACH), min(size, at + REACH)) for at, size in ((x, width), (y, height))
    )
    around = scene.crop((left, top, right, bottom))
    for rule in rules:
        weight = render(around, rule, RULE_SPP, seed=seed, settings=settings).weight
        marks[rule.partition(":")[0]] = float(weight[y - top, x - left])
    variance = (sums["curve"] + np.maximum(sums["position"], 0))[:, 0] * job.gain**2
    marks["oracle"] = float(GRID[variance.argmin()])
    return Explanation(job, spp, (x, y), variance=variance, marks=marks, **recorder.findings(job, direct))


def _record(pixel: Scene, spp: int, seed: int, settings: Settings) -> tuple[Job, _Recorder]:
    """Render a scene of one pixel; return the job, and what records its samples."""
    job = resolve(pixel, Fixed(0.5), spp, seed, settings).alone
    recorder = _Recorder(1, 2 * job.settings.shading_samples)
    for tile in make_tiles((1, 1), seed, 0, job.budget.pilot(0.5, 2 * spp, lambda *_: recorder)):
        render_tile(job.scene, tile)
    return job, recorder


class _Recorder(Curves):
    """Variance curves of one pixel, and all records of its shading samples."""

    directions = True

    def __init__(self, pixels: int, shading_samples: int) -> None:
        super().__init__(pixels, shading_samples)
        self._records: list[Any] = []  # `Record`s with directions
        self._radiance: list[Array] = []

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """Add one block of `count` camera samples; records are kept with the numbers of their camera samples."""
        numbers = np.arange(self._n, self._n + count)
        super().add(records, radiance, count)
        self._records += [replace(record, sample=take(numbers, record.sample)) for record in records]
        self._radiance.append(radiance.mean(axis=0, dtype=np.float64))

    def unsampled(self) -> Array:
        """Return the radiance of the camera samples that no technique estimates, ``(N,)``."""
        radiance = np.concatenate(self._radiance)
        rest = radiance.copy()
        for record in self._records:
            rest[record.sample] -= record.value.mean(axis=0) / (2 * self._s)
        rest[np.abs(rest) < 1e-6 * radiance] = 0  # rounding errors
        return rest

    def findings(self, job: Job, direct: _Recorder) -> dict[str, Any]:
        """Return fields of an `Explanation`: ``mean``, ``sources``, ``rare``, ``largest``, ``vertex``.

        `direct` has recorded the pixel in direct lighting, where no lobe but delta lobes sends rays on.
        """
        radiance, s = np.concatenate(self._radiance), job.settings.shading_samples
        plan, compensation = job.scene.plan, job.settings.sky_compensation
        self._job = job
        # a tree may select among lamps where a path has scattered, see `dmis.estimator.draws`
        self._lights = [
            (*plan.sampled_lights(name, compensation), *plan.deltas) for name in (job.settings.lights, "tree")
        ]
        halves = defaultdict[Source, Array](lambda: np.zeros((2, len(radiance))))  # L_1c, L_2c
        for record in self._records:
            half = record.sample_index % 2
            halves[self._source(record)][half, record.sample] += record.value.mean(axis=0) / s
        at_y = sum(halves.values(), np.zeros((2, len(radiance))))
        # the same in both halves: emission that is seen, delta lights
        rest = self.unsampled()
        share = min(1, direct.unsampled().var() / rest.var()) if rest.var() else 1
        halves[SEEN] = np.stack([rest, rest]) * share
        halves[FURTHER] = np.stack([rest, rest]) * (1 - share)
        deviation = at_y + rest - (at_y + rest).mean(axis=1, keepdims=True)
        # V_c = Cov(L_1c, L_1),  P_c = Cov(L_1c, L_2)
        of_sources = {c: ((a * deviation).mean(), (a * deviation[::-1]).mean()) for c, a in halves.items() if a.any()}
        total = max(sum(v for v, _ in of_sources.values()), 1e-300)
        squares = np.sort(np.square(deviation[0]))[::-1].cumsum()
        # the largest sample of each source
        best: dict[Source, tuple[float, Any, int]] = {}
        for record in self._records:
            value = record.value.mean(axis=0)
            source, k = self._source(record), int(value.argmax()) if len(value) else 0
            if value.any() and value[k] > best.get(source, (0.0,))[0]:
                best[source] = (float(value[k]), record, k)
        largest = sorted(best.values(), key=lambda item: -item[0])[:LARGEST]
        return {
            "mean": float(radiance.mean()) * job.gain,
            "sources": {c: (float(v / total), float(p / total)) for c, (v, p) in of_sources.items()},
            "rare": (np.searchsorted(squares, squares[-1] / 2) + 1) / len(radiance),
            "largest": tuple(self._steps(record, k) for _, record, k in largest),
            "vertex": self._vertex(*largest[0][1:]) if largest else None,
        }

    def _light(self, record: Any) -> tuple[Any, str]:
        """Return the light that a record samples, and its name."""
        settings, (lights, selected) = self._job.settings, self._lights
        beyond, number = divmod(record.key[-1], len(lights))
        deeper = len(record.key) > 1 and settings.integrator == "path"
        if deeper and self._job.scene.plan.selects_deeper(settings.lights):
            # a tree selects among lamps if the path has scattered, but not behind mirrors: p_l tells which
            p_l = lights[number].seen_from(record.surface.ng).hit(record.p, record.wi).pdf
            if np.isclose(p_l, record.pdf[0], rtol=1e-3).mean() < 0.5:
                lights = selected
                beyond, number = divmod(record.key[-1], len(lights))
        return lights[number], f"{type(lights[number]).__name__} {number}{' from behind' if beyond else ''}"

    def _source(self, record: Any) -> Source:
        """Return light, technique and surface of a record, see `Record.key`."""
        return self._light(record)[1], self._job.settings.techniques[record.technique_index], len(record.key)

    def _vertex(self, record: Any, k: int) -> tuple[ShadingPoints, Any, list[Array]]:
        """Return `Explanation.vertex` at the sample k of a record; paths come to later surfaces at other places."""
        alike = [r for r in self._records if r.key == record.key and len(r.key) == 1]
        directions = [[r.wi for r in alike if r.technique_index == technique] for technique in (0, 1)]
        surface = record.surface.take(np.full(2, k))
        return surface, self._light(record)[0], [np.hstack([np.zeros((3, 0)), *of]) for of in directions]

    def _steps(self, record: Any, k: int) -> dict[str, Any]:
        """Return the steps of the shading sample k of a record, see `Explanation.largest`."""
        origin, length, gain = self._job.given_scene.units
        sample, path = record.sample[k], {}
        for other in self._records:
            at = np.flatnonzero(other.sample == sample)
            if len(at) and len(other.key) <= len(record.key):
                path[len(other.key)] = (other.p[:, at[0]] * length + origin).tolist()
        p_l, p_b = record.pdf[:, k].tolist()
        p_w = (p_l + p_b) / 2
        return {
            "camera_sample": int(sample),
            "source": self._source(record),
            "path": [path[depth] for depth in sorted(path)],
            "wi": record.wi[:, k].tolist(),
            "lobes": [type(lobe).__name__ for lobe in record.surface.reflection],
            "f": (record.value[:, k] * (p_w * gain)).tolist(),
            "p_l": p_l,
            "p_b": p_b,
            "W": (p_l, p_b)[record.technique_index] / (p_l + p_b),
            "value": float(record.value[:, k].mean()) * gain,
        }


def _vector(values: Sequence[float]) -> str:
    """Return a vector as text."""
    return f"({', '.join(f'{x:.3g}' for x in values)})"
