"""What a rule decides from pilot tables: its rounds get films made of them, and nothing is rendered."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.bench.data import Pilots
from dmis.bench.samples import SampleTable
from dmis.estimator.mis import BRDF, LIGHT
from dmis.estimator.records import PIXEL_SUMS, Record, wants_of
from dmis.estimator.settings import Settings
from dmis.fit.fixed import Given
from dmis.fit.registry import make_rule
from dmis.fit.round import Budget, Round
from dmis.fit.rule import Rule, merge_settings, next_round, rule_text
from dmis.pipeline.tile import patch_sums
from dmis.variance.moments import Film, Moments

AnyRule = Rule | str | Callable[[Mapping[float, SampleTable]], Any]
"""A rule, its text, or a function of the pilot tables by w: it returns shares ``(H, W)``, or shares and samples."""
SPP = 32
"""Budget of every rule, in camera samples per pixel."""
SETTINGS = Settings(sampler="independent", reuse_pilot=False, compensation=0)
"""Settings that rules must agree with: independent points, and light sampling of skies as in pbrt."""


def decide(rule: AnyRule, pilots: Pilots, seed: int = 0) -> Round:
    """Return the round with all that a rule decides when it learns from pilots.

    That is its final round, or one before with `dmis.fit.round.Round.patterns`, whose samples pilots do not have.

    Raises
    ------
    ValueError
        If the rule is not right, or needs samples or settings that pilots do not have.
    """
    text = rule_text(rule)
    shape, *_ = (table.shape for table in pilots.tables.values())
    if callable(rule) and not isinstance(rule, type):
        result = rule(pilots.tables)
        maps = result if isinstance(result, tuple) and len(result) == 2 else (result,)
        if maps[0] is None or np.shape(maps[0]) not in ((), shape):
            got = "None" if maps[0] is None else f"shape {np.shape(maps[0])}"
            raise ValueError(f"a function must return one share or shares {shape}, alone or with samples; got {got}")
        rule = Given(*maps)
    rule = make_rule(rule)  # type: ignore[arg-type]  # refuses a class
    settings, _ = merge_settings(SETTINGS, None, rule, text)
    rule = rule.filled(settings)
    if settings.techniques != ("light", "brdf") or settings.allocation != "systematic" or rule.multi_technique:
        raise _lack(text, f"{settings.allocation} shares of {' and '.join(settings.techniques)}")
    if reason := rule.fallback(SPP):
        raise ValueError(f"rule {text} must learn at {SPP} samples per pixel, the budget here; got: {reason}")
    rounds = rule.rounds(Budget(SPP, shape, settings, seed, rule.weigh or settings.weigh))
    film = None
    used = Counter[float]()
    while (requested := next_round(rounds, film, rule)) is not None:
        round_ = requested.checked(shape)
        if round_.stage == "final" or round_.patterns is not None:
            if round_.mixture != (LIGHT, BRDF):
                raise _lack(text, " and ".join(technique.name for technique in round_.mixture))
            return round_
        film = _film(round_, pilots, used, text)
    raise ValueError(f"rule {text} must yield a final round, which budget.final(fit) makes; got none")


def _lack(text: str, needs: str, available: str = "fixed shares of light and brdf alone") -> ValueError:
    """Return the error that a rule needs something else than is available in pilots."""
    return ValueError(f"rule {text} needs {needs}; pilots have {available}. Measure it by python -m dmis compare")


def _film(round_: Round, pilots: Pilots, used: Counter[float], text: str) -> Film:
    """Return the film of a round, of samples that no other film has; `used` counts these by w."""
    n, s, shares = int(np.max(round_.spp)), round_.settings.shading_samples, (round_.shares, round_.tilt)
    observed = np.broadcast_to(round_.spp, next(iter(pilots.tables.values())).shape) > 0
    w = float(round_.shares.flat[0])
    samples = np.broadcast_to(round_.spp, observed.shape)
    same = all(a is None or a.ndim == 1 for a in shares) and (samples[observed] == n).all()
    table = pilots.tables.get(w)
    begin = used[w]
    if round_.image_weight and table is not None:  # a first round that goes on: the samples that are left tell as much
        n = min(n, table.spp - begin)
    if not same or table is None or begin + n > table.spp or s > table.shading_samples:
        available = ", ".join(
            f"{t.spp} of {t.shading_samples} shading samples at {w:g}" for w, t in pilots.tables.items()
        )
        needs = f"{np.mean(n):g} camera samples of {s} shading samples at w = {w:g}, after {begin} others"
        raise _lack(text, needs, f"in all pixels, {available}")
    if round_.needs_features == "pixels":
        raise _lack(text, "features of pixels", "those of patches")
    if round_.statistic is not None and wants_of(round_.statistic(1, s)).directions:
        raise _lack(text, "directions of samples", "densities")
    used[w] += n
    part = _part(table, begin, n, s)
    tilt = None if round_.tilt is None else float(round_.tilt[0])
    radiance = part.radiance(tilt).astype(np.float32)
    moments = Moments.of(radiance)
    mean, root = (a.astype(np.float32) for a in (moments.mean, np.sqrt(moments.m2)))
    number = n if observed.all() else n * observed[..., None]
    features = pilots.features if round_.needs_features else {}
    sums = _sums(round_, part, radiance, tilt, observed)
    return Film(number, mean * observed[..., None], root, part.rays, sums, s, features, budget=SPP)


def _sums(
    round_: Round, part: SampleTable, radiance: Array, tilt: float | None, observed: np.ndarray
) -> Mapping[str, Array]:
    """Return the sums of a round's statistic over patches, of `observed` pixels; rays are the same in all pixels."""
    pixels = observed.size
    statistic = None if round_.statistic is None else round_.statistic(pixels, part.shading_samples)
    if statistic is None:
        return {}
    wants = wants_of(statistic)
    if wants.records:
        statistic.add(_records(part, tilt), radiance.reshape(-1, 3).T, part.spp)
    sums = {name: a * observed.reshape(-1) for name, a in statistic.sums().items()}
    if wants.pixel_sums:
        per_pixel = np.ones(pixels) / pixels
        closest, occlusion = (part.rays.get(kind, 0) for kind in ("camera", "shadow"))
        squares = np.square(radiance.astype(float)).mean(axis=-1).sum(axis=0).reshape(-1)
        sums |= dict(zip(PIXEL_SUMS, (closest * per_pixel, occlusion * per_pixel, squares), strict=True))
    return patch_sums(sums, part.shape, wants)


def _part(table: SampleTable, begin: int, n: int, s: int) -> SampleTable:
    """Return `n` camera samples from number `begin` on, with the first of their samples of each technique, s in all."""
    number = table.camera_sample.astype(int) - begin
    w = float(table.w[0])
    most = np.array([1, s * w, s * (1 - w)])[table.technique + 1]
    kept = (number >= 0) & (number < n) & (table.sample_index < most)
    part = replace(table, camera_sample=number).rows(kept)
    share = s / table.shading_samples
    scale = np.where(part.technique < 0, 1 / share, 1).astype(np.float32)  # p_l = p_b = 1 / S
    kinds = (LIGHT.rays, BRDF.rays)
    rays = {kind: round(n * share) if kind.startswith(kinds) else n for kind, n in table.rays.items()}
    return replace(part, p_l=part.p_l * scale, p_b=part.p_b * scale, spp=n, shading_samples=s, rays=rays)


def _records(table: SampleTable, tilt: float | None) -> list[Record]:
    """Return the shading samples of a table as a statistic takes them."""
    values: Array = table.estimates(tilt).T.astype(np.float32)
    sample = table.place()
    pdf = np.stack([table.p_l, table.p_b])
    labels = np.stack([table.technique, table.light, table.sample_index])
    records = []
    for label in np.unique(labels[:, table.technique >= 0], axis=1).T:
        at = np.flatnonzero((labels == label[:, None]).all(axis=0))
        technique, light, index = label.tolist()
        records.append(Record(technique, (light,), index, sample[at], values[:, at], pdf[:, at]))
    return records
