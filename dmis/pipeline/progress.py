"""Progress of renders: a function of the caller's own, or a bar of tqdm (extra ``progress``)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

Progress = Callable[[str, int, int], None]
"""``progress(stage, done, total)``: camera samples of all stages of a render so far, or renders of a rule."""


@contextmanager
def reporting(progress: Progress | bool | None, unit: str = "samples") -> Iterator[Progress | None]:
    """Give a function that reports progress, or None; True is a bar of tqdm that counts `unit`, removed at the end.

    A ValueError if `progress` is neither a function, nor True, False or None; an ImportError if tqdm is missing.
    """
    if progress is not True:
        if progress and not callable(progress):
            must = "progress must be a function progress(stage, done, total), True for a bar, or None"
            raise ValueError(f"{must}; got {progress!r}")
        yield progress or None
        return
    try:
        from tqdm.auto import tqdm
    except ImportError as missing:
        raise ImportError("progress=True needs tqdm: pip install 'dmis[progress]'") from missing
    bar: Any
    with tqdm(unit=f" {unit}", unit_scale=True, leave=False) as bar:

        def show(stage: str, done: int, total: int) -> None:
            """Move the bar, see `Progress`."""
            if done < bar.n:  # another render has begun
                bar.reset()
            bar.total = total
            bar.set_description(stage, refresh=bar.desc != f"{stage}: ")
            bar.update(done - bar.n)

        yield show
