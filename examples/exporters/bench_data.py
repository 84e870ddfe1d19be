"""Write data for MIS-Bench from a renderer of one's own: here of a toy whose pixels are 1-D integrals.

Each pixel integrates f(x) over [0, 1]; light sampling has the density 2x, BRDF sampling 2(1 - x). Writes toy.npz with
the converged variances and toy-0.npz with the pilots of seed 0, in plain NumPy: docs/mis-bench.md describes the arrays.

    python examples/exporters/bench_data.py
    python -m dmis bench-rules thesis second-moment:filter=gaussian --scenes toy.npz

A file may also hold B blocks of a larger image: of one height, one below the other. Then `about` of the converged
variances is ``[H, W, B]``, and rules treat each block as an image. The array `weight` (R, C) holds the number of pixels
of the larger image that each patch represents. Patches of weight 0 are not judged, and their curves may be 0; filters
use their pilots and features as neighbours.
"""

import hashlib
import json

import numpy as np

H, W, rng, x = 8, 12, np.random.default_rng(1), (np.arange(1000) + 0.5) / 1000
GRID = np.array([0.002, 0.01, 0.03, 0.08, 0.16, 0.27, 0.38])
GRID = np.concatenate([GRID, [0.5], 1 - GRID[::-1]])


def f(x, pixel):
    return x * (1 + 20 * (1 - x) ** 4 * (pixel % W > 5))


def write(path, about, arrays):
    data = b"".join(k.encode() + arrays[k].tobytes() for k in sorted(arrays))
    digest = hashlib.sha256(data).hexdigest()
    header = json.dumps({"mis-bench": 2, "about": about, "checksum": digest})
    np.savez(path, header=np.array(header), **arrays)


def variance(w, shares, power=1):  # of the mean of 2 samples W_k f / (a_k p_k)
    p, value = np.stack([2 * x, 2 - 2 * x]), f(x, np.arange(H * W)[:, None])
    weights = (np.array([[w], [1 - w]]) * p) ** power
    total = np.zeros(H * W)
    for W_k, a, p_k in zip(weights / weights.sum(axis=0), shares, p):
        v = W_k * value / (a * p_k)
        total += a * ((p_k * v**2).mean(axis=1) - (p_k * v).mean(axis=1) ** 2) / 2
    relative = total / (value.mean(axis=1) ** 2 + 0.01)
    patches = np.stack([total, relative]).reshape(2, H // 4, 4, W // 4, 4)
    return patches.mean(axis=(2, 4)).astype(np.float32)


half = (0.5, 0.5)
shares, tilts = zip(*((variance(w, (w, 1 - w)), variance(w, half)) for w in GRID))
truth = {"variance": np.moveaxis(np.array([shares, tilts]), 2, 0)}
truth |= {"power": variance(0.5, half, 2)}
truth |= {"cost": np.ones((15, H // 4, W // 4), np.float32)}
write("toy.npz", [H, W], truth)

about, arrays = [], {}
for w, spp, s in ((0.0, 2, 2), (0.5, 6, 4), (1.0, 2, 2)):
    pixel, sample, k = np.indices((H * W, spp, s)).reshape(3, -1)
    technique = (k >= w * s).astype(int)
    u = rng.random(len(k))
    at = np.where(technique == 0, np.sqrt(u), 1 - np.sqrt(u))  # inverse of the CDF
    columns = {"pixel": pixel, "camera_sample": sample, "technique": technique}
    columns |= {"sample_index": k - technique * int(w * s), "light": 0 * k}
    floats = {"w": np.full(len(k), w), "cost": np.ones(len(k))}
    floats |= {"f": np.repeat(f(at, pixel)[:, None], 3, 1)}
    floats |= {"p_l": 2 * at, "p_b": 2 - 2 * at}
    columns |= {name: a.astype(np.float32) for name, a in floats.items()}
    arrays |= {f"{w} {name}": column for name, column in columns.items()}
    n = H * W * spp
    rays = {"camera": n, "shadow": n * s * w, "brdf": n * s * (1 - w)}
    about.append({"w": w, "shape": [H, W], "spp": spp, "shading_samples": s})
    about[-1]["rays"] = rays
write("toy-0.npz", about, arrays)
