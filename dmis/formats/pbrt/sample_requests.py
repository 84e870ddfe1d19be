"""Samplers and numbers of samples of pbrt files, which a scene keeps as suggestions.

They do not change the expected image, so nothing here makes a file fail: a parameter of another type is not used.
"""

from __future__ import annotations

from collections.abc import Sequence

from dmis.formats.pbrt.parameters import ParameterSet
from dmis.formats.pbrt.tokens import Token
from dmis.light.light import Light
from dmis.scene.suggestions import Suggestions

SAMPLER_NAMES = {
    "lowdiscrepancy": "lowdiscrepancy",
    "02sequence": "lowdiscrepancy",
    "stratified": "stratified",
    "random": "independent",
    "independent": "independent",
}
"""Samplers of dmis by the names of pbrt's."""
ROUNDED = ("lowdiscrepancy", "02sequence", "maxmindist")
"""pbrt's samplers that round numbers of samples up to powers of two."""


class SampleRequests:
    """The sampler and the numbers of samples that the lines of a file ask for."""

    def __init__(self) -> None:
        self._sampler: str | None = None
        self._spp: int | None = None
        self.strategy: str | None = None
        """``all`` or ``one``: the lights that direct lighting samples at each point; None if no line says."""
        self.light_samples: list[int] = []
        """Samples of each light so far."""

    def read_sampler(self, line: Token, p: ParameterSet) -> None:
        """Read a Sampler line, whose string is `line`."""
        name, (count, side) = line.name, (4, 2) if p.dialect == "v2" else (16, 4)
        if name == "stratified":
            spp = _whole(p, "xsamples", side) * _whole(p, "ysamples", side)
        else:
            spp = _whole(p, "pixelsamples", 4 if name == "random" else count)
        self._sampler, self._spp = name, power_of_two(spp) if name in ROUNDED else spp

    def of_light(self, p: ParameterSet) -> int:
        """Return the number of samples that a light asks for, rounded as the file's sampler does."""
        number = _whole(p, "nsamples", 1) if p.dialect != "v4" else 1
        number = _whole(p, "samples", number) if p.dialect == "v3" else number
        # without a Sampler line pbrt-v2 takes lowdiscrepancy
        rounded = self._sampler in ROUNDED or (self._sampler is None and p.dialect == "v2")
        return power_of_two(number) if rounded else number

    def suggestions(self, integrator: tuple[str, int], lights: Sequence[Light | None]) -> Suggestions:
        """Return what the file asks for; `lights` are those of `light_samples`."""
        known = self._sampler is None or self._sampler in SAMPLER_NAMES
        pairs = zip(lights, self.light_samples, strict=True)
        return Suggestions(
            *integrator,
            sampler=SAMPLER_NAMES.get(self._sampler or ""),
            spp=self._spp,
            lights=self.strategy,
            light_samples=tuple(number for light, number in pairs if light is not None and not light.delta),
            unmet=() if known else (f"sampler {self._sampler}",),
        )


def power_of_two(number: int) -> int:
    """Return the least power of two that is not below `number`."""
    return 1 << max(number - 1, 0).bit_length()


def _whole(parameters: ParameterSet, name: str, default: int) -> int:
    """Return the positive integer called `name`, and note it as read; the default if it is absent or something else."""
    parameter = parameters.items.get(name)
    if parameter is None or parameter.kind != "integer" or len(parameter.values) != 1 or parameter.numbers[0] < 1:
        return default
    parameters.read_names.add(name)
    return int(parameter.numbers[0])
