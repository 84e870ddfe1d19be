"""Scenes in which no light has two techniques: no share is learned, and all samples are final."""

import numpy as np
import pytest

import dmis
from dmis.fit.round import Fit
from dmis.testing.scenes import box_scene

POINT, SUN = dmis.PointLight((1, -1, 2), (3, 3, 3)), dmis.DistantLight((0, 0.3, 1), (1, 1, 1))


DELTAS = box_scene(dmis.matte(0.6), (POINT, SUN), resolution=(40, 32))
"""A matte floor under lights of a single direction each."""
SKY = dmis.EnvironmentLight(np.random.default_rng(1).random((4, 8, 3)))
MIRROR = box_scene(dmis.mirror(), (SKY,), resolution=(40, 32))
"""A mirror under a sky, which no surface samples."""


@pytest.mark.parametrize("scene", [DELTAS, MIRROR], ids=["deltas", "mirror"])
@pytest.mark.parametrize(
    ("rule", "same"),
    [
        ("thesis", "balance"),
        ("thesis:patch=8,reuse=yes", "balance"),
        ("thesis:combiner=power,sampler=sobol", "pbrt:sampler=sobol"),
        ("second-moment", "balance"),
        ("second-moment:combiner=optimal", "balance:combiner=optimal"),
        ("second-moment:combiner=maximum", "balance:combiner=maximum"),
    ],
)
def test_images_are_those_of_equal_shares(scene: dmis.Scene, rule: str, same: str) -> None:
    """The same bits and rays as `balance` with the settings of the rule; the maps say so, and the provenance, why."""
    stages = set()
    result = dmis.render(scene, rule, 9, seed=2, progress=lambda stage, done, total: stages.add(stage))
    other = dmis.render(scene, same, 9, seed=2)
    np.testing.assert_array_equal(result.image, other.image)
    np.testing.assert_array_equal(result.variance, other.variance)
    assert result.rays == other.rays and result.image.max() > 0
    assert (result.weight == 0.5).all() and (result.samples == 9).all()
    assert stages == {"final"} and result.maps == {} and result.provenance["pilot_rays"] == {}
    assert "no pilot" in result.provenance["nothing_to_mix"] and "nothing_to_mix" not in other.provenance
    shares = [render.provenance["settings"]["compensation"] for render in (result, other)]
    assert result.provenance["rule"] == rule and shares[0] == shares[1]


def test_rules_that_divide_camera_samples_have_a_first_round() -> None:
    """`auto` takes more samples where the image is noisy, whatever the lights."""
    result = dmis.render(DELTAS, "auto", 32, seed=1, sampler="sobol")
    assert np.ptp(result.samples) > 0 and (result.weight == 0.5).all()
    assert not result.provenance["pilot_rays"] and "nothing_to_mix" not in result.provenance
    # the default is to render the pilot; ``shares_only = True`` leaves it out
    result = dmis.render(DELTAS, Own(), 8)
    assert (result.weight == 0.25).all() and result.provenance["pilot_rays"]["camera"] > 0
    rule = Own()
    rule.shares_only = True
    result = dmis.render(DELTAS, rule, 8)
    assert (result.weight == 0.5).all() and result.provenance["pilot_rays"] == {}


class Own(dmis.Rule):
    """A rule of one's own, of which it is not known what it decides."""

    pilot = {0.5: 2}  # noqa: RUF012

    def fit(self, pilot):
        return Fit(0.25)


def test_one_light_with_two_techniques_is_enough() -> None:
    """A lamp beside the others brings the pilot back; one without power does not."""
    lamp, dark = (dmis.QuadLight((-0.5, -0.5, 2), (0, 1, 0), (1, 0, 0), (e, e, e)) for e in (3, 0))
    for light, learned in ((lamp, True), (dark, False)):
        scene = box_scene(dmis.matte(0.6), (POINT, light), resolution=(16, 12))
        assert scene.plan.mixable == learned
        result = dmis.render(scene, "thesis", 8, seed=1)
        assert ("nothing_to_mix" not in result.provenance) == learned == (result.maps != {})
        assert ("nothing to mix" in scene.describe()) != learned
