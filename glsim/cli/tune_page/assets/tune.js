// The middle and the right of the page: images, 3D, profile and figures of the shown picture.

import { chart, element, Figures, text } from "./figures.js";
import { endsOf, LayerImage } from "./images.js";
import { DEPTH, DISPARITY, GREY, gradient, SIGNED } from "./maps.js";
import { unpack, valueAt } from "./packet.js";
import { Surface } from "./surface.js";

// The tiles in their order: layer -> [title, colours, unit]; a picture shows those of its layers.
const KINDS = {
  clean: ["clean", DEPTH, "mm"],
  noisy: ["noisy", DEPTH, "mm"],
  disparity: ["disparity", DISPARITY, "px"],
  difference: ["noisy − clean", SIGNED, "mm"],
  reason: ["reason"],
  infrared: ["infrared", GREY, ""],
  infrared_right: ["infrared, right", GREY, ""],
};
const state = { picture: null, other: null, split: 0.5, view: null, cursor: null, line: null, differenceMm: 10 };
// Pause after a request that failed, as while the server restarts.
const RETRY_MS = 1000;
const shows = (picture, kind) => kind === "difference" || kind in picture.layers;
const images = {},
  others = {},
  keys = {};
let surface,
  figures,
  root,
  readoutLine,
  profile,
  reasonNames = [];

function build(view, panel, reasons) {
  history.replaceState(null, "", "/"); // a link is opened once: later changes outlive a reload
  root = view;
  reasonNames = reasons.map(([, help]) => help);
  const tiles = element(root, "div", "tiles");
  for (const [kind, [title, colours]] of Object.entries(KINDS)) {
    const [canvas, caption] = addTile(tiles, kind, title);
    if (colours) {
      const key = element(caption, "span", "key");
      keys[kind] = [element(key, "span"), element(key, "i"), element(key, "span")];
      keys[kind][1].style.background = gradient(colours);
    }
    canvas.setAttribute("aria-label", `${title}: arrow keys move the cursor`);
    images[kind] = new LayerImage(canvas, kind);
    others[kind] = new LayerImage(canvas, kind);
    listen(canvas);
  }
  const [canvas, caption] = addTile(tiles, "surface", "surface");
  canvas.setAttribute("aria-label", "noisy surface: drag or arrow keys turn it");
  surface = new Surface(canvas);
  const ghost = element(element(caption, "label", "key"), "input");
  ghost.type = "checkbox";
  ghost.checked = true;
  ghost.after("clean one over it");
  ghost.addEventListener("change", () => {
    surface.ghost = ghost.checked;
    surface.draw();
  });
  const strip = element(root, "div", "strip");
  readoutLine = element(strip, "div", "readout", "move over an image; drag a line with Shift for its profile");
  profile = element(strip, "canvas", "profile");
  figures = new Figures(panel, reasons);
  new ResizeObserver(() => {
    redraw();
    surface.draw();
    figures.draw();
    drawProfile();
  }).observe(root);
}

function addTile(tiles, kind, title) {
  const tile = element(tiles, "figure", "tile");
  const caption = element(tile, "figcaption");
  element(caption, "span", "", title);
  const canvas = element(tile, "canvas");
  canvas.tabIndex = 0;
  canvas.dataset.kind = kind;
  tile.addEventListener("dblclick", () => {
    const one = tiles.classList.toggle("one");
    for (const other of tiles.children) other.classList.toggle("big", one && other === tile);
    fit();
    surface.draw();
  });
  return [canvas, caption];
}

// Show the tiles of the picture's layers, in two rows; the surface takes what is left of the second.
function arrange() {
  let tiles = 1;
  for (const [kind, image] of Object.entries(images)) {
    const shown = shows(state.picture, kind);
    image.canvas.parentElement.hidden = !shown;
    tiles += shown;
  }
  root.querySelector(".tiles").style.setProperty("--columns", Math.ceil(tiles / 2));
  surface.canvas.parentElement.classList.toggle("wide", tiles % 2 === 1);
}

// Show the whole window of the picture.
function fit() {
  const p = state.picture;
  const canvas = Object.values(images)
    .map((image) => image.canvas)
    .find((c) => c.clientWidth);
  if (!p || !canvas) return;
  const scale = Math.min(canvas.clientWidth / (p.width + 8), canvas.clientHeight / (p.height + 8));
  state.view = { x: p.left + p.width / 2, y: p.top + p.height / 2, scale };
  state.fitted = p.head.window.join();
  redraw();
}

function pixelAt(canvas, event) {
  const box = canvas.getBoundingClientRect(),
    v = state.view;
  return [
    Math.floor(v.x + (event.clientX - box.left - box.width / 2) / v.scale),
    Math.floor(v.y + (event.clientY - box.top - box.height / 2) / v.scale),
  ];
}

function listen(canvas) {
  let held = null;
  const share = (e) => (e.clientX - canvas.getBoundingClientRect().left) / canvas.clientWidth;
  canvas.addEventListener("pointerdown", (e) => {
    if (!state.view) return;
    canvas.setPointerCapture(e.pointerId);
    const onSplit = state.other && Math.abs(share(e) - state.split) < 0.04;
    const what = onSplit ? "split" : e.shiftKey ? "line" : "move";
    held = { what, at: [e.clientX, e.clientY], view: { ...state.view }, start: pixelAt(canvas, e) };
  });
  canvas.addEventListener("pointerup", () => {
    held = null;
  });
  canvas.addEventListener("pointermove", (e) => {
    if (!state.view) return;
    state.cursor = pixelAt(canvas, e);
    if (held?.what === "line") {
      state.line = [...held.start, ...state.cursor];
      drawProfile();
    } else if (held?.what === "split") {
      state.split = Math.min(1, Math.max(0, share(e)));
    } else if (held) {
      const { x, y, scale } = held.view;
      state.view = { scale, x: x - (e.clientX - held.at[0]) / scale, y: y - (e.clientY - held.at[1]) / scale };
    }
    readout();
    redraw();
  });
  canvas.addEventListener(
    "wheel",
    (e) => {
      if (!state.view) return;
      e.preventDefault();
      const [x, y] = pixelAt(canvas, e),
        v = state.view;
      const scale = Math.min(60, Math.max(0.2, v.scale * Math.exp(-e.deltaY * 0.0015))),
        kept = v.scale / scale;
      state.view = { scale, x: x + (v.x - x) * kept, y: y + (v.y - y) * kept };
      redraw();
    },
    { passive: false },
  );
  canvas.addEventListener("keydown", (e) => {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[e.key];
    if (!step || !state.picture) return;
    e.preventDefault();
    const p = state.picture;
    const [x, y] = state.cursor || [p.left + (p.width >> 1), p.top + (p.height >> 1)];
    state.cursor = [x + step[0], y + step[1]];
    readout();
    redraw();
  });
}

function redraw() {
  if (!state.picture || !state.view) return;
  for (const [kind, image] of Object.entries(images)) {
    const other = state.other && kind !== "clean" && shows(state.other, kind) ? others[kind] : null;
    image.draw(state.view, state.cursor, state.line, other, state.split);
  }
}

function readout() {
  const p = state.picture;
  if (!p || !state.cursor) return;
  const [x, y] = state.cursor;
  if (x < 0 || y < 0 || x >= p.head.width || y >= p.head.height) return;
  const unit = p.head.depth_unit_mm,
    value = (name) => valueAt(p, name, x, y);
  const [clean, noisy] = ["clean", "noisy"].map(value);
  const depth = (d) => (d ? `${text(d * unit)} mm` : "none");
  const parts = [`(${x}, ${y})`, `clean ${depth(clean)}`, `noisy ${depth(noisy)}`];
  parts.push(`difference ${clean && noisy ? `${((noisy - clean) * unit).toFixed(unit < 1 ? 1 : 0)} mm` : "–"}`);
  if (shows(p, "disparity")) parts.push(`disparity ${value("disparity") ? `${value("disparity").toFixed(2)} px` : "none"}`);
  const counts = ["infrared", "infrared_right"].filter((name) => shows(p, name)).map(value);
  parts.push(`infrared ${counts.join(" and ")} counts`, `reason: ${reasonNames[value("reason")]}`);
  readoutLine.textContent = parts.join("  ");
}

// Depths of clean and noisy along the line; without a line, along the row of the middle.
function drawProfile() {
  const p = state.picture;
  if (!p) return;
  const middle = p.top + (p.height >> 1);
  const [x0, y0, x1, y1] = state.line || [p.left, middle, p.left + p.width - 1, middle];
  const steps = Math.max(Math.abs(x1 - x0), Math.abs(y1 - y0), 1);
  const along = (name) =>
    Array.from({ length: steps + 1 }, (_, i) => {
      const [x, y] = [x0 + ((x1 - x0) * i) / steps, y0 + ((y1 - y0) * i) / steps].map(Math.round);
      return [i, valueAt(p, name, x, y) * p.head.depth_unit_mm || null];
    });
  const series = [
    { points: along("noisy"), colour: "--accent" },
    { points: along("clean"), colour: "--second" },
  ];
  const depths = series.flatMap(({ points }) => points.map(([, depth]) => depth)).filter(Boolean);
  const [low, high] = depths.length ? [Math.min(...depths), Math.max(...depths)] : [0, 1];
  const pad = Math.max((high - low) * 0.05, 2);
  chart(profile, series, [0, steps], [low - pad, high + pad], "px");
}

// A picture of the server; null: there is none.
async function fetchPicture(address) {
  const answer = await fetch(address, { cache: "no-store" });
  if (!answer.ok) throw new Error(`${answer.status} ${address}`);
  return answer.status === 204 ? null : unpack(await answer.arrayBuffer());
}

// Write the ends of the colours.
function showKeys() {
  const unit = state.picture.head.depth_unit_mm;
  for (const [kind, [low, , high]] of Object.entries(keys)) {
    if (!shows(state.picture, kind)) continue;
    const scale = kind === "clean" || kind === "noisy" ? unit : 1;
    const [first, last] = state.ends[kind].map((value) => text(value * scale).replace("-", "−"));
    low.textContent = first;
    high.textContent = `${last} ${KINDS[kind][2]}`;
  }
}

// Paint the layers of the picture, and of B in the same colours.
function paintAll() {
  const { picture, other } = state;
  state.ends = endsOf(picture, state.differenceMm);
  for (const kind of Object.keys(KINDS)) {
    images[kind].set(shows(picture, kind) ? picture : null, state.ends[kind]);
    others[kind].set(other && shows(other, kind) ? other : null, state.ends[kind]);
  }
  showKeys();
  redraw();
}

// Show the pictures of the server: a request waits there until a later one than the last is drawn.
// The next one is asked for before this one is painted, so that the server draws beside the browser.
async function follow(tab) {
  let last = 0,
    painted = null;
  for (;;) {
    const picture = await fetchPicture(`/tune/next/${tab}?after=${last}`).catch(() => "failed");
    if (picture === "failed") await new Promise((done) => setTimeout(done, RETRY_MS));
    if (!picture?.head) continue;
    last = picture.head.number;
    await painted;
    painted = new Promise((done) => setTimeout(() => show(picture).then(done)));
  }
}

// Show a picture; resolves when it is on the screen, of a hidden tab when that is seen again.
async function show(picture) {
  state.picture = picture;
  arrange();
  if (state.fitted !== picture.head.window.join()) fit();
  paintAll();
  readout();
  drawProfile();
  surface.set(picture);
  await new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
  root.dataset.shown = picture.head.number;
  window.emitEvent("tune_shown", {});
}

window.glsimTune = {
  build: (view, panel, reasons, tab) => {
    build(document.getElementById(view), document.getElementById(panel), reasons);
    state.tab = tab;
    follow(tab);
  },
  showOther: async (address) => {
    state.other = address ? await fetchPicture(address) : null;
    if (state.picture) paintAll();
  },
  fit,
  scale: (mm) => {
    state.differenceMm = mm;
    if (state.picture) paintAll();
  },
  statistics: (now, other) => figures.show(now, other),
  recording: (real, here) => figures.showReal(real, here),
  state,
};
for (const [name, given] of window.tuneQueue || []) window.glsimTune[name](...given);
