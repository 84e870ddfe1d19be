"""Weight rules by name: `RULES`, and `make_rule`, which reads ``name:option=value,...``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from typing import Any

from dmis.fit import Fixed, Rule, Thesis
from dmis.learned import Learned
from dmis.simplex import Simplex
from dmis.technique import TECHNIQUES


def _simplex(**options: Any) -> Rule:
    shares = {name: options.pop(name) for name in tuple(options) if name in TECHNIQUES}
    if not shares:
        return Simplex(**options)
    if wrong := options.keys() - {"combiner", "sampler"}:
        raise ValueError(
            f"rule simplex with shares that are given has the options combiner, sampler; got {', '.join(sorted(wrong))}"
        )
    if len(shares) < 2:
        raise ValueError(f"rule simplex needs shares of at least two techniques; got {', '.join(shares)}")
    w = tuple(shares.values())
    rule = Fixed(w, techniques=tuple(shares), **options)
    return rule if len(w) > 2 else replace(rule, w=w[0])


_RELATIVES = ("taylor", "inverse-variance", "neyman", "representativity", "kl", "tsallis", "linear")

RULES: dict[str, Callable[..., Rule]] = {
    "balance": Fixed,
    "fixed": Fixed,
    "pbrt": lambda **options: Fixed(**{"combiner": "power", **options}),
    "one-sample": lambda **options: Fixed(**{"allocation": "random", **options}),
    "uniform": lambda **options: Fixed(**{"w": 1.0, "techniques": ("uniform", "brdf"), **options}),
    "resampled": lambda **options: Fixed(**{"techniques": ("resampled", "brdf"), **options}),
    "thesis": Thesis,
    "second-moment": partial(Learned, "second-moment", combiner="balance+power"),
    **{name: partial(Learned, name, shrink=False) for name in _RELATIVES},
    "simplex": _simplex,
    "auto": partial(Learned, "second-moment", counts=True, split=True, reuse=False),
}
"""Rules by name: ``balance`` and ``pbrt`` (1 light + 1 BRDF sample, balance or power heuristic), ``fixed:W``,
``one-sample`` (a random choice between the techniques), ``uniform`` (hemisphere sampling, for teaching),
``resampled:W`` (`dmis.resampling` in the place of light sampling), ``thesis``; ``second-moment`` and its relatives in
the literature, see `dmis.learned`; ``simplex:light+brdf+resampled``, weights of several techniques, see `dmis.simplex`,
and ``simplex:light=0.5,brdf=0.3,resampled=0.2``, given ones; ``auto``, the best of them all.
"""


def make_rule(text: Rule | str) -> Rule:
    """Read a rule: ``thesis``, ``thesis:patch=16,filter=none``, ``fixed:0.25``. What is a rule already stays as it is.

    A bare value is the rule's first option.

    Parameters
    ----------
    text
        A name of `RULES`, a colon, and options ``name=value`` separated by commas.

    Returns
    -------
    Rule
        What `dmis.render.render` takes.

    Raises
    ------
    ValueError
        If it is neither, there is no such rule or option, or a value does not fit.
    """
    if not isinstance(text, str):
        if isinstance(text, type) or not isinstance(text, Rule):
            raise ValueError(f"rule must be a rule, or text such as thesis:patch=16; got {text!r}")
        return text
    name, _, rest = text.strip().partition(":")
    if name not in RULES:
        raise ValueError(
            f"rule must be one of {', '.join(RULES)}, and options behind a colon, as in thesis:patch=4; got {name!r}"
        )
    kind: Any = type(RULES[name]())
    types = {f.name: bool if f.default is None else type(f.default) for f in fields(kind)}
    if name in ("balance", "pbrt", "uniform"):
        types.pop("w")
    types.pop("techniques", None)
    types.pop("objective", None)
    if name == "simplex":
        types |= dict.fromkeys(TECHNIQUES, float)
    options: dict[str, Any] = {}
    convert: dict[type, Callable[[str], Any]] = {int: int, float: float, str: str, bool: _yes_or_no}
    for item in filter(None, rest.split(",")):
        key, equals, value = item.partition("=")
        if not equals:
            key, value = next(iter(types)), item
        if key not in types:
            raise ValueError(f"rule {name} has the options {', '.join(types)}; got {key!r}")
        try:
            options[key] = convert[types[key]](value)
        except ValueError:
            kind_of = "yes or no" if types[key] is bool else f"of type {types[key].__name__}"
            first = "" if equals else f", of which a value without a name is the first; there are {', '.join(types)}"
            raise ValueError(f"option {key} of rule {name} must be {kind_of}; got {value!r}{first}") from None
    return RULES[name](**options)


def _yes_or_no(text: str) -> bool:
    words = {"yes": True, "true": True, "on": True, "1": True, "no": False, "false": False, "off": False, "0": False}
    if text.lower() not in words:
        raise ValueError(text)
    return words[text.lower()]
