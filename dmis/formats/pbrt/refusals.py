"""Collection of the errors of a pbrt file, so that one message lists all that is not supported."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from dmis.formats.pbrt.tokens import PbrtError

MAX_ERRORS = 1000
"""Number of errors after which a file is not read on."""


class Refusals:
    """Errors so far, in order, each line of the file once."""

    def __init__(self) -> None:
        self._errors: dict[str, PbrtError] = {}

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
            lines.append(f"{places} must change before the file can be read")
        return PbrtError("\n".join(lines))
