"""Weight rules by name: `RULES`, `register_rule` for one's own, and `make_rule`, which reads ``name:option=value``.

`Thesis`, the rule ``thesis``, is `dmis.fit.thesis.ThesisRule` with options for what the thesis leaves open. With the
defaults the rule has the steps of `dmis.fit.thesis` and no others.
"""

from __future__ import annotations

import re
import reprlib
from collections.abc import Callable
from dataclasses import dataclass, is_dataclass, replace
from functools import partial
from inspect import signature
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from dmis.base.plugins import Later, Registry, loaded_plugins, raised
from dmis.base.validate import did_you_mean, one_of, positive, whole
from dmis.base.vectors import Array
from dmis.estimator.mis import TECHNIQUES
from dmis.filter import check_taps
from dmis.fit.fixed import Fixed
from dmis.fit.rule import Rule, check_form
from dmis.fit.thesis import ThesisRule


@dataclass(frozen=True)
class Thesis(ThesisRule):
    """Choose weights by a parabola through three pilot variances per patch: Seo's thesis (2014), Sec. 3.

    Parameters
    ----------
    patch
        Side of a patch in pixels (the thesis tries 4 to 32).
    spp
        Pilot samples at each of the three weights, at least 2 (the thesis: 2 or 4).
    channels
        Variance that is fitted: of ``luminance``, or ``rgb``, the mean of the three.
    filter, size, sigma
        ``gaussian`` or ``none``; taps on a side, odd, and standard deviation of the Gaussian, in patches.
    no_signal, ragged
        What the Gaussian does with patches without a signal: ``half``, they enter it as w = 1/2, or ``skip``, it leaves
        them out; and with patches that the border cuts: ``equal``, they count as the others do, or ``area``, by their
        pixels. By the defaults all patches count the same, as in the thesis.
    reuse
        Whether the pilot's samples are part of the image. None: as the settings say, and no by default.
    combiner, sampler
        Of the final samples. None: as the settings say.
    weigh
        What w is: the share that the ``heuristic`` uses, with as many light as BRDF samples at every vertex
        (docs/theory.md, Eq. 8a), or the share of light ``samples``. Empty: the first, unless the preset is
        ``thesis-shares`` or the combiner is not ``balance``.

    Notes
    -----
    The maps of its `Fit` are ``status`` (see `dmis.fit.thesis.STATUS`), ``raw`` and ``filtered``, the weights before
    and after the filter, and ``variances``, those of the pilot, ``(3, rows, columns)``.
    """

    patch: int | Literal["auto"] = 16  # type: ignore[assignment]  # auto was one, and is refused with advice
    channels: str = "luminance"
    filter: str = "gaussian"
    no_signal: str = "half"
    ragged: str = "equal"
    reuse: bool | None = None
    combiner: str | None = None
    sampler: str | None = None
    weigh: str = ""

    def __post_init__(self) -> None:
        whole("patch", self.patch, 1, 65535, "in pixels; the plug-in patch_size has thesis-by-pilot, which chooses it")
        whole("spp of the pilot", self.spp, 2, more="because a variance needs two samples")
        one_of("channels", self.channels, ("luminance", "rgb"))
        one_of("filter", self.filter, ("gaussian", "none"))
        one_of("no_signal", self.no_signal, ("half", "skip"))
        one_of("ragged", self.ragged, ("equal", "area"))
        check_taps(self.size)
        positive("sigma", self.sigma)

    def grey(self, variance: Array) -> Array:
        return variance.mean(axis=-1) if self.channels == "rgb" else super().grey(variance)

    def smooth(self, raw: Array, status: np.ndarray, area: Array) -> Array:
        return raw if self.filter == "none" else super().smooth(raw, status, area)

    def counts(self, status: np.ndarray, area: Array) -> Array:
        """Return 1 for each patch, or the share of it that is inside of the image; or 0 without a signal."""
        count = np.ones(status.shape) if self.ragged == "equal" else area / area.max()
        return count * (status != 3) if self.no_signal == "skip" else count


RULES: Registry[Callable[..., Rule]] = Registry(
    "rule",
    {
        "balance": partial(Fixed, 0.5, combiner="balance"),
        "fixed": Fixed,
        "pbrt": partial(Fixed, 0.5, combiner="power"),
        "one-sample": partial(Fixed, allocation="random"),
        "uniform": partial(Fixed, 1.0, techniques=("uniform", "brdf")),
        "thesis": Thesis,
        "second-moment": Later("dmis.fit.second_moment", "SecondMoment"),
        "counts": Later("dmis.fit.auto", "Auto", (False,)),
        "auto": Later("dmis.fit.auto", "Auto"),
    },
    joint="-",
    reserved={"all": "compare has it for every rule", "pinned": "compare has it for its pinned baseline"},
)
"""Rules by name; `about` says what each does."""
_ABOUT = {
    "balance": "Take one light and one BRDF sample, weighed by the balance heuristic.",
    "pbrt": "Take one light and one BRDF sample, weighed by the power heuristic.",
    "one-sample": "Choose a technique at random for each sample: light sampling with probability w.",
    "uniform": "Sample the hemisphere uniformly in place of the lights, for teaching.",
    "counts": "Choose numbers of camera samples per pixel from a first round, with equal shares.",
}
"""What the rules do that share a class with others."""
_GUESSES = {"power": "pbrt", "light": "fixed:1", "brdf": "fixed:0", "bsdf": "fixed:0"}
"""The rules that are meant by names which are none."""


def about(name: str) -> str:
    """Return a sentence that says what a rule of `RULES` does: for a class of one's own the first of its docstring."""
    return _ABOUT.get(name) or (RULES[name].__doc__ or "").strip().partition("\n")[0]


def register_rule(name: str, cls: Callable[..., Rule]) -> None:
    """Add a rule by name, so that `render`, `compare` and the command line find it as text, ``name:option=value``.

    Parameters
    ----------
    name
        Letters and digits, words joined by hyphens, such as ``quieter-patches``.
    cls
        Class that derives from `dmis.fit.rule.Rule`, or a function that returns a rule. Its arguments, such as the
        fields of a dataclass, are the rule's options: each has a default, and those whose default is a number, a
        string, True or False may be given as text.

    Raises
    ------
    ValueError
        If the name is not of this form or is taken, an argument has no default, or `cls` makes no rule.
    """
    RULES.check(name, cls)
    try:
        rule = cls()
    except TypeError as error:
        raise ValueError(
            f"rule {name} must have a default for every option, because its name alone is a rule; got: {error}"
        ) from error
    except Exception as error:
        raise ValueError(f"rule {name} must make a rule of its defaults; {raised(error)}") from error
    make_rule(rule)
    RULES[name] = cls


def make_rule(rule: Rule | str) -> Rule:
    """Return a rule from its text: ``thesis:patch=16,filter=none``, ``fixed:light=0.5,brdf=0.3,uniform=0.2``.

    Parameters
    ----------
    rule
        A name of `RULES`, a colon, and options ``name=value`` separated by commas; a bare value is the first option, as
        in ``fixed:0.25``. A rule object is returned as it is.

    Raises
    ------
    ValueError
        If there is no such rule or option, a value does not fit, or pilot or settings are not of the right form.
    """
    if isinstance(rule, int | float) and 0 <= rule <= 1:
        raise _no_such_rule(f"{float(rule):g}")
    if not isinstance(rule, str):
        return _check_object(rule)
    name, _, rest = rule.strip().partition(":")
    if name not in RULES:
        raise _no_such_rule(name)
    options = _read_options(name, rest) if rest else {}
    return _fixed(options) if name == "fixed" else RULES[name](**options)  # a rule, as `register_rule` has checked


def _check_object(rule: Any) -> Rule:
    """Return an object; raise a ValueError unless it is a rule with a fit."""
    must = f"rule must be a rule, or text such as thesis:patch=16; got {reprlib.repr(rule)}"
    if isinstance(rule, type):
        raise ValueError(f"{must}. Make an object of the class: {rule.__name__}()")
    if not isinstance(rule, Rule):
        derive = f"Derive its class from dmis.Rule: class {type(rule).__name__}(dmis.Rule)"
        raise ValueError(f"{must}. {derive if hasattr(rule, 'fit') else 'A map of weights is dmis.Given(weight=...)'}")
    if type(rule).fit is Rule.fit and type(rule).rounds is Rule.rounds:
        raise ValueError(
            f"{must}, which has no method fit. Add it to class {type(rule).__name__}: "
            f"def fit(self, pilot): return dmis.Fit(weight=0.5)"
        )
    check_form(rule)
    return rule


def _no_such_rule(name: str) -> ValueError:
    """Return the error that a name is that of no rule."""
    guess = _GUESSES.get(name.lower(), f"fixed:{name}" if re.fullmatch(r"[01]|[01]?\.\d+", name) else "")
    hint = f", did you mean {guess!r}?" if guess else did_you_mean(name, RULES) or "."
    how = "dmis.register_rule adds one; on the command line, name the file that calls it with --plugin"
    if loaded_plugins() and RULES.keys() == RULES.shipped:
        files = " and ".join(path.name for path in loaded_plugins())
        how = f"{files} registered no rule: end it with dmis.register_rule({name!r}, ...), and the rule's class"
    return RULES.unknown(name, ", and options behind a colon, as in thesis:patch=4", f"{hint} {how}")


def _fixed(options: dict[str, Any]) -> Rule:
    """Return the rule ``fixed`` of the share of light samples, or of a share of each technique."""
    shares = {name: options.pop(name) for name in tuple(options) if name in TECHNIQUES}
    if ("w" in options) == bool(shares):
        raise ValueError(
            f"rule fixed needs the share of light samples, such as fixed:0.5, or else shares of techniques, such as "
            f"fixed:light=0.5,brdf=0.3,uniform=0.2; got {'both' if shares else 'none'}"
        )
    if not shares:
        return Fixed(**options)
    if len(shares) < 2:
        raise ValueError(f"rule fixed needs shares of at least two techniques; got {', '.join(shares)}")
    w = tuple(shares.values())
    rule = Fixed(w, techniques=tuple(shares), **options)
    return rule if len(w) > 2 else replace(rule, w=w[0])


# Options ------------------------------------------------------------------------------------------------------------


_BOOLS = dict.fromkeys(("yes", "true", "on", "1"), True) | dict.fromkeys(("no", "false", "off", "0"), False)
_READERS: dict[Any, Callable[[str], Any]] = {
    int: int,
    float: float,
    str: str,
    bool: lambda text: _BOOLS[text.lower()],
}


def _options(name: str) -> dict[str, list[Any]]:
    """Return the options of a rule: the type of their values, one of `_READERS`, and words that they may be, too.

    They are the arguments whose default can be text. Where this is None, the type is that of the annotation.
    """
    made = RULES[name]
    function: Any = made.func if isinstance(made, partial) else made
    plain_class = isinstance(function, type) and not is_dataclass(function)
    try:
        # of a dataclass those of its fields, each by the module of its class
        hints = get_type_hints(function.__init__ if plain_class else function)
    except (NameError, AttributeError, TypeError):  # annotations that only type checkers understand
        hints = {}
    options = {}
    for key, p in signature(made).parameters.items():
        kinds = get_args(hints.get(key, p.annotation))  # of ``int | Literal["auto"]`` or ``float | None``
        kind = type(p.default) if p.default is not None else next((k for k in kinds if k in _READERS), None)
        if kind in _READERS:
            options[key] = [kind, *(word for k in kinds if get_origin(k) is Literal for word in get_args(k))]
    return options


def _read_options(name: str, text: str) -> dict[str, Any]:
    """Return the values of a rule's options from ``option=value,option=value``."""
    own = _options(name)
    options = own | ({key: [float] for key in TECHNIQUES} if name == "fixed" else {})
    values: dict[str, Any] = {}
    for item in filter(None, text.split(",")):
        key, equals, value = item.partition("=")
        if not equals and own and key not in own:
            key, value = next(iter(own)), item
        if key not in options:
            known = f"the options {', '.join(options)}" if options else "no options"
            raise ValueError(f"rule {name} has {known}; got {key!r}{did_you_mean(key, options)}")
        if key in values:
            raise ValueError(f"option {key} of rule {name} must be given once; got {values[key]} and {value}")
        kind, *words = options[key]
        allowed = " or ".join(["yes or no" if kind is bool else f"of type {kind.__name__}", *words])
        if item == key:
            raise ValueError(f"option {key} of rule {name} needs a value, {allowed}: {name}:{key}=...")
        try:
            values[key] = value if value in words else _READERS[kind](value)
        except (ValueError, KeyError):
            first = "" if equals else f", of which a value without a name is the first; there are {', '.join(options)}"
            raise ValueError(f"option {key} of rule {name} must be {allowed}; got {value!r}{first}") from None
    return values
