"""
All figures and a contact sheet
===============================

Runs every ``plot_*.py`` at the size asked for, and writes ``figures/index.html``, which shows all figures by section
with their captions. What a script prints goes to ``<script>.txt`` beside its figure. With ``--publish docs`` the
figures also go to the project: as WebP files to ``docs/figures``, where pages and the gallery take them from.
"""

import html
import itertools
import json
import resource
import subprocess
import sys
import time
from datetime import date
from pathlib import Path

from common import ROOT, options
from PIL import Image

SECTIONS = {"thesis": "The thesis, figure by figure", "explained": "Explained", "measured": "Measured"}
"""Folders of scripts, in the order of the page, and their headings there."""
LARGEST = 150_000
"""Bytes of a published figure."""

opts, given = options(
    __file__,
    __doc__,
    only={"nargs": "+", "default": [""], "help": "run only scripts with one of these in their paths"},
    publish={"type": Path, "help": "folder of the project's pages, docs, that get the figures too"},
)
if given.publish is not None and opts.size != "default":
    sys.exit(f"--publish takes figures of the default size; got --{opts.size}")
if given.publish is not None and opts.scene_dir is not None:
    sys.exit(
        "--publish takes figures of the scenes that come with dmis, because their captions name these (TT would be "
        f"env.pbrt); got the scene folder {opts.scene_dir}. Unset DMIS_PBRT_SCENES, and leave out --scene-dir."
    )
folder = opts.output.parent
folder.mkdir(parents=True, exist_ok=True)
here = Path(__file__).resolve().parent
sections = {name: sorted((here / name).glob("plot_*.py")) for name in SECTIONS}
scripts = [
    script
    for section in sections.values()
    for script in section
    if any(part in script.relative_to(here).as_posix() for part in given.only)
]


def publish(picture: Path, seconds: float) -> None:
    """Write a figure as WebP of at most `LARGEST` bytes; title, caption and panel go to ``captions.json`` beside it."""
    to = given.publish / "figures" / f"{picture.stem}.webp"
    to.parent.mkdir(parents=True, exist_ok=True)
    with Image.open(picture) as image:
        about, pixels = image.info, image.convert("RGB")
    for scale, quality in itertools.product((1, 0.75, 0.6, 0.5, 0.4), (90, 75, 60, 45, 30)):  # noise needs many bytes
        pixels.resize([round(side * scale) for side in pixels.size]).save(to, quality=quality, method=6)
        if to.stat().st_size <= LARGEST:
            break
    git = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip() or "unknown"
    made = f"{date.today()}, commit {commit}, {seconds:.0f} CPU seconds"
    table = to.with_name("captions.json")
    captions = json.loads(table.read_text("utf-8")) if table.exists() else {}
    captions[picture.stem] = {
        "title": about["Title"],
        "caption": about["Description"],
        "made": made,
        "panel": [float(side) for side in about["Panel"].split()],
    }
    table.write_text(json.dumps(captions, indent=1, ensure_ascii=False, sort_keys=True) + "\n", "utf-8")


# %%
# One line for each script. One that fails does not keep the others from running.
arguments = [] if opts.size == "default" else [f"--{opts.size}"]
if opts.scene_dir is not None:
    arguments += ["--scene-dir", str(opts.scene_dir)]
if opts.threads is not None:
    arguments += ["--threads", str(opts.threads)]
failed = []
begun = time.perf_counter()
for k, script in enumerate(scripts, 1):
    begin, cpu = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    print(f"[{k:2}/{len(scripts)}] {script.stem:38}", end=" ", flush=True)
    picture = folder / f"{script.stem}.png"
    done = subprocess.run(
        [sys.executable, str(script), *arguments, "-o", str(picture)], capture_output=True, text=True, check=False
    )
    log = folder / f"{script.stem}.txt"
    log.write_text(done.stdout + done.stderr, "utf-8")
    cpu = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - cpu
    if done.returncode:
        failed.append(script.stem)
    elif given.publish is not None:
        publish(picture, cpu)
    end = f"FAILED, see {log}" if done.returncode else picture
    print(f"{time.perf_counter() - begin:6.1f} s ({cpu:6.1f} s CPU)  {end}", flush=True)

# %%
# The contact sheet shows the pictures of this run and of earlier ones: titles and captions are in their metadata.
parts = []
for name, heading in SECTIONS.items():
    entries = []
    for picture in (folder / f"{script.stem}.png" for script in sections[name]):
        if not picture.exists():
            continue
        with Image.open(picture) as image:
            about = image.info
        title, caption = (html.escape(" ".join(about.get(key, "").split())) for key in ("Title", "Description"))
        entries.append(
            f'<figure id="{picture.stem}"><a href="{picture.name}"><img src="{picture.name}" alt="{title}"></a>'
            f"<figcaption><b>{title}</b> (<code>{name}/{picture.stem}.py</code>) {caption}</figcaption></figure>"
        )
    if entries:
        parts += [f"<h2>{heading}</h2><div>", *entries, "</div>"]
style = """body{font:15px/1.45 sans-serif;margin:2em;background:#f6f6f4;color:#222}
div{display:grid;grid-template-columns:repeat(auto-fill,minmax(34em,1fr));gap:2em}
figure{margin:0;padding:1em;background:#fff;border:1px solid #ddd}img{width:100%}"""
page = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>dmis: figures</title><style>{style}</style></head>
<body><h1>Figures</h1>
{chr(10).join(parts)}
</body></html>
"""
(folder / "index.html").write_text(page, "utf-8")
print(f"{time.perf_counter() - begun:.0f} s in all, {folder / 'index.html'}")
sys.exit(f"failed: {', '.join(failed)}" if failed else 0)
