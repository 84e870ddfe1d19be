"""
All figures and a contact sheet
===============================

Makes the references that several figures share, runs every ``plot_*.py`` at the size asked for, and writes
``figures/index.html``, which shows all figures by section with their captions. What a script prints goes to
``<script>.txt`` beside its figure.
"""

import html
import subprocess
import sys
import time
from pathlib import Path

from common import SCENES, options
from PIL import Image

SECTIONS = {"thesis": "The thesis, figure by figure", "explained": "Explained", "measured": "Measured"}
"""Folders of scripts, in the order of the page, and their headings there."""

opts, given = options(
    __file__,
    __doc__,
    only={"nargs": "+", "default": [""], "help": "run only scripts with one of these in their names"},
)
folder = opts.output.parent
folder.mkdir(parents=True, exist_ok=True)
sections = {name: sorted((Path(__file__).resolve().parent / name).glob("plot_*.py")) for name in SECTIONS}
scripts = [
    script for section in sections.values() for script in section if any(part in script.stem for part in given.only)
]

# %%
# References are rendered once and kept; the scripts read them from disk.
begun = time.perf_counter()
for k, name in enumerate(SCENES, 1):
    begin = time.perf_counter()
    print(f"[{k}/{len(SCENES)}] reference of {name:20}", end=" ", flush=True)
    reference = opts.reference(opts.scene(name))
    print(f"{time.perf_counter() - begin:6.1f} s  2 x {reference.spp} spp", flush=True)

# %%
# One line for each script. One that fails does not keep the others from running.
arguments = [] if opts.size == "default" else [f"--{opts.size}"]
if opts.scene_dir is not None:
    arguments += ["--scene-dir", str(opts.scene_dir)]
if opts.threads is not None:
    arguments += ["--threads", str(opts.threads)]
failed = []
for k, script in enumerate(scripts, 1):
    begin = time.perf_counter()
    print(f"[{k:2}/{len(scripts)}] {script.stem:38}", end=" ", flush=True)
    picture = folder / f"{script.stem}.png"
    done = subprocess.run(
        [sys.executable, str(script), *arguments, "-o", str(picture)], capture_output=True, text=True, check=False
    )
    log = folder / f"{script.stem}.txt"
    log.write_text(done.stdout + done.stderr, "utf-8")
    if done.returncode:
        failed.append(script.stem)
    print(f"{time.perf_counter() - begin:6.1f} s  {f'FAILED, see {log}' if done.returncode else picture}", flush=True)

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
