// The page that denoises the visitor's own maps: what is open, which network runs, and what it made.

import { followTheme } from "../static/theme.js";
import { arrange, millimetres, readMap, wholeSteps } from "./depth_files.js";
import { Network } from "./network.js";
import { encodePng } from "./png.js";
import "../tune.js";

const facts = window.glsimFacts; // written by glsim.tune.denoise_page
const at = (id) => document.getElementById(id);
const view = window.glsimTune; // images, 3D and profile: tune.js
const networks = new Map(); // loaded ones, by name
const state = { maps: [], now: 0, result: null, run: 0 };
const TILES = [
  ["noisy", "measured"],
  ["clean", "denoised"],
  ["difference", "measured − denoised"],
];
// Step in which depth is shown, mm, and most of its values.
const SHOWN_MM = 0.1,
  MOST = 65535;

function say(text, kind = "") {
  at("message").textContent = text;
  at("message").className = kind;
}

const step = () => Math.min(Math.max(Number(at("step").value) || 1, 0.01), 10);

function chosenNetwork() {
  const name = at("network").value;
  if (!networks.has(name)) networks.set(name, new Network(facts.networks[name], facts.numbers));
  return networks.get(name);
}

// The images that a network takes of map `now`: itself and earlier maps of its size.
function inputsOf(now, depth) {
  const map = state.maps[now],
    inputs = { noisy_mm: [depth], before_mm: [] };
  for (let k = now - 1; k >= 0 && alike(state.maps[k], map); k--) inputs.before_mm.push(millimetres(state.maps[k], step()));
  return inputs;
}
const alike = (a, b) => a.width === b.width && a.height === b.height;

// What a network would use and was not given.
function missing(images, inputs) {
  return "before_mm" in images && !inputs.before_mm.length ? ", no earlier maps: this one alone" : "";
}

// A picture of tune.js of two maps in millimetres.
function pictureOf(map, noisy, denoised) {
  const { width, height } = map;
  let [near, far] = [Infinity, 0];
  for (const mm of noisy)
    if (mm > 0) {
      near = Math.min(near, mm);
      far = Math.max(far, mm);
    }
  const unit = Math.max(SHOWN_MM, Math.ceil(far / MOST / SHOWN_MM + 1) * SHOWN_MM * (far > MOST * SHOWN_MM)),
    whole = (depth) => Uint16Array.from(depth, (mm) => Math.round(mm / unit)),
    focal = facts.numbers.focal_share * width;
  return {
    left: 0,
    top: 0,
    width,
    height,
    head: {
      width,
      height,
      focal_px: [focal, focal],
      centre_px: [width / 2, height / 2],
      depth_unit_mm: unit,
      depth_ends: far ? [near / unit, Math.max(far, near + unit) / unit] : undefined,
    },
    layers: { noisy: whole(noisy), clean: whole(denoised) },
  };
}

// Denoise and show the chosen map; the visitor may choose another one meanwhile.
async function show() {
  const run = ++state.run,
    map = state.maps[state.now];
  state.result = null;
  at("save").disabled = true;
  if (!map) return;
  place();
  try {
    const noisy = millimetres(map, step());
    at("hint").hidden = true;
    view.display(pictureOf(map, noisy, new Float32Array(noisy.length)));
    say(`${map.name}: denoising…`, "busy");
    const network = chosenNetwork(),
      name = at("network").value;
    await network.session; // its time is not the map's
    if (run !== state.run) return;
    const begun = performance.now(),
      inputs = inputsOf(state.now, noisy),
      result = await network.denoise(inputs, map.width, map.height);
    if (run !== state.run) return;
    const seconds = ((performance.now() - begun) / 1000).toFixed(2);
    state.result = { map, depth: result.depth };
    view.display(pictureOf(map, noisy, result.depth));
    at("save").disabled = false;
    const what = result.unchanged
      ? "unchanged, for it has no noise"
      : `${name}, ${seconds} s${missing(facts.networks[name].images, inputs)}`;
    say(`${map.name}: ${what}`);
    document.body.dataset.runs = Number(document.body.dataset.runs || 0) + 1;
  } catch (error) {
    if (run === state.run) say(error.message, "problem");
  }
}

// Where the map stands in its sequence, and the steps in which it can be saved.
function place() {
  const map = state.maps[state.now],
    several = state.maps.length > 1;
  for (const id of ["earlier", "place", "later"]) at(id).hidden = !several;
  at("earlier").disabled = state.now === 0;
  at("later").disabled = state.now === state.maps.length - 1;
  at("place").textContent = `${state.now + 1} of ${state.maps.length}`;
  at("step").disabled = Boolean(map.stated || map.floats);
  if (map.stated) at("step").value = map.stated;
  // As glsim denoise: steps of 0.1 mm where the file states its step, else those that were read.
  const own = map.floats ? facts.numbers.fine_mm : map.stated || step(),
    steps = [...new Set([own, facts.numbers.fine_mm, 1])].sort((a, b) => a - b),
    wanted = map.stated ? Math.min(own, facts.numbers.fine_mm) : own;
  at("out").replaceChildren(...steps.map((mm) => new Option(`${mm} mm`, mm, false, mm === wanted)));
}

// Take files of the visitor, all or none.
async function take(files) {
  if (!files.length) return;
  say("reading…", "busy");
  try {
    const maps = arrange(await Promise.all([...files].map((file) => readMap(file, facts.numbers.unit_keyword, facts.numbers.most_px))));
    if (!maps.length) throw new Error("these are infrared images alone: give the depth maps too");
    state.maps = maps;
    state.now = 0;
    await show();
  } catch (error) {
    say(error.message, "problem");
  }
}

// The file of the shown result.
async function saved() {
  const { map, depth } = state.result,
    mm = Number(at("out").value);
  return encodePng(map.width, map.height, wholeSteps(depth, mm), { [facts.numbers.unit_keyword]: String(mm) });
}

async function save() {
  try {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await saved());
    link.download = `${state.result.map.name.replace(/\.\w+$/, "")}_denoised.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
  } catch (error) {
    say(error.message, "problem");
  }
}

async function example() {
  const answer = await fetch("example.png");
  await take([new File([await answer.blob()], "example.png")]);
}

function listen() {
  const page = document.querySelector("main");
  at("open").addEventListener("click", () => at("files").click());
  at("files").addEventListener("change", () => take([...at("files").files]).then(() => (at("files").value = "")));
  at("example").addEventListener("click", () => example().catch((error) => say(error.message, "problem")));
  window.addEventListener("dragover", (e) => {
    e.preventDefault();
    page.classList.add("dropping");
  });
  window.addEventListener("dragleave", (e) => e.relatedTarget || page.classList.remove("dropping"));
  window.addEventListener("drop", (e) => {
    e.preventDefault();
    page.classList.remove("dropping");
    take([...e.dataTransfer.files]);
  });
  for (const id of ["network", "step"]) at(id).addEventListener("change", show);
  for (const [id, by] of [
    ["earlier", -1],
    ["later", 1],
  ])
    at(id).addEventListener("click", () => {
      state.now += by;
      show();
    });
  at("range").addEventListener("change", (e) => view.scale(Number(e.target.value)));
  at("save").addEventListener("click", save);
  followTheme(at("theme"), view.themed);
}

function start() {
  for (const name of Object.keys(facts.networks)) at("network").append(new Option(name));
  view.build("view", null, [], undefined, { kinds: TILES, pair: true });
  new ResizeObserver(() => view.fit()).observe(at("view"));
  listen();
  if (location.protocol === "file:" || !window.ort) {
    for (const id of ["open", "example"]) at(id).disabled = true;
    say("serve this folder to run networks: python3 -m http.server, then open http://localhost:8000/denoise.html", "problem");
    return;
  }
  const { wasm } = window.ort.env;
  wasm.wasmPaths = new URL("onnxruntime/", location.href).href;
  wasm.proxy = true; // in a worker, so that the page stays alive
  wasm.numThreads = 1; // more need headers that plain servers do not send
  chosenNetwork(); // reads the first network
}

// For tests and notebooks.
window.glsimDenoise = { state, take, saved, show };
start();
