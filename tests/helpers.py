"""What the tests share beside `dmis.testing`: the level of significance, pickling, renders of single tiles.

All seeds are fixed, so a test that passes once passes always; `LEVEL` says how likely a right implementation would
have been to fail at the first run. It is 1 % for all statistical tests of the suite together.
"""

from __future__ import annotations

import json
import linecache
import re
import runpy
import struct
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import scipy.stats

import dmis
from dmis.base.vectors import Array
from dmis.brdf.lobe import Directions
from dmis.brdf.materials import Material, plastic
from dmis.estimator.mis import COMBINERS, TECHNIQUES
from dmis.estimator.settings import Settings
from dmis.experiment.runs import Run
from dmis.fit.registry import RULES
from dmis.fit.round import Round
from dmis.fit.rule import merge_settings
from dmis.formats.load_scene import load_scene
from dmis.formats.shipped import SHIPPED
from dmis.intersect import Hits
from dmis.light.area import SphereLight
from dmis.pipeline.result import Result
from dmis.pipeline.tile import Tile, render_tile
from dmis.samplers.streams import SAMPLERS
from dmis.scene.scene import Scene
from dmis.testing.outcome import Outcome
from dmis.testing.scenes import box_scene, surface
from dmis.testing.sphere import sphere_rule

LEVEL = 1 - 0.99 ** (1 / 1000)
"""Šidák's level of each of (at most) 1000 statistical tests whose chance of any false alarm is 1 %."""
Z_LIMIT = float(scipy.stats.norm.isf(LEVEL / 2))
"""Two-sided limit of a normal deviate at `LEVEL`, 4.4."""


LITERATURE = Path(__file__).parents[1] / "examples" / "literature"
"""Folder of the plug-ins with rules of papers."""


def load_literature() -> SimpleNamespace:
    """Load the plug-ins of `LITERATURE`, and return their modules by name."""
    stems = [path.stem for path in LITERATURE.glob("*.py")]
    return SimpleNamespace(**{stem: dmis.load_plugin(stem) for stem in stems})


@contextmanager
def registries_kept() -> Iterator[None]:
    """Take back the rules, techniques, samplers and heuristics that are registered within, and forget `LITERATURE`."""
    tables = [(table, dict(table)) for table in (RULES, TECHNIQUES, SAMPLERS, COMBINERS)]
    loaded = set(sys.modules)
    try:
        yield
    finally:
        for path in LITERATURE.glob("*.py"):
            if path.stem not in loaded:
                sys.modules.pop(path.stem, None)
        for table, known in tables:
            table.clear()
            table.update(known)  # type: ignore[arg-type]


def with_fault(base: type, method: str, change: Callable[..., Any]) -> Any:
    """Return a class like `base` whose `method` returns what `change` makes of its result and its arguments."""
    original = getattr(base, method)
    return type("Mine", (base,), {method: lambda self, *args: change(original(self, *args), *args)})


def assert_found(outcomes: Sequence[Outcome], check: str, message: str) -> None:
    """Assert that a check with `check` in its name failed, with a message in which the pattern `message` is found."""
    failed = [outcome for outcome in outcomes if not outcome.passed]
    assert any(check in outcome.name and re.search(message, outcome.message) for outcome in failed), failed


def run_cell(code: str, name: str, namespace: dict[str, Any]) -> None:
    """Run Python code as a notebook runs a cell: its source is known by its name."""
    linecache.cache[name] = (len(code), None, code.splitlines(keepends=True), name)
    exec(compile(code, name, "exec", dont_inherit=True), namespace)


def script(path: str) -> SimpleNamespace:
    """Return the names of a script of the repository, such as ``benchmarks/count_lines.py``."""
    return SimpleNamespace(**runpy.run_path(str(Path(__file__).parents[1] / path)))


def fresh_python(code: str) -> str:
    """Return the output of a new Python process that runs `code`."""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


@cache
def shipped(name: str, resolution: tuple[int, int] | None = None) -> Scene:
    """Return a scene that comes with dmis, made once; None: at its own resolution, others share the triangles."""
    if resolution is None or resolution == (64, 64):
        return load_scene(name, resolution)
    scene = shipped(name, (64, 64))
    return scene.seen_by(replace(scene.camera, resolution=resolution))


def shared_scene(source: Any, resolution: tuple[int, int] | None = None, **options: Any) -> Scene:
    """Return what `dmis.load_scene` does; a scene that comes with dmis is made once, see `shipped`."""
    if source not in SHIPPED or options:
        return load_scene(source, resolution, **options)
    return shipped(source, resolution)


def grid_uniforms(side: int, dtype: type = np.float64, low: float = 0.03, high: float = 0.97) -> Array:
    """A regular grid in the unit square, away from its edges, ``(2, side**2)``."""
    line = np.linspace(low, high, side)
    return np.stack(np.meshgrid(line, line, indexing="ij")).reshape(2, -1).astype(dtype)


def mirror_hemisphere(wo: Array, rings: int = 500, sectors: int = 200) -> tuple[Array, Array]:
    """Quadrature over the upper hemisphere, dense about the mirror direction: ``(3, N)`` and weights ``(N,)``."""
    w, weights = sphere_rule(wo * [-1, -1, 1], rings, sectors, power=3.0)
    up = w[2] > 0
    return np.ascontiguousarray(w[:, up]), weights[up]


def reflected(material: Material, wo: Array, rings: int = 500, sectors: int = 200) -> float:
    """Share of the light from one direction that a material reflects, the largest of the channels."""
    w, weights = mirror_hemisphere(wo, rings, sectors)
    some = surface(material, wo, w.shape[1])
    return float((np.broadcast_to(some.eval(Directions(some, w)), w.shape).astype(float) @ (w[2] * weights)).max())


@contextmanager
def offline_tab(browser: Any, page: Path) -> Iterator[Any]:
    """Open a page in a tab that may not go anywhere; at the end there is no error, and nothing was asked for."""
    tab = browser.new_page(viewport={"width": 1000, "height": 800}, offline=True)
    troubles: list[str] = []
    tab.on("pageerror", lambda error: troubles.append(str(error)))
    tab.on("console", lambda message: troubles.append(message.text))
    tab.on("request", lambda request: troubles.append(request.url) if request.url.startswith("http") else None)
    tab.goto(page.as_uri())
    yield tab
    tab.close()
    assert troubles == []


def glb(document: Any, body: bytes = b"") -> bytes:
    """Return a GLB file of a description and a buffer, whose length is a multiple of 4."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if body:
        chunks += struct.pack("<I4s", len(body), b"BIN\0") + body
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def run(rule: str, spp: int, seed: int, seconds: float, mse: float, overhead: float = 0.0) -> Run:
    """Record of a render that was never made, of two CPU seconds for each second and a relMSE of a tenth of the MSE."""
    return Run(rule, spp, seed, 100 * spp, overhead, 0.0, seconds - overhead, mse, 0.1 * mse, mse, 2 * seconds)


def tga(*greys: int) -> bytes:
    """Return a TGA file of one row of grey pixels."""
    header = b"\0\0\2\0\0\0\0\0\0\0\0\0" + bytes([len(greys), 0, 1, 0, 24, 0])
    return header + bytes(np.repeat(np.uint8(greys), 3))


def triangle_ply(
    rows: Sequence[str] = ("0 0 0", "1 0 0", "0 1 0"),
    face: str | None = "3 0 1 2",
    names: Sequence[str] = "xyz",
    comment: str = "none",
) -> str:
    """Return a PLY file of three vertices, whose columns have names, and one face; None: no faces."""
    head = [
        "ply",
        "format ascii 1.0",
        f"comment {comment}",
        "element vertex 3",
        *(f"property float {n}" for n in names),
    ]
    faces = [] if face is None else ["element face 1", "property list uchar int vertex_indices"]
    return "\n".join([*head, *faces, "end_header", *rows, face or "", ""])


def pickled(value: Any) -> Any:
    """`value` after a trip through pickle."""
    import pickle

    return pickle.loads(pickle.dumps(value))


class Watched:
    """A caster that counts the rays of `closest` and their hits, and keeps the origins of occlusion queries."""

    def __init__(self, caster: Any) -> None:
        self._caster, self.rays, self.met, self.origins = caster, 0, 0, list[Array]()

    def closest(self, origin: Array, direction: Array) -> Hits:
        hits = self._caster.closest(origin, direction)
        self.rays += len(hits.prim)
        self.met += int((hits.prim >= 0).sum())
        return hits

    def occluded(self, origin: Array, direction: Array, distance: Array) -> np.ndarray:
        self.origins.append(origin.copy())
        return self._caster.occluded(origin, direction, distance)


def pixel_shares(w: Array | float) -> Array:
    """Shares of both techniques, ``(2, P)`` from `w` of the first, ``(P,)``; ``(2, 1)`` from a number."""
    first = np.atleast_1d(np.float32(w))
    return np.stack([first, 1 - first])


def image_tile(scene: Scene, seed: int, round_: Round, pass_: int = 0) -> Tile:
    """Return the tile of a round that is the whole image, with settings for the scene in place of ``auto``."""
    width, height = scene.camera.resolution
    settings = merge_settings(round_.settings, scene)[0]
    return Tile(seed, pass_, 0, (slice(0, height), slice(0, width)), replace(round_, settings=settings))


def tile_of(
    scene: Scene, seed: int = 0, spp: int = 16, w: float = 0.5, sampler: str = "independent", **settings: object
) -> tuple[Array, Counter[str]]:
    """Pixel means ``(H, W, 3)`` of one tile that is the whole image, and its rays."""
    round_ = Round(spp, pixel_shares(w), Settings(sampler=sampler, **settings))
    rendered = render_tile(scene, image_tile(scene, seed, round_))
    return rendered.mean, rendered.rays


def means(scene: Scene, seeds: range, spp: int = 8, **options: object) -> Array:
    """Mean radiance of the image for each seed, ``(seeds,)``."""
    return np.array([tile_of(scene, seed, spp, **options)[0].mean() for seed in seeds])


def mean_and_error(images: Any) -> tuple[float, float]:
    """Mean of renders of one image with different seeds, ``(seeds, ..., channels)``, and its standard error.

    Errors of pixels are uncorrelated, so two large images say as much as many small ones, and cost less: a render has
    a fixed cost.
    """
    pixels = np.mean(images, axis=-1, dtype=float)
    # Var(mean) = sum of Var(pixel) / (pixels^2 seeds)
    return float(pixels.mean()), float(np.sqrt(pixels.var(axis=0, ddof=1).mean() / pixels.size))


LAMP = SphereLight((0.0, 1.5, 3.0), 1.0, (5.0, 4.0, 3.0))


@cache
def lamp_images(rule: Any, first: int = 0, roughness: float = 0.1, **settings: Any) -> Array:
    """Two images of a glossy floor under `LAMP`, a large sphere."""
    scene = box_scene(plastic(0.3, 0.3, roughness), (LAMP,), resolution=(28, 28))
    seeds = (first, first + 1)
    return np.array([dmis.render(scene, rule, 32, seed=s, parallel=1, **settings).image for s in seeds])


def z_score(a: Array, b: Array | float) -> float:
    """Difference of the means of two independent samples, ``(N,)`` and ``(M,)``, over its standard error.

    `b` may be a number without error.
    """
    a = np.asarray(a, float)
    error2, other = a.var(ddof=1) / len(a), b
    if np.ndim(b):
        b = np.asarray(b, float)
        error2, other = error2 + b.var(ddof=1) / len(b), b.mean()
    return float((a.mean() - other) / np.sqrt(error2))


def images_z_score(a: Any, b: Any) -> float:
    """Difference of the means of renders ``(seeds, H, W, 3)`` by two ways, over its standard error."""
    (mean_a, error_a), (mean_b, error_b) = mean_and_error(a), mean_and_error(b)
    return (mean_a - mean_b) / float(np.hypot(error_a, error_b))


def channels_z(a: Result, b: Result) -> Array:
    """Return the differences of the channels' means of two renders, over their standard errors, ``(3,)``."""
    difference = a.image.mean(axis=(0, 1), dtype=float) - b.image.mean(axis=(0, 1), dtype=float)
    return difference / np.sqrt((a.variance + b.variance).mean(axis=(0, 1), dtype=float) / a.weight.size)


def results_z(a: Result, b: Result) -> float:
    """Return the difference of the means of two renders, over its standard error, channels taken as fully dependent."""
    variance = sum((np.sqrt(r.variance, dtype=float).mean(axis=2) ** 2).sum() for r in (a, b)) / a.weight.size**2
    return float((a.image.mean(dtype=float) - b.image.mean(dtype=float)) / np.sqrt(variance))
