"""What to write in place of names that dmis had, and of the few that users of other renderers write most."""

from __future__ import annotations

from collections.abc import Iterable

from dmis.base.validate import did_you_mean

_EXPLAIN = "python examples/explained/why_is_this_pixel_noisy.py --help, in a checkout"
COMMAND_LINE = {
    "bench": "bench-rules for rules; python benchmarks/speed.py SCENE, in a checkout, for times beside those of Embree",
    "diff": "info A.exr B.exr, with -o MAP.png and --metric flip",
    "explain": _EXPLAIN,
    **dict.fromkeys(("oracle", "--oracle-spp"), "print(dmis.make_oracle(scene).limit()), in Python"),
    "table": "figure DIR -o FILE, whose extension is .tex, .md or .csv",
    **dict.fromkeys(("help", "list", "list-rules", "rules", "scenes"), "info --rules, or info --scenes"),
    "view": "dmis.show({'A': dmis.load_image('A.exr')}).save('A.html'), in Python",
    "denoise": "render SCENE -o OUT.exr --layers albedo,normal, for a denoiser; dmis has none",
    "--material": "dmis.load_scene(file, material=dmis.matte(0.5)), in Python",
    "--render": "python benchmarks/mis_bench.py --validate --rules RULE, in a checkout",
    "--aov": "--layers NAME,NAME",
    "--gpu": "--threads N; dmis renders on CPUs alone",
    "--samples": "--spp N",
    **dict.fromkeys(("--size", "--width", "--height"), "--resolution WxH"),
    "--target-error": "--noise X",
    "--heuristic": "--rule fixed:0.5,combiner=power",
}
"""Commands and options that dmis does not have, and what to write."""
NAMES = {
    **dict.fromkeys(("BSDF", "register_material"), "dmis.Material, or a model such as dmis.ggx(...)"),
    "denoise": 'dmis.render(scene, layers=["albedo", "normal"]), for a denoiser; dmis has none',
    "explain": _EXPLAIN,
    "flip": "dmis.experiment.metrics.flip(image, reference)",
    "list_rules": "list(dmis.fit.registry.RULES)",
    "load": "dmis.load_scene(path), dmis.load_mesh(path) or dmis.load_image(path)",
    "pixels": "dmis.render(scene).image",
    "reference": "dmis.make_reference(scene)",
    **dict.fromkeys(("save", "save_image"), "dmis.write_image(path, result)"),
    **dict.fromkeys(("scenes", "list_scenes"), "dmis.SHIPPED"),
    "tonemap": "dmis.image.tonemap(image)",
}
"""Attributes that ``dmis`` and its objects do not have, and what to write."""
KEYWORDS = {
    "aovs": "layers=",
    "samples": "spp=",
    "resolution": "dmis.load_scene(name, resolution=(width, height))",
    "heuristic": 'rule="fixed:0.5", combiner="power"',
    "target_noise": "noise=",
    "time": "seconds=",
    "crop": "scene.crop((x0, y0, x1, y1))",
    "threads": "parallel=",
    "workers": "parallel=",
    "oracle": "print(dmis.make_oracle(scene).limit())",
    "weigh": 'rule="thesis:weigh=heuristic"',
    "xy": "dmis.samples(scene, [row * width + column])",
}
"""Arguments of `render`, `compare` and `samples` that they do not have, and what to write."""
COMBINERS = {
    "frozen": "a rule whose final round has tilt=(0.5, 0.5), which are weights of equal counts at any share",
}
"""Combiners that dmis does not have any more, and what to write."""
PLUGINS = {
    **dict.fromkeys(("taylor", "inverse-variance", "neyman", "representativity", "kl", "tsallis"), "objectives"),
    "simplex": "simplex",
    "resampled": "resampled",
    "thesis-by-pilot": "patch_size",
}
"""Rules and techniques that were part of dmis, and the plug-ins of examples/literature that register them."""


def advice(word: str, written: dict[str, str], names: Iterable[str]) -> str:
    """Return the end of a message about an unknown word: what to write, the likeliest of `names`, or nothing."""
    return f": write {written[word]}" if word in written else did_you_mean(word, names, 0.7)
