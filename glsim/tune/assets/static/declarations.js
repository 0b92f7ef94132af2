// Read GLSL stages as glsim.gl.declarations does, with its own patterns (from Python), and
// substitute what WebGL2 writes otherwise.

import { FUNCTIONS } from "./functions.js";

const LAYER_TYPES = { float: 1, vec2: 2, vec4: 4 };
const PARAMETER_TYPES = ["float", "int", "bool"];
const HEADER = ["#version 300 es", "precision highp float; precision highp int; precision highp sampler2D;", ...FUNCTIONS];

// A mistake in a stage. problems: [{file, line, text}].
export class StageError extends Error {
  constructor(problems) {
    super(problems.map((p) => `${p.file}:${p.line}: ${p.text}`).join("; "));
    this.problems = problems;
  }
}

const fail = (at, text) => {
  throw new StageError([{ file: at.file, line: at.line, text }]);
};

// Insert includes, each once. Returns [{text, file, line}]. files: text by name.
export function flatten(file, text, files, pattern, included = new Set(), top = true) {
  const lines = text.split("\n");
  if (lines[lines.length - 1] === "") lines.pop();
  const flat = [];
  lines.forEach((line, n) => {
    const match = pattern.exec(line);
    if (!match) {
      if (top || !line.startsWith("#version")) flat.push({ text: line, file, line: n + 1 });
      return;
    }
    const beside = file.slice(0, file.lastIndexOf("/") + 1) + match.groups.name;
    const found = [beside, match.groups.name].find((name) => name in files);
    if (found === undefined) fail({ file, line: n + 1 }, `no file ${match.groups.name} to include`);
    if (included.has(found)) return;
    included.add(found);
    flat.push(...flatten(found, files[found], files, pattern, included, false));
  });
  return flat;
}

function number(text, at) {
  const plain = text.trim();
  if (plain === "true" || plain === "false") return plain === "true" ? 1 : 0;
  const value = Number(plain.replace(/[uf]$/, ""));
  if (plain === "" || Number.isNaN(value)) fail(at, `${plain} is not a plain number`);
  return value;
}

function parameter(match, at, patterns) {
  const { type, name } = match.groups;
  if (!PARAMETER_TYPES.includes(type)) fail(at, `a parameter is ${PARAMETER_TYPES.join(", ")}, not ${type}`);
  const note = patterns.note.exec(match.groups.note || "");
  if (match.groups.default === undefined || !note || (type !== "bool" && !note.groups.low)) {
    fail(at, `${name} needs a default and a note: uniform ${type} ${name} = 1; //@ [0, 10] mm what it does`);
  }
  const low = note.groups.low ? number(note.groups.low, at) : 0;
  const high = note.groups.high ? number(note.groups.high, at) : 1;
  const value = number(match.groups.default, at);
  if (!(value >= low && value <= high)) fail(at, `the default ${value} of ${name} is outside [${low}, ${high}]`);
  const slider = patterns.slider.exec(note.groups.slider || "");
  const shown = slider && slider.groups.low !== undefined ? [number(slider.groups.low, at), number(slider.groups.high, at)] : null;
  return {
    name,
    type,
    default: value,
    low,
    high,
    unit: note.groups.unit,
    help: note.groups.help.trim(),
    slider: shown,
    log_scale: Boolean(slider?.groups.log),
    step: slider?.groups.step === undefined ? 0 : number(slider.groups.step, at),
  };
}

// The declarations of a flattened stage: parameters, reads, writes [name, type, scale], bound, sparse.
// What stands between #ifdef and #endif is left out: the page defines no constants.
export function describe(flat, patterns) {
  const found = { parameters: [], reads: [], writes: [], bound: [], sparse: false };
  let hidden = 0;
  for (const at of flat) {
    if (/^\s*#ifdef\b/.test(at.text)) hidden++;
    if (/^\s*#endif\b/.test(at.text) && hidden) hidden--;
    if (patterns.sparse.test(at.text)) found.sparse = true;
    if (hidden) continue;
    const uniform = patterns.uniform.exec(at.text),
      out = patterns.out.exec(at.text);
    if (uniform) {
      const { type, name } = uniform.groups;
      if (type === "sampler2D" && name.startsWith("u_")) found.reads.push(name.slice(2));
      else if (name.startsWith("u_")) found.bound.push(name);
      else found.parameters.push(parameter(uniform, at, patterns));
    } else if (out) {
      if (!(out.groups.type in LAYER_TYPES)) fail(at, `a written layer is float, vec2 or vec4, not ${out.groups.type}`);
      const scale = patterns.scale.exec(out.groups.rest);
      found.writes.push([out.groups.name, out.groups.type, scale ? scale.groups.scale : "1"]);
    } else if (patterns.unreadable.test(at.text)) {
      fail(at, "declare one uniform or layer a line");
    }
  }
  if (!found.writes.length) fail(flat[0], "the stage writes no layer: declare e.g. out float depth;");
  return found;
}

// GLSL ES 3.00 of a flattened stage: its version line and precise functions, no initialisers of uniforms, and locations of
// the outputs in the order of their declaration.
export function toWebgl(flat, writes, patterns) {
  const place = new Map(writes.map(([name], n) => [name, n]));
  const lines = flat.slice(1).map(({ text }) => {
    const uniform = patterns.uniform.exec(text),
      out = patterns.out.exec(text);
    if (uniform && uniform.groups.default !== undefined) return text.replace(/=[^;]*;/, ";");
    if (out && place.has(out.groups.name)) {
      return `layout(location = ${place.get(out.groups.name)}) ${text.replace(/^\s*layout\s*\([^)]*\)/, "").trim()}`;
    }
    return text;
  });
  return `${[...HEADER, ...lines].join("\n")}\n`;
}

// The driver's messages at the lines of the files. WebGL writes ERROR: 0:12: words.
export function locate(log, flat) {
  const problems = [];
  for (const match of log.matchAll(/ERROR: \d+:(\d+): ([^\n\0]*)/g)) {
    const at = flat[Number(match[1]) - HEADER.length] || flat[0];
    problems.push({ file: at.file, line: at.line, text: match[2] });
  }
  return problems.length ? problems : [{ file: flat[0].file, line: 1, text: log.trim() || "does not link" }];
}

export const components = (type) => LAYER_TYPES[type];

// Regular expressions of the patterns that Python writes.
export function compilePatterns(texts) {
  return Object.fromEntries(Object.entries(texts).map(([name, text]) => [name, new RegExp(text)]));
}
