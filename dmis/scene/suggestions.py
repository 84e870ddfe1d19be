"""What a scene's file asks for beside the scene itself: integrator, sampler and numbers of samples."""

from __future__ import annotations

from dataclasses import dataclass

from dmis.base.validate import whole

DEFAULT_INTEGRATOR = "direct"
"""Integrator of scenes made in Python. The reader of a file takes the default of the file's dialect."""
DEFAULT_DEPTH = 5
"""Default maximum path depth, in surfaces that a path visits; pbrt-v2's."""
MAX_DEPTH = 10_000
"""Largest maximum path depth."""


@dataclass(frozen=True)
class Suggestions:
    """Wishes of a scene's file about how it is rendered. None of it changes what the scene is.

    Renders take integrator and depth from here unless told otherwise; the rest is taken by
    `dmis.estimator.settings.Settings.as_in_file` and ``--as-in-file`` only.

    Parameters
    ----------
    integrator, max_depth
        See `dmis.estimator.settings.Settings`; None if the file does not say.
    sampler
        dmis's name of the file's sampler; None if the file names none, or one that dmis does not have.
    spp
        Camera samples per pixel; None if the file does not say.
    lights
        ``all`` or ``one``: the lights that direct lighting samples at each point; None if the file does not say.
    light_samples
        Light samples, and as many BRDF samples, of each light that is not a single direction or point, in the order of
        the scene's lights, rounded as the file's sampler does.
    unmet
        What the file asks for and dmis does not have, in words.
    """

    integrator: str | None = None
    max_depth: int | None = None
    sampler: str | None = None
    spp: int | None = None
    lights: str | None = None
    light_samples: tuple[int, ...] = ()
    unmet: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.integrator not in (None, "direct", "path"):
            raise ValueError(f"integrator must be direct or path, or None; got {self.integrator!r}")
        if self.max_depth is not None:
            object.__setattr__(self, "max_depth", whole("max_depth", self.max_depth, 1, MAX_DEPTH, "or None"))

    @property
    def shading_samples(self) -> int | None:
        """S of direct lighting: light and BRDF samples of the light that has most; None if no light has any."""
        return 2 * max(self.light_samples) if self.light_samples else None

    def describe(self) -> str:
        """Return lines for ``python -m dmis info``."""
        source = "the scene's" if self.integrator else "the default, because the scene names none"
        depth = self.max_depth or DEFAULT_DEPTH
        text = f"  integrator: {self.integrator or DEFAULT_INTEGRATOR}, max_depth {depth}, {source}"
        samples = [f"sampler {self.sampler}"] if self.sampler else []
        samples += [f"{self.spp} spp"] if self.spp else []
        samples += [f"lights {self.lights}"] if self.lights else []
        if self.light_samples:
            numbers = ", ".join(map(str, sorted(set(self.light_samples))))
            largest = "" if len(set(self.light_samples)) == 1 else ", the largest number counts"
            samples.append(f"light samples {numbers} (shading_samples {self.shading_samples} of direct{largest})")
        if samples:
            text += f"\n  samples that the file asks for (--as-in-file): {', '.join(samples)}"
        return text + "".join(f"\n  not available: {wish}" for wish in self.unmet)
