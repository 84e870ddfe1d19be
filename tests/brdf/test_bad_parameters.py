"""Parameters of materials that are refused: each names the parameter, what is allowed and what was given."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

import dmis
from dmis.brdf.fresnel import Conductor, Dielectric
from dmis.brdf.texture import Image
from dmis.testing.scenes import FLOOR


def image(*texel: float) -> Image:
    """Two texels, the first of which is good."""
    return Image(np.array([[np.full(len(texel), 0.1), texel]]))


ONE = Image(np.ones((1, 1, 1)))
NOT_POSITIVE = (0, -0.1, np.inf, np.nan, 1e-39, 1e39, (0.1, 0.2), (1, 2, 3))
INDICES = (*NOT_POSITIVE, ONE)
BLACK_OUTSIDE = Image(np.full((2, 2, 1), 0.5), wrap="black")
LENGTHS = (*NOT_POSITIVE, image(0), image(-1), image(0.1, 0.2, 0.3), BLACK_OUTSIDE)
ALPHAS = (*LENGTHS, 1e-6)
COLOURS = (-0.1, 1.001, (255, 0, 0), (0.1, np.inf, 0), (0.1, 0.2), (1, 1, 1, 1), 1e39, image(200.0))
SHARES = (-0.1, 1.5, np.nan)
COUNTS = (0, 1.5, np.nan)
FRESNEL = (1.5, Dielectric(-1.5), Conductor((1, np.nan, 1), (0, 0, 0)), Conductor((1, 1, 1), (0, 0)))
BAD: list[tuple[Callable[..., Any], dict[str, tuple]]] = [
    (dmis.matte, {"kd": COLOURS, "sigma": (91, -1, np.nan, ONE)}),
    (dmis.plastic, {"kd": COLOURS, "ks": COLOURS, "roughness": LENGTHS, "eta": INDICES}),
    (dmis.metal, {"roughness": LENGTHS, "eta": ((1, 2), ONE, np.nan), "k": (ONE, (1, np.nan, 1), -1)}),
    (dmis.shiny_metal, {"ks": (*COLOURS, 2, ONE), "kr": COLOURS, "roughness": LENGTHS}),
    (dmis.substrate, {"kd": COLOURS, "ks": COLOURS, "u_roughness": LENGTHS, "v_roughness": LENGTHS}),
    (dmis.mirror, {"kr": COLOURS}),
    (dmis.glass, {"kr": COLOURS, "kt": COLOURS, "eta": INDICES}),
    (dmis.uber, {"kd": COLOURS, "ks": COLOURS, "kr": COLOURS, "kt": COLOURS}),
    (dmis.uber, {"opacity": (2, (0.5, -0.1, 1), ONE), "roughness": LENGTHS, "eta": INDICES}),
    (dmis.phong, {"kd": COLOURS, "ks": COLOURS, "exponent": LENGTHS}),
    (dmis.lafortune, {"exponent": LENGTHS, "c_n": (0, 1.2, np.nan, ONE), "c_t": (-1.1, 1.1, np.nan, ONE)}),
    (dmis.blinn_phong, {"kd": COLOURS, "ks": COLOURS, "exponent": LENGTHS}),
    (dmis.ward, {"kd": COLOURS, "ks": COLOURS, "alpha": ALPHAS, "alpha_v": ALPHAS}),
    (dmis.ashikhmin_shirley, {"kd": COLOURS, "ks": COLOURS, "n_u": LENGTHS, "n_v": LENGTHS}),
    (dmis.torrance_sparrow, {"kd": COLOURS, "ks": COLOURS, "exponent": LENGTHS, "fresnel": FRESNEL}),
    (dmis.cook_torrance, {"kd": COLOURS, "ks": COLOURS, "alpha": ALPHAS, "alpha_v": ALPHAS, "fresnel": FRESNEL}),
    (dmis.ggx, {"kd": COLOURS, "ks": COLOURS, "alpha": ALPHAS, "alpha_v": ALPHAS, "fresnel": FRESNEL}),
    (dmis.rough_glass, {"kr": COLOURS, "kt": COLOURS, "alpha": ALPHAS, "alpha_v": ALPHAS, "eta": (*INDICES, 1)}),
    (dmis.coated_diffuse, {"kd": COLOURS, "alpha": (1e-6, 11, np.nan, (0.1, 0.2), ONE), "bounces": COUNTS}),
    (dmis.coated_diffuse, {"eta": (0.9, 101, np.nan), "thickness": (-1, np.nan)}),
    (dmis.coated_conductor, {"eta": (0, np.nan), "k": (-1,), "coat_eta": (0.5, 4.1), "bounces": COUNTS}),
    (dmis.coated_conductor, {"alpha": (-1, 1.1), "coat_alpha": (1e-6, -1), "thickness": (-1, np.nan)}),
    (dmis.metallic_roughness, {"base": COLOURS, "metallic": SHARES, "roughness": SHARES, "opacity": SHARES}),
    (dmis.metallic_roughness, {"specular": SHARES, "eta": INDICES}),
    (partial(dmis.Part, FLOOR, dmis.ggx()), {"tangent": ((0, 0, 0), (np.nan, 1, 1), (0, 1))}),
    # whether or not there is a lobe that has it
    (partial(dmis.plastic, ks=0), {"eta": INDICES}),
    (partial(dmis.glass, kr=0, kt=0), {"eta": INDICES}),
    (partial(dmis.uber, ks=0), {"eta": INDICES}),
    (partial(dmis.uber, opacity=0), {"kd": (-1,)}),
    (partial(dmis.uber, opacity=(1, 1, 1)), {"kd": ((0.1, 0.2),)}),
]


@pytest.mark.parametrize("make, name, values", [(make, *item) for make, named in BAD for item in named.items()])
def test_a_parameter_out_of_range_is_named(make: Callable[..., Any], name: str, values: tuple) -> None:
    for value in values:
        with pytest.raises(ValueError, match=rf"{name.removeprefix('coat_')}( of fresnel)? must .*; got "):
            make(**{name: value})
