"""The scene of the tutorials: four metal plates that mirror four lamps, after Veach and Guibas (1995).

The plates go from smooth (far) to rough (near), the lamps from small to large. Each plate is tilted so that the
camera sees all lamps mirrored in it. The smaller a lamp and the rougher a plate, the better it is to aim at the lamp;
the larger a lamp and the smoother a plate, the better it is to follow the reflection.
"""

import numpy as np

import dmis
from dmis.formats.load_scene import light_part

EYE = np.array([0.0, -9.0, 3.0])
LAMPS = (0.05, 0.17, 0.45, 1.0)
"""Radii."""
ROUGHNESS = (0.0005, 0.002, 0.008, 0.03)
"""Of the plates, from far to near; Blinn's exponent is one over it."""


def plates(resolution: tuple[int, int] = (96, 72)) -> dmis.Scene:
    """The scene, `resolution` as (width, height)."""
    height = 3.2
    lamps = [
        dmis.SphereLight((x, 2.5, height), radius, (0.8 / radius**2,) * 3)  # all send out the same power
        for x, radius in zip((-3.6, -1.3, 1.2, 3.9), LAMPS, strict=True)
    ]
    parts = [dmis.Part(floor(), dmis.matte(0.35))]
    for y, z, roughness in zip((1.2, -0.4, -1.9, -3.2), (0.6, 0.25, 0.0, -0.2), ROUGHNESS, strict=True):
        parts.append(dmis.Part(plate(np.array([0, y, z]), np.array([0, 2.5, height])), dmis.metal(roughness=roughness)))
    parts += [light_part(lamp) for lamp in lamps]
    camera = dmis.Camera.look_at(tuple(EYE), (0.0, 0.0, 1.1), fov=39, resolution=resolution)
    return dmis.Scene(camera, tuple(parts), tuple(lamps), "plates")


def floor() -> dmis.Mesh:
    """A floor and a back wall, which bound what is seen."""
    x, front, back, low, high = 9.0, -6.0, 5.0, -0.9, 8.0
    vertices = [[-x, front, low], [x, front, low], [x, back, low], [-x, back, low], [-x, back, high], [x, back, high]]
    return dmis.Mesh(np.array(vertices), np.array([[0, 1, 2], [0, 2, 3], [3, 2, 5], [3, 5, 4]]))


def plate(centre: np.ndarray, lamp: np.ndarray) -> dmis.Mesh:
    """A plate through `centre` whose normal halves the angle between the eye and `lamp`."""
    to_eye, to_lamp = EYE - centre, lamp - centre
    normal = to_eye / np.linalg.norm(to_eye) + to_lamp / np.linalg.norm(to_lamp)
    across = np.array([4.2, 0, 0])
    along = np.cross(normal, across)
    along *= 0.6 / np.linalg.norm(along)
    corners = [centre - across - along, centre + across - along, centre + across + along, centre - across + along]
    return dmis.Mesh(np.array(corners), np.array([[0, 1, 2], [0, 2, 3]]))
