"""Make the skies of `tt.pbrt` and `tt-overcast.pbrt`: light probes of a piazza, with the low sun and without it.

Writes `scenes/textures/sky.exr` and `scenes/textures/sky-overcast.exr`.

What: a latitude-longitude map, 1024 x 512 half floats, in the convention of pbrt-v2: the direction (x, y, z), z up, is
looked up at u = phi / (2 pi), phi = atan2(y, x) in [0, 2 pi), and v = acos(z) / pi, so that row 0 is the zenith.

How: a clear-sky gradient with a warm glow around the sun, two layers of fractal clouds, a ring of box-shaped houses
that are hit by a ray per texel and shaded by sun and sky, a paved ground, and a sun with a soft edge.

Why: it stands in for a photographed probe that cannot be passed on.  The sun is a disk of 2.5 degrees radius that gives
the floor about as much light as all the rest.  It is so small that a sampled reflection lobe rarely finds it, so a
matte floor wants light sampling; but the lobe of a glossy coat is far narrower than the sky, so where the coat mirrors
the sky it wants lobe sampling.  Neither technique is good everywhere, which is what the scene is for.  The second sky
is the first without the disk, all else equal, because the probe of the original scene has no sun in it.

Run: python scenes/make_sky.py        (deterministic, a few seconds, needs numpy and OpenEXR)
"""

from pathlib import Path

import numpy as np
import OpenEXR

FOLDER = Path(__file__).parent / "textures"
WIDTH, HEIGHT = 1024, 512

SUN_AZIMUTH, SUN_ELEVATION = 84.0, 29.0  # degrees
SUN_RADIUS, SUN_EDGE = 2.5, 0.6  # degrees: where the disk ends, and over how much it fades
GROUND_IRRADIANCE_SUN = 1.55  # what the disk gives a horizontal surface (green)
GROUND_IRRADIANCE_REST = 1.60  # what everything else above the horizon gives it
SUN_COLOUR = np.array([1.16, 1.00, 0.76])
EYE_HEIGHT = 1.2  # metres above the pavement from which the houses are seen


def smoothstep(x, low, high):
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def mix(a, b, t):
    return a + (b - a) * t[..., None]


def hash01(*integers):
    """A number in [0, 1) for every tuple of integers."""
    h = np.uint32(2166136261)
    for i in integers:
        h = (h ^ np.asarray(i).astype(np.int64).astype(np.uint32)) * np.uint32(16777619)
        h = (h ^ (h >> np.uint32(13))) * np.uint32(0x5BD1E995)
    h = h ^ (h >> np.uint32(15))
    return h.astype(float) / 2.0**32


def value_noise(p, seed):
    """Smooth noise in [0, 1): random values at the integer points of the plane, quintic interpolation."""
    cell = np.floor(p)
    t = p - cell
    t = t * t * t * (t * (6 * t - 15) + 10)
    total = 0
    for dx in (0, 1):
        for dy in (0, 1):
            weight = (t[..., 0] if dx else 1 - t[..., 0]) * (t[..., 1] if dy else 1 - t[..., 1])
            total = total + weight * hash01(cell[..., 0] + dx, cell[..., 1] + dy, seed)
    return total


def fractal_noise(p, seed, octaves=6):
    """Octaves of value noise, each turned and at half the amplitude; in [0, 1]."""
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    total, amplitude, norm = 0, 1.0, 0.0
    for octave in range(octaves):
        total = total + amplitude * value_noise(p, seed + octave)
        norm += amplitude
        amplitude *= 0.5
        p = 2.03 * (p @ turn) + 17.3
    return total / norm


def texel_directions():
    phi = (np.arange(WIDTH) + 0.5) / WIDTH * 2 * np.pi
    theta = (np.arange(HEIGHT) + 0.5) / HEIGHT * np.pi
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    solid_angle = np.sin(theta) * (2 * np.pi / WIDTH) * (np.pi / HEIGHT)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1), solid_angle


def sun_direction():
    a, e = np.radians([SUN_AZIMUTH, SUN_ELEVATION])
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def clear_sky(w, angle):
    """Deep blue above, pale and warm at the horizon, golden around the sun, a mauve belt opposite to it."""
    up = np.clip(w[..., 2], 0, 1)
    sky = mix(np.array([0.62, 0.66, 0.72]), np.array([0.13, 0.24, 0.47]), up**0.55)
    haze = np.exp(-up / 0.16)
    toward = 0.5 + 0.5 * np.cos(angle)
    sky = sky + haze[..., None] * mix(np.array([0.22, 0.10, 0.16]), np.array([1.05, 0.62, 0.24]), toward**2)
    glow = 1.6 * np.exp(-angle / 0.10) + 0.55 * np.exp(-angle / 0.35)
    return sky + glow[..., None] * np.array([1.0, 0.74, 0.42])


def add_clouds(sky, w, angle):
    """Small fair-weather clouds under a veil of streaks, both on flat layers so that they crowd at the horizon."""
    up = np.clip(w[..., 2], 0.03, 1)
    plane = w[..., :2] / (up + 0.12)[..., None]
    lit = 0.40 + 1.1 * np.exp(-angle / 0.45) + 0.35 * np.cos(angle / 2) ** 2
    fade = smoothstep(up, 0.04, 0.22)

    veil = smoothstep(fractal_noise(plane * np.array([0.9, 3.6]) + 5.0, 11), 0.45, 0.85) * 0.5 * fade
    sky = mix(sky, lit[..., None] * np.array([1.25, 1.08, 0.95]), veil)

    density = fractal_noise(plane * 1.7, 71) - 0.06 * np.abs(plane).max(-1)
    cover = smoothstep(density, 0.50, 0.66) * fade
    thick = smoothstep(density, 0.56, 0.82)
    edge_colour, core_colour = np.array([1.5, 1.22, 0.98]), np.array([0.62, 0.58, 0.66])
    return mix(sky, lit[..., None] * mix(edge_colour, core_colour, thick), 0.85 * cover)


def houses():
    """Boxes (x0, y0, x1, y1, height, colour number) around the piazza, with a tower in the ring."""
    random = np.random.default_rng(1387)
    boxes = []
    for side in range(4):
        at = -62.0
        while at < 62.0:
            wide, deep = random.uniform(11, 24), random.uniform(30, 46)
            high = random.uniform(8, 15) if random.random() > 0.12 else 3.0
            a, b = at, at + wide - (random.random() < 0.25) * 2.5
            boxes.append(
                [
                    (deep, a, deep + 14, b),
                    (a, deep, b, deep + 14),
                    (-deep - 14, a, -deep, b),
                    (a, -deep - 14, b, -deep),
                ][side]
                + (high, random.integers(5))
            )
            at += wide
    boxes.append((-58.0, -34.0, -51.0, -27.0, 34.0, 1))
    boxes.append((20.0, -70.0, 40.0, -52.0, 21.0, 3))
    return boxes


HOUSE_COLOURS = np.array(
    [[0.62, 0.47, 0.33], [0.70, 0.60, 0.46], [0.55, 0.36, 0.26], [0.66, 0.55, 0.50], [0.50, 0.45, 0.38]]
)


def facade(along, height, top, albedo, light, number):
    """Radiance of a wall: plaster, a cornice, a plinth, and rows of windows of which a few are lit from inside."""
    storey, bay = 3.6, 3.1
    colour = albedo * (0.9 + 0.2 * hash01(np.floor(along * 2), np.floor(height * 2), number))[..., None]
    colour = np.where((height < 0.9)[..., None], 0.6 * colour, colour)
    colour = np.where((height > top - 0.5)[..., None], 1.15 * colour, colour)
    row, column = np.floor((height - 0.9) / storey), np.floor(along / bay)
    u, v = along / bay - column, (height - 0.9) / storey - row
    window = (np.abs(u - 0.5) < 0.19) & (v > 0.22) & (v < 0.74) & (height < top - 0.9) & (row >= 0)
    frame = (np.abs(u - 0.5) < 0.24) & (v > 0.17) & (v < 0.79) & (height < top - 0.9) & (row >= 0)
    colour = np.where(frame[..., None], np.minimum(1.25 * colour, 0.8), colour)
    wall = colour * light / np.pi
    glow = hash01(row, column, number + 40)
    pane = np.where(
        (glow < 0.22)[..., None],
        np.array([1.9, 1.15, 0.45]) * (0.5 + 3 * glow[..., None]),
        np.array([0.06, 0.08, 0.11]),
    )
    return np.where(window[..., None], pane, wall)


def add_houses(image, w, sun, irradiance_sun, irradiance_sky):
    """Trace every texel from the middle of the piazza against the boxes; the nearest wall wins."""
    nearest = np.full(w.shape[:2], np.inf)
    flat = np.where(np.abs(w) < 1e-6, 1e-6, w)
    for number, (x0, y0, x1, y1, top, kind) in enumerate(houses()):
        tx = np.sort(np.stack([x0 / flat[..., 0], x1 / flat[..., 0]]), 0)
        ty = np.sort(np.stack([y0 / flat[..., 1], y1 / flat[..., 1]]), 0)
        enter, leave = np.maximum(tx[0], ty[0]), np.minimum(tx[1], ty[1])
        height = EYE_HEIGHT + enter * w[..., 2]
        hit = (enter > 0) & (enter < leave) & (height > 0) & (height < top) & (enter < nearest)
        if not hit.any():
            continue
        nearest[hit] = enter[hit]
        faces_x = (tx[0] > ty[0])[hit]
        d, t = w[hit], enter[hit]
        cos = np.maximum(np.where(faces_x, -np.sign(d[:, 0]) * sun[0], -np.sign(d[:, 1]) * sun[1]), 0)
        along = np.where(faces_x, t * d[:, 1] - y0, t * d[:, 0] - x0)
        light = irradiance_sun * cos[:, None] + 0.6 * irradiance_sky
        image[hit] = facade(along, height[hit], top, HOUSE_COLOURS[kind], light, number)
    return image


def write(name, image):
    FOLDER.mkdir(exist_ok=True)
    half = np.ascontiguousarray(image, dtype=np.float16)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": OpenEXR.Channel(half)}) as out:
        out.write(str(FOLDER / name))
    print(f"{FOLDER / name}: {WIDTH} x {HEIGHT}, {(FOLDER / name).stat().st_size / 1e6:.2f} MB")


def main():
    w, solid_angle = texel_directions()
    sun = sun_direction()
    angle = np.arccos(np.clip(w @ sun, -1, 1))
    above = w[..., 2] > 0
    horizontal = (np.maximum(w[..., 2], 0) * solid_angle)[..., None]

    sky = add_clouds(clear_sky(w, angle), w, angle)
    irradiance_sky = (sky * horizontal).sum((0, 1))
    sky *= GROUND_IRRADIANCE_REST / irradiance_sky[1]
    irradiance_sky *= GROUND_IRRADIANCE_REST / irradiance_sky[1]
    irradiance_sun = GROUND_IRRADIANCE_SUN * SUN_COLOUR / sun[2]  # on a surface that faces the sun

    paving = np.array([0.30, 0.27, 0.24]) * (irradiance_sun * sun[2] + irradiance_sky) / np.pi
    image = np.where(above[..., None], sky, paving)
    image = add_houses(image, w, sun, irradiance_sun, irradiance_sky)
    image *= GROUND_IRRADIANCE_REST / (image * horizontal).sum((0, 1))[1]

    degrees = np.degrees(angle)
    disk = 1 - smoothstep(degrees, SUN_RADIUS - SUN_EDGE, SUN_RADIUS + SUN_EDGE)
    disk_irradiance = (disk[..., None] * horizontal).sum((0, 1))
    sun_radiance = GROUND_IRRADIANCE_SUN * SUN_COLOUR / disk_irradiance
    write("sky-overcast.exr", image)
    image = image + disk[..., None] * sun_radiance
    write("sky.exr", image)

    rest = ((image - disk[..., None] * sun_radiance) * horizontal).sum((0, 1))
    total = (image * horizontal).sum((0, 1))
    print(
        f"sun radiance {sun_radiance.round(0)}, irradiance on the ground: sun {(total - rest).round(3)}, "
        f"rest {rest.round(3)}; radiance of a floor of albedo 0.7: {(0.7 * total / np.pi).round(3)}"
    )


if __name__ == "__main__":
    main()
