"""Words of the command line, right and wrong; see `fuzz`."""

from __future__ import annotations

import random

from dmis.cli.arguments import COMMANDS
from dmis.fit.registry import RULES

AMOUNTS = ["", " ", "1" * 5000]
AMOUNTS += "0 1 2 3 4 5 16 -1 0.5 0.25 1e400 1e-400 1e9 99999999999999999999 nan inf -inf x".split()


def rule_text(rng: random.Random) -> str:
    """A rule with options, right or wrong."""
    name = rng.choice([*RULES, "none", ""])
    keys = ["patch", "spp", "filter", "size", "sigma", "reuse", "combiner", "sampler"]
    keys += ["guard", "gamma", "cost", "w", "techniques", "objective", "channels"]
    words = ["gaussian", "none", "joint", "yes", "no", "rgb", "balance", "power", "optimal", "sobol"]
    words += ["balance+power", "cutoff", "maximum", "stratified", "random"]
    options = []
    for _ in range(rng.randint(0, 3)):
        value = rng.choice(AMOUNTS) if rng.random() < 0.6 else rng.choice(words)
        options.append(value if rng.random() < 0.2 else f"{rng.choice(keys)}={value}")
    return f"{name}:{','.join(options)}" if options or rng.random() < 0.1 else name


OPTIONS = {
    name: {names.split()[0]: about for names, about in command.options.items() if names.startswith("-")}
    for name, command in COMMANDS.items()
}
SIZES = ["4x4", "1x1", "0x0", "-1x4", "99999x1", "65535x65535", "4", "x", "4x4x4", "²x²", "1" * 5000 + "x1", "4X3"]
FILES = ["no/such/a.exr", ".", "/", "/proc/x.exr", "/dev/full", "/dev/null", "out.exr", "out.EXR", "out.png"]
FILES += ["good/a.ply", "", "a\nb.exr", "\udcff.exr", "x" * 300 + ".exr", "scene.pbrt", "good/g.exr", "-"]


def arguments(rng: random.Random) -> list[str]:
    """Words for the command line."""
    command = rng.choice([*OPTIONS, "render", "render", "compare"])
    out = [command] if rng.random() < 0.97 else []
    scenes = ["scene.pbrt"] * 12 + ["good/a.ply", "case.pbrt", "nothing.pbrt", "no-such", "", "good/g.exr", "/dev/zero"]
    out += [rng.choice(scenes)] if rng.random() < 0.95 else []
    if command in ("render", "compare"):
        out += ["--spp", "2", "--resolution", "6x4"]
    if command in ("render", "compare") and rng.random() < 0.9:
        out += ["-o", "out.exr" if command == "render" else "out"]
    for _ in range(rng.randint(0, 4)):
        option = rng.choice(list(OPTIONS[command]))
        flag = OPTIONS[command][option].get("action") == "store_true"
        out += [option, *([] if flag or rng.random() < 0.02 else value(rng, option))]
    if command == "compare" and "--reference" not in out:
        out += ["--reference", "good/g.exr"]
    if rng.random() < 0.1:
        out.insert(rng.randrange(len(out) + 1), rng.choice(["--", "-", "--nothing", "--help=3", "\udcff", "''", "@x"]))
    return out


def value(rng: random.Random, option: str) -> list[str]:
    """The value of an option, mostly of its kind."""
    if option in ("--rule", "--rules"):
        return [",".join(rule_text(rng) for _ in range(1 + (option == "--rules")))]
    if option == "--resolution":
        return [rng.choice(SIZES)]
    if option in ("--checkpoint", "--stats", "--png", "-o", "--reference"):
        return [rng.choice(FILES)]
    if option in ("--workers", "--cluster"):
        return [rng.choice(["0", "-1", "x", "1.5", "99999999999999999999", "", "tcp://"])]
    words = {
        "--integrator": "direct path",
        "--lights": "all one",
        "--sampler": "sobol stratified",
        "--dialect": "v2 v4",
    }
    if option in words and rng.random() < 0.7:
        return [rng.choice(words[option].split())]
    return [rng.choice(AMOUNTS)]
