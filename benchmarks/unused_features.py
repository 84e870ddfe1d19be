"""
What is not needed costs nothing
================================

Adds one unused feature at a time to a scene and measures the time to render it against that of the plain scene: CPU
seconds of one thread, both rendered in turn so that they meet the same machine, the median of the ratios of neighbours
with its standard error. The images must be the same to the last bit. `--quick` checks the images and measures little.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

import dmis
from dmis.brdf.diffuse import Lambert
from dmis.brdf.materials import Material, matte, metal, mirror, plastic
from dmis.brdf.models import ggx
from dmis.brdf.texture import Image
from dmis.estimator.allocation import shares_of
from dmis.fit.round import Round
from dmis.fit.rule import merge_settings
from dmis.geometry.shapes import quad, sphere
from dmis.geometry.transforms import translate
from dmis.light.area import QuadLight
from dmis.light.delta import PointLight
from dmis.light.environment import EnvironmentLight
from dmis.light.light import Light
from dmis.pipeline.tile import Tile, render_tile
from dmis.scene.camera import Camera
from dmis.scene.groups import Part
from dmis.scene.scene import Scene
from dmis.scene.suggestions import Suggestions

FEATURE_COST_LIMIT = 1.01
KD = (0.5, 0.25, 0.125)
LAMP = QuadLight((-0.5, -0.5, 2), (0, 1, 0), (1, 0, 0), (5, 4, 3))
CHECKS = Image(np.indices((8, 8)).sum(axis=0)[..., None] % 2 * np.float32(0.8))


def plain(size: tuple[int, int]) -> Scene:
    """A floor and a ball under a lamp, and a light of a single direction; behind the camera a square like the ball."""
    camera = Camera.look_at((0, -3, 2), (0, 0, 0.3), fov=40, resolution=size)
    ball = sphere(0.5, segments=48).transformed(translate((0, 0, 0.5)))
    gold = metal(roughness=0.05)
    square = quad((-0.2, -3.9, 0.7), (0.4, 0, 0), (0, 0, 0.3))
    parts = Part(quad((-4, -4, 0), (8, 0, 0), (0, 8, 0)), plastic(KD)), Part(ball, gold), Part(square, gold)
    return Scene(camera, parts, (LAMP, PointLight((2, -2, 2), (1, 1, 1))), "plain", Suggestions("direct", 5))


def behind(material: Material) -> Callable[[Scene], Scene]:
    """Changes the material of the square behind the camera, which itself takes Embree a hundredth of the time."""
    return lambda scene: replace(scene, parts=(*scene.parts[:-1], replace(scene.parts[-1], material=material)))


def light(more: Light) -> Callable[[Scene], Scene]:
    """Adds a light before the others."""
    return lambda scene: replace(scene, lights=(more, *scene.lights))


def floor(change: Callable[[Material], Material]) -> Callable[[Scene], Scene]:
    """Changes the material of the floor."""

    def changed(scene: Scene) -> Scene:
        first, *others = scene.parts
        return replace(scene, parts=(replace(first, material=change(first.material)), *others))

    return changed


FEATURES: dict[str, Callable[[Scene], Scene]] = {
    "nothing (the same scene)": lambda scene: replace(scene),
    "an image texture of one colour": floor(lambda m: plastic(Image(np.full((64, 64, 3), KD, np.float32)))),
    "a black lobe": floor(lambda m: replace(m, lobes=(*m.lobes, Lambert(0.0)))),
    "an area light without power": light(replace(LAMP, radiance=(0, 0, 0))),
    "a point light without power": light(PointLight((1, 1, 1), (0, 0, 0))),
    "an environment without radiance": light(EnvironmentLight(np.zeros((32, 64, 3)))),
    "another material out of sight": behind(matte((0.1, 0.2, 0.3), sigma=20)),
    "an image texture out of sight": behind(matte(CHECKS)),
    "an anisotropic lobe out of sight": behind(ggx(alpha=0.1, alpha_v=0.4)),
    "a mirror out of sight": behind(mirror()),
    "a black surface out of sight": behind(matte(0)),
}
"""What each adds to a scene."""


def tile_of(scene: Scene, spp: int) -> Tile:
    """The whole image as one tile."""
    settings = merge_settings(dmis.Settings(), scene)[0]
    width, height = scene.camera.resolution
    return Tile(1, 0, 0, (0, height), (0, width), Round(spp, shares_of(0.5)[:, None], settings))


def ratios(scene: Scene, other: Scene, spp: int, pairs: int) -> np.ndarray:
    """CPU time of `other` over that of `scene`, of `pairs` renders of both, in turn first and second."""
    seconds = np.empty((pairs, 2))
    for k in range(pairs):
        for n in (0, 1) if k % 2 else (1, 0):
            begin = time.process_time()
            one = (scene, other)[n]
            render_tile(one, tile_of(one, spp))
            seconds[k, n] = time.process_time() - begin
    return seconds[:, 1] / seconds[:, 0]


def main() -> int:
    """Print the table; 1 if a feature costs more than the limit for sure."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[4])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--pairs", type=int, help="renders of each (default 200)")
    given = parser.parse_args()
    size, spp, pairs = ((32, 24), 4, 4) if given.quick else ((64, 64), 8, 200)
    pairs = given.pairs or pairs
    scene = plain(size)
    image = render_tile(scene, tile_of(scene, spp)).mean
    print("| unused feature | time with / without | same bits |\n|---|---|---|")
    failed = False
    for name, add in FEATURES.items():
        other = add(scene)
        same = np.array_equal(render_tile(other, tile_of(other, spp)).mean, image)
        found = ratios(scene, other, spp, pairs)
        # of the median, from the spread of the middle half: one pair that is interrupted does not matter
        low, middle, high = np.quantile(found, [0.25, 0.5, 0.75])
        error = 1.2533 * (high - low) / 1.349 / np.sqrt(pairs)
        failed |= not same or (not given.quick and middle - 3 * error > FEATURE_COST_LIMIT)
        print(f"| {name} | {middle:.4f} ± {error:.4f} | {'yes' if same else 'NO'} |", flush=True)
    return int(failed)


if __name__ == "__main__":
    raise SystemExit(main())
