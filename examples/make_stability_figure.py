"""
What float32 can and cannot do
==============================

Stiff scenes with known answers (stiff.py), each rendered twice with the same samples:
as always, in float32, and with the whole renderer in float64 (float64.py). What is left
of seven digits, for lights from a millionth to a million times the size of the scene
over lobes of roughness 1 to 1e-8; and how the error grows along the other axes of
stiffness.
"""

import numpy as np
from common import ROOT, options, print_canvas, write_webp
from stiff import KD, LIFT, ROUGHNESS, SIZES, ULP, both, chosen, rounding_errors

opts, given = options(__file__, __doc__, docs={"action": "store_true", "help": "also write the picture of docs/images"})
every = opts.pick(36, 1)
cases = chosen(every)
single, double = (found["family"] for found in both(opts.pick(4, 128), every))
errors = rounding_errors(single, double)

# %%
# Left: radius of the light against roughness. The map is whole only if no case was left
# out.
figure, axes = print_canvas(1, 2, 3.6)
left, right = axes[0]
grid = np.full((len(ROUGHNESS), len(SIZES)), np.nan)
for case, error in zip(cases, errors):
    if case.other is not None:
        at = np.abs(np.log10(ROUGHNESS) - np.log10(case.other)).argmin()
        grid[at, np.abs(np.log10(SIZES) - np.log10(case.value / 8)).argmin()] = -np.log10(error)
drawn = left.imshow(grid, origin="lower", cmap="viridis", vmin=3, vmax=7, aspect="auto")
left.set_xticks(range(0, len(SIZES), 3), [f"{size:g}" for size in SIZES[::3]])
left.set_yticks(range(len(ROUGHNESS)), [f"{roughness:g}" for roughness in ROUGHNESS])
left.set_xlabel("radius of the light (sizes of the scene)")
left.set_ylabel("roughness (1 / Blinn exponent)")
figure.colorbar(drawn, ax=left, label="correct digits of the mean", extend="min")

# %%
# Right: the axes along which digits are lost, and two along which none are.
AXES = {
    "grazing light": "tab:red",
    "light in contact, at right angles": "tab:orange",
    "light in contact, facing": "tab:brown",
    "grazing view, turned": "tab:purple",
    "slivers": "tab:blue",
    "radiance": "tab:green",
    "offset": "tab:olive",
}
for axis, colour in AXES.items():
    of = [k for k, case in enumerate(cases) if case.axis == axis]
    stiffness = [abs(np.log10(cases[k].value)) for k in of]
    order = np.argsort(stiffness)
    right.plot(np.array(stiffness)[order], errors[of][order], "o-", color=colour, label=axis)
right.axhline(ULP, color="black", linestyle=":", label="one rounding of float32")
right.axhline(1e-3, color="0.5", linestyle="--", label="three digits")
right.set_yscale("log")
right.set_ylim(ULP / 3, 3)
right.set_xlim(-0.3, 8.3)  # that of radiance goes on to 30, as flat as before
right.set_xlabel("stiffness (powers of ten)")
right.set_ylabel("relative error by rounding")
figure.legend(loc="outside lower center", ncols=3)
opts.save(
    figure,
    "What float32 can and cannot do",
    f"""Left: correct digits of the mean that the balance heuristic finds for a floor
    (albedo {KD}, with a glossy lobe) under a sphere; an ordinary scene has six or
    seven. Right: the error by rounding alone. Radiance and the distance from the origin
    may be what they like, because units are changed before anything is rounded. Lights
    that are nearer to a surface than the offset of rays ({LIFT:.1g} here), views that
    are as flat as the rounding of a direction, and triangles that are a million times
    as long as wide cost digits.""",
)
if given.docs and opts.size != "quick":
    write_webp(opts.output, ROOT / "docs" / "images" / "stability.webp")
