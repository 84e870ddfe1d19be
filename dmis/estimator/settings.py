"""How direct lighting is estimated: what can be chosen, what goes together, and named presets of all of it.

**Presets** are complete sets of settings, which later changes of the defaults do not alter.

``thesis`` is the estimator of Seo's thesis (2014), which stands on pbrt-v2. Pinned: light and BRDF sampling, whose
counts are rounded systematically to their shares of S on average; all lights in direct lighting, and one, picked
uniformly, at each vertex of a path; skies sampled by luminance, without compensation for the other technique;
independent points, or pbrt-v2's ``lowdiscrepancy`` ones; balance or power heuristic; a pilot of independent points,
combined by the balance heuristic. The caller gives S, integrator and depth. The rule says whether its pilot is part of
the image; if it does not, the pilot is with independent points. Its w weighs the heuristic, with one light sample for
each BRDF sample; ``thesis-shares`` has the same values, and w divides the samples.

``nearest`` is ``thesis`` with pbrt-v2's points unless the caller names others. It was chosen *knowing* the thesis's
numbers: of all set-ups that were tried its absolute errors are nearest to the thesis's, with the numbers of samples
that the scene files ask for (`Settings.as_in_file`), ``integrator="path"`` on both killeroo scenes, ``"direct"`` on the
others, and 128 points in the final pass: 122 rounded up to a power of two, as pbrt-v2's sampler does. So ``spp`` is 134
for the rule ``thesis``, and 128 for ``balance``. docs/thesis.md has the errors.

What has no field in `Settings` yet is pinned as the code has it: lights sampled by area, spheres by their cone; lobes
of a surface picked uniformly; a path continued by one more BRDF sample, beside those of direct lighting; Russian
roulette as in `dmis.estimator.path`. Whoever makes one of these a choice, or changes it, adds a field to `Settings`
whose value in this preset is the old behaviour. Images of the preset are held by `tests/estimator/test_presets.py`.
Not pinned: the order in which a sample goes through the triangles of a `dmis.light.mesh_light.MeshLight`, which no
scene of the thesis has. It changes which number gives which point, and no density.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any

from dmis.base.validate import did_you_mean, one_of, whole
from dmis.estimator.mis import Technique, combiner_by_name, technique_by_name
from dmis.light.light_sample import check_compensation
from dmis.samplers.streams import SAMPLERS
from dmis.scene.scene import Scene, SceneWarning
from dmis.scene.suggestions import DEFAULT_DEPTH, DEFAULT_INTEGRATOR, MAX_DEPTH

MAX_SHADING_SAMPLES = 100
"""Largest number of shading samples of a camera sample."""
DEFAULTS: Mapping[str, Any] = {
    "shading_samples": 2,
    "techniques": ("light", "brdf"),
    "combiner": "balance",
    "allocation": "systematic",
    "lights": "auto",
    "integrator": DEFAULT_INTEGRATOR,
    "max_depth": DEFAULT_DEPTH,
    "sampler": "sobol",
    "reuse_pilot": False,
    "compensation": 0.95,
    "preset": None,
}
"""Default values of settings; `dmis.fit.rule.merge_settings` has the exceptions of some rules.

Compensation: on tt and tt-overcast, direct and by paths, `balance` has .96, .99, .91 and .99 of its relMSE with .9,
`auto` 1.00, .95, .98 and .97; .99 is 5 to 15 % worse than .9 on tt-overcast. ``python benchmarks/vary.py compensation
0.9 0.95 0.99 --scenes tt tt-overcast`` measures it.
"""


@dataclass(frozen=True)
class Preset:
    """A complete set of estimator settings.

    Attributes
    ----------
    values
        Value of every field of `Settings` but ``preset``.
    choices
        Fields that may have another value, with all values that they may have; an empty tuple stands for any, and
        those whose value is ``auto`` or None may have any, too.
    rule
        Rule of a render that names none.
    weigh
        What w of the rule ``thesis`` is, one of `dmis.fit.round.WEIGH`.
    """

    values: Mapping[str, Any]
    choices: Mapping[str, tuple[Any, ...]]
    rule: str
    weigh: str


_THESIS = Preset(
    values={
        "shading_samples": 2,
        "techniques": ("light", "brdf"),
        "combiner": "balance",
        "allocation": "systematic",
        "lights": "pbrt",
        "integrator": "auto",
        "max_depth": "auto",
        "sampler": "independent",
        "reuse_pilot": None,
        "compensation": 0.0,
    },
    choices={
        "shading_samples": (),
        "combiner": ("balance", "power"),
        "sampler": ("independent", "lowdiscrepancy"),
    },
    rule="thesis",
    weigh="heuristic",
)

PRESETS: Mapping[str, Preset] = {
    "thesis": _THESIS,
    "thesis-shares": replace(_THESIS, weigh="samples"),
    "nearest": replace(_THESIS, values={**_THESIS.values, "sampler": "lowdiscrepancy"}),
}
"""Presets by name, see the beginning of this file."""


class NotGiven:
    """Sentinel in a field of `Settings` that was not given: it reads as the default, and equals it."""

    def __reduce__(self) -> tuple[Any, ...]:
        return not_given, (type(self).__mro__[2](self),)


_KINDS = {kind: type("NotGiven", (NotGiven, kind), {}) for kind in (int, float, str, tuple)}


def not_given(value: Any) -> Any:
    """Return a `NotGiven` that reads as `value`; None, which stands for itself, stays."""
    return _KINDS.get(type(value), lambda same: same)(value)


def given_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of settings that are given: all but `NotGiven`, ``auto``, and None where it is the default."""

    def is_open(name: str, value: Any) -> bool:
        return isinstance(value, NotGiven) or value is getattr(Settings, name) or str(value) == "auto"

    return {name: value for name, value in values.items() if not is_open(name, value)}


def _technique_names(name: str, value: Any) -> tuple[str, ...]:
    """Return names of techniques as a tuple; raise a ValueError unless they are two or more."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise ValueError(f"{name} must be names such as ('light', 'brdf'); got {value!r}")
    names = tuple(value)
    if len(names) < 2:
        raise ValueError(f"{name} must be at least two names, which share the samples; got {names}")
    return names


_CHECKS: dict[str, Callable[[str, Any], Any]] = {
    "shading_samples": partial(whole, least=1, most=MAX_SHADING_SAMPLES),
    "techniques": _technique_names,
    "combiner": lambda _, name: combiner_by_name(str(name)).name,
    "allocation": partial(one_of, allowed=("systematic", "random")),
    "max_depth": lambda name, d: d if d in (None, "auto") else whole(name, d, 1, MAX_DEPTH, "auto or None"),
    "sampler": lambda name, kind: one_of(name, kind, ("auto", *SAMPLERS)),
    "reuse_pilot": partial(one_of, allowed=(True, False, None)),
    "compensation": lambda _, share: check_compensation(share),
    "preset": partial(one_of, allowed=(*PRESETS, None)),
}
"""Check of each field of `Settings` that is not one of its option's choices: it takes name and value, returns the value
as it is kept, or raises a ValueError."""


def _depth(text: str) -> int | str | None:
    """Return a path depth: a number, ``auto``, or None for ``none``, which sets no limit."""
    return None if text == "none" else text if text == "auto" else int(text)


def _option(
    default: Any, text: str, parse: Callable[[str], Any] = str, metavar: str = "", choices: tuple[str, ...] = ()
) -> Any:
    """Return a field of `Settings` that is an option of the command line, with its help, parser and allowed values."""
    return field(default=default, metadata={"help": text, "type": parse, "metavar": metavar, "choices": choices})


@dataclass(frozen=True)
class Settings:
    """Settings of the estimator of direct lighting and paths.

    Parameters
    ----------
    shading_samples
        S, light or BRDF samples per camera sample and light.
    techniques
        The techniques that share them, two or more; of two, w is the share of the first.
    combiner
        Heuristic that weights them, see `dmis.estimator.mis.combiner_by_name`.
    allocation
        ``systematic`` or ``random``, see `dmis.estimator.allocation`.
    lights
        ``all``: every light is sampled at every point; ``one``: one light, picked uniformly; ``pbrt``: all in direct
        lighting, one at each vertex of a path, as pbrt-v2 does. ``tree``, ``power``, ``even``: the area lights
        are sampled as if they were one light (`dmis.light.selection`); each sample selects one of them by a light tree,
        by power, or uniformly. Each of the others, such as skies, is sampled separately. ``auto``: ``all``, or
        ``tree`` for many lights or a mesh of many triangles, as `dmis.scene.plan.Plan.selection` decides, and for
        several area lights where a path has been scattered.
    integrator
        ``direct``: light that reaches surfaces from the lights, seen through mirrors and glass; ``path``: light that
        has been scattered by other surfaces too; ``auto``: what the scene's file says, or its
        dialect's default; ``direct`` for a scene made in Python.
    max_depth
        Of ``direct``: surfaces that a camera sample may visit through mirrors and glass. Of ``path``: surfaces that
        may scatter light on its way from a light to the camera, 1 being direct lighting; None: any number, ended by
        Russian roulette. ``auto``: what the scene says, or else `dmis.scene.suggestions.DEFAULT_DEPTH`.
    sampler
        ``independent``, ``stratified``, ``sobol`` or ``lowdiscrepancy`` (pbrt-v2's), for the final pass, see
        `dmis.samplers`. ``auto``: ``sobol``.
    reuse_pilot
        Whether the samples of a rule's pilot are part of the image, each with the same weight as a final sample. None:
        if the final samples are independent, as the pilot's are, and no pilot has a technique alone: among
        low-discrepancy ones a few independent ones cost more than they bring, and w = 0 or 1 may have many times the
        error of a mixture.
    compensation
        Share of the light samples of a sky, in [0, 1), that are drawn in proportion to what exceeds its mean radiance
        (`dmis.light.environment.EnvironmentLight`, whose own value comes first), where BRDF sampling is among the
        techniques and covers the rest. None: that of `DEFAULTS`, or 0 with a rule that samples lights or the BRDF
        alone.
    preset
        Name of the preset whose values fields have that are not given, see `PRESETS`; None:
        there is none.

    Notes
    -----
    A field that is not given, or is ``auto``, reads as the preset's value or its default, and leaves the decision to
    rule, preset and scene (`dmis.fit.rule.merge_settings`). A value that is given stays, also one that equals the
    default: a rule that needs another is refused. Equality of settings compares values alone.
    """

    shading_samples: int = _option(
        not_given(DEFAULTS["shading_samples"]), "light plus BRDF samples per camera sample (default 2)", int, "S"
    )
    techniques: tuple[str, ...] = not_given(DEFAULTS["techniques"])
    combiner: str = not_given(DEFAULTS["combiner"])
    allocation: str = not_given(DEFAULTS["allocation"])
    lights: str = _option(
        "auto",
        "lights sampled at a point: all; one at random; pbrt, all in direct lighting and one on paths; tree, power or "
        "even, one of many lights picked in this way (default auto: all, or tree if there are many)",
        choices=("auto", "all", "one", "pbrt", "even", "power", "tree"),
    )
    integrator: str = _option(
        "auto",
        "direct: light from the lights only; path: also light from other surfaces (default auto: the scene's)",
        choices=("auto", "direct", "path"),
    )
    max_depth: int | str | None = _option(
        "auto",
        "largest number of surfaces on a path: direct counts mirrors and glass; path counts all, 1 is direct lighting "
        "and none no limit (default: the scene's, or 5)",
        _depth,
        "D",
    )
    sampler: str = _option(
        "auto", "sample points: independent, stratified, sobol or lowdiscrepancy (default sobol)", str, "NAME"
    )
    reuse_pilot: bool | None = None
    compensation: float | None = _option(
        None, "share of a sky's light samples drawn from its radiance above the mean (default 0.95)", float, "SHARE"
    )
    preset: str | None = _option(None, "fixed settings, to reproduce the thesis (default none)", choices=tuple(PRESETS))

    def __post_init__(self) -> None:
        preset = PRESETS.get(_CHECKS["preset"]("preset", self.preset))
        values, choices = ({}, {}) if preset is None else (preset.values, preset.choices)
        given = self.explicit
        for option in fields(self):
            name = option.name
            check = _CHECKS.get(name) or partial(one_of, allowed=option.metadata["choices"])
            value = check(name, given[name]) if name in given else not_given(values.get(name, option.default))
            object.__setattr__(self, name, value)
        techniques = tuple(map(technique_by_name, self.techniques))
        if combiner_by_name(self.combiner).collector:
            check_mixture(self.combiner, techniques, self.lights)
        if self.max_depth is None and self.integrator != "path":
            raise ValueError(
                "max_depth must be a number with integrator direct or auto, because mirrors may face each other"
            )
        for name, pinned in given_values(values).items():
            allowed = choices.get(name, (pinned,))
            if allowed and (value := getattr(self, name)) not in allowed:
                raise ValueError(
                    f"preset {self.preset} has {name} {' or '.join(map(repr, allowed))}; got {value!r}. Give another "
                    f"value, or no preset"
                )

    @property
    def explicit(self) -> dict[str, Any]:
        """The fields that were given, by name."""
        return given_values(vars(self))

    @property
    def sky_compensation(self) -> float:
        """`compensation` where BRDF sampling covers what it leaves out, else 0."""
        return (self.compensation or 0.0) if "brdf" in self.techniques else 0.0

    @property
    def weigh(self) -> str:
        """What w is, one of `dmis.fit.round.WEIGH`, if a rule leaves it open: shares if `combiner` is not balance."""
        return PRESETS[self.preset or "thesis"].weigh if self.combiner == "balance" else "samples"

    @property
    def one_light(self) -> bool:
        """Whether one light is picked at each point; `integrator` must not be ``auto`` any more."""
        return self.lights == "one" or (self.lights == "pbrt" and self.integrator == "path")

    @classmethod
    def as_in_file(cls, scene: Scene, **options: Any) -> Settings:
        """Return the settings that the file of `scene` suggests, see `dmis.scene.suggestions.Suggestions`.

        `options` are settings that replace what the file says. Direct lighting takes as many shading samples as the
        light with the most has light and BRDF samples in pbrt, at most `MAX_SHADING_SAMPLES`; paths take one of each,
        of one light.

        Warns
        -----
        SceneWarning
            If the file asks for what dmis does not have.
        """
        suggested, given = scene.suggested, make_settings(**options).explicit
        direct = given.get("integrator", suggested.integrator or DEFAULT_INTEGRATOR) == "direct"
        samples = (suggested.shading_samples if direct else None) or cls.shading_samples
        most = MAX_SHADING_SAMPLES
        unmet = [*suggested.unmet, *([f"{samples} shading samples (at most {most})"] if samples > most else [])]
        if unmet:
            text = f"scene {scene.name}: the file asks for what dmis does not have: {', '.join(unmet)}"
            warnings.warn(SceneWarning(text), stacklevel=2)
        values = {"shading_samples": min(samples, most), "sampler": suggested.sampler or "auto"}
        values["lights"] = (suggested.lights or "auto") if direct else "one"
        if preset := options.get("preset"):  # what it pins stays as it is
            values = {name: value for name, value in values.items() if name in PRESETS[preset].choices}
        return make_settings(**{**values, **options})

    @property
    def deepest(self) -> float:
        """`max_depth` as a number that depths compare with; infinite for None. It must not be ``auto`` any more."""
        return math.inf if self.max_depth is None else int(self.max_depth)


def check_mixture(combiner: str, techniques: Sequence[Technique], lights: str = "all") -> None:
    """Raise a ValueError unless a combiner goes with the techniques: their number, their pdfs, and lights sampled."""
    checked = combiner_by_name(combiner)
    if checked.collector and lights in ("one", "pbrt"):
        raise ValueError(
            f"combiner {combiner} cannot have lights {lights}, because its fit is over all samples of each light. Use "
            f"lights all or power"
        )
    if checked.collector and len(techniques) > 2:
        names = ", ".join(technique.name for technique in techniques)
        raise ValueError(f"combiner {combiner} needs two techniques; got {len(techniques)}: {names}")
    without = [repr(technique.name) for technique in techniques if not technique.exact]
    if checked.collector and without:
        raise ValueError(
            f"combiner {combiner} needs the pdf of every technique, but {', '.join(without)} has none. Use combiner "
            f"balance or power"
        )


def make_settings(settings: Settings | None = None, **options: Any) -> Settings:
    """Return `settings`, or the default ones, with `options` in the place of the fields that they name.

    Parameters
    ----------
    settings
        Base of the options; None: nothing is given.
    options
        Fields of `Settings` by name. An option takes the place of the field, whatever `settings` has there.

    Raises
    ------
    ValueError
        If `settings` is something else, there is no such field, or a value does not fit, for example because the preset
        does not allow it.
    """
    if settings is not None and not isinstance(settings, Settings):
        raise ValueError(f"settings must be a dmis.Settings or None; got {settings!r}")
    names = [field.name for field in fields(Settings)]
    if unknown := [name for name in options if name not in names]:
        from dmis.base.synonyms import KEYWORDS

        written = [f"{KEYWORDS[name]} for {name}" for name in unknown if name in KEYWORDS]
        hint = f". Write {', '.join(written)}" if written else did_you_mean(unknown[-1], names)
        raise ValueError(f"options must be among {', '.join(names)}; got {', '.join(unknown)}{hint}")
    return replace(settings or Settings(), **options)
