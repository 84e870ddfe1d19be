"""Notes about lines of a pbrt file that are not used or probably mean something else, and the warnings made of them;
and its errors, so that one message lists all that is not supported.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from dmis.base.validate import did_you_mean
from dmis.formats.pbrt.dialect import IRRELEVANT
from dmis.formats.pbrt.parameters import SPECTRUM_TYPES, UNDEFINED, ParameterSet
from dmis.formats.pbrt.tokens import PbrtError, Source, Token
from dmis.scene.scene import SceneWarning

MIN_LIKENESS = 0.8
"""Similarity, 0 to 1, from which on an unknown parameter may be a misspelt one."""
UNUSED = "not used, because it does not change the expected image"
_UNKNOWN = "not used, because it is unknown there"


class PbrtWarning(SceneWarning):
    """Warning about lines of a pbrt file that were not used, probably have another meaning, or are too bright.

    Lines are not used if they do not change the expected image or are unknown; what changes it and is not applied is
    named as such. Reflectances above 1 are too bright; below 0 they are taken as 0.
    """


class Notes:
    """Notes by kind and by what they are about, with the tokens; `warnings` are texts beside them."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.warnings: list[str] = []
        self._notes: dict[str, dict[str, dict[int, Token]]] = {UNUSED: {}, _UNKNOWN: {}}

    def add(self, kind: str, what: str, token: Token) -> None:
        """Note what a warning that begins with `kind` says of a token."""
        self._notes.setdefault(kind, {}).setdefault(what, {})[id(token)] = token

    def add_parameters(self, p: ParameterSet) -> None:
        """Note the findings about the parameters of a line, and the parameters that no reader has used."""
        for kind, item in p.findings:
            texture = f"{item.values[0]!r} for " if kind == UNDEFINED else ""
            self.add(kind, f"{texture}{item.name!r} of {item.directive.text}", item.token)
        for name, item in p.items.items():
            directive = item.directive.text
            if name in p.read_names:
                continue
            what = f"parameter {name!r} of {directive}"
            if directive in ("Sampler", "Renderer") or name in IRRELEVANT.get(directive, ()):
                self.add(UNUSED, what, item.token)
                continue
            hint = did_you_mean(name, p.read_names, MIN_LIKENESS)
            if directive in ("LightSource", "AreaLightSource") and item.kind in SPECTRUM_TYPES:
                meant = "I" if "I" in p.read_names else "L"
                hint = "" if meant in p.items else f", did you mean {meant!r}?"
            self.add(_UNKNOWN, what + hint, item.token)

    def warn(self, stacklevel: int) -> None:
        """Issue a warning for each text and each kind of note, with the first places of what it is about."""
        for kind, named in self._notes.items():
            if named:
                places = ", ".join(self._places(what, *tokens.values()) for what, tokens in named.items())
                self.warnings.append(f"{self.source.path}: {kind}: {places}")
        for text in self.warnings:
            warnings.warn(PbrtWarning(text), stacklevel=stacklevel + 1)

    def _places(self, what: str, first: Token, *others: Token) -> str:
        file = "" if first.source is self.source else f"{first.source.path}:"
        return f"{what} (line {file}{first.line}{f' and {len(others)} more' if others else ''})"


MAX_ERRORS = 1000
"""Number of errors after which a file is not read on."""


class Refusals:
    """Errors so far, in order, each line of the file once."""

    def __init__(self) -> None:
        self._errors: dict[str, PbrtError] = {}
        self.complete = False
        """Whether the file is read to its end."""

    def __bool__(self) -> bool:
        return bool(self._errors)

    def add(self, error: PbrtError) -> None:
        """Add an error, unless it is there already: a material's is found again at each shape.

        Raise `error` once there are `MAX_ERRORS`.
        """
        if len(self._errors) >= MAX_ERRORS:
            raise self.error()
        self._errors.setdefault(str(error), error)

    @contextmanager
    def collect(self) -> Iterator[None]:
        """Add the first error of the block, and go on behind the block."""
        try:
            yield
        except PbrtError as error:
            if error.is_last:
                raise
            self.add(error)

    def error(self) -> PbrtError:
        """Return one error that lists all of them: each token and reason once, with its first place."""
        kinds: dict[str, list[PbrtError]] = {}
        for error in self._errors.values():
            kinds.setdefault(error.reason, []).append(error)
        lines = [
            str(same[0]) + (f" (and {len(same) - 1} more places)" if len(same) > 1 else "") for same in kinds.values()
        ]
        if len(self._errors) > 1:
            least = "at least " if len(self._errors) >= MAX_ERRORS else ""
            places = f"{least}{len(self._errors):,} places of {len(kinds):,} kinds"
            more = "" if self.complete or least else "; reading stopped at the last one, so more may follow"
            lines.append(f"{places} must change before the file can be read{more}")
        return PbrtError("\n".join(lines))
