"""Integrator and depth that a scene's file names."""

from __future__ import annotations

from dataclasses import dataclass

from dmis.base.validate import whole
from dmis.scene.defaults import DEFAULT_DEPTH, DEFAULT_INTEGRATOR, MAX_DEPTH


@dataclass(frozen=True)
class Suggestions:
    """Wishes of a scene's file about how it is rendered, which renders follow unless told otherwise.

    Parameters
    ----------
    integrator, max_depth
        See `dmis.estimator.settings.Settings`; None if the file does not say.
    """

    integrator: str | None = None
    max_depth: int | None = None

    def __post_init__(self) -> None:
        if self.integrator not in (None, "direct", "path"):
            raise ValueError(f"integrator must be direct or path, or None; got {self.integrator!r}")
        if self.max_depth is not None:
            object.__setattr__(self, "max_depth", whole("max_depth", self.max_depth, 1, MAX_DEPTH, "or None"))

    def describe(self) -> str:
        """Return a line for ``python -m dmis info``."""
        source = "set by the scene: its file, or the dialect's default"
        if self.integrator is None:
            source = "the default, because the scene names none"
        depth = self.max_depth or DEFAULT_DEPTH
        return f"  integrator: {self.integrator or DEFAULT_INTEGRATOR}, max_depth {depth}, {source}"
