"use strict";
// Error times time of a painted map, from the variance curves of the patches. Sums over patches follow each change,
// so that a stroke costs what it touches. Nothing here needs a page.
const MEASURES = ["relative", "absolute"];

const NOISE_SPP = 16; // camera samples per pixel whose noise the image shows

// Standard normal numbers, the same for each seed everywhere: mulberry32 (Ettinger 2017), Box and Muller 1958.
function normals(count, seed) {
  const uniform = () => {
    seed = (seed + 0x6d2b79f5) | 0;
    let t = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
  return Float32Array.from({ length: count }, () => Math.sqrt(-2 * Math.log(1 - uniform())) * Math.cos(2 * Math.PI * uniform()));
}

const linear = value => value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
const encoded = value => value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055;

const floats = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);

class Model {
  constructor(data) {
    const { patch, grid, most } = data, [height, width, rows, columns] = data.shape, count = rows * columns;
    Object.assign(this, { rows, columns, patch, width, height, grid, most, count });
    this.curves = {}; // variance by measure, and cost: (G, rows, columns)
    for (const name of [...MEASURES, "cost"]) this.curves[name] = floats(data.curves[name]);
    this.maps = {}; // by measure and name: w and n of the patches
    for (const measure of MEASURES) {
      this.maps[measure] = { balance: { w: new Float32Array(count).fill(0.5), n: new Float32Array(count).fill(1) } };
      for (const label of ["thesis", "oracle", "oracle + samples"]) {
        const [w, n] = data.maps[measure][label].map(floats);
        this.maps[measure][label] = { w, n };
      }
    }
    // share of the image's pixels in each patch: those at the border may be smaller
    this.area = Float64Array.from({ length: count }, (_, p) => {
      const row = Math.floor(p / columns), column = p % columns;
      const high = Math.min(patch, height - row * patch), wide = Math.min(patch, width - column * patch);
      return high * wide / (width * height);
    });
    this.load(this.maps.absolute.balance);
    this.base = { ...this.error, time: this.time };
  }

  // Shares of light samples and numbers of samples of all patches, as copies.
  load({ w, n }) {
    this.w = Float64Array.from(w);
    this.n = Float64Array.from(n);
    this.error = Object.fromEntries(MEASURES.map(measure => [measure, 0]));
    this.time = 0;
    for (let p = 0; p < this.count; p++) this.add(p, 1);
  }

  // Index of the grid point at or below w, and the place between it and the next one.
  between(w) {
    const { grid } = this;
    let k = grid.length - 2;
    while (k > 0 && grid[k] > w) k--;
    return [k, (w - grid[k]) / (grid[k + 1] - grid[k])];
  }

  // Variance in a measure, or cost, of a patch at w.
  at(name, p, w) {
    const [k, t] = this.between(w), curve = this.curves[name], low = curve[k * this.count + p];
    return low + t * (curve[(k + 1) * this.count + p] - low);
  }

  // Add the part of a patch to the sums, mean(V / n) by measure and mean(n C), or take it away.
  add(p, sign) {
    const w = this.w[p], n = this.n[p], share = sign * this.area[p];
    for (const measure of MEASURES) this.error[measure] += share * this.at(measure, p, w) / n;
    this.time += share * n * this.at("cost", p, w);
  }

  set(p, { w = this.w[p], n = this.n[p] }) {
    this.add(p, -1);
    this.w[p] = w;
    this.n[p] = n;
    this.add(p, 1);
  }

  // Error times time over that of balance.
  value(measure) { return this.error[measure] * this.time / (this.base[measure] * this.base.time); }

  // The model of another map, with the same curves.
  of(map) {
    const model = Object.create(this);
    model.load(map);
    return model;
  }

  // Change of the logarithm of the value by patch p at w, up to a constant: its parts of error and of time.
  part(measure, p, w) {
    return this.at(measure, p, w) / this.n[p] / this.error[measure] + this.n[p] * this.at("cost", p, w) / this.time;
  }

  // What the share of each patch does to the value, as a change of its logarithm from w = 1/2; below 0 it helps.
  changes(measure) {
    return this.area.map((area, p) => area * (this.part(measure, p, this.w[p]) - this.part(measure, p, 0.5)));
  }

  // Patches whose centres are at most `radius` patches from a line between two places, [x, y] in patches.
  stroke([x0, y0], [x1, y1], radius) {
    // the patch below the end itself, too: its centre may be farther
    const inside = [], reach = radius + 0.5, length = (x1 - x0) ** 2 + (y1 - y0) ** 2;
    const range = (a, b, most) => [Math.max(0, Math.floor(Math.min(a, b) - reach)),
      Math.min(most - 1, Math.floor(Math.max(a, b) + reach))];
    const [left, right] = range(x0, x1, this.columns), [top, bottom] = range(y0, y1, this.rows);
    for (let row = top; row <= bottom; row++)
      for (let column = left; column <= right; column++) {
        const [x, y] = [column + 0.5, row + 0.5];
        const along = length ? ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / length : 0;
        const t = Math.min(1, Math.max(0, along)), dx = x - x0 - t * (x1 - x0), dy = y - y0 - t * (y1 - y0);
        const below = Math.floor(x1) === column && Math.floor(y1) === row;
        if (below || dx * dx + dy * dy <= reach * reach) inside.push(row * this.columns + column);
      }
    return inside;
  }

  // Standard deviation of a pixel of a patch after NOISE_SPP samples, times the patch's number of them.
  deviation(p) {
    return Math.sqrt(Math.max(0, this.at("absolute", p, this.w[p])) / (NOISE_SPP * this.n[p]));
  }

  // Write the pixels of a patch, bytes in sRGB, from linear colours (0 to 1) and a standard normal number of each pixel.
  addNoise(p, bytes, colours, normal) {
    const top = Math.floor(p / this.columns) * this.patch, left = p % this.columns * this.patch, deviation = this.deviation(p);
    for (let y = top; y < Math.min(top + this.patch, this.height); y++)
      for (let x = left; x < Math.min(left + this.patch, this.width); x++) {
        const pixel = y * this.width + x, noise = deviation * normal[pixel];
        for (let k = 4 * pixel; k < 4 * pixel + 3; k++)
          bytes[k] = Math.round(255 * encoded(Math.min(1, Math.max(0, colours[k] + noise))));
      }
  }

  // The map as Python, for dmis.Given; without numbers of samples where they are even.
  python() {
    const text = values => {
      const lines = Array.from({ length: this.rows }, (_, row) => {
        const line = values.subarray(row * this.columns, (row + 1) * this.columns);
        return `    [${[...line].map(value => String(Number(value.toPrecision(4)))).join(", ")}],`;
      });
      return `pixels([\n${lines.join("\n")}\n])`;
    };
    const { patch, height, width } = this, even = this.n.every(n => n === this.n[0]);
    const repeat = `np.repeat(np.repeat(np.array(patches), ${patch}, 0), ${patch}, 1)[:${height}, :${width}]`;
    return `import dmis
import numpy as np


def pixels(patches):
    return ${repeat}


rule = dmis.Given(
weight=${text(this.w)},
${even ? "" : `samples=${text(this.n)},\n`})
# dmis.render(scene, rule, spp=128): scene of ${width}x${height} pixels
`;
  }
}
