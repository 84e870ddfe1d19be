"""Rendering with a rule: pilot, fit, final pass, one image.

The budget `spp` includes the pilot. Pilot and final image are both unbiased. Where the pilot is part of the image they
are averaged with weights fixed beforehand, their camera samples: so the result is unbiased although the weights were
learned. (Weighting by estimated variance would not be.) Each of them is a pass over the image (`dmis.passes`).
"""

from __future__ import annotations

import math
import os
import pickle
import time
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from typing import Any

import numpy as np

from dmis import __version__, control, technique
from dmis.budget import LEVELS, divided, whole_samples
from dmis.checkpoint import Store
from dmis.checks import whole
from dmis.combine import COLLECTORS
from dmis.cost import UNSEEN
from dmis.files import check_writable
from dmis.fireflies import find_fireflies
from dmis.fit import Fixed, Rule, Weight, check_fit, settle
from dmis.guides import guides
from dmis.memory import release
from dmis.mis import FROZEN
from dmis.passes import Passes, Progress
from dmis.rules import make_rule
from dmis.samplers import Kind, stream
from dmis.scene import Scene
from dmis.settings import DEPTH, MOST, Settings
from dmis.tile import Tile
from dmis.units import suited
from dmis.variance import Film
from dmis.vec import Array
from dmis.workers import Workers

LEARNING = 16
"""Samples per pixel from which on a pilot pays."""
MOST_SPP = 2**20
"""Camera samples per pixel."""
MOST_WORKERS = 1024
"""Threads or processes."""
_SAVED = 24  # bytes that a checkpoint has for a pixel and pass, sums aside


@dataclass(frozen=True, eq=False)
class Result:
    """An image and how it came about.

    Attributes
    ----------
    image
        ``(H, W, 3)`` float32 linear RGB, row 0 on top.
    deviation
        ``(H, W, 3)`` float32: estimated standard deviation of `image` itself (of the mean, not of one sample); NaN at
        one sample. It takes samples to be independent, so it is too large where systematic rounding or a structured
        sampler spreads them. Its square is `variance`.
    weight
        ``(H, W)`` float32: share of light samples in the final pass, or whichever technique is the first.
    samples
        ``(H, W)`` float32: samples of the budget spent, pilot included, whether or not it is part of the image. Camera
        samples, where they have as many shading samples as `settings` says; with more they count for as many.
    seconds
        ``pilot``, ``fit``, ``render`` (the final pass) and their sum ``total``.
    rays
        Rays traced, by kind: ``camera`` (one per camera sample, but for pixels that are known to see nothing),
        ``shadow`` (of light samples), ``brdf``, ``uniform``, ``resampled``, ``delta`` (towards lights of a single
        direction), ``specular`` (through mirrors and glass), ``bounce 1``, ``bounce 2``, ... (of paths that went on
        from so many surfaces); ``guide``, towards what a rule's filter is guided by.
    maps
        Diagnostics of the rule.
    provenance
        What is needed to make the image again; plain JSON data. ``bias`` lists what makes it biased, if anything does.
    """

    image: Array
    deviation: Array
    weight: Array
    samples: Array
    seconds: Mapping[str, float]
    rays: Mapping[str, int]
    maps: Mapping[str, np.ndarray]
    provenance: Mapping[str, Any]
    tiles: tuple[Tile, ...] = field(default=(), repr=False)

    @property
    def variance(self) -> Array:
        """``(H, W, 3)`` float64: square of `deviation`, which may be beyond float32."""
        return np.square(self.deviation, dtype=np.float64)

    @property
    def fireflies(self) -> np.ndarray:
        """``(H, W)`` bool: pixels that look like fireflies, see `dmis.fireflies`."""
        return find_fireflies(self.image, self.variance, self.samples)


def render(
    scene: Scene,
    rule: Rule | str | None = None,
    spp: int = 128,
    *,
    seed: int = 0,
    sampler: Kind | None = None,
    settings: Settings | None = None,
    threads: int | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> Result:
    """Render `scene`.

    Parameters
    ----------
    rule
        A rule or its text, ``balance``, ``fixed:0.25``, ``thesis:patch=16``; see `dmis.rules.RULES`. None: ``auto``, or
        ``balance``, with the techniques and the combiner of `settings`, for fewer than `LEARNING` samples or tens of
        thousands, for a number of shading samples that is odd or very large, or with the technique ``resampled``.
    spp
        Camera samples per pixel, the rule's pilot included.
    seed
        Not negative. The image depends on it, on nothing in the machine.
    sampler
        Shorthand for ``settings.sampler``. The pilot is always independent, because a sample variance assumes it.
    settings
        Estimator settings. A rule has some of its own, such as its combiner; it is an error to ask for others here.
    threads
        Number of threads if neither workers nor an executor are given; default: one per processor.
    workers
        Number of processes in place of threads. Tiles of one that dies are rendered again. A script must then start
        from under ``if __name__ == "__main__":``.
    executor
        Where tiles are rendered in place of these: any `concurrent.futures.Executor`, Dask's
        ``Client.get_executor(pure=False)`` among them. It is not shut down.
    progress
        Called in this thread after each tile.
    checkpoint
        A file that every finished tile is saved to; if it exists, rendering goes on from it. It is removed at the
        end.

    Raises
    ------
    ValueError
        If an argument is out of range, settings and rule disagree, a rule's weights are none, or the checkpoint is
        damaged, in use, or belongs to a different image; or if a pixel comes out as infinite or NaN, which never is in
        an image.
    OSError
        If the checkpoint cannot be written; a ``ChildProcessError`` if workers keep dying.
    """
    if not isinstance(scene, Scene):
        raise ValueError(f"scene must be a dmis.Scene, which dmis.load_scene makes; got {scene!r}")
    spp, seed = whole("spp", spp, 1, MOST_SPP), whole("seed", seed, 0)
    threads, workers = _crew(threads, workers, executor)
    described, (scene, gain) = scene, suited(scene)
    asked = settings or Settings()
    asked = asked if sampler is None else replace(asked, sampler=sampler)
    if rule is None:
        s = asked.shading_samples
        half: Rule = Fixed(0.5, asked.combiner, asked.techniques, asked.allocation)
        learns = LEARNING <= spp <= LEVELS[-1] // 2 and s % 2 == 0 and 2 * s <= MOST and _exact(asked)
        rule = "auto" if learns else "balance" if half == Fixed() else half
    rule_text = rule if isinstance(rule, str) else repr(rule)
    rule = make_rule(rule)
    settings = scene.plan.settle(settle(rule, rule_text, asked))
    if settings.reuse_pilot is None:
        settings = replace(settings, reuse_pilot=settings.sampler == "independent")
    gather = getattr(rule, "statistic", None)
    several = getattr(rule, "several", False)
    if len(settings.techniques) > 2 and not several:
        raise ValueError(
            f"rule {rule_text} divides samples between two techniques; got {', '.join(settings.techniques)}, which "
            f"rule simplex divides them between"
        )
    if gather is not None and not several and not _exact(settings):
        raise ValueError(
            f"rule {rule_text} learns from densities, and that of technique resampled is not known; rules that learn "
            f"from variances, such as thesis, and fixed weights do without"
        )
    if gather is not None and settings.allocation == "random":
        raise ValueError(
            f"rule {rule_text} learns variances at shares that are kept, and allocation random keeps none; rules that "
            f"gather no statistic, such as thesis, and fixed weights go with it"
        )
    controlled = settings.combiner == "controlled"
    if controlled:
        gather = control.statistic(rule.pilot, gather)
    elif gather is not None and _separate(rule, settings):
        gather = partial(gather, classes=2)
    pilot_spp = sum(rule.pilot.values())
    if spp <= pilot_spp:
        raise ValueError(
            f"spp must be more than the pilot's {pilot_spp} camera samples, because the budget includes the pilot "
            f"of rule {rule_text}; got {spp}"
        )
    provenance = {
        "dmis": __version__,
        "scene": scene.name,
        "scene_hash": fingerprint(described),
        "resolution": list(scene.camera.resolution),
        "rule": rule_text,
        "spp": spp,
        "seed": seed,
        "settings": asdict(settings),
        **({} if settings.clamp is None else {"bias": [f"camera samples clamped at {settings.clamp:g}"]}),
    }
    if settings.clamp is not None:
        settings = replace(settings, clamp=settings.clamp / gain)
    learning = pilot_settings(settings, rule.pilot, gather is not None)
    if checkpoint is not None:
        check_writable(checkpoint, _SAVED * math.prod(scene.camera.resolution) * (len(rule.pilot) + 1))
    store = Store(checkpoint, provenance)
    crew = Workers(scene, executor, threads, workers)
    work = Passes(scene, seed, crew, progress, store)
    try:
        scene.prepare()
        begin = time.perf_counter()
        pilot = {
            w: work.render(k, "pilot", int(n if gather is None else n // len(settings.techniques)), w, learning, gather)
            for k, (w, n) in enumerate(sorted(rule.pilot.items()))
        }
        if getattr(rule, "guided", False):
            seen, rays = guides(scene)
            work.rays["guide"] += rays
            pilot = {w: replace(p, guides=seen) for w, p in pilot.items()}
            del seen
            release(math.prod(scene.camera.resolution))
        fitted = time.perf_counter()
        fit = rule.fit({w: control.without(p) for w, p in pilot.items()} if controlled else pilot)
        check_fit(fit, scene.camera.resolution[::-1], len(settings.techniques) if several else 2)
        combiner = fit.combiner or settings.combiner
        if fit.later is not None and combiner in COLLECTORS:
            raise ValueError(f"a rule's later must be None with combiner {combiner}, which knows one weight of a pixel")
        if combiner == "frozen":
            fit = replace(fit, weight=np.clip(fit.weight, *FROZEN))
            fit = fit if fit.later is None else replace(fit, later=np.clip(fit.later, *FROZEN))
        mean, shading_samples = divided(spp - pilot_spp, settings.shading_samples, fit.split)
        fit = replace(fit, split=shading_samples / settings.shading_samples)
        counts: Array | int = mean
        if fit.samples is not None:
            counts = whole_samples(np.asarray(fit.samples), mean, stream(seed, len(pilot), 2**31))
        shading = replace(settings, combiner=combiner, shading_samples=shading_samples)
        beta = control.coefficients(pilot[0.5], fit.weight, fit.later) if controlled else None
        pilot_rays = sum((Counter(p.rays) for p in pilot.values()), Counter[str]())
        parts = [(p.moments, int(np.mean(p.moments.n))) for p in pilot.values()] if settings.reuse_pilot else []
        del pilot  # it is large, and nothing else of it is needed
        final_begin = time.perf_counter()
        final = work.render(
            len(rule.pilot), "final", counts, fit.weight, shading, control=beta, later=fit.later
        ).moments
        end = time.perf_counter()
    except BaseException:
        store.close()
        crew.close(now=True)
        raise
    crew.close()
    work.rays.pop(UNSEEN, None)
    image, deviation = _combine([(final, spp - pilot_spp), *parts], gain)  # not `mean`, which depends on the pilot
    store.remove()
    shape = image.shape[:2]
    return Result(
        image=image,
        deviation=deviation,
        weight=_map(_first(fit.weight), shape),
        samples=_map(pilot_spp + np.float32(fit.split) * np.asarray(counts, np.float32), shape),
        seconds={
            "pilot": fitted - begin,
            "fit": final_begin - fitted,
            "render": end - final_begin,
            "total": end - begin,
        },
        rays=dict(work.rays),
        maps=fit.maps,
        provenance={**provenance, "combiner": combiner, "rays": dict(work.rays), "pilot_rays": dict(pilot_rays)},
        tiles=tuple(work.tiles),
    )


def pilot_settings(settings: Settings, pilot: Mapping[Weight, int], paired: bool) -> Settings:
    """What a pilot is rendered with: independent samples, which statistics assume, and the balance heuristic, whose
    terms are f / p_w, however the final samples are drawn and combined.

    If `paired`, because a statistic is gathered, with twice the shading samples in half the camera samples: what
    varies over a pixel, and what varies at a point, are told apart by two independent estimates at the same point. For
    K techniques to have two samples each, with K times as many in as many times fewer.

    Raises
    ------
    ValueError
        If a number of samples is odd, and must not be.
    """
    settings = replace(settings, combiner="balance", allocation="systematic", sampler="independent")
    if not paired:
        return settings
    techniques = len(settings.techniques)
    for name, n in (("shading_samples", settings.shading_samples), *(("pilot samples", n) for n in pilot.values())):
        if n % 2:
            raise ValueError(f"{name} must be even for rules that learn from two halves of them; got {n}")
        if name != "shading_samples" and n % techniques:
            raise ValueError(f"{name} must be a multiple of {techniques}, the number of techniques; got {n}")
    return replace(settings, shading_samples=techniques * settings.shading_samples)


def _separate(rule: Rule, settings: Settings) -> bool:
    """Whether weights of later surfaces are learned apart; not for combiners that need to know a pixel's one weight."""
    several = settings.integrator == "path" and settings.max_depth != 1
    return getattr(rule, "separate", False) and several and settings.combiner not in COLLECTORS


def _exact(settings: Settings) -> bool:
    return all(technique.find(name).exact for name in settings.techniques)


def _crew(threads: int | None, workers: int | None, executor: Executor | None) -> tuple[int | None, int | None]:
    """Numbers of threads and workers; only one of the three may be given."""
    given = {"threads": threads, "workers": workers, "executor": executor}
    if len(names := [name for name, value in given.items() if value is not None]) > 1:
        raise ValueError(
            f"tiles are rendered by threads, workers or an executor, not by more; got {' and '.join(names)}"
        )
    return (
        None if threads is None else whole("threads", threads, 1, MOST_WORKERS),
        None if workers is None else whole("workers", workers, 1, MOST_WORKERS),
    )


def _combine(parts: list[tuple[Film, int]], gain: float) -> tuple[Array, Array]:
    """Average images with weights fixed beforehand, their numbers of samples; and the average's deviation.

    They take the place of the first of them, and are worked out row by row, because images are large. Both are in the
    units of the scene that was given, which has `gain` times the radiance of the one that was rendered.
    The actual numbers of adaptive samples depend on the pilot, and must not be weights: that would be biased.
    """
    total = sum(n for _, n in parts)
    image, deviation = parts[0][0].mean, parts[0][0].root
    shape = image.shape
    for row in range(len(image)):
        mean, variance = np.zeros((2, *shape[1:]))
        for part, n in parts:
            share = n / total
            mean += part.mean[row] * share
            n_each = np.broadcast_to(np.asarray(part.n, np.float64), (*shape[:2], 1))[row]
            freedom = np.where(n_each > 1, n_each - 1, np.nan)  # one sample has no variance
            variance += np.square(part.root[row], dtype=np.float64) / (freedom * n_each) * share**2
        mean *= gain
        if not (np.abs(mean) <= np.finfo(np.float32).max).all():
            most = np.abs(mean).max()
            raise ValueError(f"radiance must be below 3.4e38, the largest float32; the image has {most:g}")
        with np.errstate(over="ignore"):  # a deviation may be beyond float32 where the mean is not
            image[row], deviation[row] = mean, np.sqrt(variance) * gain
    return image, deviation


def _map(values: Array | float, shape: tuple[int, int]) -> Array:
    return np.ascontiguousarray(np.broadcast_to(np.asarray(values, np.float32), shape))


def _first(weight: Array | float) -> Array:
    """Share of the first technique, of what a `dmis.fit.Fit` has."""
    found = np.asarray(weight, np.float32)
    return found[0] if found.ndim in (1, 3) else found


def fingerprint(scene: Scene) -> str:
    """A short hash of the description: camera, meshes and which of them are lights, materials, lights; an integrator or
    filter if not the usual.
    """
    import hashlib  # imported where used: it brings OpenSSL

    lights = [(type(light).__name__, [getattr(light, f.name) for f in fields(light)]) for light in scene.lights]
    materials = [part.material for part in scene.parts]
    camera = scene.camera
    digest = hashlib.sha256(
        pickle.dumps((camera.fov, camera.resolution, camera.corner, camera.frame, lights, materials))
    )
    digest.update(np.asarray(camera.to_world, np.float64).tobytes())
    if camera.filter is not None:
        digest.update(repr(camera.filter).encode())
    if (scene.integrator or "direct", scene.max_depth or DEPTH) != ("direct", DEPTH):
        digest.update(repr((scene.integrator, scene.max_depth)).encode())
    for part in scene.parts:
        digest.update(np.asarray(part.mesh.vertices, np.float32).tobytes())
        digest.update(np.asarray(part.mesh.faces, np.int32).tobytes())
        for name, table in (("normals", part.mesh.normals), ("uv", part.mesh.uv)):
            if table is not None:
                digest.update(name.encode() + np.asarray(table, np.float32).tobytes())
        if part.light is not None:
            digest.update(b"light %d" % next(k for k, light in enumerate(scene.lights) if light is part.light))
        if part.tangent is not None:
            digest.update(np.asarray(part.tangent, np.float64).tobytes())
    return digest.hexdigest()[:16]
