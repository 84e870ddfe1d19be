"""Progress of renders: a function of the caller's own, or a bar of tqdm (extra ``progress``)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any

Progress = Callable[[str, int, int], None]
"""``progress(stage, done, total)``: camera samples of all stages of a render so far, or renders of a rule."""


class ProgressBar:
    """A `Progress` that shows a bar: on standard error, or as a widget in a notebook.

    Parameters
    ----------
    unit
        What is counted.

    Raises
    ------
    ImportError
        If tqdm is missing.
    """

    def __init__(self, unit: str) -> None:
        try:
            from tqdm.auto import tqdm
        except ImportError as missing:
            raise ImportError("progress=True needs tqdm: pip install 'dmis[progress]'") from missing
        self._bar: Any = tqdm(unit=f" {unit}", unit_scale=True, leave=False)

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Show that `done` of `total` are done; where less are done than before, another render has begun."""
        if done < self._bar.n:
            self._bar.reset()
        self._bar.total = total
        self._bar.set_description(stage, refresh=self._bar.desc != f"{stage}: ")
        self._bar.update(done - self._bar.n)

    def close(self) -> None:
        """Remove the bar."""
        self._bar.close()


@contextmanager
def reporting(progress: Progress | bool | None, unit: str = "samples") -> Iterator[Progress | None]:
    """Give a function that reports progress, or None; a bar that True has made is removed at the end.

    A ValueError if `progress` is neither a function, nor True, False or None.
    """
    if progress is True:
        with closing(ProgressBar(unit)) as bar:
            yield bar
    elif progress is None or progress is False:
        yield None
    elif callable(progress):
        yield progress
    else:
        raise ValueError(
            f"progress must be a function progress(stage, done, total), True for a bar, or None; got {progress!r}"
        )
