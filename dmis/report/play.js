// The page: a brush on the image, and the numbers of the map. The numbers themselves are those of play_model.js.
const DATA = JSON.parse(document.getElementById("data").textContent);
const model = new Model(DATA);
const $ = id => document.getElementById(id);
const limit = (value, low, high) => Math.min(high, Math.max(low, value));
const NAMES = ["balance", "thesis", "oracle", "oracle + samples"];
const COLOURS = { painted: "#00a17a", balance: "#808080", thesis: "#d55e00", oracle: "#2b8cd6", "oracle + samples": "#8a6fd1" };
// What a brush paints: its slider, its colours at both ends, and how far a value is from even, -1 to 1.
const BRUSHES = {
  w: {
    label: "share w", min: model.grid[1], max: model.grid.at(-2), step: 0.01, start: 0.25, ends: ["0 BRDF", "1 light"],
    colours: [[178, 24, 43], [33, 102, 172]], text: w => w.toFixed(2), far: w => 2 * w - 1, value: x => x,
  },
  n: {
    label: "samples", min: -4, max: 4, step: 0.5, start: 1, ends: ["few samples", "many"],
    colours: [[140, 81, 10], [1, 102, 94]], text: n => `×${Number(n.toPrecision(2))}`,
    far: n => Math.log2(n) / Math.log2(model.most), value: x => 2 ** x,
  },
};
const MARKS = ["none", "thesis", "painted"];
const MARK_LABELS = { none: "no marks", thesis: "mark thesis", painted: "mark yours" };
const COPY = "copy for dmis.Given";
const state = { brush: "w", measure: "relative", marks: "none", hidden: false, x: 0, y: 0,
  values: { w: BRUSHES.w.start, n: BRUSHES.n.start }, strokes: 0, past: [], future: [], stroke: null, noise: true };
const stage = $("stage"), picture = new Image(), sheet = new OffscreenCanvas(model.columns, model.rows);
const marked = new OffscreenCanvas(1, 1);
// the image with noise, its pixels, their linear colours and their random numbers
const noisy = new OffscreenCanvas(model.width, model.height), grain = noisy.getContext("2d", { willReadFrequently: true });
const normal = normals(model.width * model.height, 1);
let bytes = null, colours = null;
const tints = sheet.getContext("2d"), pixels = tints.createImageData(model.columns, model.rows);
const models = {}; // of the maps that can be loaded, by measure and name
for (const measure of MEASURES)
  models[measure] = Object.fromEntries(NAMES.map(name => [name, model.of(model.maps[measure][name])]));
// the pointer starts at the patch with most of the error
const noise = [...model.area].map((area, p) => area * model.at(state.measure, p, 0.5)), noisiest = noise.indexOf(Math.max(...noise));
Object.assign(state, { x: noisiest % model.columns + 0.5, y: Math.floor(noisiest / model.columns) + 0.5 });

// Buttons ------------------------------------------------------------------------------------------------------------

function button(place, label, action, pressed) {
  const element = document.createElement("button");
  Object.assign(element, { type: "button", onclick: action, pressed });
  element.append(label);
  place.append(element);
  return element;
}

for (const [name, { label }] of Object.entries(BRUSHES))
  button($("brushes"), label, () => set({ brush: name }), () => state.brush === name);
for (const measure of MEASURES)
  button($("measures"), measure, () => set({ measure }), () => state.measure === measure);
for (const marks of MARKS) button($("marks"), MARK_LABELS[marks], () => set({ marks }), () => state.marks === marks);
button($("actions"), "fill", () => { begin(); paint([...model.w.keys()]); finish(); });
const undoButton = button($("actions"), "undo", undo), redoButton = button($("actions"), "redo", redo);
button($("marks"), "noise", () => set({ noise: !state.noise }), () => state.noise);
button($("marks"), "hide map", () => set({ hidden: !state.hidden }), () => state.hidden);
const copyButton = button($("copy"), COPY, copy);
button($("copy"), "save as map.py", save);

const rows = Object.fromEntries(["painted", ...NAMES].map(name => {
  const row = $("rows").insertRow(), dot = document.createElement("i");
  row.style.setProperty("--colour", COLOURS[name]);
  const cells = [0, 1, 2, 3].map(() => row.insertCell());
  dot.className = "dot";
  if (name === "painted") { cells[0].append(dot, "yours"); row.className = "yours"; }
  else button(cells[0], name, () => load(name)).prepend(dot);
  return [name, { cells, bar: cells[3].appendChild(document.createElement("i")) }];
}));

function set(change) {
  Object.assign(state, change);
  tint([...model.w.keys()]);
  show();
}

function load(name) {
  remember();
  model.load(model.maps[state.measure][name]);
  set({ strokes: 0 });
}

const snapshot = () => ({ w: model.w.slice(), n: model.n.slice(), strokes: state.strokes });

function remember() {
  state.past.push(snapshot());
  state.future = [];
  if (state.past.length > 100) state.past.shift();
}

// Go to the last map of one list, and leave the present one in the other.
function travel(from, to) {
  const map = from.pop();
  if (!map || state.stroke) return map && from.push(map);
  to.push(snapshot());
  model.load(map);
  set({ strokes: map.strokes });
}

function undo() { travel(state.past, state.future); }
function redo() { travel(state.future, state.past); }

// The old way of copying works for files, too, and where it fails the text is selected.
function copy() {
  $("code").hidden = false;
  $("code").value = model.python();
  $("code").select();
  copyButton.textContent = document.execCommand("copy") ? "copied" : "selected: press Ctrl+C";
  setTimeout(() => { copyButton.textContent = COPY; }, 2000);
}

function save() {
  const link = document.createElement("a"), file = new Blob([model.python()], { type: "text/x-python" });
  Object.assign(link, { href: URL.createObjectURL(file), download: "map.py" });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// Painting -----------------------------------------------------------------------------------------------------------

function begin() {
  remember();
  state.stroke = [state.x, state.y];
}

function paint(patches) {
  const value = BRUSHES[state.brush].value(state.values[state.brush]);
  for (const p of patches) model.set(p, { [state.brush]: value });
  tint(patches);
}

// Paint from the last place of the stroke to the pointer.
function go() {
  const { x, y, stroke } = state;
  if (!stroke) return;
  paint(model.stroke(stroke, [x, y], Number($("size").value)));
  state.stroke = [x, y];
}

function finish() {
  if (!state.stroke) return;
  state.stroke = null;
  state.strokes++;
  model.load(model); // sums anew, without the rounding of many changes
  set({});
}

function place(event) {
  const unit = stage.clientWidth / model.width * model.patch;
  state.x = limit(event.offsetX / unit, 0, model.columns - 0.01);
  state.y = limit(event.offsetY / unit, 0, model.rows - 0.01);
}

stage.addEventListener("pointerdown", event => {
  if (event.button || state.stroke) return;
  stage.setPointerCapture(event.pointerId);
  place(event);
  begin();
  go();
  show();
});
stage.addEventListener("pointermove", event => {
  if (!event.isPrimary) return;
  place(event);
  go();
  show();
});
for (const end of ["pointerup", "pointercancel"]) stage.addEventListener(end, finish);

stage.addEventListener("keydown", event => {
  const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
  if (step) {
    state.x = limit(Math.floor(state.x) + 0.5 + step[0], 0.5, model.columns - 0.5);
    state.y = limit(Math.floor(state.y) + 0.5 + step[1], 0.5, model.rows - 0.5);
  } else if (event.key !== " ") return;
  event.preventDefault();
  if (event.key === " " && !event.repeat) begin();
  go();
  show();
});
stage.addEventListener("keyup", event => { if (event.key === " ") finish(); });
stage.addEventListener("blur", finish);

document.addEventListener("keydown", event => {
  if (event.altKey || event.target.matches("textarea")) return;
  if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z") { event.preventDefault(); return event.shiftKey ? redo() : undo(); }
  if (event.ctrlKey || event.metaKey) return;
  const next = (names, name) => names[(names.indexOf(name) + 1) % names.length];
  const slide = (id, step) => { $(id).value = Number($(id).value) + step * $(id).step; $(id).dispatchEvent(new Event("input")); };
  ({
    "[": () => slide("value", -1), "]": () => slide("value", 1), "-": () => slide("size", -1),
    "+": () => slide("size", 1), "=": () => slide("size", 1), u: undo, y: redo,
    b: () => set({ brush: next(Object.keys(BRUSHES), state.brush) }),
    r: () => set({ measure: next(MEASURES, state.measure) }),
    m: () => set({ marks: next(MARKS, state.marks) }),
    n: () => set({ noise: !state.noise }),
    h: () => set({ hidden: !state.hidden }),
  })[event.key]?.();
});
$("value").addEventListener("input", () => { state.values[state.brush] = Number($("value").value); show(); });
$("size").addEventListener("input", show);

// What is seen -------------------------------------------------------------------------------------------------------

// Colours of a value of the brush: none where it is even, one towards each end.
function colour(brush, value) {
  const far = limit(brush.far(value), -1, 1), alpha = Math.abs(far) < 1e-6 ? 0 : 0.2 + 0.6 * Math.abs(far);
  return [...brush.colours[far < 0 ? 0 : 1], Math.round(255 * alpha)];
}

function tint(patches) {
  const brush = BRUSHES[state.brush], values = model[state.brush];
  for (const p of patches) pixels.data.set(colour(brush, values[p]), 4 * p);
  tints.putImageData(pixels, 0, 0);
  if (state.noise && bytes) {
    for (const p of patches) model.addNoise(p, bytes.data, colours, normal);
    grain.putImageData(bytes, 0, 0);
  }
  if (state.marks !== "none") mark();
}

function show() {
  const brush = BRUSHES[state.brush], { measure } = state, value = model.value(measure), slider = $("value");
  Object.assign(slider, { min: brush.min, max: brush.max, step: brush.step, value: state.values[state.brush] });
  $("quantity").textContent = state.brush;
  slider.setAttribute("aria-label", brush.label);
  $("shown").textContent = brush.text(brush.value(state.values[state.brush]));
  $("score").innerHTML = `<b>${value.toFixed(3)}</b> × balance`;
  const beaten = NAMES.filter(name => state.strokes && value < models[measure][name].value(measure) - 5e-5), { strokes } = state;
  $("strokes").textContent = `${measure} error × time · ${strokes} stroke${strokes === 1 ? "" : "s"}${beaten.length ? ` · beats ${beaten.join(", ")}` : ""}`;
  undoButton.disabled = !state.past.length;
  redoButton.disabled = !state.future.length;
  for (const element of document.querySelectorAll("button"))
    if (element.pressed) element.setAttribute("aria-pressed", element.pressed());
  for (const [name, { cells, bar }] of Object.entries(rows)) {
    const of = m => (name === "painted" ? model : models[m][name]).value(m);
    MEASURES.forEach((m, k) => {
      cells[k + 1].textContent = of(m).toFixed(3);
      cells[k + 1].classList.toggle("active", m === measure);
    });
    bar.style.width = `${limit(of(measure) / 1.5, 0, 1) * 100}%`;
  }
  for (const m of MEASURES) $(m).classList.toggle("active", m === measure);
  [$("low").textContent, $("high").textContent] = brush.ends;
  const [low, high] = brush.colours.map(c => c.join(" "));
  $("ramp").style.background = `linear-gradient(90deg, rgb(${low} / .8), rgb(${low} / .2) 48%, #0000 50%, rgb(${high} / .2) 52%, rgb(${high} / .8))`;
  compose();
  plot();
}

function compose() {
  const sharp = window.devicePixelRatio || 1, wide = stage.clientWidth, high = wide * model.height / model.width;
  const [w, h] = [Math.round(wide * sharp), Math.round(high * sharp)], unit = wide / model.width * model.patch;
  if (!w || !h) return; // the page is not laid out
  if (stage.width !== w || stage.height !== h) {
    for (const canvas of [stage, marked]) Object.assign(canvas, { width: w, height: h });
    mark();
  }
  const context = stage.getContext("2d");
  context.setTransform(sharp, 0, 0, sharp, 0, 0);
  context.imageSmoothingEnabled = false;
  if (picture.complete) context.drawImage(state.noise && bytes ? noisy : picture, 0, 0, wide, high);
  if (!state.hidden) context.drawImage(sheet, 0, 0, model.columns * unit, model.rows * unit);
  if (state.marks !== "none") context.drawImage(marked, 0, 0, wide, high);
  const reach = (Number($("size").value) + 0.5) * unit;
  context.beginPath();
  context.arc(state.x * unit, state.y * unit, reach, 0, 7);
  outline(context, 1.5);
}

function outline(context, width) {
  context.lineWidth = width + 2; context.strokeStyle = "#000a"; context.stroke();
  context.lineWidth = width; context.strokeStyle = "#fff"; context.stroke();
}

// Draw the marks: rings where the map's share lowers the number, crosses where it raises it, with areas in proportion,
// none below the mean. They are small pictures on a sheet of their own: thousands of them as one path take too long.
function mark() {
  const context = marked.getContext("2d"), unit = marked.width / model.width * model.patch;
  const ring = glyph(unit, (path, x, size) => path.arc(x, x, size, 0, 7));
  const cross = glyph(unit, (path, x, size) => {
    for (const turn of [-1, 1]) { path.moveTo(x - size, x - turn * size); path.lineTo(x + size, x + turn * size); }
  });
  const changes = (state.marks === "thesis" ? models[state.measure].thesis : model).changes(state.measure);
  const mean = changes.reduce((sum, change) => sum + Math.abs(change), 0) / model.count;
  context.clearRect(0, 0, marked.width, marked.height);
  changes.forEach((change, p) => {
    if (Math.abs(change) <= mean) return;
    const size = ring.width * Math.min(1, 0.4 * Math.sqrt(Math.abs(change) / mean));
    const [x, y] = [p % model.columns, Math.floor(p / model.columns)].map(place => (place + 0.5) * unit - size / 2);
    context.drawImage(change < 0 ? ring : cross, x, y, size, size);
  });
}

function glyph(unit, draw) {
  const picture = new OffscreenCanvas(Math.ceil(unit), Math.ceil(unit)), context = picture.getContext("2d");
  context.beginPath();
  draw(context, unit / 2, unit * 0.35);
  outline(context, Math.max(0.8, unit / 12));
  return picture;
}

// V(w) of the patch below the pointer over that at w = 1/2, on a logarithmic scale, and the maps on it.
function plot() {
  const p = Math.floor(state.y) * model.columns + Math.floor(state.x), { measure } = state, half = model.at(measure, p, 0.5);
  const [left, right, top, bottom] = [40, 425, 14, 210], steps = Array.from({ length: 101 }, (_, k) => k / 100);
  const x = w => left + w * (right - left);
  const of = w => half > 0 ? model.at(measure, p, w) / half : 1, part = w => model.part(measure, p, w) / (model.part(measure, p, 0.5) || 1);
  // powers of two from at least 1/4 to 4, so that no curve is cut
  const powers = steps.flatMap(w => [of(w), part(w)]).map(ratio => limit(Math.log2(ratio || 1e-9), -12, 20));
  const low = Math.min(-2, Math.floor(Math.min(...powers))), high = Math.max(2, Math.ceil(Math.max(...powers)));
  const y = ratio => top + (high - limit(Math.log2(ratio || 1e-9), low, high)) / (high - low) * (bottom - top);
  const line = of => steps.map((w, k) => `${k ? "L" : "M"}${x(w).toFixed(1)} ${y(of(w)).toFixed(1)}`).join("");
  const { row, column } = { row: Math.floor(state.y), column: Math.floor(state.x) };
  const every = Math.ceil((high - low) / 6), lines = [];
  for (let k = Math.ceil(low / every) * every; k <= high; k += every) lines.push(k);
  let drawing = lines.map(k => [k < 0 ? `1/${2 ** -k}` : 2 ** k, 2 ** k]).map(([text, ratio]) =>
    `<path d="M${left} ${y(ratio)}H${right}" stroke="var(--rule)"/><text x="${left - 6}" y="${y(ratio) + 4}" text-anchor="end">${text}</text>`).join("");
  drawing += [["0 BRDF", 0, "start"], ["w = ½", 0.5, "middle"], ["1 light", 1, "end"]].map(([text, w, anchor]) =>
    `<text x="${x(w)}" y="${bottom + 20}" text-anchor="${anchor}">${text}</text>`).join("");
  drawing += `<path d="${line(part)}" fill="none" stroke="var(--soft)" stroke-width="1.5" stroke-dasharray="5 4"/>`;
  drawing += `<path d="${line(of)}" fill="none" stroke="var(--ink)" stroke-width="2.2"/>`;
  const dots = ["balance", "thesis", "oracle"].map(name => [name, model.maps[measure][name].w[p]]);
  // one shape for each map, the painted one below: disc, square, triangle, diamond
  const shapes = { balance: "M-6-6H6V6H-6Z", thesis: "M0-8L8 6H-8Z", oracle: "M0-9L9 0L0 9L-9 0Z", painted: "M-9 0A9 9 0 1 0 9 0A9 9 0 1 0-9 0Z" };
  [["painted", model.w[p]], ...dots].forEach(([name, w], k) => {
    const shape = at => `<path transform="translate(${at})" d="${shapes[name]}" fill="${COLOURS[name]}" stroke="var(--card)" stroke-width="1.5"/>`;
    drawing += shape(`${x(w)} ${y(of(w))}`) + shape(`${left + 14 + k * 98} ${bottom + 34}`);
    drawing += `<text x="${left + 28 + k * 98}" y="${bottom + 38}">${name === "painted" ? "yours" : name}</text>`;
  });
  $("plot").innerHTML = drawing;
  $("caption").textContent = `Variance over that at w = ½ in the patch at x ${column * model.patch}, y ${row * model.patch}. Here w = ${model.w[p].toFixed(2)}, samples ×${Number(model.n[p].toPrecision(2))}; dashed: with time, what counts in the number.`;
}

stage.style.setProperty("--shape", model.width / model.height);
picture.onload = () => {
  grain.drawImage(picture, 0, 0);
  bytes = grain.getImageData(0, 0, model.width, model.height);
  colours = Float32Array.from(bytes.data, value => linear(value / 255));
  set({});
};
picture.src = DATA.image;
new ResizeObserver(compose).observe(stage);
set({});
