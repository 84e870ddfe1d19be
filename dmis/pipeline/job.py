"""A render job: everything that is checked and decided before the first ray.

`Job.of` takes the arguments of `dmis.pipeline.render.render`, does every check once, and holds the rule, the settings
of pilot and final pass, the pilot's samples and the statistic that the pilot gathers. `Job.final_pass` turns a rule's
fit into the final pass.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any
from warnings import warn

import numpy as np

from dmis import __version__
from dmis.base.validate import whole
from dmis.base.vectors import Array
from dmis.estimator.allocation import shares_of
from dmis.estimator.combiner import combiner_by_name
from dmis.estimator.patterns import PatternMap
from dmis.estimator.presets import PRESETS
from dmis.estimator.records import Statistic
from dmis.estimator.settings import MAX_SHADING_SAMPLES, Settings, resolve_auto
from dmis.estimator.technique import technique_by_name
from dmis.fit import control_variate
from dmis.fit.fixed import Fixed
from dmis.fit.registry import make_rule
from dmis.fit.rule import Fit, Pilot, Rule, Weight, check_fit, merge_settings, rule_text
from dmis.pipeline.budget import LEVELS, fill_budget, whole_samples
from dmis.pipeline.fingerprint import digest, fingerprint, package_hash
from dmis.pipeline.tile import layout
from dmis.samplers.streams import stream
from dmis.scene.scene import Scene, SceneWarning

MIN_SPP_TO_LEARN = 16
"""Camera samples per pixel from which on a pilot pays."""
MAX_SPP = 2**20
"""Largest number of camera samples per pixel."""
LEARNED_COMPENSATION = 0.9
"""Compensation of skies, see `Settings`, with a rule that learns from the samples' densities, if none is given.

Of 0, 0.5 and 0.9 the last has the least error on the scene tt: the weights are learned under it.
"""
NOTHING_TO_MIX = "no light has two techniques: no pilot, equal shares"
"""Value of ``nothing_to_mix`` in the provenance of a render for which this is so."""


@dataclass(frozen=True, eq=False)
class FinalPass:
    """The final pass: a rule's fit in whole numbers of samples.

    Attributes
    ----------
    fit
        The fit of the rule.
    shares
        Shares of the techniques, within the range of the combiner, ``(K,)`` or ``(K, H, W)``.
    settings
        Estimator settings.
    samples
        Camera samples per pixel of each replicate, one number or ``(H, W)``.
    control
        Coefficients of the control variate, ``(H, W, 3)``; None: there is none.
    patterns
        Patterns of the pixels, if the rule `continues`; then `samples` are those behind the first round.
    """

    fit: Fit
    shares: Array
    settings: Settings
    samples: Array | int
    control: Array | None
    patterns: PatternMap | None = None


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
        Estimator settings of the final pass, before the fit.
    pilot_settings
        Estimator settings of the pilot, see `pilot_settings`.
    statistic
        Makes the statistic that the pilot gathers; None: the moments of the pixels alone.
    nothing_to_mix
        Whether the rule learns shares alone, and no light of the scene has two techniques: then there is no pilot.
    fallback
        Why the budget is too small for the rule of `rule_text`, and which rule renders it; empty if it is not.
    """

    scene: Scene
    gain: float
    rule: Rule
    rule_text: str
    spp: int
    seed: int
    settings: Settings
    pilot_settings: Settings
    statistic: Callable[[int, int], Statistic] | None
    given_scene: Scene
    nothing_to_mix: bool
    fallback: str

    @classmethod
    def of(cls, scene: Scene, rule: Rule | str | None, spp: int, seed: int, settings: Settings) -> Job:
        """Return the job of these arguments of `dmis.pipeline.render.render`; a ValueError if one is not right."""
        if not isinstance(scene, Scene):
            raise ValueError(f"scene must be a dmis.Scene, which dmis.load_scene makes; got {scene!r}")
        spp, seed = whole("spp", spp, 1, MAX_SPP), whole("seed", seed, 0)
        _warn_if_dark(scene)
        float32_scene, gain = scene.in_float32
        rule = default_rule(spp, settings) if rule is None else rule
        text = rule_text(rule)
        rule = make_rule(rule)
        fallback = rule.fallback(spp, settings.replicates)
        rule = rule.adapted(spp, resolve_auto(settings, float32_scene).sampler, settings.replicates)
        settings = resolve_auto(merge_settings(rule, text, settings), float32_scene)
        if settings.reuse_pilot is None:
            settings = replace(settings, reuse_pilot=settings.sampler == "independent")
        if settings.compensation is None:
            settings = replace(settings, compensation=0 if rule.statistic is None else LEARNED_COMPENSATION)
        _check_rule(rule, text, settings)
        nothing_to_mix = rule.shares_only and not float32_scene.plan.mixable
        if nothing_to_mix:
            rule, settings = _without_learning(settings)
        statistic = rule.statistic
        if combiner_by_name(settings.combiner).control_variate:
            statistic = control_variate.statistic(rule.pilot, statistic)
        pilot_spp = sum(rule.pilot.values())
        if spp <= pilot_spp:
            raise ValueError(
                f"spp must be more than the pilot's {pilot_spp} camera samples, because the budget includes the pilot "
                f"of rule {text}; got {spp}. Use a larger spp or another rule, such as balance"
            )
        learning = pilot_settings(settings, rule.pilot, statistic is not None, text)
        if rule.continues:
            learning = replace(learning, sampler=settings.sampler)
        job = cls(
            float32_scene, gain, rule, text, spp, seed, settings, learning, statistic, scene, nothing_to_mix, fallback
        )
        _check_replicates(job)
        return job

    @property
    def pilot_samples(self) -> dict[Any, int]:
        """Camera samples per pixel that the pilot renders at each weight, in ascending order of the weights.

        With a statistic a camera sample has as many times the shading samples as there are techniques, and there are
        as many times fewer.
        """
        factor = 1 if self.statistic is None else len(self.settings.techniques)
        return {w: int(n if factor == 1 else n // factor) for w, n in sorted(self.rule.pilot.items())}

    @property
    def final_spp(self) -> int:
        """Camera samples per pixel that the pilot leaves of the budget."""
        return self.spp - sum(self.rule.pilot.values())

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
            **({"nothing_to_mix": NOTHING_TO_MIX} if self.nothing_to_mix else {}),
            **({"fallback": self.fallback} if self.fallback else {}),
        }

    def without_tables(self) -> Job:
        """Return a job with the same provenance that does not keep the tables of its scene and Embree's copy."""
        description = self.given_scene.changed()
        return replace(self, scene=description, given_scene=description)

    @property
    def key(self) -> dict[str, Any]:
        """Key of a checkpoint: the provenance, the rule's content, the layout of tiles and the code.

        A ValueError if the scene or the rule has no fingerprint.
        """
        hashes = {"scene_hash": fingerprint(self.given_scene), "rule_hash": digest(self.rule, "rule")}
        return {**self.provenance, **hashes, "tiles": layout(self.settings), "package_hash": package_hash()}

    def final_pass(self, pilot: Mapping[Any, Pilot]) -> FinalPass:
        """Return the final pass that the rule fits to the `pilot`, the whole samples of its budget included."""
        settings = self.settings
        controlled = combiner_by_name(settings.combiner).control_variate
        fit = self.rule.fit(
            {w: control_variate.without_control_sums(p) for w, p in pilot.items()} if controlled else pilot
        )
        height_width = self.scene.camera.resolution[::-1]
        check_fit(fit, height_width, len(settings.techniques))
        shares = fit.shares
        if fit.continuation is not None:
            plan, rng = fit.continuation.of_replicate(settings.replicates), stream(self.seed, len(pilot), 2**31)
            first = int(np.max(pilot[0.5].moments.n)) // settings.replicates
            samples: Array | int = fill_budget(plan, first, rng) - plan.patterns.begin
            return FinalPass(fit, shares, settings, samples, None, plan.patterns)
        share_range = combiner_by_name(settings.combiner).share_range
        if share_range != (0, 1):
            shares = shares_of(np.clip(shares[0], *share_range))
        samples = self.final_spp // settings.replicates
        if fit.samples is not None:
            samples = whole_samples(np.asarray(fit.samples), samples, stream(self.seed, len(pilot), 2**31))
        control = control_variate.coefficients(pilot[0.5], shares) if controlled else None
        return FinalPass(fit, shares, settings, samples, control)


def pilot_settings(settings: Settings, pilot: Mapping[Weight, int], paired: bool, text: str) -> Settings:
    """Return the settings that a pilot is rendered with.

    Its samples are independent, as statistics assume, and combined by the balance heuristic, whose terms are f / p_w,
    however the final samples are drawn and combined. If `paired`, because a statistic is gathered, a camera sample has
    twice the shading samples, and there are half as many camera samples: two independent estimates at one point tell
    the variance over the pixel from the variance at the point. For K techniques to have two samples each, there are K
    times the shading samples in as many times fewer camera samples. `text` is that of the rule in messages.

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
            even = f"{n - 1} or {n + 1}" if n > 1 else "2"
            raise ValueError(
                f"{name} must be even for rule {text}, which learns from two halves of them; got {n}. Use {even}, or "
                f"rule thesis"
            )
        if name != "shading_samples" and n % techniques:
            raise ValueError(f"{name} must be a multiple of {techniques}, the number of techniques; got {n}")
    return replace(settings, shading_samples=techniques * settings.shading_samples)


def default_rule(spp: int, settings: Settings) -> Rule | str:
    """Return the rule of a render that names none.

    ``auto`` where its pilot pays and its statistic exists; else w = 1/2 with the techniques and the combiner of
    `settings`: for fewer than 16 samples per pixel or tens of thousands, for a number of shading samples that is odd or
    very large, and with the technique ``resampled``. A preset names its rule.
    """
    if settings.preset is not None:
        return PRESETS[settings.preset].rule
    s = settings.shading_samples
    if (
        MIN_SPP_TO_LEARN <= spp <= LEVELS[-1] // 2
        and s % 2 == 0
        and 2 * s <= MAX_SHADING_SAMPLES
        and _densities_known(settings)
    ):
        return "auto"
    rule = Fixed(0.5, settings.combiner, settings.techniques, settings.allocation)
    return "balance" if rule == Fixed() else rule


def _without_learning(settings: Settings) -> tuple[Rule, Settings]:
    """Return the rule of equal shares for a scene with nothing to mix, and the settings that go with it.

    All heuristics are the same there; a control variate, whose coefficients need a pilot, is 0.
    """
    if combiner_by_name(settings.combiner).control_variate:
        settings = replace(settings, combiner="balance")
    k = len(settings.techniques)
    w = 0.5 if k == 2 else (1 / k,) * k
    return Fixed(w, settings.combiner, settings.techniques, settings.allocation), settings


def _check_rule(rule: Rule, rule_text: str, settings: Settings) -> None:
    """Raise a ValueError if the rule is incompatible with the techniques or the allocation of the settings."""
    if len(settings.techniques) > 2 and not rule.multi_technique:
        raise ValueError(
            f"rule {rule_text} needs two techniques; got {len(settings.techniques)}: {', '.join(settings.techniques)}. "
            f"Use rule simplex:{'+'.join(settings.techniques)}"
        )
    if rule.statistic is not None and not rule.multi_technique and not _densities_known(settings):
        without = [name for name in settings.techniques if not technique_by_name(name).exact]
        raise ValueError(
            f"rule {rule_text} needs the pdf of every technique, but {', '.join(map(repr, without))} has none. Use "
            f"thesis or fixed weights"
        )
    if rule.statistic is not None and settings.allocation == "random":
        raise ValueError(
            f"rule {rule_text} needs allocation systematic, because it learns variances at fixed shares; got random. "
            f"Use thesis or fixed weights, which go with it"
        )


def _check_replicates(job: Job) -> None:
    """Raise a ValueError if replicates have no use with the sampler of a job, or do not divide its samples evenly."""
    replicates, sampler = job.settings.replicates, job.settings.sampler
    if replicates == 1:
        return
    if sampler == "independent":
        raise ValueError(
            f"replicates must be 1 with sampler independent, where the variance of the samples is exact already; got "
            f"{replicates}. Use sampler sobol, or leave replicates out"
        )
    pilot = 0 if job.rule.continues else job.spp - job.final_spp
    if (job.spp - pilot) % replicates:
        least = job.spp - (job.spp - pilot) % replicates
        behind = f", of which rule {job.rule_text} takes {pilot} for its pilot" if pilot else ""
        raise ValueError(
            f"the camera samples of a pixel must be divisible by {replicates} for replicates={replicates}; got "
            f"{job.spp}{behind}. Use spp {least} or {least + replicates}"
        )
    for n in job.pilot_samples.values() if job.rule.continues else ():
        if n % (2 * replicates):
            raise ValueError(
                f"the first round of rule {job.rule_text} must have a multiple of {2 * replicates} camera samples for "
                f"replicates={replicates}; got {n}. Use spp={4 * replicates} in the rule, or leave it out"
            )


def _densities_known(settings: Settings) -> bool:
    """Return whether the pdf of every technique is known."""
    return all(technique_by_name(name).exact for name in settings.techniques)


def _warn_if_dark(scene: Scene) -> None:
    """Warn before a black image is rendered because no light of the scene emits."""
    if not any(light.has_power() for light in scene.lights):
        text = (
            f"scene {scene.name}: none of its {len(scene.lights)} lights emits, so the image is black. Add a light, "
            f"such as dataclasses.replace(scene, lights=[dmis.PointLight((0, 0, 5), (50, 50, 50))])"
        )
        warn(SceneWarning(text), stacklevel=4)
