"use strict";
// Buttons that save what the page shows: tables as CSV, plots as SVG.

function save(name, type, text) {
  const link = document.createElement("a"), address = URL.createObjectURL(new Blob([text], { type }));
  Object.assign(link, { href: address, download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 1000);
}

// Cells as they are shown; numbers with the minus sign of ASCII, and nothing in place of a dash.
function csv(table) {
  const cell = ({ textContent: text }) => {
    text = text === "–" ? "" : text.replace(/^−/, "-");
    return /[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  return [...table.rows].map(row => [...row.cells].map(cell).join(",") + "\n").join("");
}

// A file of its own has neither the page's colours nor its fonts.
function svg(plot) {
  const copy = plot.cloneNode(true), { width, height } = plot.viewBox.baseVal;
  copy.setAttribute("width", width);
  copy.setAttribute("height", height);
  copy.setAttribute("style", "color: #23252b; background: #fff; font-family: sans-serif");
  return new XMLSerializer().serializeToString(copy);
}

function saveButton(label, element, place, action) {
  const button = document.createElement("button");
  Object.assign(button, { type: "button", className: "save", textContent: label, onclick: action });
  button.setAttribute("aria-label", `save ${element} as ${label}`);
  place.append(button);
}

for (const [k, plot] of document.querySelectorAll(".plots svg").entries()) {
  const name = plot.getAttribute("aria-label");
  saveButton("SVG", name, plot.parentElement, () => save(`plot-${k + 1}.svg`, "image/svg+xml", svg(plot)));
}
for (const table of document.querySelectorAll(".wide table")) {
  const scene = table.closest("section")?.querySelector("h2").textContent ?? "scenes", kind = table.className;
  const name = `${scene}-${kind}.csv`.replace(/[^\w.-]+/g, "_");
  saveButton("CSV", `the table ${kind} of ${scene}`, table.parentElement, () => save(name, "text/csv", csv(table)));
}
