// The middle and the right of the page: images, 3D, profile and statistics of the shown picture.

import { chart, text } from "./charts.js";
import { Figures } from "./figures.js";
import { endsOf, LayerImage } from "./images.js";
import { DEPTH, DISPARITY, GREY, gradient, SIGNED } from "./maps.js";
import { unpack, valueAt } from "./packet.js";
import { Rate } from "./rate.js";
import { Surface, View } from "./surface.js";

// The tiles in their order, of layers and their titles; a picture shows those of its layers.
let kinds = [
  ["clean", "clean"],
  ["noisy", "noisy"],
  ["disparity", "disparity"],
  ["difference", "noisy − clean"],
  ["reason", "reason"],
  ["infrared", "infrared"],
  ["infrared_right", "infrared, right"],
];
const state = {
  picture: null,
  other: null,
  split: 0.5,
  view: null,
  cursor: null,
  line: null,
  differenceMm: 10,
  spanMm: 0,
  times: [],
  painted: 0,
  pressed: 0,
  shown: 0,
};
// Pause after a request that failed, as while the server restarts.
const RETRY_MS = 1000;
const MAPS = { clean: DEPTH, noisy: DEPTH, disparity: DISPARITY, difference: SIGNED, infrared: GREY, infrared_right: GREY };
const shows = (picture, kind) => kind === "difference" || kind in picture.layers;
const titleOf = (kind) => kinds.find(([name]) => name === kind)[1];
const images = {},
  others = {},
  keys = {};
let seen,
  figures,
  rate,
  root,
  words = [];

const make = (parent, tag, cls, content) => {
  const made = document.createElement(tag);
  if (cls) made.className = cls;
  if (content !== undefined) made.textContent = content;
  parent.append(made);
  return made;
};

// Quasar names a slider, and focuses a part of it that has neither name nor role.
const SPOKEN = ["aria-label", "aria-valuemin", "aria-valuemax", "aria-valuenow"];
function nameSliders() {
  for (const part of document.querySelectorAll(".q-slider[aria-label] .q-slider__track-container")) {
    const slider = part.closest(".q-slider");
    part.setAttribute("role", "slider");
    for (const name of SPOKEN) {
      const value = slider.getAttribute(name);
      if (value !== null && part.getAttribute(name) !== value) part.setAttribute(name, value);
    }
  }
}
function keepSlidersNamed() {
  let waiting = false;
  const later = () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      nameSliders();
    });
  };
  new MutationObserver(later).observe(document.body, {
    childList: true,
    subtree: true,
    attributeFilter: ["aria-valuenow"],
  });
  later();
}

// panel: of the figures, or null. live: {kinds, frames, pair} of a page that shows what a denoiser makes of
// maps. frames: of a recording that is played, for its rate; pair: both surfaces side by side, not as a ghost.
function build(view, panel, reasonWords, live) {
  keepSlidersNamed();
  if (live) kinds = live.kinds;
  root = view;
  words = reasonWords;
  root.textContent = "";
  const tiles = make(root, "div", "tiles");
  for (const [kind, title] of kinds) {
    const tile = make(tiles, "figure", "tile");
    const caption = make(tile, "figcaption");
    make(caption, "span", "", title);
    if (MAPS[kind]) {
      const key = make(caption, "span", "key");
      keys[kind] = [make(key, "span"), make(key, "i"), make(key, "span")];
      keys[kind][1].style.background = gradient(MAPS[kind]);
    }
    const canvas = make(tile, "canvas");
    canvas.tabIndex = 0;
    canvas.dataset.kind = kind;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${title}: arrow keys move the cursor`);
    images[kind] = new LayerImage(canvas, kind);
    others[kind] = new LayerImage(canvas, kind);
    listen(canvas);
    tile.addEventListener("dblclick", () => enlarge(tile));
  }
  if (live?.pair) {
    tiles.classList.add("pair");
    seen = new View(0.25, 0.1);
    for (const name of ["clean", "noisy"]) tiles.prepend(surfaceTile(tiles, [name], "noisy", `${titleOf(name)} surface`));
  } else {
    seen = new View(0.5, 0.2);
    surfaceTile(tiles, ["noisy", "clean"], "clean", "surface");
  }
  const strip = make(root, "div", "strip");
  state.readout = make(strip, "div", "readout", "move over an image; drag a line with Shift for its profile");
  state.profile = make(strip, "canvas", "profile");
  figures = panel && new Figures(panel);
  rate = live?.frames === undefined ? undefined : new Rate(document.getElementById("tune-rate"), live.frames);
  new ResizeObserver(() => {
    redraw();
    seen.draw();
    figures?.draw();
    drawProfile();
  }).observe(root);
}

// Add a tile with a surface, of which the second layer is the ghost.
function surfaceTile(tiles, names, middle, title) {
  const tile = make(tiles, "figure", "tile solid");
  const caption = make(tile, "figcaption", "", title);
  const canvas = make(tile, "canvas");
  canvas.tabIndex = 0;
  canvas.dataset.kind = "surface";
  canvas.setAttribute("aria-label", `${titleOf(names[0])} surface: drag or arrow keys turn it`);
  const surface = new Surface(canvas, seen, names, middle);
  if (names.length > 1) {
    const ghost = make(make(caption, "label", "key"), "input");
    ghost.type = "checkbox";
    ghost.checked = true;
    ghost.after(`${titleOf("clean")} one over it`);
    ghost.addEventListener("change", () => {
      surface.ghost = ghost.checked;
      surface.draw();
    });
  }
  tile.addEventListener("dblclick", () => enlarge(tile));
  return tile;
}

// Show the tiles of the picture's layers, in two rows; the surface takes what is left of the second.
function arrange() {
  let tiles = 1;
  for (const [kind] of kinds) {
    const shown = shows(state.picture, kind);
    images[kind].canvas.parentElement.hidden = !shown;
    tiles += shown;
  }
  root.querySelector(".tiles").style.setProperty("--columns", Math.ceil(tiles / 2));
  for (const { canvas } of seen.surfaces) canvas.parentElement.classList.toggle("wide", tiles % 2 === 1);
  if (!images.infrared) return;
  const left = images.infrared.canvas.parentElement.querySelector("figcaption span");
  left.textContent = shows(state.picture, "infrared_right") ? "infrared, left" : "infrared";
}

function enlarge(tile) {
  const tiles = tile.parentElement;
  const one = tiles.classList.toggle("one");
  for (const other of tiles.children) other.classList.toggle("big", one && other === tile);
  fit();
  redraw();
  seen.draw();
}

// Show the whole window of the picture.
function fit() {
  const p = state.picture;
  const canvas = Object.values(images)
    .map((i) => i.canvas)
    .find((c) => c.clientWidth);
  if (!p || !canvas) return;
  const scale = Math.min(canvas.clientWidth / (p.width + 8), canvas.clientHeight / (p.height + 8));
  state.view = { x: p.left + p.width / 2, y: p.top + p.height / 2, scale };
  state.fitted = [p.left, p.top, p.width, p.height].join();
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
  canvas.addEventListener("pointerdown", (e) => {
    if (!state.view) return;
    canvas.setPointerCapture(e.pointerId);
    const box = canvas.getBoundingClientRect();
    const onSplit = state.other && Math.abs((e.clientX - box.left) / box.width - state.split) < 0.04;
    held = { at: [e.clientX, e.clientY], view: { ...state.view }, what: onSplit ? "split" : e.shiftKey ? "line" : "move" };
    if (held.what === "line") held.start = pixelAt(canvas, e);
  });
  canvas.addEventListener("pointermove", (e) => {
    if (!state.view) return;
    state.cursor = pixelAt(canvas, e);
    if (held?.what === "line") {
      state.line = [...held.start, ...state.cursor];
      drawProfile();
    } else if (held?.what === "split") {
      const box = canvas.getBoundingClientRect();
      state.split = Math.min(1, Math.max(0, (e.clientX - box.left) / box.width));
    } else if (held) {
      state.view = {
        scale: held.view.scale,
        x: held.view.x - (e.clientX - held.at[0]) / held.view.scale,
        y: held.view.y - (e.clientY - held.at[1]) / held.view.scale,
      };
    }
    readout();
    redraw();
  });
  canvas.addEventListener("pointerup", () => {
    held = null;
  });
  canvas.addEventListener(
    "wheel",
    (e) => {
      if (!state.view) return;
      e.preventDefault();
      const [x, y] = pixelAt(canvas, e),
        factor = Math.exp(-e.deltaY * 0.0015),
        v = state.view;
      const scale = Math.min(60, Math.max(0.2, v.scale * factor)),
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
    const from = state.cursor || [p.left + (p.width >> 1), p.top + (p.height >> 1)];
    state.cursor = [from[0] + step[0], from[1] + step[1]];
    readout();
    redraw();
  });
}

function redraw() {
  if (!state.picture || !state.view) return;
  for (const [kind] of kinds) {
    const other = state.other && kind !== "clean" && shows(state.other, kind) ? others[kind] : null;
    images[kind].draw(state.view, state.cursor, state.line, other, state.split);
  }
}

function readout() {
  const p = state.picture;
  if (!p || !state.cursor) return;
  const [x, y] = state.cursor;
  if (x < 0 || y < 0 || x >= p.head.width || y >= p.head.height) return;
  const unit = p.head.depth_unit_mm;
  const has = (name) => shows(p, name),
    value = (name) => valueAt(p, name, x, y);
  const [clean, noisy] = ["clean", "noisy"].map(value);
  const depth = (d) => (d ? `${text(d * unit)} mm` : "none");
  const difference = clean && noisy ? `${((noisy - clean) * unit).toFixed(unit < 1 ? 1 : 0)} mm` : "–";
  const px = has("disparity") && value("disparity");
  const disparity = has("disparity") ? `disparity ${px ? `${px.toFixed(2)} px` : "none"}  ` : "";
  const counts = ["infrared", "infrared_right"].filter(has).map(value).join(" and ");
  const infrared = counts && `infrared ${counts} counts  `;
  const reason = has("reason") ? `reason: ${words[value("reason")] ?? value("reason")}` : "";
  state.readout.textContent =
    `(${x}, ${y})  ${titleOf("clean")} ${depth(clean)}  ${titleOf("noisy")} ${depth(noisy)}  difference ${difference}  ` +
    `${disparity}${infrared}${reason}`;
}

// Depths of clean and noisy along the line; without a line, along the row of the middle.
function drawProfile() {
  const p = state.picture;
  if (!p) return;
  const middle = p.top + (p.height >> 1);
  const [x0, y0, x1, y1] = state.line || [p.left, middle, p.left + p.width - 1, middle];
  const steps = Math.max(Math.abs(x1 - x0), Math.abs(y1 - y0), 1);
  const lines = { clean: [], noisy: [] };
  let low = Infinity,
    high = -Infinity;
  for (let i = 0; i <= steps; i++) {
    const x = Math.round(x0 + ((x1 - x0) * i) / steps),
      y = Math.round(y0 + ((y1 - y0) * i) / steps);
    for (const name of ["clean", "noisy"]) {
      const depth = valueAt(p, name, x, y) * p.head.depth_unit_mm;
      lines[name].push([i, depth || null]);
      if (depth) {
        low = Math.min(low, depth);
        high = Math.max(high, depth);
      }
    }
  }
  if (low > high) [low, high] = [0, 1];
  const pad = Math.max((high - low) * 0.05, 2);
  chart(
    state.profile,
    [
      { points: lines.noisy, colour: "--accent" },
      { points: lines.clean, colour: "--second" },
    ],
    [0, steps],
    [low - pad, high + pad],
    "px",
  );
}

// A picture of the server; null: there is none.
async function fetchPicture(address) {
  const answer = await fetch(address, { cache: "no-store" });
  if (!answer.ok) throw new Error(`${answer.status} ${address}`);
  if (answer.status === 204) return null;
  return unpack(await answer.arrayBuffer());
}

// The ends of the colours.
function showKeys() {
  const p = state.picture,
    unit = p.head.depth_unit_mm;
  const written = {
    clean: (d) => [text(d * unit), " mm"],
    noisy: (d) => [text(d * unit), " mm"],
    difference: (mm) => [String(mm).replace("-", "−"), " mm"],
    disparity: (px) => [text(px), " px"],
    infrared: (counts) => [text(counts), ""],
    infrared_right: (counts) => [text(counts), ""],
  };
  for (const [kind, [low, , high]] of Object.entries(keys)) {
    if (!shows(p, kind)) continue;
    const [first, last] = state.ends[kind].map(written[kind]);
    low.textContent = first[0];
    high.textContent = last.join("");
  }
}

// Show a picture: {head, layers, left, top, width, height}, as packet.js unpacks it.
function display(picture) {
  state.picture = picture;
  state.ends = endsOf(picture, state.differenceMm, state.spanMm);
  arrange();
  for (const [kind] of kinds) images[kind].set(shows(picture, kind) ? picture : null, state.ends[kind]);
  if (state.other) paintOther();
  showKeys();
  if (state.fitted !== [picture.left, picture.top, picture.width, picture.height].join() && !state.keep) fit();
  redraw();
  readout();
  drawProfile();
  for (const surface of seen.surfaces) surface.set(picture);
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

// Show a picture of the server; resolves when it is on the screen.
function show(picture) {
  const since = state.pressed;
  state.pressed = 0;
  display(picture);
  state.shown = picture.head.number;
  root.dataset.shown = state.shown;
  window.emitEvent("tune_shown", { number: state.shown });
  return onScreen().then(() => {
    state.painted += 1;
    rate?.painted(picture.head);
    if (since) state.times.push(performance.now() - since);
  });
}

// Resolve when what is drawn now is on the screen; of a hidden tab, when it is seen again.
const onScreen = () => new Promise((done) => requestAnimationFrame(() => setTimeout(done)));

async function showOther(address) {
  state.other = address ? await fetchPicture(address) : null;
  if (state.other && state.picture) paintOther();
  redraw();
}

// Paint B in the colours of A.
function paintOther() {
  for (const [kind] of kinds) others[kind].set(shows(state.other, kind) ? state.other : null, state.ends[kind]);
}

// The time from a key or a movement in the panel to the picture that it gives.
for (const kind of ["keydown", "pointermove"]) {
  document.addEventListener(
    kind,
    (e) => {
      if (kind === "pointermove" && !e.buttons) return;
      if (!state.pressed && e.target.closest?.(".q-slider")) state.pressed = performance.now();
    },
    { capture: true, passive: true },
  );
}

window.glsimTune = {
  build: (view, panel, words, tab, live) => {
    build(document.getElementById(view), document.getElementById(panel), words, live);
    if (tab === undefined) return; // no server
    state.tab = tab;
    follow(tab);
    window.addEventListener("pagehide", () => navigator.sendBeacon(`/tune/closed/${tab}`));
  },
  display,
  showOther,
  fit: () => {
    fit();
    redraw();
  },
  scale: (mm) => {
    state.differenceMm = mm;
    if (!state.picture) return;
    state.ends.difference = [-mm, mm];
    images.difference.set(state.picture, state.ends.difference);
    showKeys();
    if (state.other) paintOther();
    redraw();
  },
  span: (mm) => {
    state.spanMm = mm;
    if (state.picture) display(state.picture);
  },
  statistics: (now, other) => figures.show(now, other),
  recording: (real, here) => figures.showReal(real, here),
  themed: () => {
    figures?.draw();
    drawProfile();
  },
  state,
};
for (const [name, given] of window.tuneQueue || []) window.glsimTune[name](...given);
