"""Checks of a weight rule: what `fit` returns, also from degenerate pilots, and the mean of its renders."""

from __future__ import annotations

import warnings

import numpy as np

from dmis.brdf.materials import matte, plastic
from dmis.estimator.settings import Settings
from dmis.fit.registry import make_rule
from dmis.fit.rule import Rule
from dmis.pipeline.render import render
from dmis.pipeline.result import Result
from dmis.scene.scene import Scene
from dmis.testing.outcome import Check, Fault, Outcome, run_checks
from dmis.testing.scenes import box_scene, compare_means
from dmis.testing.statistics import level, z_limit

SPP = 32
"""Camera samples per pixel of each render, the pilot included."""


def check_rule(rule: Rule | str, name: str = "") -> list[Outcome]:
    """Check a weight rule by what `Rule` and `Fit` promise.

    Parameters
    ----------
    rule
        An object, or the text of a registered one.
    name
        For messages. Default: that of the class, or the text.

    Returns
    -------
    list of Outcome
        One for each check. A right rule fails any of them with a probability of 1e-4.
    """
    name = name or (rule if isinstance(rule, str) else type(rule).__name__)

    def prepare() -> list[Check]:
        make_rule(rule)
        sizes = [_scene(size) for size in ((16, 16), (21, 13), (1, 1))]  # whole patches, cut ones, a single pixel
        dark = [box_scene(matte(0.0)), box_scene(lights=()), box_scene(eye=(0, -3, 6), target=(0, 40, 0))]
        return [
            ("fit returns shares in [0, 1] of the shape of the image", lambda: _check_fit(rule, sizes)),
            ("fit copes with a pilot without variance", lambda: _check_fit(rule, dark)),
            ("fit depends on the pilot alone", lambda: _check_deterministic(rule)),
            ("renders agree with balance", lambda: _check_renders(rule, name)),
        ]

    return run_checks(name, "it is a rule", prepare)


def _render(rule: Rule | str, scene: Scene, seed: int = 0) -> Result:
    """Render a scene by a rule; raise a Fault with the message of a fit that is refused."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a scene without light
            return render(scene, rule, SPP, seed=seed, settings=Settings(integrator="direct"), parallel=1)
    except ValueError as error:
        width, height = scene.camera.resolution
        raise Fault(f"fit, image of {width}x{height} pixels: {error}") from error


def _scene(size: tuple[int, int] = (16, 16)) -> Scene:
    return box_scene(plastic(0.4, 0.4, 0.05), resolution=size)


def _check_fit(rule: Rule | str, scenes: list[Scene]) -> str:
    """Raise a Fault if the shares of a scene are refused."""
    shares = [_render(rule, scene).weight for scene in scenes]
    return f"shares from {min(w.min() for w in shares):.3f} to {max(w.max() for w in shares):.3f}"


def _check_deterministic(rule: Rule | str) -> str:
    """Raise a Fault if two renders of the same seed differ."""
    first, second = (_render(rule, _scene(), 3) for _ in range(2))
    if not np.array_equal(first.weight, second.weight):
        change = np.abs(first.weight - second.weight).max()
        raise Fault(
            f"fit returns other shares from the same pilot, by up to {change:.3g}: it must depend on the pilot alone, "
            f"not on a clock, a global random generator, or what an earlier call left behind"
        )
    if not np.array_equal(first.samples, second.samples):
        raise Fault("fit returns other numbers of samples from the same pilot: it must depend on the pilot alone")
    return "two renders of one seed are equal"


def _check_renders(rule: Rule | str, name: str) -> str:
    """Raise a Fault if the mean is not that of the balance heuristic."""
    _render(rule, _scene())  # a fit that is refused
    advice = (
        "fit or settings: shares may depend on the pilot only if its samples are no part of the image, or weigh as "
        "much as their share of the budget (settings reuse_pilot)"
    )
    return compare_means(_scene(), [("balance", "balance"), (name, rule)], z_limit(level(1)), advice, spp=128)
