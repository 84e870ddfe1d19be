"""What people guess, and what to write: names of other libraries and renderers."""

from __future__ import annotations

from collections.abc import Iterable

from dmis.base.validate import did_you_mean

_EXPLAIN = "python examples/explained/why_is_this_pixel_noisy.py --help, in a checkout"
COMMAND_LINE = {
    "bench": "bench-rules for rules; python benchmarks/speed.py SCENE, in a checkout, for times beside those of Embree",
    "diff": "info A.exr B.exr, with -o MAP.png and --metric flip",
    "explain": _EXPLAIN,
    "oracle": "compare SCENE --oracle-spp 2048 -o DIR; in Python, print(dmis.make_oracle(scene).text())",
    "table": "figure DIR -o FILE, whose extension is .tex, .md or .csv",
    "list": "info --scenes, or info --rules",
    "scenes": "info --scenes",
    "rules": "info --rules",
    "show": "render SCENE -o OUT.png",
    "view": "render SCENE -o OUT.png",
    "heuristics": "info --rules; options of a rule name a heuristic, as in fixed:0.5,combiner=power",
    "flip": "info A.exr B.exr --metric flip",
    "tonemap": "render SCENE -o OUT.png --exposure X",
    "layers": "info IMAGE.exr, or render SCENE -o OUT.exr --layers albedo,normal",
    "crop": "render SCENE -o OUT.exr --crop x0,y0,x1,y1",
    "resume": "render SCENE -o OUT.exr --checkpoint DIR, twice",
    "reference": "compare SCENE -o DIR, which renders one and keeps it",
    "--time": "--seconds S",
    "--time-limit": "--seconds S",
    "--samples": "--spp N",
    "--size": "--resolution WxH",
    "--heuristic": "--rule fixed:0.5,combiner=power",
    "--combiner": "--rule fixed:0.5,combiner=power",
    "--mis": "--rule fixed:0.5,combiner=power; --rule fixed:1 is light samples alone",
    "--depth": "--max-depth N",
    "--jobs": "--threads N",
    "--resume": "--checkpoint DIR with render; compare resumes by itself, when the same command runs again",
    "--format": "-o FILE, whose extension tells the format",
    "--list-rules": "info --rules",
}
"""Commands and options that dmis does not have, and what to write."""
NAMES = {
    "BRDF": "dmis.Material, or a model such as dmis.ggx(...)",
    "BSDF": "dmis.Material, or a model such as dmis.ggx(...)",
    "Light": "dmis.QuadLight, DiskLight, SphereLight, MeshLight, EnvironmentLight or PointLight",
    "Renderer": "dmis.render(scene, rule, spp)",
    "HEURISTICS": "list(dmis.estimator.mis.COMBINERS)",
    "Sampler": 'dmis.render(scene, sampler="sobol"); dmis.register_sampler adds one',
    "balance_heuristic": 'dmis.render(scene, "balance")',
    "power_heuristic": 'dmis.render(scene, "fixed:0.5,combiner=power")',
    "explain": _EXPLAIN,
    "explain_pixel": _EXPLAIN,
    "flip": "dmis.experiment.metrics.flip(image, reference)",
    "heuristics": "list(dmis.estimator.mis.COMBINERS)",
    "list_rules": "list(dmis.fit.registry.RULES)",
    "list_scenes": "dmis.SHIPPED",
    "load": "dmis.load_scene(path), dmis.load_mesh(path) or dmis.load_image(path)",
    "load_exr": "dmis.read_exr(path)",
    "psnr": "dmis.mse(image, reference)",
    "rmse": "dmis.mse(image, reference) ** 0.5",
    "reference": "dmis.make_reference(scene, spp)",
    "render_reference": "dmis.make_reference(scene, spp)",
    "save_exr": "dmis.write_exr(path, image)",
    "save_image": "dmis.write_image(path, result)",
    "scenes": "dmis.SHIPPED",
    "tonemap": "dmis.image.tonemap(image)",
}
"""Attributes that ``dmis`` does not have, and what to write."""
KEYWORDS = {
    "samples": "spp=",
    "samples_per_pixel": "spp=",
    "resolution": "dmis.load_scene(name, resolution=(width, height))",
    "size": "dmis.load_scene(name, resolution=(width, height))",
    "heuristic": 'rule="fixed:0.5", combiner="power"',
    "heuristics": 'rules=["balance", "fixed:0.5,combiner=power"]',
    "time": "seconds=",
    "time_limit": "seconds=",
    "crop": "scene.crop((x0, y0, x1, y1))",
    "threads": "parallel=",
    "workers": "parallel=",
    "executor": "parallel=",
    "depth": "max_depth=",
}
"""Arguments of `render` and `compare` that they do not have, and what to write."""
PLUGINS = {
    **dict.fromkeys(("taylor", "inverse-variance", "neyman", "representativity", "kl", "tsallis"), "objectives"),
    "simplex": "simplex",
    "resampled": "resampled",
}
"""Rules and techniques that were part of dmis, and the plug-ins of examples/literature that register them."""


def advice(word: str, written: dict[str, str], names: Iterable[str]) -> str:
    """Return the end of a message about an unknown word: what to write in its place; empty if that is not known.

    Parameters
    ----------
    written
        `COMMAND_LINE` or `NAMES`.
    names
        Words that exist, the likeliest of which is named for others.
    """
    if word in written:
        return f": write {written[word]}"
    return did_you_mean(word, names, 0.7)
