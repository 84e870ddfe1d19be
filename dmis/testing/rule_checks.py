"""Checks of a weight rule: its rounds, also from degenerate pilots, and the mean of its renders.

The renderer refuses shares and rounds that are wrong; here it renders images in which a rule may yield some.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator

from dmis.base.plugins import raised
from dmis.brdf.materials import matte, plastic
from dmis.fit.registry import make_rule
from dmis.fit.rule import Rule
from dmis.pipeline.render import render
from dmis.pipeline.result import Result, costly_pilot
from dmis.scene.scene import Scene
from dmis.testing.outcome import Check, Fault, Outcome, run_checks
from dmis.testing.scenes import box_scene, compare_means
from dmis.testing.statistics import level

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
    yield "renders agree with balance", lambda: _check_renders(rule, name)


def _spp(rule: Rule | str) -> int:
    """Return the camera samples per pixel of each render, so many that the rule learns."""
    made = make_rule(rule)
    spp = SPP
    while spp < made.least_spp or spp <= made.pilot_samples(spp):
        spp *= 2
    return spp


def _render(rule: Rule | str, scene: Scene) -> Result:
    """Render a scene by a rule."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a scene without light
        return render(scene, rule, _spp(rule), integrator="direct", parallel=1)


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


def _check_renders(rule: Rule | str, name: str) -> str:
    """Raise a Fault if the mean is not that of the balance heuristic; also say if a pilot makes most of the error."""
    advice = (
        "fit or rounds: what decides the samples of a pixel in the image must come from samples that are not in it, or "
        "from other pixels. Leave out before, or spp of the last Round depends on the samples that it is joined to; a "
        "round of the same sequence must begin where the one before ends (begin). settings: dmis.check_technique tells "
        "whether a technique of your own is wrong"
    )
    # few samples of many pixels, because the bias of adaptive ones is largest where the pilot is a large part
    rules = [("balance", "balance"), (name, rule)]
    means = compare_means(_scene((64, 64)), rules, level(1), advice, _spp(rule))
    return "; ".join(filter(None, [means, costly_pilot(_render(rule, _scene()).provenance)]))
