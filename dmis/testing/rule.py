"""Checks of a weight rule: its fit or rounds, also from degenerate pilots, and the mean of its renders."""

from __future__ import annotations

import warnings
from collections.abc import Generator
from dataclasses import replace

import numpy as np

from dmis.base.plugins import raised
from dmis.brdf.materials import matte, plastic
from dmis.estimator.settings import Settings
from dmis.fit.registry import make_rule
from dmis.fit.round import Budget, Pilot, Round
from dmis.fit.rule import Rule, next_round
from dmis.pipeline.job import Job, resolve
from dmis.pipeline.render import render_job
from dmis.pipeline.result import Result, costly_pilot
from dmis.scene.scene import Scene
from dmis.testing.outcome import Check, Fault, Outcome, run_checks
from dmis.testing.scenes import box_scene, compare_means
from dmis.testing.statistics import level, z_limit

SPP = 32
"""Least camera samples per pixel of each render, the pilot included."""


def check_rule(rule: Rule | str, name: str = "") -> list[Outcome]:
    """Check a weight rule by what `Rule`, `Fit` and `Round` promise.

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
        _render(rule, _scene())  # one outcome of a rule that is refused
        method = "fit" if type(make_rule(rule)).rounds is Rule.rounds else "rounds"
        sizes = [_scene(size) for size in ((16, 16), (21, 13), (1, 1))]  # whole patches, cut ones, a single pixel
        dark = [box_scene(matte(0.0)), box_scene(lights=()), box_scene(eye=(0, -3, 6), target=(0, 40, 0))]
        return [
            (f"{method} returns shares in [0, 1] of the shape of the image", lambda: _check_shares(rule, sizes)),
            (f"{method} copes with a pilot without variance", lambda: _check_shares(rule, dark)),
            (f"{method} depends on the pilot alone", lambda: _check_deterministic(rule, method)),
            ("renders agree with balance", lambda: _check_renders(rule, name)),
        ]

    return run_checks(name, "it is a rule that renders", prepare)


class _Recorded(Rule):
    """The rule of a job, with a list of the rounds that it yields."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self.yielded: list[Round] = []

    def rounds(self, budget: Budget) -> Generator[Round, Pilot, None]:
        """See `Rule.rounds`; the budget is that of the job, which depends on its rule."""
        rounds = self._job.rule.rounds(self._job.budget)
        film = None
        while (round_ := next_round(rounds, film)) is not None:
            self.yielded.append(round_)
            film = yield round_


def _spp(rule: Rule | str) -> int:
    """Return the camera samples per pixel of each render, so many that the rule learns."""
    spp, made = SPP, make_rule(rule)
    while spp < made.least_spp or spp <= made.pilot_samples(spp):
        spp *= 2
    return spp


def _render(rule: Rule | str, scene: Scene, seed: int = 0) -> tuple[Result, list[Round]]:
    """Render a scene by a rule; return its rounds, too, or raise a Fault with the message of one that is refused."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a scene without light
            job = resolve(scene, rule, _spp(rule), seed, Settings(integrator="direct"))
            recorded = _Recorded(job)
            return render_job(replace(job, rule=recorded), 1), recorded.yielded
    except ValueError as error:
        width, height = scene.camera.resolution
        raise Fault(f"image of {width}x{height} pixels: {raised(error)}") from error


def _scene(size: tuple[int, int] = (16, 16)) -> Scene:
    return box_scene(plastic(0.4, 0.4, 0.05), resolution=size)


def _check_shares(rule: Rule | str, scenes: list[Scene]) -> str:
    """Raise a Fault if the shares of a scene are refused."""
    shares = [_render(rule, scene)[0].weight for scene in scenes]
    return f"shares from {min(w.min() for w in shares):.3f} to {max(w.max() for w in shares):.3f}"


def _check_deterministic(rule: Rule | str, method: str) -> str:
    """Raise a Fault if two renders of the same seed differ."""
    first, second = (_render(rule, _scene(), 3)[0] for _ in range(2))
    for field, values in (("weight", "shares"), ("samples", "numbers of samples"), ("image", "rounds")):
        change = np.abs(getattr(first, field) - getattr(second, field)).max()
        if change:
            raise Fault(
                f"{method} returns other {values} from the same pilot ({field} differs by up to {change:.3g}): it must "
                f"depend on the pilot alone, not on a clock, a global random generator, or an earlier call"
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
    rules = [("balance", "balance"), (name, rule)]
    # few samples of many pixels, because the bias of adaptive ones is largest where the pilot is a large part
    means = compare_means(_scene((64, 64)), rules, z_limit(level(1)), _advice(rounds), _spp(rule))
    return "; ".join(filter(None, [means, costly_pilot(result.provenance)]))


def _advice(rounds: list[Round]) -> str:
    """Return the likely cause of a wrong mean of a rule that yields these rounds."""
    own = [name for name in rounds[-1].settings.techniques if name not in ("light", "brdf")]
    if own:
        return f"settings: dmis.check_technique tells whether technique {' or '.join(own)} is wrong"
    if rounds[-1].before is not None:
        return (
            "rounds: spp of the last Round depends on the samples that it is joined to (before), so that these weigh "
            "more where they were dark. Leave before out, and fix image_weight beforehand; or decide by other pixels"
        )
    return (
        "fit or rounds: what decides the samples of a pixel in the image must come from samples that are not in it, or "
        "from other pixels; and a round of the same sequence must begin where the one before ends (begin)"
    )
