"""Checks of a weight rule: its rounds, also from degenerate pilots, and the mean of its renders.

The renderer refuses shares and rounds that are wrong; here it renders images in which a rule may yield some.
"""

from __future__ import annotations

import warnings
from collections.abc import Generator, Iterator
from dataclasses import replace

from dmis.base.plugins import raised
from dmis.brdf.materials import matte, plastic
from dmis.estimator.settings import Settings
from dmis.fit.registry import make_rule
from dmis.fit.round import Budget, Round
from dmis.fit.rule import Rule, next_round
from dmis.pipeline.job import resolve
from dmis.pipeline.render import render_job
from dmis.pipeline.result import Result, costly_pilot
from dmis.scene.scene import Scene
from dmis.testing.outcome import Check, Fault, Outcome, run_checks
from dmis.testing.scenes import box_scene, compare_means
from dmis.testing.statistics import level
from dmis.variance.moments import Film

SPP = 32
"""Least camera samples per pixel of each render, the pilot included."""


def check_rule(rule: Rule | str, name: str = "") -> list[Outcome]:
    """Return the outcomes of the checks of a weight rule, by what `Rule`, `Fit` and `Round` promise.

    It is an object, or the text of a registered one; its `name` in messages is that of the class or the text by
    default. A right rule fails any check with a probability of 1e-4.
    """
    name = name or (rule if isinstance(rule, str) else type(rule).__name__)
    return run_checks(name, _checks(rule, name))


def _checks(rule: Rule | str, name: str) -> Iterator[Check]:
    """Yield the checks of a rule."""
    _render(rule, _scene())  # one outcome of a rule that is refused
    images = {f"{width}x{height} pixels": _scene((width, height)) for width, height in ((21, 13), (1, 1))}
    images |= {"a black floor": box_scene(matte(0.0)), "no light": box_scene(lights=())}
    images |= {"nothing in view": box_scene(eye=(0, -3, 6), target=(0, 40, 0))}
    yield "renders any image", lambda: _check_images(rule, images)
    yield "depends on the pilot alone", lambda: _check_deterministic(rule)
    yield "renders agree with balance", lambda: _check_renders(rule, name)


def _spp(rule: Rule | str) -> int:
    """Return the camera samples per pixel of each render, so many that the rule learns."""
    spp, made = SPP, make_rule(rule)
    while spp < made.least_spp or spp <= made.pilot_samples(spp):
        spp *= 2
    return spp


def _render(rule: Rule | str, scene: Scene, seed: int = 0) -> tuple[Result, list[Round]]:
    """Render a scene by a rule; return the rounds that it yields, too."""
    rounds: list[Round] = []

    class Recorded(Rule):
        """The rule of the job; its budget depends on that rule, too."""

        def rounds(self, budget: Budget) -> Generator[Round, Film, None]:
            generator, film = job.rule.rounds(job.budget), None
            while (round_ := next_round(generator, film)) is not None:
                rounds.append(round_)
                film = yield round_

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a scene without light
        job = resolve(scene, rule, _spp(rule), seed, Settings(integrator="direct"))
        return render_job(replace(job, rule=Recorded()), 1), rounds


def _scene(size: tuple[int, int] = (16, 16)) -> Scene:
    return box_scene(plastic(0.4, 0.4, 0.05), resolution=size)


def _check_images(rule: Rule | str, images: dict[str, Scene]) -> str:
    """Raise a Fault if the renderer refuses what the rule yields for an image, such as a pilot without variance."""
    for image, scene in images.items():
        try:
            _render(rule, scene)
        except ValueError as error:
            raise Fault(f"an image of {image}: {raised(error)}") from error
    return f"images of {', '.join(images)}"


def _check_deterministic(rule: Rule | str) -> str:
    """Raise a Fault if two renders of the same seed differ."""
    first, second = (_render(rule, _scene(), 3)[0] for _ in range(2))
    if (first.image != second.image).any():
        raise Fault(
            "fit or rounds: two renders of one seed differ. A rule must depend on the pilot alone, not on a clock, a "
            "global random generator, or an earlier call"
        )
    return "two renders of one seed are equal"


def _check_renders(rule: Rule | str, name: str) -> str:
    """Raise a Fault if the mean is not that of the balance heuristic; also say if a pilot makes most of the error."""
    result, rounds = _render(rule, _scene())
    weights, others = ([r.image_weight for r in yielded] for yielded in (rounds, _render(rule, _scene(), 1)[1]))
    if weights != others:
        raise Fault(
            f"rounds: image_weight depends on samples, {weights} with one seed and {others} with another, which biases "
            f"the image; fix it beforehand, as budget.pilot and budget.final do"
        )
    advice = (
        "fit or rounds: what decides the samples of a pixel in the image must come from samples that are not in it, or "
        "from other pixels. Leave out before, or spp of the last Round depends on the samples that it is joined to; a "
        "round of the same sequence must begin where the one before ends (begin)"
    )
    own = [technique for technique in rounds[-1].settings.techniques if technique not in ("light", "brdf")]
    if own:
        advice = f"settings: dmis.check_technique tells whether technique {' or '.join(own)} is wrong"
    # few samples of many pixels, because the bias of adaptive ones is largest where the pilot is a large part
    rules = [("balance", "balance"), (name, rule)]
    means = compare_means(_scene((64, 64)), rules, level(1), advice, _spp(rule))
    return "; ".join(filter(None, [means, costly_pilot(result.provenance)]))
