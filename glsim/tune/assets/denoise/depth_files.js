// The visitor's files as depth maps: PNG of 16 bits and .npy, as glsim/map_files.py reads them.

import { decodePng } from "./png.js";

const NPY = "\x93NUMPY";
const READERS = {
  u2: ["getUint16", 2],
  f4: ["getFloat32", 4],
  f8: ["getFloat64", 8],
};
// Floats are metres up to the depth of 16-bit millimetres.
const FAR_M = 65.535;

// {width, height, values, floats} of a .npy file's bytes. Throws Error.
function decodeNpy(file, mostPixels) {
  if (String.fromCharCode(...file.subarray(0, 6)) !== NPY) throw new Error("is no .npy file");
  const view = new DataView(file.buffer, file.byteOffset, file.byteLength),
    late = file[6] > 1,
    begin = late ? 12 : 10,
    end = begin + (late ? view.getUint32(8, true) : view.getUint16(8, true));
  const text = String.fromCharCode(...file.subarray(begin, Math.min(end, begin + 4096)));
  const [, order, type] = /'descr': '([<>|=]?)(\w+)'/.exec(text) || [],
    shape = (/'shape': \(([\d, ]*)\)/.exec(text)?.[1] ?? "")
      .split(",")
      .filter((n) => n.trim())
      .map(Number);
  if (!(type in READERS) || shape.length !== 2) throw new Error("is no depth map: it needs (H, W) of uint16 or float metres");
  if (text.includes("'fortran_order': True")) throw new Error("is in Fortran order: save it with numpy.ascontiguousarray");
  const [height, width] = shape,
    [read, bytes] = READERS[type];
  if (width * height > mostPixels) throw new Error(`has ${width} x ${height} pixels, more than ${mostPixels}`);
  if (file.length < end + bytes * width * height) throw new Error("is cut off");
  const values = new (type === "u2" ? Uint16Array : Float32Array)(width * height);
  for (let i = 0; i < values.length; i++) values[i] = view[read](end + bytes * i, order !== ">");
  return { width, height, values, floats: type !== "u2" };
}

// {name, width, height, values, floats, stated}: stated is the file's own step in mm, or 0. Throws Error
// that names the file. keyword: of the text chunk with the step.
export async function readMap(file, keyword, mostPixels) {
  try {
    const bytes = new Uint8Array(await file.arrayBuffer()),
      npy = file.name.toLowerCase().endsWith(".npy"),
      map = npy ? decodeNpy(bytes, mostPixels) : await decodePng(bytes, mostPixels);
    return { ...map, name: file.name, floats: Boolean(map.floats), stated: Number(map.texts?.[keyword]) || 0 };
  } catch (error) {
    throw new Error(`${file.name}: ${error.message}`);
  }
}

// Depth in float32 millimetres, 0 = none. step: mm of whole numbers. Throws Error for millimetres as floats.
export function millimetres(map, step) {
  const depth = new Float32Array(map.values.length),
    unit = Math.fround(map.floats ? 1000 : map.stated || step);
  for (let i = 0; i < depth.length; i++) {
    const value = map.values[i];
    if (!(value > 0 && value < Infinity)) continue;
    if (map.floats && value > FAR_M) throw new Error(`${map.name}: floats are metres, and this has ${value.toFixed(0)}: divide it by 1000`);
    depth[i] = Math.fround(value * unit);
  }
  return depth;
}

const INFRARED = /_(infrared|ir)$/i;
const stem = (name) => name.replace(/\.\w+$/, "");

// Order depth maps as a sequence (frame_9 before frame_10); infrared images beside them are left out.
export function arrange(maps) {
  const depths = maps.filter((map) => !INFRARED.test(stem(map.name)));
  return depths.sort((a, b) => a.name.localeCompare(b.name, undefined, { numeric: true }));
}

// Whole steps of depth, halves to even as NumPy rounds; nothing but 0 becomes 0. Throws Error beyond 16 bits.
export function wholeSteps(depth, step) {
  const scale = Math.fround(1000 / step);
  return Uint16Array.from(depth, (mm) => {
    if (mm <= 0) return 0;
    const exact = Math.fround(Math.fround(mm * Math.fround(0.001)) * scale),
      low = Math.floor(exact),
      steps = exact - low < 0.5 || (exact - low === 0.5 && low % 2 === 0) ? low : low + 1;
    if (steps > 65535) throw new Error(`a depth of ${mm.toFixed(0)} mm does not fit 16 bits in steps of ${step} mm`);
    return Math.max(steps, 1);
  });
}
