// The page without a server: what the visitor has changed, and the frame that it gives.

import { unpackCapture } from "./captures.js";
import { Engine, Scene } from "./chain.js";
import { compilePatterns, describe, flatten, StageError, toWebgl } from "./declarations.js";
import { Editor } from "./editor.js";
import { pictureOf, statisticsOf } from "./measure.js";
import { drawPanel, make, short } from "./panel.js";
import { followTheme } from "./theme.js";
import "../tune.js";

const facts = window.glsimFacts; // written by glsim.tune.static_page
const patterns = compilePatterns(facts.patterns);
const at = (id) => document.getElementById(id);
const view = window.glsimTune; // images, 3D and figures: tune.js

// state: what the address holds. values: "stage.parameter" -> number; code: stage -> changed GLSL.
const state = { sensor: facts.first_sensor, scene: facts.scenes[0].name, seed: 0, camera: 0, values: {}, code: {} };
const scenes = new Map(),
  arriving = new Map(); // scenes arrive as scripts: they open from file:// too
let engine,
  editor,
  chain = [],
  selected = "",
  shown = null,
  playing = false,
  frames = 0;

const sensor = () => facts.sensors[state.sensor];
const keyOf = (stage, parameter) => `${stage.name}.${parameter.name}`;

// ---- the chain ----

// Describe and link a stage's text. Raises StageError.
function linked(stage, text) {
  const flat = flatten(stage.file, text, facts.files, patterns.include);
  const found = describe(flat, patterns);
  return { ...stage, ...found, linked: engine.link(toWebgl(flat, found.writes, patterns), flat) };
}

function buildChain() {
  chain = sensor().stages.map((stage) => {
    if (stage.array) return stage;
    const own = linked(stage, facts.files[stage.file]);
    if (!(stage.name in state.code)) return own;
    try {
      return { ...linked(stage, state.code[stage.name]), changed: true };
    } catch (error) {
      if (!(error instanceof StageError)) throw error;
      return { ...own, changed: true, problems: error.problems };
    }
  });
  if (!chain.some((s) => s.name === selected)) selected = (chain.find((s) => !s.array) || chain[0]).name;
}

// The value that a parameter starts from: the sensor's, or the drawn camera's.
function startOf(stage, parameter) {
  const key = keyOf(stage, parameter),
    place = sensor().drawn.indexOf(key);
  if (place >= 0) return sensor().cameras[state.camera % sensor().cameras.length][place];
  return stage.settings[parameter.name] ?? parameter.default;
}

function ownValue(stage, parameter) {
  const start = startOf(stage, parameter),
    key = keyOf(stage, parameter),
    changed = key in state.values;
  return { start, changed, value: changed ? state.values[key] : start, drawn: stage.ranges[parameter.name] };
}

const ENABLED = { name: "enabled", default: 1 };
function allValues() {
  const of = (stage) => [ENABLED, ...stage.parameters].map((p) => [p.name, ownValue(stage, p).value]);
  return Object.fromEntries(chain.filter((s) => !s.array).map((stage) => [stage.name, Object.fromEntries(of(stage))]));
}

// ---- scenes ----

window.glsimScene = (scene) => {
  scenes.set(scene.name, scene);
  for (const done of arriving.get(scene.name) || []) done();
};

async function sceneData(name) {
  if (!scenes.has(name)) {
    await new Promise((done, failed) => {
      arriving.set(name, [...(arriving.get(name) || []), done]);
      const script = make(document.head, "script");
      script.onerror = () => failed(new Error(`scenes/${name}.js cannot be read`));
      script.src = `scenes/${name}.js`;
    });
  }
  return scenes.get(name);
}

// Put the chosen scene on the GPU; the visitor may choose another one meanwhile.
async function loadScene() {
  const chosen = () => `${state.scene} ${state.sensor}`;
  while (shown?.key !== chosen()) {
    const key = chosen(),
      use = state.sensor,
      { captures, blobs } = await sceneData(state.scene);
    const layers = await unpackCapture(captures[use], blobs, facts.units);
    if (key !== chosen()) continue;
    shown?.scene.release();
    const capture = captures[use];
    shown = { key, capture, layers, scene: new Scene(engine, sensor().rig, capture.window, layers, capture.side) };
  }
}

// ---- drawing ----

// Run the chain; returns {layers: float32 of the window, picture, milliseconds}.
function runChain() {
  const { capture, scene, layers } = shown,
    begun = performance.now();
  const seeds = { u_seed: String(state.seed), u_sequence_seed: capture.sequence_seed, u_device_seed: capture.device_seed };
  const uniforms = { ...capture.uniforms, u_time_s: state.seed / facts.frames_per_second };
  const textures = scene.run(
    chain.filter((s) => !s.array),
    allValues(),
    uniforms,
    seeds,
    facts.blank,
  );
  const result = { clean: layers.clean };
  for (const name of ["depth", "reason", "infrared"]) result[name] = textures[name] ? scene.read(textures[name]) : null;
  const milliseconds = performance.now() - begun;
  return { layers: result, milliseconds, picture: pictureOf(sensor().rig, capture.window, result, facts.reasons) };
}

function say(text, bad = false) {
  at("message").textContent = text;
  at("message").className = bad ? "problem" : "note";
}

let waiting = false,
  busy = false,
  again = false;
// Draw soon; many changes between two frames of the screen are drawn once.
function redraw() {
  again = true;
  if (!waiting && !busy) {
    waiting = true;
    setTimeout(draw, 0);
  }
}

async function draw() {
  waiting = false;
  busy = true;
  again = false;
  try {
    await loadScene();
    const run = runChain();
    view.display(run.picture);
    if (!playing || frames % 5 === 0)
      view.statistics(statisticsOf(run.picture, shown.layers.normal, facts.reasons, run.milliseconds), null);
    say(chain.find((s) => s.problems) ? "a stage has a mistake: its last good program runs" : "");
    if (!frames) view.fit(); // the layout is ready now
    document.body.dataset.frames = ++frames;
  } catch (error) {
    say(error.message, true);
    if (!(error instanceof StageError)) console.error(error);
  }
  busy = false;
  if (playing) {
    state.seed++;
    at("seed").value = state.seed;
    setTimeout(redraw, 0);
  } else if (again) redraw();
}

// ---- panel, editor, address ----

function showPanel() {
  const focus = document.activeElement?.closest?.("[data-parameter]")?.dataset.parameter,
    kind = document.activeElement?.type;
  drawPanel(at("stages"), chain, selected, ownValue, {
    select: (stage) => {
      selected = stage.name;
      showPanel();
      showCode();
    },
    toggle: (stage, on) => change(keyOf(stage, ENABLED), on ? 1 : 0, startOf(stage, ENABLED)),
    change: (stage, parameter, value) => change(keyOf(stage, parameter), value, startOf(stage, parameter)),
    reset: (stage, parameter) => {
      delete state.values[keyOf(stage, parameter)];
      showPanel();
      changed();
    },
  });
  if (focus)
    at("stages")
      .querySelector(`[data-parameter="${CSS.escape(focus)}"] input[type="${kind}"]`)
      ?.focus();
}

function change(key, value, start) {
  if (value === start) delete state.values[key];
  else state.values[key] = value;
  changed();
}

function changed() {
  writeAddress();
  redraw();
}

function showCode() {
  const stage = chain.find((s) => s.name === selected);
  at("code-name").textContent = stage.name;
  at("code-file").textContent = stage.array ? "a Python stage: it runs in glsim, not here" : stage.file;
  editor.set(stage.array ? "" : (state.code[stage.name] ?? facts.files[stage.file]), stage.array);
  at("original").disabled = !(stage.name in state.code);
  showProblems(stage, stage.problems || []);
}

function showProblems(stage, problems) {
  editor.mark(problems.filter((p) => p.file === stage.file));
  at("problems").textContent = problems.map((p) => `${p.file}:${p.line}: ${p.text}`).join("\n");
  at("problems").hidden = !problems.length;
}

// The last good program of the stage runs on if the text has a mistake.
function edited(text) {
  const place = chain.findIndex((s) => s.name === selected),
    stage = chain[place];
  if (stage.array) return;
  const original = sensor().stages[place];
  if (text === facts.files[stage.file]) delete state.code[stage.name];
  else state.code[stage.name] = text;
  let problems = [];
  try {
    chain[place] = { ...linked(original, text), changed: stage.name in state.code };
  } catch (error) {
    if (!(error instanceof StageError)) throw error;
    problems = error.problems;
    chain[place] = { ...stage, problems };
  }
  at("original").disabled = !(stage.name in state.code);
  showProblems(stage, problems);
  showPanel();
  changed();
}

// The address holds what differs from the start: #sensor=...&stage.parameter=...&code.stage=...
function writeAddress() {
  const words = new URLSearchParams({ sensor: state.sensor, scene: state.scene, seed: state.seed, camera: state.camera });
  for (const [key, value] of Object.entries(state.values)) words.set(key, short(value));
  for (const [stage, text] of Object.entries(state.code)) words.set(`code.${stage}`, text);
  history.replaceState(null, "", `#${words}`);
}

function readAddress() {
  const words = new URLSearchParams(location.hash.slice(1));
  const one = (name, known) => (known.includes(words.get(name)) ? words.get(name) : state[name]);
  state.sensor = one("sensor", Object.keys(facts.sensors));
  state.scene = one(
    "scene",
    facts.scenes.map((s) => s.name),
  );
  for (const name of ["seed", "camera"]) state[name] = Math.min(Math.max(parseInt(words.get(name), 10) || 0, 0), 2 ** 31);
  state.values = {};
  state.code = {};
  for (const [key, text] of words) {
    if (key.startsWith("code.")) state.code[key.slice(5)] = text;
    else if (key.includes(".") && Number.isFinite(Number(text))) state.values[key] = Number(text);
  }
}

// The options of `glsim` that set the same values.
function setLine() {
  const quoted = (text) => (/^[\w.=+-]+$/.test(text) ? text : `'${text}'`);
  const word = (key, value) => {
    const [name, parameter] = key.split(".");
    const declared =
      parameter === "enabled" ? { type: "bool" } : chain.find((s) => s.name === name)?.parameters.find((p) => p.name === parameter);
    if (!declared) return null;
    return `--set ${quoted(`${key}=${declared.type === "bool" ? value > 0.5 : short(value)}`)}`;
  };
  const drawn = sensor().drawn.map((key, n) => [key, sensor().cameras[state.camera % sensor().cameras.length][n]]);
  const values = new Map([...drawn, ...Object.entries(state.values)]);
  return [`--sensor ${state.sensor}`, ...[...values].map(([k, v]) => word(k, v)).filter(Boolean)].join(" ");
}

async function copy(text, what) {
  at("copied").value = text;
  at("copied").hidden = false;
  at("copied").select();
  try {
    await navigator.clipboard.writeText(text);
    say(`${what} copied`);
  } catch {
    say(`${what}: copy it from the box`);
  }
}

// ---- start ----

function openSensor() {
  at("sensor").value = state.sensor;
  at("scene").value = state.scene;
  at("seed").value = state.seed;
  at("camera").hidden = !sensor().cameras.length;
  at("camera").textContent = `draw another camera (${state.camera})`;
  at("sensor").title = sensor().title;
  buildChain();
  showPanel();
  showCode();
  changed();
}

function listen() {
  at("sensor").addEventListener("change", (e) => {
    Object.assign(state, { sensor: e.target.value, values: {}, code: {}, camera: 0 });
    openSensor();
  });
  at("scene").addEventListener("change", (e) => {
    state.scene = e.target.value;
    changed();
  });
  at("seed").addEventListener("change", (e) => {
    state.seed = Math.max(0, parseInt(e.target.value, 10) || 0);
    e.target.value = state.seed;
    changed();
  });
  at("camera").addEventListener("click", () => {
    state.camera = (state.camera + 1) % sensor().cameras.length;
    openSensor();
  });
  at("play").addEventListener("click", () => {
    playing = !playing;
    at("play").textContent = playing ? "❚❚ stop" : "▶ play";
    if (playing) redraw();
    else changed();
  });
  at("reset").addEventListener("click", () => {
    Object.assign(state, { values: {}, code: {} });
    openSensor();
  });
  at("set").addEventListener("click", () => copy(setLine(), "options"));
  at("link").addEventListener("click", () => copy(location.href, "link"));
  at("copied").addEventListener("blur", (e) => {
    e.target.hidden = true;
  });
  at("original").addEventListener("click", () => {
    delete state.code[selected];
    buildChain();
    showPanel();
    showCode();
    changed();
  });
  at("stages").addEventListener("change", showPanel);
  at("range").addEventListener("change", (e) => view.scale(Number(e.target.value)));
  followTheme(at("theme"), view.themed);
  window.addEventListener("hashchange", () => {
    readAddress();
    openSensor();
  });
}

function start() {
  for (const [name, { title }] of Object.entries(facts.sensors)) make(at("sensor"), "option", "", name).title = title;
  for (const { name, title } of facts.scenes) make(at("scene"), "option", "", title).value = name;
  const words = Object.fromEntries(facts.reasons.map((r, code) => [code, `${r.name.toLowerCase().replaceAll("_", " ")}: ${r.help}`]));
  view.build("view", "figures", words);
  new ResizeObserver(() => view.fit()).observe(at("view"));
  if (facts.denoise) Object.assign(at("denoise"), { href: "denoise.html", hidden: false });
  readAddress();
  listen();
  try {
    const shared = (name) => {
      const flat = flatten(name, facts.files[name], facts.files, patterns.include);
      return toWebgl(flat, [], patterns);
    };
    engine = new Engine(document.createElement("canvas"), { vertex: shared(facts.vertex), silhouette: shared(facts.silhouette) });
  } catch (error) {
    say(error.message, true);
    return;
  }
  editor = new Editor(at("editor"), edited);
  openSensor();
}

// For tests and notebooks: the float32 layers of the shown frame, and what the page read of the stages.
window.glsimStatic = {
  state,
  run: async () => {
    await loadScene();
    const run = runChain();
    return { ...run, inputs: shown.layers };
  },
  open: openSensor,
  setLine,
  chain: () => chain,
};
start();
