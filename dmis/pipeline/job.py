"""A render job: everything that is checked and decided before the first ray.

`resolve` takes the arguments of `dmis.pipeline.render.render`, does every check once, and returns the `Job`: the scene,
the rule, and the settings with which the rule makes its rounds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any
from warnings import warn

import numpy as np

from dmis import __version__
from dmis.base.validate import whole
from dmis.estimator.presets import PRESETS
from dmis.estimator.settings import MAX_SHADING_SAMPLES, Settings, resolve_auto
from dmis.estimator.technique import technique_by_name
from dmis.fit.fixed import Fixed
from dmis.fit.registry import make_rule
from dmis.fit.round import Budget, pilot_settings
from dmis.fit.rule import Rule, merge_settings, rule_text
from dmis.fit.sample_numbers import LEAST_SPP, LEVELS
from dmis.pipeline.fingerprint import digest, fingerprint, package_hash, sampling_hashes
from dmis.pipeline.tile import layout
from dmis.scene.scene import Scene, SceneWarning

DEFAULT_SPP = 128
"""Camera samples per pixel of a render that nothing else ends."""
MAX_SPP = 2**20
"""Largest number of camera samples per pixel."""
LEARNED_COMPENSATION = 0.9
"""Compensation of skies, see `Settings`, with a rule that learns from the samples' densities, if none is given.

Of 0, 0.5 and 0.9 the last has the least error on the scene tt: the weights are learned under it.
"""
NOTHING_TO_MIX = "no light has two techniques: no pilot, equal shares"
"""Value of ``nothing_to_mix`` in the provenance of a render for which this is so."""


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
    spp, seed
        Camera samples per pixel, the pilot's included; seed.
    settings
        Estimator settings of the final pass.
    notes
        Why another rule than that of `rule_text` renders it, by kind: ``nothing_to_mix`` or ``fallback``; else empty.
    """

    scene: Scene
    gain: float
    given_scene: Scene
    rule: Rule
    rule_text: str
    spp: int
    seed: int
    settings: Settings
    notes: Mapping[str, str] = field(default_factory=dict)

    @property
    def budget(self) -> Budget:
        """What the rule makes its rounds with."""
        shape, weigh = self.scene.camera.resolution[::-1], self.rule.weigh or self.settings.weigh
        return Budget(self.spp, shape, self.settings, self.seed, weigh, self.scene.plan)

    @cached_property
    def provenance(self) -> Mapping[str, Any]:
        """Description of the image before it is rendered; plain JSON data.

        The hash of the scene takes time: so all of it is made when it is first read. The hash is None if a part of the
        scene has no fingerprint (`dmis.pipeline.fingerprint.digest`), because an image is written all the same.
        """
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

    def without_tables(self) -> Job:
        """Return a job with the same provenance that does not keep the tables of its scene and Embree's copy."""
        description = self.given_scene.changed()
        return replace(self, scene=description, given_scene=description)

    @property
    def key(self) -> dict[str, Any]:
        """Key of a checkpoint: the provenance; rule, sampler and techniques by content; the layout of tiles; the code.

        A ValueError if the scene or one of these has no fingerprint.
        """
        hashes = {"scene_hash": fingerprint(self.given_scene), "rule_hash": digest(self.rule, "rule")}
        hashes |= sampling_hashes(vars(self.settings))
        return {**self.provenance, **hashes, "tiles": layout(self.settings), "package_hash": package_hash()}


def resolve(scene: Scene, rule: Rule | str | None, spp: int | None, seed: int, settings: Settings) -> Job:
    """Return the job of the arguments of `dmis.pipeline.render.render`, with a value in place of every default.

    A ValueError if an argument is not right, or arguments do not go together.
    """
    if not isinstance(scene, Scene):
        raise ValueError(f"scene must be a dmis.Scene, which dmis.load_scene makes; got {scene!r}")
    spp, seed = whole("spp", DEFAULT_SPP if spp is None else spp, 1, MAX_SPP), whole("seed", seed, 0)
    float32_scene, gain = scene.in_float32
    if not float32_scene.plan.has_light:
        dark = (
            f"scene {scene.name}: none of its {len(scene.lights)} lights emits, so the image is black. Add one, such as"
        )
        example = "dataclasses.replace(scene, lights=[dmis.PointLight((0, 0, 5), (50, 50, 50))])"
        warn(SceneWarning(f"{dark} {example}"), stacklevel=3)
    rule = default_rule(spp, settings) if rule is None else rule
    text = rule_text(rule)
    rule = make_rule(rule)
    settings = resolve_auto(merge_settings(rule, text, settings), float32_scene)
    notes: dict[str, str] = {}
    if reason := rule.fallback(spp):
        notes, rule = {"fallback": reason}, _equal_shares(settings)
    if settings.reuse_pilot is None:
        # a pilot of one technique alone may have many times the error of a mixture
        mixed = all(0 < share < 1 for weight in rule.pilot for share in np.ravel(weight))
        settings = replace(settings, reuse_pilot=mixed and settings.sampler == "independent")
    if settings.compensation is None:
        settings = replace(settings, compensation=0 if rule.statistic is None else LEARNED_COMPENSATION)
    techniques = settings.techniques
    if len(techniques) > 2 and not rule.multi_technique:
        raise ValueError(
            f"rule {text} needs two techniques; got {len(techniques)}: {', '.join(techniques)}. "
            f"Use rule simplex:{'+'.join(techniques)}"
        )
    if rule.statistic is not None:
        _check_statistic(rule, text, settings)
    if rule.shares_only and not float32_scene.plan.mixable:
        notes, rule = {**notes, "nothing_to_mix": NOTHING_TO_MIX}, _equal_shares(settings)
    if spp <= (pilot_spp := rule.pilot_samples(spp)):
        raise ValueError(
            f"spp must be more than the pilot's {pilot_spp} camera samples, because the budget includes the pilot "
            f"of rule {text}; got {spp}. Use a larger spp or another rule, such as balance"
        )
    return Job(float32_scene, gain, scene, rule, text, spp, seed, settings, notes)


def default_rule(spp: int, settings: Settings) -> Rule | str:
    """Return the rule of a render that names none.

    ``auto`` where its pilot pays and its statistic exists; else w = 1/2 with the techniques and the combiner of
    `settings`: for fewer than 16 samples per pixel or tens of thousands, for a number of shading samples that is odd or
    very large, and with the technique ``resampled``. A preset names its rule.
    """
    if settings.preset is not None:
        return PRESETS[settings.preset].rule
    s = settings.shading_samples
    pays = LEAST_SPP <= spp <= LEVELS[-1] // 2
    if pays and s % 2 == 0 and 2 * s <= MAX_SHADING_SAMPLES and not _without_densities(settings):
        return "auto"
    rule = _equal_shares(settings)
    return "balance" if rule == Fixed() else rule


def _equal_shares(settings: Settings) -> Fixed:
    """Return the rule of equal shares with these settings."""
    k = len(settings.techniques)
    return Fixed(0.5 if k == 2 else (1 / k,) * k, settings.combiner, settings.techniques, settings.allocation)


def _without_densities(settings: Settings) -> list[str]:
    """Return the names of the techniques whose pdf is not known."""
    return [name for name in settings.techniques if not technique_by_name(name).exact]


def _check_statistic(rule: Rule, text: str, settings: Settings) -> None:
    """Raise a ValueError if the rule's statistic does not go with the techniques, samples or allocation of settings."""
    if not rule.multi_technique and (without := _without_densities(settings)):
        raise ValueError(
            f"rule {text} needs the pdf of every technique, but {', '.join(map(repr, without))} has none. Use thesis "
            f"or fixed weights"
        )
    if settings.allocation == "random":
        raise ValueError(
            f"rule {text} needs allocation systematic, because it learns variances at fixed shares; got random. Use "
            f"thesis or fixed weights, which go with it"
        )
    for name, n in (
        ("shading_samples", settings.shading_samples),
        *(("pilot samples", n) for n in rule.pilot.values()),
    ):
        if n % 2:
            raise ValueError(
                f"{name} must be even for rule {text}, which learns from two halves of them; got {n}. Use {n + 1}, or "
                f"rule thesis"
            )
        if name != "shading_samples" and n % (techniques := len(settings.techniques)):
            raise ValueError(f"{name} must be a multiple of {techniques}, the number of techniques; got {n}")
    pilot_settings(settings, paired=True)  # refuses too many shading samples
