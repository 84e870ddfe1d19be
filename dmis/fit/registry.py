"""Weight rules by name: `RULES`, `register_rule` for one's own, and `make_rule`, which reads ``name:option=value``."""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Mapping
from dataclasses import replace
from functools import partial
from inspect import Parameter, signature
from typing import Any

from dmis.base.plugins import loaded_plugins
from dmis.base.validate import did_you_mean
from dmis.estimator.technique import TECHNIQUES
from dmis.fit.fixed import Fixed
from dmis.fit.rounds import Rounds
from dmis.fit.rule import Rule, complete_rule
from dmis.fit.second_moment import SecondMoment
from dmis.fit.simplex import Simplex
from dmis.fit.thesis import Thesis


def _simplex(**options: Any) -> Rule:
    shares = {name: options.pop(name) for name in tuple(options) if name in TECHNIQUES}
    if not shares:
        return Simplex(**options)
    allowed = ("combiner", "sampler", "compensation")
    if wrong := options.keys() - set(allowed):
        raise ValueError(
            f"rule simplex with shares that are given has the options {', '.join(allowed)}; got "
            f"{', '.join(sorted(wrong))}"
        )
    if len(shares) < 2:
        raise ValueError(f"rule simplex needs shares of at least two techniques; got {', '.join(shares)}")
    w = tuple(shares.values())
    rule = Fixed(w, techniques=tuple(shares), **options)
    return rule if len(w) > 2 else replace(rule, w=w[0])


_RELATIVES = ("taylor", "inverse-variance", "neyman", "representativity", "kl", "tsallis")
RULES: dict[str, Callable[..., Rule]] = {
    "balance": Fixed,
    "fixed": Fixed,
    "pbrt": lambda **options: Fixed(**{"combiner": "power", **options}),
    "one-sample": lambda **options: Fixed(**{"allocation": "random", **options}),
    "uniform": lambda **options: Fixed(**{"w": 1.0, "techniques": ("uniform", "brdf"), **options}),
    "resampled": lambda **options: Fixed(**{"techniques": ("resampled", "brdf"), **options}),
    "thesis": Thesis,
    "second-moment": partial(SecondMoment, "second-moment"),
    **{name: partial(SecondMoment, name) for name in _RELATIVES},
    "simplex": _simplex,
    "counts": partial(Rounds, False),
    "auto": Rounds,
}
"""Rules by name: ``balance`` and ``pbrt`` (1 light + 1 BRDF sample, balance or power heuristic), ``fixed:W``,
``one-sample`` (a random choice between the techniques), ``uniform`` (hemisphere sampling, for teaching),
``resampled:W`` (`dmis.estimator.resampling` in the place of light sampling), ``thesis``; ``second-moment`` and its
relatives in the literature, see `dmis.fit.second_moment`; ``simplex:light+brdf+resampled``, weights of several
techniques, see `dmis.variance.simplex_curves`, and ``simplex:light=0.5,brdf=0.3,resampled=0.2``, given ones; ``auto``,
the best of them all, which learns shares and numbers of samples per pixel in two rounds, and ``counts``, the same with
equal shares (`dmis.fit.rounds`).
"""
_SHIPPED = frozenset(RULES)
_RESERVED = {"all": "compare has it for every rule", "pinned": "compare has it for its pinned baseline"}
_HELD = dict.fromkeys(("balance", "pbrt", "uniform"), "w") | {"counts": "weights"}
_HELD |= dict.fromkeys(("second-moment", *_RELATIVES), "objective")
"""The argument of a class that its rule of this name has already, so that it is no option."""
_REMOVED_RULES = {"linear": "second-moment, which minimises the variance that linear fitted f for"}
"""What to use in place of rules of earlier versions."""
_REMOVED_OPTIONS = {
    "shrink": "curves of patches are filtered alone; choose the filter with filter= and size=",
    "strategies": "the pilot has the thesis's three; spp= sets its samples at each",
}
"""What to do in place of options of earlier versions."""
_REST = (Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD)


def register_rule(name: str, cls: Callable[..., Any]) -> None:
    """Add a rule by name, so that `render`, `compare` and the command line find it as text, ``name:option=value``.

    Parameters
    ----------
    name
        Letters and digits, words joined by hyphens, such as ``quieter-patches``.
    cls
        Class of the rule: one that derives from `dmis.fit.rule.Rule`, or a plain one with a method ``fit``; or a
        function that returns a rule. Its arguments, such as the fields of a dataclass, are the rule's options: each
        has a default, and those whose default is a number, a string, True or False may be given as text. The class of
        a name may be defined anew, as a notebook cell that runs twice does.

    Raises
    ------
    ValueError
        If the name is not of this form or is taken, an argument has no default, or `cls` makes no rule.
    """
    if not isinstance(name, str) or not re.fullmatch("[A-Za-z][A-Za-z0-9]*(-[A-Za-z0-9]+)*", name):
        raise ValueError(f"name of a rule must be letters, digits and hyphens, such as my-rule; got {name!r}")
    if not callable(cls):
        raise ValueError(
            f"rule {name} must be a class with a method fit, or a function that returns a rule; got {cls!r}. "
            f"Write dmis.register_rule({name!r}, MyRule)"
        )
    if name in _RESERVED:
        raise ValueError(f"name of a rule must not be {name}, because {_RESERVED[name]}. Choose another name")
    if name in _SHIPPED or (name in RULES and _origin(RULES[name]) != _origin(cls)):
        owner = "dmis" if name in _SHIPPED else ".".join(_origin(RULES[name]))
        raise ValueError(f"name of a rule must be new; {name!r} is taken by {owner}. Choose another name")
    try:
        required = [key for key, p in signature(cls).parameters.items() if p.default is p.empty and p.kind not in _REST]
    except ValueError:  # some classes of C have no signature
        required = []
    if required:
        raise ValueError(
            f"rule {name} must have a default for every option, because its name alone is a rule; "
            f"{', '.join(required)} of {_origin(cls)[1]} has none. Write {required[0]}=..."
        )
    complete_rule(cls())
    RULES[name] = cls


def _origin(cls: Any) -> tuple[str, str]:
    """Return module and name of a class or function."""
    return cls.__module__, getattr(cls, "__qualname__", repr(cls))


def make_rule(text: Rule | str | Any) -> Rule:
    """Read a rule: ``thesis``, ``thesis:patch=16,filter=none``, ``fixed:0.25``.

    A bare value is the rule's first option. A rule object stays as it is; one of a plain class gets the defaults of
    `Rule`.

    Parameters
    ----------
    text
        A name of `RULES`, a colon, and options ``name=value`` separated by commas.

    Returns
    -------
    Rule
        What `dmis.pipeline.render.render` takes.

    Raises
    ------
    ValueError
        If it is neither, there is no such rule or option, or a value does not fit.
    """
    if not isinstance(text, str):
        return complete_rule(text)
    name, _, rest = text.strip().partition(":")
    if name not in RULES:
        raise _no_such_rule(name)
    convert: dict[type, Callable[[str], Any]] = {int: int, float: float, str: str, bool: _yes_or_no}
    types, words = _option_types(name, convert), _option_words(name)
    types.pop(_HELD.get(name, ""), None)
    if name == "simplex":
        types |= dict.fromkeys(TECHNIQUES, float)
    options: dict[str, Any] = {}
    for item in filter(None, rest.split(",")):
        key, equals, value = item.partition("=")
        if not equals and key in _arguments(name) and key in types:
            raise ValueError(f"option {key} of rule {name} needs a value: {name}:{key}={_example(name, key)}")
        if not equals and types:
            key, value = next(iter(types)), item
        if key not in types and key in _REMOVED_OPTIONS:
            raise ValueError(f"rule {name} has no option {key} any more: {_REMOVED_OPTIONS[key]}; got {item!r}")
        if key not in types:
            known = f"the options {', '.join(types)}" if types else "no options"
            raise ValueError(f"rule {name} has {known}; got {key!r}{did_you_mean(key, types)}")
        if key in options:
            raise ValueError(f"option {key} of rule {name} must be given once; got {options[key]} and {value}")
        try:
            options[key] = value if value in words.get(key, ()) else convert[types[key]](value)
        except ValueError:
            kind_of = "yes or no" if types[key] is bool else f"of type {types[key].__name__}"
            kind_of = " or ".join([kind_of, *words.get(key, ())])
            first = "" if equals else f", of which a value without a name is the first; there are {', '.join(types)}"
            raise ValueError(f"option {key} of rule {name} must be {kind_of}; got {value!r}{first}") from None
    if name == "fixed" and "w" not in options:
        raise ValueError("rule fixed needs the share of light samples, such as fixed:0.5; got none")
    return complete_rule(RULES[name](**options))


def _no_such_rule(name: str) -> ValueError:
    """Return the error that a name is that of no rule."""
    if name in _REMOVED_RULES:
        return ValueError(f"rule {name} was removed. Use {_REMOVED_RULES[name]}")
    how = "dmis.register_rule adds one; on the command line, name the file that calls it with --plugin"
    if loaded_plugins() and RULES.keys() == _SHIPPED:
        files = " and ".join(path.name for path in loaded_plugins())
        how = f"{files} registered no rule: end it with dmis.register_rule({name!r}, ...), and the rule's class"
    return ValueError(
        f"rule must be one of {', '.join(RULES)}, and options behind a colon, as in thesis:patch=4; got {name!r}"
        f"{did_you_mean(name, RULES) or '.'} {how}"
    )


def _arguments(name: str) -> Mapping[str, Parameter]:
    """Return the arguments of a rule that are its options, by name."""
    arguments = signature(type(RULES[name]())) if name in _SHIPPED else signature(RULES[name])
    return {key: p for key, p in arguments.parameters.items() if p.kind not in _REST}


def _example(name: str, option: str) -> str:
    """Return the default value of a rule's option as text, an example of what it may be."""
    argument = _arguments(name)[option]
    default = argument.default
    if default is None and _type_of(argument) is float:
        return "0.5"
    return "no" if default in (None, False) else "yes" if default is True else str(default)


def _option_types(name: str, readable: Container[type]) -> dict[str, type]:
    """Return the types of a rule's options by name."""
    types = {key: _type_of(p) for key, p in _arguments(name).items()}
    return {key: kind for key, kind in types.items() if kind in readable}


def _type_of(argument: Parameter) -> type:
    """Return the type of an option: that of its default; where this is None, float if annotated so, else bool."""
    if argument.default is not None:
        return type(argument.default)
    return float if "float" in str(argument.annotation) else bool


def _option_words(name: str) -> dict[str, list[str]]:
    """Return the words that options take beside numbers, by name: those of ``Literal`` in an annotation."""
    literal = re.compile(r"Literal\[(.*?)\]")
    return {
        key: re.findall(r"\w+", match[1])
        for key, p in _arguments(name).items()
        if (match := literal.search(str(p.annotation)))
    }


def _yes_or_no(text: str) -> bool:
    words = {"yes": True, "true": True, "on": True, "1": True, "no": False, "false": False, "off": False, "0": False}
    if text.lower() not in words:
        raise ValueError(text)
    return words[text.lower()]
