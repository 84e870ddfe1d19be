"""Freeze small images, share maps and sample maps before a refactoring, and compare them after it.

    python benchmarks/frozen.py write BEFORE.npz      renders every configuration, prints a hash, keeps the arrays
    python benchmarks/frozen.py compare BEFORE.npz    renders again and prints what differs; exit code 1 if anything

Both runs belong on one machine: other processors round differently, and by paths one shadow ray that is rounded to the
other side shifts all random numbers after it. `publish` keeps fingerprints instead, a few means of each render that
hold on all processors: a published table is old if renders of its rules and scenes have other fingerprints.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

import dmis
from dmis.base.synonyms import PLUGINS

RESOLUTION = (48, 40)
SPP = 32
SEED = 3
TOLERANCE = 5e-4
"""Relative difference of two numbers of a fingerprint that rounding may make; see `fingerprint`."""
SCENES = ("teapot-area-light", "killeroo-diffuse", "killeroo-gold", "tt", "cornell", "veach-mis", "ten-lights")
INTERIORS = ("interior", "interior-glasses", "interior-door")
FLAT = ("teapot-area-light flat", "killeroo-gold flat", "tt flat")
"""Scenes without their vertex normals: no shading normal of theirs leaves the triangle's."""
FEATURES = ("lens", "pixel filter", "mesh lamp", "mask", "spherical camera")
"""What the teapot's scene is given, one at a time, because no shipped scene has it."""


def configurations() -> dict[str, dict[str, Any]]:
    """Return the arguments of `dmis.render` by name; ``scene`` is a name that `load` takes.

    Points are independent where the name says nothing else, so that files from before another default stay comparable.
    Names that begin with "defaults" have the settings of `dmis.render` as it stands. No published piece depends on a
    name that begins with "defaults", "preset" or "paths".
    """
    table: dict[str, dict[str, Any]] = {}

    def add(scene: str, rule: str, **settings: Any) -> None:
        options = ",".join(f"{key}={value}" for key, value in settings.items())
        settings = {"sampler": "independent", **settings}
        table[f"{scene} {rule} {options}".strip()] = {"scene": scene, "rule": rule, "settings": settings}

    for scene in (*SCENES, *FLAT):
        for rule in ("balance", "thesis", "auto"):
            add(scene, rule, integrator="path" if scene == "cornell" else "direct")
    for scene in INTERIORS:
        for rule in ("balance", "auto"):
            add(scene, rule, integrator="direct")
    for scene in (*FLAT, "veach-mis", "ten-lights"):
        add(scene, "balance", integrator="path")
    for rule in ("pbrt", "one-sample", "uniform", "resampled", "fixed:0.25", "thesis:patch=8,filter=none"):
        add("killeroo-gold", rule, integrator="direct")
    for rule in ("second-moment", "second-moment:filter=gaussian", "neyman", "taylor", "representativity", "simplex"):
        add("tt", rule, integrator="direct")
    add("teapot-area-light", "fixed:light=0.5,brdf=0.3,uniform=0.2", integrator="direct")
    for sampler in ("sobol", "stratified"):
        add("tt", "balance", integrator="direct", sampler=sampler)
        add("teapot-area-light", "auto", integrator="direct", sampler=sampler)
        add("cornell", "second-moment", integrator="path", sampler=sampler)
    for combiner in ("maximum", "cutoff", "optimal"):
        add("killeroo-gold", f"fixed:0.4,combiner={combiner}", integrator="direct")
    add("tt", "balance", integrator="path", max_depth=3)
    add("tt", "balance", integrator="path", max_depth=None)
    add("killeroo-gold", "thesis", integrator="path", lights="one")
    add("teapot-area-light", "balance", integrator="direct", shading_samples=5)
    for scene in (*SCENES, "tt-overcast"):
        table[f"defaults {scene}"] = {"scene": scene, "rule": None, "settings": {}}
    for preset in ("thesis", "nearest"):
        for scene in SCENES[:4]:
            table[f"preset {preset} {scene}"] = {"scene": scene, "rule": None, "settings": {"preset": preset}}
    for scene, rule, sampler in (
        ("cornell", "auto", "sobol"),
        ("killeroo-diffuse", "auto", "sobol"),
        ("killeroo-diffuse", "thesis", "lowdiscrepancy"),
    ):
        settings = {"integrator": "path", "sampler": sampler}
        table[f"paths {scene} {rule} {sampler}"] = {"scene": scene, "rule": rule, "settings": settings}
    for feature in FEATURES:
        add(f"teapot-area-light with {feature}", "auto", integrator="direct", sampler="sobol")
    return table


def load(name: str) -> dmis.Scene:
    """Return a shipped scene, one of `FLAT`, or one with a feature of `FEATURES`."""
    shipped, _, feature = name.removesuffix(" flat").partition(" with ")
    scene = dmis.load_scene(shipped, resolution=RESOLUTION)
    if feature:
        return with_feature(scene, feature)
    if name not in FLAT:
        return scene
    flat = tuple(replace(part, mesh=replace(part.mesh, normals=None)) for part in scene.parts)
    return replace(scene, parts=flat)


def with_feature(scene: dmis.Scene, feature: str) -> dmis.Scene:
    """Return the teapot's scene with one of `FEATURES`."""
    camera, parts = scene.camera, scene.parts
    if feature == "lens":
        return replace(scene, camera=replace(camera, lens_radius=0.3, focal_distance=8.0))
    if feature == "pixel filter":
        return replace(scene, camera=replace(camera, filter=dmis.PixelFilter("gaussian", (2.0, 2.0), 0.6)))
    if feature == "spherical camera":
        return replace(scene, camera=replace(camera, projection="spherical"))
    if feature == "mesh lamp":
        ball = trimesh.creation.icosphere(subdivisions=1, radius=0.5)
        lamp = dmis.MeshLight(ball.vertices + (0.0, -2.0, 2.5), ball.faces, (6.0, 4.0, 2.0))
        return replace(scene, parts=(*parts, dmis.light_part(lamp)), lights=(*scene.lights, lamp))
    squares = dmis.Mask(dmis.Image((np.indices((8, 8)).sum(axis=0) % 2).astype(np.float32)[..., None]))
    index = next(i for i, part in enumerate(parts) if part.light is None)
    uv = parts[index].mesh.vertices[:, :2] / 4
    floor = replace(parts[index], mesh=replace(parts[index].mesh, uv=uv), mask=squares)
    return replace(scene, parts=(*parts[:index], floor, *parts[index + 1 :]))


def render(configuration: Mapping[str, Any], scenes: dict[str, dmis.Scene]) -> dict[str, np.ndarray]:
    """Render one configuration; the arrays that must not change, by name."""
    name = configuration["scene"]
    scene = scenes.setdefault(name, load(name))
    if configuration["rule"] in PLUGINS:
        dmis.load_plugin(PLUGINS[configuration["rule"]])
    result = dmis.render(scene, configuration["rule"], SPP, seed=SEED, parallel=2, **configuration["settings"])
    arrays = {"image": result.image, "deviation": result.deviation, "weight": result.weight, "samples": result.samples}
    return {**arrays, "rays": np.array(sorted(result.rays.items()), dtype="U32")}


def fingerprint(arrays: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Return the means of the arrays of a render, those with pixels weighted by their number, and the number of rays.

    NumPy without AVX rounds differently: all of 63 renders had other bits, but their numbers differ by at most 6.4e-5.
    With another seed at least one number of each render differs by 3.3e-3 or more.
    """
    numbers = {}
    for name in ("image", "deviation", "weight", "samples"):
        pixels = arrays[name].astype(np.float64).reshape(RESOLUTION[0] * RESOLUTION[1], -1).mean(axis=1)
        numbers[name] = float(pixels.mean())
        numbers[f"{name} by number"] = float(np.average(pixels, weights=np.arange(len(pixels))))
    return {**numbers, "rays": float(arrays["rays"][:, 1].astype(float).sum())}


def agree(before: Mapping[str, float], after: Mapping[str, float]) -> bool:
    """Return whether two fingerprints differ by rounding at most."""
    if before.keys() != after.keys():
        return False
    return all(np.isclose(before[name], after[name], rtol=TOLERANCE, atol=0, equal_nan=True) for name in before)


def digest(arrays: Mapping[str, np.ndarray]) -> str:
    """Return sixteen hexadecimal digits that depend on every bit of the arrays."""
    sha = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        sha.update(f"{name} {array.dtype.str} {array.shape}".encode() + array.tobytes())
    return sha.hexdigest()[:16]


def differences(before: Mapping[str, np.ndarray], after: Mapping[str, np.ndarray]) -> Iterator[str]:
    """Yield a line for each array of one configuration that is not bit-identical: how far off it is, in ulps."""
    for name in sorted(before):
        old, new = before[name], after[name]
        if old.shape != new.shape or old.dtype != new.dtype:
            yield f"{name}: {old.dtype}{old.shape} became {new.dtype}{new.shape}"
        elif old.tobytes() != new.tobytes():
            if old.dtype.kind != "f":
                yield f"{name}: {old.tolist()} became {new.tolist()}"
                continue
            ulps = np.abs(old.astype(np.float64) - new) / np.spacing(np.maximum(np.abs(old), np.abs(new)))
            count = int((~(ulps == 0)).sum())
            yield f"{name}: {count} of {old.size} entries differ, by at most {np.nanmax(ulps):g} ulp"


def main(arguments: list[str] | None = None) -> int:
    """Run the command line above; returns the exit code."""
    parser = argparse.ArgumentParser(description="Freeze small renders, or compare with frozen ones.")
    parser.add_argument("action", choices=("write", "compare"))
    parser.add_argument("file", type=Path, help="the .npz file of the frozen arrays")
    options = parser.parse_args(arguments)
    frozen = np.load(options.file) if options.action == "compare" else None
    scenes: dict[str, dmis.Scene] = {}
    arrays: dict[str, np.ndarray] = {}
    changed = 0
    for name, configuration in configurations().items():
        found = render(configuration, scenes)
        lines = []
        if frozen is not None:
            before = {key: frozen[f"{name}|{key}"] for key in found if f"{name}|{key}" in frozen}
            lines = list(differences(before, found)) if before else ["not in the file"]
        changed += bool(lines)
        print(digest(found), name, *(f"\n    {line}" for line in lines), flush=True)
        arrays.update({f"{name}|{key}": array for key, array in found.items()})
    if frozen is None:
        np.savez_compressed(options.file, **arrays)  # type: ignore[arg-type]
        return 0
    print(f"{changed} of {len(configurations())} configurations changed")
    return int(changed > 0)


if __name__ == "__main__":
    sys.exit(main())
