"""Layers of an image: what its pixels show, and parts of its light, from the records of the image's own samples.

``albedo``, ``normal``
    Albedo and normal of the first surface, means over 16 rays per pixel, for denoisers.
``depth``, ``position``, ``uv``, ``part``
    Distance, position, texture coordinates and number in `Scene.parts` of the first surface at the pixel's centre.
``direct``, ``indirect``
    Visible emission, delta lights and light reflected once; light reflected at later surfaces, also behind mirrors.
    Both sum to the image.
``emission``, ``light``, ``light:NUMBER``
    Visible emission and delta lights; the light of every sampled light, or of one. All sum to the image.
``technique``
    The contribution ``W f / (w_k p_k)`` of each technique's samples, which with ``emission`` sum to the image. The
    estimate ``f / p_k`` of one alone is rendered by ``fixed:1`` and ``fixed:0`` (Veach 1997, Figure 9.2, has both).
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from dmis.base.patches import pixels_together
from dmis.base.validate import did_you_mean
from dmis.base.vectors import Array
from dmis.estimator.mis import combiner_by_name
from dmis.estimator.records import Record, Wants
from dmis.fit.round import Budget, Round
from dmis.fit.rule import Rule, next_round
from dmis.pipeline.job import Job
from dmis.scene.feature_buffers import SURFACE_LAYERS, render_surface_layers
from dmis.variance.moments import Film

OF_LIGHT = ("direct", "indirect", "emission", "light", "technique")
"""Layers of light, beside ``light:NUMBER``."""


def with_layers(job: Job, names: Sequence[str]) -> Job:
    """Return the job with `Job.layers` that make the layers `names`.

    A ValueError if a layer is unknown, or does not go with the rule. Layers of light need a number of samples that is
    fixed and the same for all pixels; with them a window is rendered as an image of its own.
    """
    plan, settings = job.scene.plan, job.settings
    lights = [type(light).__name__ for light in plan.sampled_lights(settings.lights, settings.sky_compensation)]
    known = [*SURFACE_LAYERS, *OF_LIGHT, *(f"light:{number}" for number in range(len(lights)))]
    for name in names:
        if name == "unweighted":
            raise ValueError("layer unweighted is rendered by rule fixed:1 for light, fixed:0 for BRDF samples")
        if name not in known:
            numbered = (f"light:{number} ({light})" for number, light in enumerate(lights))
            allowed = ", ".join((*SURFACE_LAYERS, *OF_LIGHT, *numbered))
            raise ValueError(f"layers must be of {allowed}; got {name!r}{did_you_mean(name, known)}")
    of_light = frozenset(names) - {*SURFACE_LAYERS}
    job = replace(job, notes={**job.notes, "layers": ",".join(names)})
    make = partial(render_surface_layers, job.given_scene, [name for name in names if name not in of_light])
    if not of_light:
        return replace(job, layers=make)
    if job.most > job.spp:
        raise ValueError("layers of light need a fixed number of samples: give spp without noise or seconds")
    paths = settings.integrator == "path"
    if of_light & {"direct", "indirect"} and plan.deltas and paths:
        raise ValueError(
            "layers direct and indirect by paths need a scene without delta lights, because no record tells at which "
            "surface such a light shines; this scene has some. Take light and emission, or integrator=direct"
        )
    if paths and plan.selects_deeper(settings.lights) and any(name.startswith("light") for name in of_light):
        raise ValueError("layers of lights by paths need samples of each, but a tree selects one; set lights=all")
    parts = {"light": range(len(lights)), "technique": settings.techniques}
    files = [f"{name}.{of}" for name in parts.keys() & of_light for of in parts[name]]
    files += [name.replace(":", ".") for name in of_light - parts.keys()]
    rule = _Gathering(job.rule, tuple(sorted(files)), len(lights) + len(plan.deltas), settings.techniques)
    return replace(job.alone, rule=rule, layers=lambda: {**make(), **rule.means(job)})


@dataclass(frozen=True, eq=False)
class _Gathering(Rule):
    """A rule whose rounds of the image gather layers of light in `sums`, times their weights in the image."""

    rule: Rule
    layers: tuple[str, ...]
    lights: int
    techniques: tuple[str, ...]
    sums: dict[str, Array] = field(default_factory=dict)

    def means(self, job: Job) -> dict[str, Array]:
        """Return the layers that were gathered, ``(H, W, 3)`` float32."""
        scale, shape = job.gain / self.sums.pop("weight"), job.given_scene.camera.resolution[::-1]
        images = {name: pixels_together(sums * scale, shape) for name, sums in self.sums.items()}
        return {name: np.moveaxis(image, 0, -1).astype(np.float32) for name, image in images.items()}

    @property
    def weigh(self) -> str:
        return self.rule.weigh

    def rounds(self, budget: Budget) -> Generator[Round, Film, None]:
        """See `Rule.rounds`."""
        rounds, film = self.rule.rounds(budget), None
        while (requested := next_round(rounds, film)) is not None:
            film = yield self._gathered(requested) if requested.image_weight else requested
            if requested.image_weight:
                means = {name: sums / requested.spp for name, sums in film.sums.items()} | {"weight": np.ones(())}
                for name, mean in means.items():
                    self.sums[name] = self.sums.get(name, 0) + requested.image_weight * mean

    def _gathered(self, round_: Round) -> Round:
        """Return a round of the image that gathers the layers.

        A ValueError if they would not sum to the image, because records do not tell all of it or weigh otherwise.
        """
        combiner, names = combiner_by_name(round_.settings.combiner), tuple(t.name for t in round_.mixture)
        uneven = round_.patterns is not None or np.ndim(round_.spp) > 0
        violated = {
            "a rule that takes the same number of samples in all pixels, such as balance or thesis": uneven,
            "rounds without a statistic (reuse_pilot=False)": round_.statistic is not None,
            "rounds that go on from no earlier one": round_.before is not None,
            f"rounds of the settings' techniques, {', '.join(self.techniques)}": names != self.techniques,
            "a combiner that only weighs samples, such as balance": combiner.collector is not None,
        }
        got = f"combiner {combiner.name}, techniques {', '.join(names)}, rule {self.rule!r}"
        for need, wrong in violated.items():
            if wrong:
                raise ValueError(f"layers of light need {need}; got {got}")
        return replace(round_, statistic=partial(_LayerSums, rule=self))


class _LayerSums:
    """Statistic of the layers of light, for each pixel: sums over its camera samples, ``(3, P)``."""

    wants = Wants(sums="pixels")

    def __init__(self, pixels: int, shading_samples: int, rule: _Gathering) -> None:
        self._pixels, self._s, self._rule = pixels, shading_samples, rule
        self._sums = {name: np.zeros((3, pixels)) for name in rule.layers}

    def add(self, records: Sequence[Record], radiance: Array, count: int) -> None:
        """See `dmis.estimator.records.Statistic.add`."""
        pixel, rest = np.arange(radiance.shape[1]) % self._pixels, radiance.astype(np.float64)
        for record in records:
            samples = slice(None) if record.sample is None else record.sample
            value = record.value.astype(np.float64) / self._s
            rest[:, samples] -= value
            technique = self._rule.techniques[record.technique_index]
            surface = "direct" if len(record.key) == 1 else "indirect"
            for name in (surface, f"light.{record.key[-1] % self._rule.lights}", f"technique.{technique}"):
                self._put(name, pixel[samples], value)
        rest[np.abs(rest) < 1e-6 * radiance] = 0  # rounding errors
        for name in ("direct", "emission"):
            self._put(name, pixel, rest)

    def _put(self, name: str, pixel: np.ndarray, value: Array) -> None:
        """Add values ``(3, N)`` to a layer, if it is asked for."""
        if name in self._sums:
            for total, channel in zip(self._sums[name], value, strict=True):
                total += np.bincount(pixel, channel, self._pixels)

    def sums(self) -> dict[str, Array]:
        """See `dmis.estimator.records.Statistic.sums`."""
        return self._sums
