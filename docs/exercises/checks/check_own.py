"""Checks of exercises 19 to 21, of tutorial 6: numbers of samples, a lobe, a rule of one's own."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np

from dmis.base.vectors import Array
from dmis.brdf.lobe import Directions
from dmis.brdf.materials import Material
from dmis.fit.rule import Rule
from dmis.formats.load_scene import load_scene
from dmis.pipeline.render import render
from dmis.scene.scene import Scene
from dmis.scene.shading_points import ShadingPoints
from dmis.testing.outcome import Outcome
from dmis.testing.scenes import surface
from dmis.testing.sphere import sphere_rule, uniforms
from grading import (
    Failed,
    at_most,
    call,
    call_object,
    check_array,
    check_directions,
    compare,
    exercise,
    exponent,
    seeded,
)

_SEEDS = range(8)
_SPP = 32
_RATIO = 0.85
"""Largest error of a rule over that of the balance heuristic, at the upper end of its interval."""


@exercise(19)
def sample_counts(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 19: numbers of samples by variance and cost."""
    variance = np.array([[1.0, 4.0], [0.25, 9.0]])
    (n,) = call(module, "sample_counts", variance, np.ones((2, 2)), 65.0, shapes=[(2, 2)])
    yield compare("equal costs: in proportion to the root", n, np.array([[10.0, 20], [5, 30]]), 1e-6)
    rng = np.random.default_rng(seeded(1))
    variance, cost = rng.exponential(1, (2, 20, 30))
    (n,) = call(module, "sample_counts", variance, cost, 5000.0, shapes=[(20, 30)])
    yield compare("the budget is spent", np.array((n * cost).sum()), 5000.0, 1e-6)
    best = np.sqrt(variance * cost).sum() ** 2 / 5000
    error = float((variance / np.maximum(n, 1e-12)).sum())
    yield at_most("the error is least", error, 1.0001 * best, "the sum of V / n", "Costly pixels get fewer samples")


@exercise(20)
def velvet(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 20: a lobe with a density of its own."""
    lobe = call_object("Velvet", getattr(module, "Velvet", None), 3.0)
    n = 100_000
    wo = np.array([np.sin(1.2), 0, np.cos(1.2)], np.float32)

    def points(count: int) -> ShadingPoints:
        return surface(Material((lobe,)), wo, count)

    def evaluate(method: str, wi: Array) -> Any:
        at = points(wi.shape[1])
        return call_object(f"Velvet.{method}", getattr(at, method), Directions(at, wi.astype(np.float32)))

    def pdf(wi: Array) -> Array:
        return check_array("Velvet.pdf", evaluate("pdf", wi), wi.shape[1:])

    def reflected(wi: Array) -> Array:
        """Return f cos of the first channel above the surface, ``(N,)``."""
        return np.broadcast_to(evaluate("eval", wi), wi.shape)[0] * np.maximum(wi[2], 0)

    call_object("Velvet", points, 1)  # a lobe without one of the methods is refused
    wi = check_array("Velvet.sample", call_object("Velvet.sample", points(n).sample, uniforms(n, seeded(1))), (3, n))
    yield compare("directions are unit vectors", (wi * wi).sum(axis=0), 1.0, 1e-4)
    yield from check_directions("Velvet", wi, pdf)

    # furnace: under light of 1 from everywhere, the mean of f cos / p is the albedo, whatever the density
    grid, solid_angles = sphere_rule()
    albedo = float(reflected(grid) @ solid_angles)
    values = reflected(wi) / np.maximum(pdf(wi), 1e-9)
    e = exponent(20)
    expected = 6 * (1 - float(wo[2])) ** e / ((e + 1) * (e + 2))
    yield compare("eval is that of velvet", albedo, expected, 0.01, "Leave eval as it is")
    z = (values.mean() - albedo) / max(values.std() / np.sqrt(n), 1e-3 * albedo)
    yield at_most("furnace: samples give the albedo", float(abs(z)), 4.0, f"|z| of {values.mean():.4f} - {albedo:.4f}")
    what, advice = "the relative variance of f cos / p", "cos / pi has more than 1.4; follow f cos more closely"
    yield at_most("little noise", float(values.var() / values.mean() ** 2), 0.3, what, advice)


@exercise(21)
def own_rule(module: ModuleType) -> Iterator[Outcome]:
    """Exercise 21: a rule that has less error than the balance heuristic, where either technique is the better one."""
    mine = call_object("Mine", getattr(module, "Mine", None))
    if not isinstance(mine, Rule):
        raise Failed("Mine is a rule", "Mine must derive from dmis.Rule, as in the starter")
    if (origin := type(mine).fit.__module__).startswith("dmis."):
        raise Failed("Mine has a fit of its own", f"Mine must define fit(self, pilot); it has that of {origin}")
    yield from _beats_balance(mine, "teapot-area-light", "the teapot below its lamp")
    yield from _beats_balance(mine, "tt-overcast", "the car under its sky")


def _beats_balance(mine: Rule, scene: str, name: str) -> Iterator[Outcome]:
    """Yield whether a rule is unbiased on a scene, and has less error than the balance heuristic at equal samples."""
    errors, means = np.stack([_errors_and_means(mine, scene), _balance(scene)], axis=1)
    error = np.sqrt(means.var(axis=1, ddof=1).sum() / len(_SEEDS))
    z = float((means[0] - means[1]).mean() / error)
    yield at_most(f"{name}: the image is unbiased", abs(z), 4.0, "|z| of its mean, against the balance heuristic")
    ratio = errors[0].mean() / errors[1].mean()
    deviation = (errors[0] - ratio * errors[1]).std(ddof=1) / np.sqrt(len(_SEEDS)) / errors[1].mean()
    half = 2.36 * deviation  # Student's 95 % interval of 8 seeds
    what = f"the upper end of the error over that of balance, {ratio:.2f} ± {half:.2f},"
    advice = "No share is good on both scenes: learn it from the pilot"
    yield at_most(f"{name}: less error at equal samples", float(ratio + half), _RATIO, what, advice)


def _errors_and_means(rule: Rule | str, scene: str) -> Array:
    """Return the mean squared error and the mean of an image for each seed, ``(2, seeds)``."""
    view, reference = _view(scene)
    images = [call_object("Mine", lambda seed: _image(view, rule, seed), seed) for seed in _SEEDS]
    return np.array([[((image - reference) ** 2).mean() for image in images], [image.mean() for image in images]])


@cache
def _balance(scene: str) -> Array:
    """Return `_errors_and_means` of the balance heuristic."""
    return _errors_and_means("balance", scene)


@cache
def _view(name: str) -> tuple[Scene, Array]:
    """Return a scene of the exercise, 64 by 36 pixels whichever it is, and its reference."""
    if name == "teapot-area-light":  # below its lamp, whose edge has noise that no share can help
        scene = load_scene(name, resolution=(64, 64)).crop((0, 28, 64, 64))
    else:
        scene = load_scene(name, resolution=(64, 36))
    return scene, render(scene, "auto", 256, seed=1000, sampler="sobol").image


def _image(scene: Scene, rule: Rule | str, seed: int) -> Array:
    """Return an image with independent points, in which errors of equal samples are compared.

    Light samples of the sky are as in pbrt: compensated ones leave less to learn.
    """
    return render(scene, rule, _SPP, seed=seed, sampler="independent", compensation=0).image
