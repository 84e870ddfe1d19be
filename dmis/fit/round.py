"""What passes between a rule and the renderer: budget, rounds, their films, and fits.

A rule has a `Budget`, from which it makes `Round`s, asks for one after the other, and is sent the
`dmis.variance.moments.Film` of each (`dmis.fit.rule.Rule.rounds`). Most rules turn the film of a pilot into a `Fit`,
shares of samples, and no more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dmis.base.validate import one_of, whole
from dmis.base.vectors import Array
from dmis.estimator.allocation import shares_of
from dmis.estimator.mis import Technique, check_technique_form, technique_by_name
from dmis.estimator.records import Statistic, wants_of
from dmis.estimator.settings import Settings, check_mixture
from dmis.samplers.streams import stream
from dmis.scene.plan import Plan
from dmis.variance.moments import Film

if TYPE_CHECKING:
    from dmis.estimator.patterns import PatternMap

_ROUNDING = 1e-6
WEIGH = ("samples", "heuristic")
"""What the weights of a rule are: shares of the samples, which the heuristic uses, too; or the heuristic's alone, while
all techniques take the same number of samples.
"""
LEVELS = np.array(sorted({round(2 ** (k / 2)) for k in range(33)}))
"""Numbers of camera samples that a pixel may have where they differ, a factor of about 1.4 apart."""
Weight = float | tuple[float, ...]
"""Share of the first of two techniques, or shares of all of them."""


@dataclass(frozen=True, eq=False)
class Round:
    """One pass over the image, or over a part of it.

    Attributes
    ----------
    spp
        Camera samples of each pixel: one number, or ``(H, W)``; of a part of the image ``(P,)``, in row order.
    shares
        Shares w_k of the K techniques, of sum 1: ``(K,)`` or ``(K, H, W)`` float32; of a part of the image ``(K, P)``,
        or ``(K, 1)`` where all pixels have the same.
    settings
        Estimator settings.
    statistic
        Makes the statistic that gathers the shading samples, the same number in each pixel; None: there is none.
    patterns
        Whole numbers of samples of each technique per pixel, in place of `shares`; None: `shares` divide the samples.
    tilt
        Shares t_k of the balance heuristic, shaped like `shares`; None: the heuristic uses `shares`.
    begin
        Number in its pixel's sequence of the first camera sample, as `spp`: 0, or where an earlier round ended.
    before
        Film of that earlier round, which the samples are joined to where `begin` is not 0, in its place; None: there
        is none.
    image_weight
        Weight of the round's mean in the image, in camera samples that are fixed beforehand; 0: it is not in the image.
    stage
        Stage that `dmis.pipeline.progress.Progress` shows: ``pilot``, ``final``, or a name of the rule's own.
    needs_features
        Whether the film brings feature buffers, see `dmis.scene.feature_buffers`: True, of patches; or ``"pixels"``.
    maps
        Diagnostics of the rule, for `dmis.pipeline.result.Result.maps`.
    techniques
        Techniques that share the samples in the place of those that the settings name: two or more, by name or as
        `Technique` objects, which may hold what an earlier round taught; empty: those of the settings.

    A round is checked where the renderer receives it, see `checked`.
    """

    spp: Array | int
    shares: Array
    settings: Settings
    statistic: Callable[[int, int], Statistic] | None = None
    patterns: PatternMap | None = None
    tilt: Array | None = None
    begin: Array | int = 0
    before: Film | None = None
    image_weight: int = 0
    stage: str = "pilot"
    needs_features: bool | str = False
    maps: Mapping[str, np.ndarray] = field(default_factory=dict)
    techniques: tuple[Technique | str, ...] = ()

    def checked(self, shape: tuple[int, int]) -> Round:
        """Return the round as it is rendered: shares and tilt are arrays, and single numbers are of Python.

        A ValueError unless it is one of an image of `shape` (height, width). Shares and tilt must be shares of the
        techniques, and numbers of samples whole. Arrays must have a value for each pixel, and each pixel samples, if
        the round is part of the image. Settings must have values in place of ``auto``, which would be read as direct
        lighting. No light must be lost.
        """
        for name in ("integrator", "max_depth", "sampler"):
            if getattr(self.settings, name) == "auto":
                raise ValueError(
                    f"settings of a round must be those of its budget; got {name}='auto'. Write budget.settings, or "
                    f"dataclasses.replace(budget.settings, ...)"
                )
        one_of("needs_features of a round", self.needs_features, (False, True, "pixels"))
        settings = self._settings_of_techniques() if self.techniques else self.settings
        if self.statistic is not None:
            self._check_statistic()
        k = len(self.mixture)
        numbers: dict[str, Any] = {
            name: _whole(f"{name} of a round", getattr(self, name), shape) for name in ("spp", "begin", "image_weight")
        }
        shares = _checked_shares("shares of a round", self.shares, k, shape)
        if numbers["image_weight"] and self.before is None and np.min(self.spp) < 1:
            raise ValueError(
                f"spp of a round with an image_weight must be at least 1, because every pixel of the image needs "
                f"samples; got {np.min(self.spp)}"
            )
        tilt = None
        if self.tilt is not None:
            check_weigh("heuristic", settings.combiner)
            tilt = _checked_shares("tilt of a round", self.tilt, k, shape)
            taken = shares if self.patterns is None else self.patterns.shading_samples(np.ones(shape, int))
            if ((taken.reshape(k, -1) <= 0) & (tilt.reshape(k, -1) > 0)).any():
                raise ValueError(
                    "shares of a round must be above 0 where the tilt gives a technique a weight, because its light "
                    "would be lost; got 0. Give it a least share, such as 0.05, or no weight"
                )
        return replace(self, **numbers, shares=shares, tilt=tilt, settings=settings)

    def _check_statistic(self) -> None:
        """Raise a ValueError if a statistic would get other numbers of samples than it is told."""
        if not wants_of(self.statistic).records:
            return
        if len({*np.unique(self.spp)} - {0}) > 1 or self.patterns is not None:
            raise ValueError(
                "a round with a statistic must have one number spp for all pixels, or 0 where it leaves them out, and "
                "no patterns, because a statistic is sent as many camera samples of each pixel. Gather it in a round "
                "before"
            )

    def _settings_of_techniques(self) -> Settings:
        """Return the settings for `techniques`; a ValueError unless these can share the samples."""
        if not isinstance(self.techniques, tuple | list):
            raise ValueError(
                f"techniques of a round must be a tuple of names and dmis.Techniques; got {self.techniques!r}"
            )
        names = [technique.name for technique in self.mixture]
        if len(set(names)) < max(len(names), 2):
            raise ValueError(f"techniques of a round must be two or more different ones; got {', '.join(names)}")
        for technique in self.mixture:
            check_technique_form(technique)
        check_mixture(self.settings.combiner, self.mixture)
        # without BRDF samples nothing samples what compensation leaves out
        return self.settings if "brdf" in names else replace(self.settings, compensation=0.0)

    @property
    def mixture(self) -> tuple[Technique, ...]:
        """The techniques that share the samples: `techniques`, or those that the settings name."""
        return tuple(map(technique_by_name, self.techniques or self.settings.techniques))

    @property
    def halvings(self) -> np.ndarray | None:
        """Halvings of each light, ``(L + 1, P)``, see `dmis.estimator.patterns.PatternMap`; None: there are none."""
        halvings = None if self.patterns is None else self.patterns.halvings
        return None if halvings is None else halvings.reshape(len(halvings), -1)

    def of_area(self, area: tuple[slice, slice]) -> Round:
        """Return the round of the pixels of an area of the image, as views; without `before` and `maps`."""
        maps = {name: getattr(self, name) for name in ("spp", "begin", "shares", "tilt")}
        views = {name: a[..., *area] for name, a in maps.items() if np.ndim(a) > 1}
        patterns = self.patterns and self.patterns.of_area(area)
        return replace(self, **views, patterns=patterns, before=None, maps={})

    def in_row_order(self) -> Round:
        """Return the round of pixels in row order: numbers ``(P,)``, shares ``(K, P)``, or ``(K, 1)`` if all equal."""
        spp, begin = (n if isinstance(n, int) else n.reshape(-1) for n in (self.spp, self.begin))
        tilt = None if self.tilt is None else _shares_in_row_order(self.tilt)
        return replace(self, spp=spp, begin=begin, shares=_shares_in_row_order(self.shares), tilt=tilt)

    def groups(self, pixels: int) -> Iterator[tuple[np.ndarray, Array | int, Array, Settings]]:
        """Yield the pixels ``(A,)`` that are rendered together, with their samples, shares and settings.

        Of a round of so many `pixels` in row order.
        """
        if self.patterns is None:
            yield np.arange(pixels), self.spp, self.shares, self.settings
            return
        for group, n, (n_l, n_b) in self.patterns.groups(np.broadcast_to(self.spp, pixels)):
            shares = np.array([[n_l], [n_b]], np.float32) / np.float32(n_l + n_b)
            yield group, n, shares, replace(self.settings, shading_samples=n_l + n_b)

    def technique_samples(self) -> tuple[Array, Array, Array]:
        """Return the camera samples of each pixel, and its light and BRDF samples, those of `before` included.

        Only for rounds with `patterns`; ``(H, W)`` each.
        """
        assert self.patterns is not None
        samples = np.broadcast_to(np.add(self.spp, self.begin), self.patterns.pattern.shape)
        light, brdf = self.patterns.shading_samples(samples)
        return samples, light, brdf


def _shares_in_row_order(shares: Array) -> Array:
    """Return shares ``(K, P)`` in row order, or ``(K, 1)`` if all pixels have the same."""
    shares = shares.reshape(len(shares), -1)
    return shares[:, :1].copy() if (shares == shares[:, :1]).all() else shares


@dataclass(frozen=True, eq=False)
class Fit:
    """The result of a rule: shares of samples for each pixel, and how the final samples are taken.

    Attributes
    ----------
    weight
        Shares of samples, in the form that suits the rule. Of two techniques the share of the first, light sampling:
        ``(H, W)``, or one number for the whole image. Of any K techniques all shares: ``(K, H, W)``, or ``(K,)`` for
        the whole image.
    samples
        Camera samples of the final pass in proportion, ``(H, W)``, of any positive scale; None: the same everywhere.
    maps
        Diagnostics by name; those of patches have one value for each in the last two axes.
    """

    weight: Array | float
    maps: Mapping[str, np.ndarray] = field(default_factory=dict)
    samples: Array | None = None


@dataclass(frozen=True, eq=False)
class Budget:
    """What a rule may spend, and what it makes its rounds with.

    Attributes
    ----------
    spp
        Camera samples per pixel of all rounds together.
    shape
        Height and width of the image.
    settings
        Estimator settings of the final pass.
    seed
        Seed of the render.
    weigh
        What weights are, one of `WEIGH`; of a rule that leaves it open, what its preset says (`Settings.weigh`).
    plan
        Plan of the scene; None: unknown.
    """

    spp: int
    shape: tuple[int, int]
    settings: Settings
    seed: int = 0
    weigh: str = "samples"
    plan: Plan | None = None

    def pilot(
        self,
        weight: Weight,
        spp: int,
        statistic: Callable[[int, int], Statistic] | None = None,
        needs_features: bool | str = False,
    ) -> Round:
        """Return a pilot round of `spp` camera samples at one weight.

        With a `statistic` and K techniques each camera sample has K S shading samples (`pilot_settings`), and there are
        ``spp // K`` of them. Whether the pilot is part of the image is a setting; its weight there is its number of
        camera samples.
        """
        if statistic is not None:
            spp //= len(self.settings.techniques)
        settings = pilot_settings(self.settings, statistic is not None)
        in_image = spp if self.settings.reuse_pilot else 0
        round_ = Round(
            spp, shares_of(weight), settings, statistic, image_weight=in_image, needs_features=needs_features
        )
        return self._tilted(round_)

    def final(self, fit: Fit, spent: int = 0, techniques: tuple[Technique | str, ...] = ()) -> Round:
        """Return the final pass of a fit, in whole numbers of samples, behind `spent` camera samples of pilots.

        Its shares are of `techniques`, or of those of the settings, see `Round`.

        Its weight in the image is what the budget has left, whatever its numbers of samples are: these depend on the
        pilot, and would bias the mean. A ValueError if the fit is not right, or no sample is left.
        """
        if not isinstance(fit, Fit):
            raise ValueError(f"a rule's fit must be a dmis.Fit; got {type(fit).__name__}. Return dmis.Fit(weight=...)")
        whole("spent", spent, 0, self.spp - 1, "so that a final pass is left")
        k, spp = len(techniques or self.settings.techniques), self.spp - spent
        shares = _checked_shares("a rule's weight", shares_of(fit.weight), k, self.shape)
        samples: Array | int = spp
        if fit.samples is not None:
            samples = np.asarray(fit.samples)
            if samples.shape != self.shape or not (np.isfinite(samples).all() and (samples > 0).all()):
                raise ValueError(
                    f"a rule's samples must be positive, finite, and of shape {self.shape}, because every pixel needs "
                    f"some; got shape {samples.shape} from {samples.min():g} to {samples.max():g}"
                )
            samples = whole_samples(samples, spp, self.generator(0))
        final = Round(samples, shares, self.settings, image_weight=spp, stage="final", maps=fit.maps)
        return self._tilted(replace(final, techniques=techniques))

    def _tilted(self, round_: Round) -> Round:
        """Return a round with equal shares, and its own as the tilt, if that is what weights are."""
        if self.weigh == "samples":
            return round_
        k = len(round_.shares)
        return replace(round_, shares=np.full(k, 1 / k, np.float32), tilt=round_.shares)

    def generator(self, number: int) -> np.random.Generator:
        """Return a random generator for decisions behind `number` rounds, which no tile draws from."""
        return stream(self.seed, number, 2**31)


def pilot_settings(settings: Settings, paired: bool) -> Settings:
    """Return the settings that a pilot is rendered with.

    Its samples are independent, as statistics assume, and combined by the balance heuristic, whose terms are f / p_w,
    however the final samples are drawn and combined. If `paired`, because a statistic is gathered, a camera sample of K
    techniques has K times the shading samples: two independent estimates at one point tell the variance over the pixel
    from the variance at the point.
    """
    settings = replace(settings, combiner="balance", allocation="systematic", sampler="independent")
    return (
        replace(settings, shading_samples=len(settings.techniques) * settings.shading_samples) if paired else settings
    )


def whole_samples(share: Array, spp: int, rng: np.random.Generator) -> np.ndarray:
    """Return whole numbers of camera samples in proportion to `share` ``(H, W)``, `spp` on average, at least 2, int32.

    Shares are positive and finite.

    Numbers are from `LEVELS`, so that pixels can be rendered together; systematic rounding with a random offset
    keeps their mean. A ValueError if there are more samples than `LEVELS` has.
    """
    if spp > LEVELS[-1]:
        raise ValueError(f"camera samples must be at most {LEVELS[-1]} per pixel where a rule divides them; got {spp}")
    least = min(2, spp)
    most = LEVELS[-1]
    values, pixels = np.unique(share, return_counts=True)
    low_scale = 0.0
    high_scale = most / values[0]
    # bisection for the scale at which the clipped samples have the mean spp; it ends when all pixels are at the least,
    # or when no float is between the two scales
    while high_scale * values[-1] > least and low_scale < (scale := (low_scale + high_scale) / 2) < high_scale:
        enough = np.clip(values * scale, least, most) @ pixels >= spp * share.size
        low_scale, high_scale = (low_scale, scale) if enough else (scale, high_scale)
    samples = np.empty(share.shape, np.int32)
    offset = rng.random()
    for row, row_samples in zip(share, samples, strict=True):
        target = np.clip(row.astype(float) * high_scale, least, most)
        low = np.clip(np.searchsorted(LEVELS, target, "right") - 1, 0, len(LEVELS) - 2)
        steps = np.cumsum(np.append(offset, (target - LEVELS[low]) / (LEVELS[low + 1] - LEVELS[low])))
        row_samples[:] = LEVELS[np.minimum(low + np.diff(np.floor(steps).astype(int)), len(LEVELS) - 1)]
        offset = steps[-1]
    return samples


def _whole(name: str, values: Any, shape: tuple[int, int]) -> Array | int:
    """Return whole numbers of the image or of each pixel; raise a ValueError unless they are such."""
    values = np.asarray(values)
    if values.shape not in ((), shape):
        raise ValueError(_of_shape(name, shape, values.shape))
    if values.dtype.kind not in "iu":
        whole_numbers = "Make it whole by dmis.fit.round.whole_samples"
        raise ValueError(f"{name} must be whole; got {values.flat[0]:g}. {whole_numbers}")
    if values.min(initial=0) < 0:
        raise ValueError(f"{name} must not be negative; got {values.min()}")
    return values if values.ndim else int(values)


def _checked_shares(name: str, shares: Any, techniques: int, shape: tuple[int, int]) -> Array:
    """Return `shares` ``(K, ...)`` of so many `techniques` as an array.

    A ValueError unless they are in [0, 1] and add up to 1, for the image or for each pixel. A NaN, such as the ratio of
    two variances that are 0, or other shares would not stop the render, but make the image wrong.
    """
    shares = np.asarray(shares)
    if shares.ndim == 0 or len(shares) != techniques:
        raise ValueError(f"{name} must be ({techniques}, ...), one for each technique; got shape {shares.shape}")
    if shares.shape[1:] not in ((), shape):
        raise ValueError(_of_shape(name, shape, shares.shape[1:]))
    inside = (shares >= -_ROUNDING) & (shares <= 1 + _ROUNDING)
    if not inside.all():
        where = f" in {np.sum(~inside.all(axis=0)):,} of {shares[0].size:,} pixels" if shares.ndim > 1 else ""
        raise ValueError(f"{name} must be in [0, 1], a share of the samples; got {shares[~inside][0]:g}{where}")
    sums = shares.sum(axis=0)
    if np.abs(sums - 1).max() > 1e-3:
        raise ValueError(
            f"{name} must add up to 1 over the techniques, because shares divide samples; got sums from "
            f"{sums.min():g} to {sums.max():g}"
        )
    return shares


def _of_shape(name: str, shape: tuple[int, int], got: tuple[int, ...]) -> str:
    """Return the message that an array of a round has another shape."""
    return f"{name} must be of shape () or {shape}, for the image or for each pixel (height, width); got {got}"


def check_weigh(weigh: str, combiner: str) -> None:
    """Raise a ValueError unless weights can be what `weigh` says, with this combiner."""
    one_of("weigh", weigh, WEIGH)
    if weigh == "heuristic" and combiner != "balance":
        raise ValueError(f"weigh=heuristic needs combiner balance; got {combiner}. Leave weigh out, or use balance")
