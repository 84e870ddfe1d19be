"""
A model as glTF and as OBJ
==========================

One room with textures, a lamp, masked leaves and a camera, written to two kinds of
files. With matte materials the images agree; glTF also describes metals and rough
coats.
"""

import runpy
import tempfile
from pathlib import Path

import dmis
from dmis import plot
from dmis.examples.gallery import options, print_canvas
from dmis.formats.shipped import SCENE_FOLDER

opts, _ = options("plot_models", __doc__)
SPP, SIZE = opts.pick((2, (48, 36)), (256, (240, 180)), (1024, (640, 480)))
MORE = 4  # times the samples for metals: paths seldom find light that these focus
make = runpy.run_path(str(SCENE_FOLDER / "make_room.py"))

# %%
# An OBJ file has no camera: take the camera of the GLB file.
with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    make["write_glb"](folder / "room.glb", make["things"]())
    make["write_obj"](folder / "room.obj", make["things"]())
    make["write_glb"](folder / "room-metals.glb", make["things"](metals=True))
    room = dmis.load_scene(folder / "room.glb", SIZE)
    scenes = {
        "GLB, matte": room,
        "OBJ, matte": dmis.load_scene(folder / "room.obj", camera=room.camera),
        "GLB, metallic and rough": dmis.load_scene(folder / "room-metals.glb", SIZE),
    }

# %%
# Render all three scenes by path tracing, because walls reflect light, too.
figure, axes = print_canvas(1, 3, 2)
means = []
for axis, (title, scene) in zip(axes[0], scenes.items(), strict=True):
    spp = SPP * (MORE if "metal" in title else 1)
    image = dmis.render(scene, "auto", spp, seed=1, parallel=opts.threads).image
    means.append(f"{image.mean():.3f}")
    plot.picture(axis, image, title, exposure=2.2)

print(f"mean radiance: {', '.join(means)}")
opts.save(
    figure,
    "A model as glTF and as OBJ",
    f"""A room with textures, a lamp, leaves that a mask cuts out and a camera, written
    as GLB and as OBJ with MTL, by paths with {SPP} samples per pixel, the last with
    {MORE * SPP}. Mean radiance:
    {", ".join(means)}. Left and middle: matte materials, which both formats have.
    Right: a metal ball, a glossy pot and polished planks, which glTF has.""",
    panel=axes[0, 2],
)
