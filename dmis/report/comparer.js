"use strict";
// The image comparer: a Viewer for each element of the class "viewer". The data are in the element with the id "data".
const DATA = JSON.parse(document.getElementById("data").textContent);
const CROP = 32; // side of a crop, pixels of the image
const LENS = 85, SLACK = 3; // radius of the magnifier, and how far a pointer may move in a click: CSS pixels
const LAYOUTS = ["single", "split", "side by side"];

// Half floats: sign, five bits of exponent, ten of fraction.
const HALF = Float32Array.from({ length: 65536 }, (_, bits) => {
  const sign = bits >> 15 ? -1 : 1, exponent = (bits >> 10) & 31, fraction = bits & 1023;
  return sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : 2 ** -24 * fraction);
});
const PALETTE = DATA.palette.map(c => [1, 3, 5].map(k => parseInt(c.slice(k, k + 2), 16)));

// sRGB of linear values in [0, 1], in steps that are finer than a display's.
const SRGB = Uint8ClampedArray.from({ length: 4097 }, (_, k) => {
  const x = k / 4096;
  return 255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);
});

const clamp = (value, low, high) => Math.min(Math.max(high, low), Math.max(low, value));

// A PNG holds the high bytes of an image above the low bytes. A promise of linear RGB.
async function decode(uri, width, height) {
  const image = new Image();
  image.src = uri;
  await image.decode();
  const canvas = new OffscreenCanvas(width, 2 * height);
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  const bytes = context.getImageData(0, 0, width, 2 * height).data, half = 4 * width * height;
  const linear = new Float32Array(3 * width * height);
  for (let from = 0, to = 0; from < half; from += 4)
    for (let k = 0; k < 3; k++) linear[to++] = HALF[bytes[from + k] << 8 | bytes[from + k + half]];
  return linear;
}

class Viewer {
  constructor(element) {
    this.element = element;
    this.scene = DATA.scenes[element.dataset.scene];
    element.replaceChildren(document.getElementById("viewer").content.cloneNode(true));
    this.canvas = element.querySelector(".stage");
    this.slider = element.querySelector(".exposure");
    this.pictures = [];
    this.turns = 0;
    const { width, height, images, reference } = this.scene, last = images.length - 1;
    Object.assign(this, { shown: Math.min(1, last), left: 0, layout: "single", cut: 0.5, lens: false, pointer: null });
    Object.assign(this, { view: "image", zoom: 1, x: 0, y: 0, middle: [width >> 1, height >> 1] });
    this.sheet = new OffscreenCanvas(width, height);
    this.leftSheet = new OffscreenCanvas(width, height);
    images.forEach((image, k) =>
      this.button(".methods", image.label, () => this.set({ shown: k }), () => this.shown === k));
    for (const view of reference ? ["image", "error"] : [])
      this.button(".views", view, () => this.set({ view }), () => this.view === view);
    for (const layout of last > 0 ? LAYOUTS : [])
      this.button(".layouts", layout, () => this.set({ layout }), () => this.layout === layout);
    this.button(".zooms", "−", () => this.magnify(1 / 2));
    this.button(".zooms", "fit", () => this.set({ zoom: 1, x: 0, y: 0 }));
    this.button(".zooms", "+", () => this.magnify(2));
    this.button(".lenses", "magnifier", () => this.set({ lens: !this.lens }), () => this.lens);
    const select = element.querySelector(".left select");
    select.append(...images.map((image, k) => new Option(image.label, k)));
    select.addEventListener("change", () => this.set({ left: Number(select.value) }));
    this.crops = last > 0 ? images.map((image, k) => this.crop(image, k)) : [];
    this.slider.addEventListener("input", () => this.set({}));
    this.listen();
    new ResizeObserver(() => this.compose()).observe(this.canvas.parentElement);
    this.set({});
  }

  listen() {
    const { canvas, element } = this;
    canvas.addEventListener("pointerdown", event => this.press(event));
    canvas.addEventListener("pointermove", event => this.move(event));
    canvas.addEventListener("pointerup", event => this.release(event));
    canvas.addEventListener("pointercancel", () => { this.held = null; });
    canvas.addEventListener("pointerleave", () => { this.pointer = null; this.compose(); });
    canvas.addEventListener("wheel", event => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      this.magnify(2 ** (-Math.sign(event.deltaY) / 2), event);
    }, { passive: false });
    element.addEventListener("pointerdown", () => activate(this));
    element.addEventListener("focusin", () => activate(this));
  }

  button(place, textContent, onclick, pressed) {
    const button = document.createElement("button");
    Object.assign(button, { type: "button", textContent, onclick, pressed });
    this.element.querySelector(place).append(button);
  }

  // A small picture of the same place in every image; a click on it shows that image.
  crop(image, k) {
    const [figure, canvas, caption] = ["figure", "canvas", "figcaption"].map(tag => document.createElement(tag));
    canvas.width = canvas.height = Math.min(CROP, this.scene.width, this.scene.height);
    canvas.addEventListener("click", () => this.set({ shown: k }));
    figure.append(canvas, caption);
    this.element.querySelector(".crops").append(figure);
    return { canvas, caption, figure };
  }

  set(change) { Object.assign(this, change); this.ready = this.draw(); }

  flip(step) { const n = this.scene.images.length; this.set({ shown: (this.shown + step + n) % n }); }

  expose(step) { this.slider.value = Number(this.slider.value) + step; this.set({}); }

  turn() { this.set({ layout: LAYOUTS[(LAYOUTS.indexOf(this.layout) + 1) % 3] }); }

  // What is where on the canvas: a sheet and its image k, the picture's left edge (at) and width (size), and the part
  // of the canvas on which it is seen, all in shares of the canvas's width.
  get panes() {
    const left = { sheet: this.leftSheet, k: this.left }, right = { sheet: this.sheet, k: this.shown }, { cut } = this;
    switch (this.layout) {
      case "split":
        return [{ ...left, at: 0, size: 1, from: 0, to: cut }, { ...right, at: 0, size: 1, from: cut, to: 1 }];
      case "side by side":
        return [{ ...left, at: 0, size: 0.5, from: 0, to: 0.5 }, { ...right, at: 0.5, size: 0.5, from: 0.5, to: 1 }];
      default:
        return [{ ...right, at: 0, size: 1, from: 0, to: 1 }];
    }
  }

  // CSS pixels of the canvas for each pixel of the image.
  get unit() { return this.canvas.clientWidth * this.panes[0].size / this.scene.width * this.zoom; }

  // The pane below a place of the canvas, and the pixel of the image, not rounded.
  find({ offsetX, offsetY }) {
    const share = offsetX / this.canvas.clientWidth, { panes, unit } = this;
    const pane = panes.find(p => share < p.to) ?? panes.at(-1);
    return { pane, px: this.x + (offsetX - pane.at * this.canvas.clientWidth) / unit, py: this.y + offsetY / unit };
  }

  // Zoom about the pointer, or about the middle. x and y are the corner that is seen, in pixels of the image.
  magnify(factor, event) {
    const zoom = clamp(this.zoom * factor, 1, 32), { clientWidth, clientHeight } = this.canvas;
    const { at, size } = this.panes.at(-1);
    const { px, py } = this.find(event ?? { offsetX: (at + size / 2) * clientWidth, offsetY: clientHeight / 2 });
    const shrink = this.zoom / zoom;
    this.set({ zoom, x: px - (px - this.x) * shrink, y: py - (py - this.y) * shrink });
  }

  onDivider(event) {
    const reach = event.pointerType === "touch" ? 24 : 8;
    return this.layout === "split" && Math.abs(event.offsetX - this.cut * this.canvas.clientWidth) < reach;
  }

  press(event) {
    const drag = this.onDivider(event) ? "divider" : this.lens && event.pointerType === "touch" ? "lens" : "picture";
    this.held = { drag, at: [event.clientX, event.clientY], way: 0 };
    this.canvas.setPointerCapture(event.pointerId);
    if (drag === "picture") this.canvas.classList.add("held");
  }

  move(event) {
    this.pointer = event;
    const { held } = this;
    if (held) {
      const [dx, dy] = [event.clientX - held.at[0], event.clientY - held.at[1]];
      Object.assign(held, { at: [event.clientX, event.clientY], way: held.way + Math.hypot(dx, dy) });
      if (held.drag === "divider") this.cut = clamp(event.offsetX / this.canvas.clientWidth, 0, 1);
      else if (held.drag === "picture" && held.way > SLACK) { this.x -= dx / this.unit; this.y -= dy / this.unit; }
    }
    this.canvas.classList.toggle("divides", this.onDivider(event));
    this.compose();
    this.probe(event);
  }

  // Without a way between press and release that is a click: crops are taken there.
  release(event) {
    const { held } = this;
    this.held = null;
    this.canvas.classList.remove("held");
    if (held?.drag === "picture" && held.way <= SLACK) {
      const { px, py } = this.find(event);
      this.set({ middle: [Math.floor(px), Math.floor(py)] });
    }
  }

  // What is under the pointer, in numbers.
  probe(event) {
    const { width, height, images, reference } = this.scene, { pane, px, py } = this.find(event);
    const column = Math.floor(px), row = Math.floor(py), image = this.pictures[pane.k], truth = this.pictures[0];
    if (!image || !truth || column < 0 || row < 0 || column >= width || row >= height) return;
    const at = 3 * (row * width + column), rgb = [...image.slice(at, at + 3)].map(v => v.toPrecision(4)).join(", ");
    const error = reference ? ` · error ${this.error(image, truth, at).toPrecision(3)}` : "";
    this.element.querySelector(".probe").textContent =
      `${images[pane.k].label} · x ${column}, y ${row} · RGB ${rgb}${error}`;
  }

  // Root of the mean over channels of the squared error.
  error(image, truth, at) {
    const r = image[at] - truth[at], g = image[at + 1] - truth[at + 1], b = image[at + 2] - truth[at + 2];
    return Math.sqrt((r * r + g * g + b * b) / 3);
  }

  async picture(k) {
    const { images, width, height } = this.scene;
    return this.pictures[k] ??= await decode(images[k].png, width, height);
  }

  get exposure() { return Number(this.slider.value); }

  // A part of image k as it is to be seen, in sRGB or in the colours of errors.
  tone(k, left, top, width, height) {
    const out = new ImageData(width, height), gain = 2 ** this.exposure;
    const image = this.pictures[k], truth = this.pictures[0];
    for (let row = 0, to = 0; row < height; row++) {
      let from = 3 * ((top + row) * this.scene.width + left);
      for (let column = 0; column < width; column++, from += 3, to += 4) {
        if (this.view === "image") {
          for (let c = 0; c < 3; c++)
            out.data[to + c] = SRGB[Math.round(4096 * Math.min(1, Math.max(0, image[from + c] * gain)))];
        } else {
          const share = Math.min(1, this.error(image, truth, from) / this.scene.scale * gain);
          out.data.set(PALETTE[Math.floor(share * (PALETTE.length - 1))], to);
        }
        out.data[to + 3] = 255;
      }
    }
    return out;
  }

  // Decode what is needed, then fill sheets, crops, buttons and the canvas.
  async draw() {
    const turn = ++this.turns, { width, height, images } = this.scene;
    await Promise.all(this.crops.length ? images.map((_, k) => this.picture(k)) : [this.picture(0)]);
    if (turn !== this.turns) return;
    for (const { sheet, k } of this.panes) sheet.getContext("2d").putImageData(this.tone(k, 0, 0, width, height), 0, 0);
    this.drawCrops();
    const ev = this.exposure;
    this.element.querySelector("output").textContent = `${ev > 0 ? "+" : ""}${ev} EV`.replace("-", "−");
    this.element.querySelector(".left").hidden = this.layout === "single";
    for (const button of this.element.querySelectorAll("button"))
      if (button.pressed) button.setAttribute("aria-pressed", button.pressed());
    this.compose();
  }

  // Corner of the crops, which stay inside of the image.
  get corner() {
    const { width, height } = this.scene, side = Math.min(CROP, width, height);
    const [left, top] = this.middle.map(place => place - (side >> 1));
    return [clamp(left, 0, width - side), clamp(top, 0, height - side), side];
  }

  drawCrops() {
    const [left, top, side] = this.corner, { width, images, reference } = this.scene;
    this.crops.forEach(({ canvas, caption, figure }, k) => {
      canvas.getContext("2d").putImageData(this.tone(k, left, top, side, side), 0, 0);
      let sum = 0;
      for (let row = top; row < top + side; row++)
        for (let column = left; column < left + side; column++)
          sum += this.error(this.pictures[k], this.pictures[0], 3 * (row * width + column)) ** 2;
      const error = reference && k ? `: RMSE ${(Math.sqrt(sum) / side).toPrecision(2)}` : "";
      caption.textContent = images[k].label + error;
      figure.classList.toggle("shown", k === this.shown);
    });
  }

  // Put the sheets on the canvas, with the frame of the crops, the divider, names and the magnifier.
  compose() {
    const { canvas, zoom, panes, layout } = this, { width, height, images } = this.scene;
    const sharp = window.devicePixelRatio || 1;
    this.x = clamp(this.x, 0, width - width / zoom);
    this.y = clamp(this.y, 0, height - height / zoom);
    canvas.style.setProperty("--shape", width / height / panes[0].size);
    const wide = canvas.clientWidth, high = wide * panes[0].size * height / width, unit = this.unit;
    canvas.width = Math.round(wide * sharp);
    canvas.height = Math.round(high * sharp);
    const context = canvas.getContext("2d"), [left, top, side] = this.corner;
    context.scale(sharp, sharp);
    context.imageSmoothingEnabled = false;
    context.font = "12px system-ui, sans-serif";
    for (const { sheet, k, at, size, from, to } of panes) {
      context.save();
      context.beginPath();
      context.rect(from * wide, 0, (to - from) * wide, high);
      context.clip();
      context.drawImage(sheet, this.x, this.y, width / zoom, height / zoom, at * wide, 0, size * wide, high);
      if (this.crops.length) this.frame(context, at * wide + (left - this.x) * unit, (top - this.y) * unit, side * unit);
      if (layout !== "single") this.name(context, images[k].label, from === 0 ? 6 : from * wide + 6);
      context.restore();
    }
    if (layout !== "single") {
      context.fillStyle = "#fff";
      context.fillRect(panes[0].to * wide - 1, 0, 2, high);
    }
    if (layout === "split") {
      context.beginPath();
      context.arc(this.cut * wide, high / 2, 7, 0, 7);
      context.fill();
    }
    if (this.lens && this.pointer && this.held?.drag !== "divider") this.drawLens(context, wide);
  }

  frame(context, x, y, side) {
    context.lineWidth = 3; context.strokeStyle = "#0009"; context.strokeRect(x, y, side, side);
    context.lineWidth = 1; context.strokeStyle = "#fff"; context.strokeRect(x, y, side, side);
  }

  name(context, label, x) {
    context.fillStyle = "#000a";
    context.fillRect(x, 6, context.measureText(label).width + 10, 19);
    context.fillStyle = "#fff";
    context.fillText(label, x + 5, 20);
  }

  // Pixels around the pointer, larger than around it and at least eight CSS pixels each; in both of two panes.
  drawLens(context, wide) {
    const { pane, px, py } = this.find(this.pointer), scale = Math.max(8, 2.5 * this.unit), reach = LENS / scale;
    for (const { sheet, at } of this.layout === "split" ? [pane] : this.panes) {
      const [x, y] = [at * wide + this.pointer.offsetX - pane.at * wide, this.pointer.offsetY];
      context.save();
      context.beginPath();
      context.arc(x, y, LENS, 0, 7);
      context.fillStyle = "#101114";
      context.fill();
      context.clip();
      context.drawImage(sheet, px - reach, py - reach, 2 * reach, 2 * reach, x - LENS, y - LENS, 2 * LENS, 2 * LENS);
      context.lineWidth = 4; context.strokeStyle = "#fff"; context.stroke();
      context.restore();
    }
  }
}

let active = null;
function activate(viewer) {
  active?.element.classList.remove("active");
  active = viewer;
  viewer.element.classList.add("active");
}

const VIEWERS = [...document.querySelectorAll(".viewer")].map(element => new Viewer(element));
if (VIEWERS.length) activate(VIEWERS[0]);

// Keys go to the comparer that was used last, or to the first one that comes into the middle of the screen.
const watcher = new IntersectionObserver(entries => {
  for (const { isIntersecting, target } of entries)
    if (isIntersecting) activate(VIEWERS.find(viewer => viewer.element === target));
}, { rootMargin: "-45% 0px -45% 0px" });
for (const viewer of VIEWERS) watcher.observe(viewer.element);

document.addEventListener("keydown", event => {
  if (!active || event.ctrlKey || event.metaKey || event.altKey || event.target.matches("select")) return;
  const sliding = event.target.matches("input"), { scene } = active;
  const keys = {
    ArrowRight: () => active.flip(1), ArrowLeft: () => active.flip(-1),
    e: () => { if (scene.reference) active.set({ view: active.view === "image" ? "error" : "image" }); },
    s: () => { if (scene.images.length > 1) active.turn(); },
    m: () => active.set({ lens: !active.lens }),
    "+": () => active.magnify(2), "=": () => active.magnify(2), "-": () => active.magnify(1 / 2),
    "[": () => active.expose(-0.5), "]": () => active.expose(0.5),
  };
  if (sliding && event.key.startsWith("Arrow")) return;
  if (/^[0-9]$/.test(event.key) && Number(event.key) < scene.images.length) active.set({ shown: Number(event.key) });
  else if (keys[event.key]) { keys[event.key](); event.preventDefault(); }
});

// In a frame, as in a notebook, the frame is as high as its page.
if (window.frameElement) new ResizeObserver(() => {
  window.frameElement.style.height = `${document.documentElement.offsetHeight}px`;
}).observe(document.documentElement);
