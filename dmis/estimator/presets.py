"""Presets: named, complete sets of estimator settings, which later changes of the defaults do not alter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any


@dataclass(frozen=True)
class Preset:
    """A complete set of estimator settings.

    Attributes
    ----------
    values
        Value of every field of `dmis.estimator.settings.Settings` but ``preset``.
    choices
        Fields that may have another value, with all values that they may have; an empty tuple stands for any, and
        those whose value is ``auto`` or None may have any, too.
    rule
        Rule of a render that names none.
    weigh
        What w of the rule ``thesis`` is, one of `dmis.fit.round.WEIGH`.
    """

    values: Mapping[str, Any]
    choices: Mapping[str, tuple[Any, ...]]
    rule: str
    weigh: str


_THESIS = Preset(
    values={
        "shading_samples": 2,
        "techniques": ("light", "brdf"),
        "combiner": "balance",
        "allocation": "systematic",
        "lights": "pbrt",
        "integrator": "auto",
        "max_depth": "auto",
        "sampler": "independent",
        "reuse_pilot": None,
        "compensation": 0.0,
    },
    choices={
        "shading_samples": (),
        "combiner": ("balance", "power"),
        "sampler": ("independent", "lowdiscrepancy"),
    },
    rule="thesis",
    weigh="heuristic",
)

PRESETS: Mapping[str, Preset] = {
    "thesis": _THESIS,
    "thesis-shares": replace(_THESIS, weigh="samples"),
    "nearest": replace(_THESIS, values={**_THESIS.values, "sampler": "lowdiscrepancy"}),
}
"""Presets by name.

``thesis`` is the estimator of Seo's thesis (2014), which stands on pbrt-v2. Pinned: light and BRDF sampling, whose
counts are rounded systematically to their shares of S on average; all lights in direct lighting, and one, picked
uniformly, at each vertex of a path; skies sampled by luminance, without compensation for the other technique;
independent points, or pbrt-v2's ``lowdiscrepancy`` ones; balance or power heuristic; a pilot of independent points,
combined by the balance heuristic. The caller gives S, integrator and depth. The rule says whether its pilot is part of
the image; if it does not, the pilot is with independent points. Its w weighs the heuristic, with one light sample for
each BRDF sample; ``thesis-shares`` has the same values, and w divides the samples.

``nearest`` is ``thesis`` with pbrt-v2's points unless the caller names others. It was chosen *knowing* the thesis's
numbers: of all set-ups that were tried its absolute errors are nearest to the thesis's, with the numbers of samples
that the scene files ask for (`Settings.as_in_file`), ``integrator="path"`` on both killeroo scenes, ``"direct"`` on the
others, and 128 points in the final pass: 122 rounded up to a power of two, as pbrt-v2's sampler does. So ``spp`` is 134
for the rule ``thesis``, and 128 for ``balance``. docs/thesis.md has the errors.

What has no field in `Settings` yet is pinned as the code has it: lights sampled by area, spheres by their cone; lobes
of a surface picked uniformly; a path continued by one more BRDF sample, beside those of direct lighting; Russian
roulette as in `dmis.estimator.path`. Whoever makes one of these a choice, or changes it, adds a field to `Settings`
whose value in this preset is the old behaviour. Images of the preset are held by `tests/estimator/test_presets.py`.
Not pinned: the order in which a sample goes through the triangles of a `dmis.light.mesh_light.MeshLight`, which no
scene of the thesis has. It changes which number gives which point, and no density.
"""
