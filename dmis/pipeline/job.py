"""A render job: everything that is checked and decided before the first ray.

`resolve` checks the arguments of `dmis.pipeline.render.render` once, and returns the `Job`: scene, rule, settings.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any
from warnings import warn

from dmis import __version__
from dmis.base.validate import whole
from dmis.base.vectors import Array
from dmis.base.window import MAX_PIXELS, Window
from dmis.estimator.settings import PRESETS, Settings
from dmis.fit.fixed import Fixed
from dmis.fit.registry import make_rule
from dmis.fit.round import LEVELS, Budget
from dmis.fit.rule import Rule, check_settings, merge_settings, rule_text
from dmis.scene.scene import Scene, SceneWarning

DEFAULT_SPP = 128
"""Camera samples per pixel of a render that nothing else ends."""
MAX_SPP = 2**20
"""Largest number of camera samples per pixel."""
FIRST_SPP = 32
"""Camera samples per pixel of a rule's own rounds where the last one is doubled, see `dmis.pipeline.stopping`."""


@dataclass(frozen=True, eq=False)
class Job:
    """A render whose arguments passed every check.

    Attributes
    ----------
    scene
        The scene in units and at a place that float32 holds; its radiance times `gain` is that of `given_scene`.
    given_scene
        The scene of the caller.
    rule, rule_text
        The rule, and its text in messages and in the provenance.
    spp, most, seed
        Camera samples per pixel, the pilot's included; how many they may become by doubling; and the seed.
    settings, sources
        Estimator settings of the final pass; and who decided each: ``caller``, ``rule``, ``preset``, ``scene``,
        ``default``.
    notes
        Why another rule than that of `rule_text` renders it (``nothing_to_mix`` or ``fallback``); a window's place.
    window
        The part of the image of `scene` that is rendered; None: all of it.
    layers
        Makes layers, when the image is rendered, see `dmis.pipeline.image_layers`.
    """

    scene: Scene
    gain: float
    given_scene: Scene
    rule: Rule
    rule_text: str
    spp: int
    most: int
    seed: int
    settings: Settings
    sources: Mapping[str, str] = field(default_factory=dict)
    notes: Mapping[str, Any] = field(default_factory=dict)
    window: Window | None = None
    layers: Callable[[], Mapping[str, Array]] = dict

    @cached_property
    def provenance(self) -> Mapping[str, Any]:
        """Description of the image before it is rendered; plain JSON data.

        Hashing the scene takes time, so the description is made when it is first read. The hash is None if a part of
        the scene has no fingerprint (`dmis.pipeline.fingerprint.digest`); an image is written all the same.
        """
        from dmis.pipeline.fingerprint import fingerprint

        scene = self.given_scene
        try:
            scene_hash = fingerprint(scene)
        except ValueError:
            scene_hash = None
        return {
            "dmis": __version__,
            "scene": scene.name,
            "scene_hash": scene_hash,
            **({"source": dict(scene.source)} if scene.source else {}),
            "resolution": list(scene.camera.resolution),
            "rule": self.rule_text,
            "spp": self.spp,
            "seed": self.seed,
            "settings": asdict(self.settings),
            **self.notes,
        }

    @property
    def alone(self) -> Job:
        """The job with its window as an image of its own, so that no time is spent outside of it."""
        return replace(self, scene=self.given_scene.in_float32[0], window=None)


def resolve(
    scene: Scene, rule: Rule | str | None, spp: int | None, seed: int, settings: Settings, doubling: bool = False
) -> Job:
    """Return the job of the arguments of `dmis.pipeline.render.render`, with a value in place of every default.

    With `doubling`, `spp` is the most: the job has `FIRST_SPP`, doubled until they are enough for the rule. A
    ValueError if an argument is not right, or arguments do not go together.
    """
    if not isinstance(scene, Scene):
        raise ValueError(f"scene must be a dmis.Scene, which dmis.load_scene makes; got {scene!r}")
    most = whole("spp", (MAX_SPP if doubling else DEFAULT_SPP) if spp is None else spp, 1, MAX_SPP)
    spp = min(FIRST_SPP, most) if doubling else most
    seed = whole("seed", seed, 0)
    float32_scene, gain = scene.in_float32
    _warn_if_dark(float32_scene)
    rule, objection = (rule, "") if rule is not None else default_rule(spp, settings)
    named, text = make_rule(rule), rule_text(rule)
    while spp < most and spp < max(named.least_spp, named.pilot_samples(spp) + 1):
        spp = min(2 * spp, most)
    objection = objection or named.fallback(spp)
    notes = {"fallback": objection} if objection else {}
    if named.shares_only and not objection and not float32_scene.plan.mixable:
        notes["nothing_to_mix"] = "no light has two techniques: no pilot, equal shares"
    # fill what is open, of the settings and then of the rule; equal shares, if there is a reason
    filled, sources = merge_settings(settings, float32_scene, named, text, equal=bool(notes))
    used = (_equal_shares(filled) if notes else named).filled(filled)
    check_settings(used, text, filled)
    if spp <= (pilot_spp := used.pilot_samples(spp)):
        raise ValueError(
            f"spp must be more than the pilot's {pilot_spp} camera samples, because the budget includes the pilot "
            f"of rule {text}; got {spp}. Use a larger spp or another rule, such as balance"
        )
    job = Job(float32_scene, gain, scene, used, text, spp, most, seed, filled, sources, notes)
    return job if scene.camera.frame is None else _of_window(job)


def budget_of(job: Job) -> Budget:
    """Return what the rule of a job makes its rounds with."""
    shape = job.given_scene.camera.resolution[::-1]
    return Budget(job.spp, shape, job.settings, job.seed, job.rule.weigh or job.settings.weigh, job.scene.plan)


def _of_window(job: Job) -> Job:
    """Return the job of a window: with the bits of the whole image, unless that is too large, or the rule learns.

    A rule that learns has no films of the rest. Of the others, all tiles that the window touches are rendered wholly,
    because their samples take random numbers of a tile in turn. The notes say where it is, and in what image.
    """
    camera = job.given_scene.camera
    frame = camera.frame or camera.resolution
    notes = {**job.notes, "crop": list(camera.window), "frame": list(frame)}
    if not isinstance(job.rule, Fixed) or math.prod(frame) > MAX_PIXELS:
        notes["window"] = "an image of its own to this rule; fixed shares, as of balance, give those of the whole image"
        return replace(job, notes=notes)
    notes["window"] = "the same pixels as in the whole image"
    return replace(job, scene=job.scene.uncropped, window=camera.window, notes=notes)


def default_rule(spp: int, settings: Settings) -> tuple[Rule | str, str]:
    """Return the rule of a render that names none, and why it is not ``auto``; the reason is empty if it is.

    ``auto`` where its first round pays and it goes with the settings; else equal shares, with the techniques, the
    combiner and the allocation of `settings`, and a warning if these are the reason. A preset names its rule.
    """
    if settings.preset is not None:
        return PRESETS[settings.preset].rule, ""
    auto, most = make_rule("auto"), LEVELS[-1] // 2
    reason = f"more than {most:,} samples per pixel, rendered with w = 1/2" if spp > most else auto.fallback(spp)
    try:
        merged, _ = merge_settings(settings, None, auto, "auto")
        check_settings(auto.filled(merged), "auto", merged)
    except ValueError as error:
        reason = str(error)
        text = f"rendered with equal shares, because auto, the rule where none is named, does not fit: {reason}"
        warn(SceneWarning(text), stacklevel=4)
    if not reason:
        return "auto", ""
    if len(settings.techniques) > 2:
        return _equal_shares(settings), reason
    return "balance" if settings.combiner == "balance" else "fixed:0.5", reason


def _equal_shares(settings: Settings) -> Fixed:
    """Return the rule of equal shares of the techniques of settings, which decide all else."""
    k = len(settings.techniques)
    return Fixed(0.5 if k == 2 else (1 / k,) * k)


def _warn_if_dark(scene: Scene) -> None:
    """Warn of a scene without light."""
    if not scene.plan.has_light:
        text = f"scene {scene.name}: none of its {len(scene.lights)} lights emits, so the image is black. Add one, such"
        example = "as dataclasses.replace(scene, lights=[dmis.PointLight((0, 0, 5), (50, 50, 50))])"
        warn(SceneWarning(f"{text} {example}"), stacklevel=4)
