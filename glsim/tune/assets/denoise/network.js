// Runs a network of glsim on one map, as glsim/denoise/network.py does, by onnxruntime-web.

import { calibrated, measuredSurfaces } from "./composites.js";
import { isClean, trustedMask } from "./safeguards.js";

// Rows or columns of the box of what is seen, with a margin, on the grid of networks: [first, last).
function span(seen, size, marginPx, { grid_px }) {
  const first = seen.indexOf(1),
    last = seen.lastIndexOf(1) + 1;
  const begin = Math.floor(Math.max(0, first - marginPx) / grid_px) * grid_px;
  return [begin, Math.min(size, Math.ceil((last + marginPx) / grid_px) * grid_px)];
}

// The box of pixels that any image has, {left, top, width, height}; null without any.
function boxOf(images, width, height, marginPx, numbers) {
  const rows = new Array(height).fill(0),
    columns = new Array(width).fill(0);
  for (const image of images)
    for (let i = 0; i < image.length; i++) {
      if (!(image[i] > 0)) continue;
      rows[(i / width) | 0] = 1;
      columns[i % width] = 1;
    }
  if (!rows.includes(1)) return null;
  const [left, right] = span(columns, width, marginPx, numbers),
    [top, bottom] = span(rows, height, marginPx, numbers);
  return { left, top, width: right - left, height: bottom - top };
}

export class Network {
  // facts: {file, images: {input: number}, keep_clean, margin_px, unlikely} and `numbers`, the constants of glsim.denoise.
  constructor(facts, numbers) {
    this.facts = facts;
    this.numbers = numbers;
    // Fetched here, so that an answer of the server that is no network is told.
    this.session = fetch(facts.file).then(async (answer) => {
      if (!answer.ok) throw new Error(`${facts.file}: the server answers ${answer.status}`);
      return window.ort.InferenceSession.create(await answer.arrayBuffer(), { executionProviders: ["wasm"] });
    });
    this.session.catch(() => {}); // told when it is used
  }

  // inputs: {name: images, in float32}, fewer of them than the network takes are filled up with zeros;
  // noisy_mm holds the frame. Returns {depth, unchanged}: mm, 0 = none; and whether it has no noise.
  async denoise(inputs, width, height) {
    const [noisy] = inputs.noisy_mm,
      { numbers } = this,
      { keep_clean, margin_px, unlikely } = this.facts,
      box = boxOf(Object.values(inputs).flat(), width, height, margin_px, numbers);
    if (!box || (keep_clean && isClean(noisy, width, height, numbers.safeguards))) return { depth: noisy.slice(), unchanged: true };
    const outputs = await this._run(inputs, width, box);
    const whole = (name, change) => {
      const image = new Float32Array(width * height);
      for (let y = 0, i = 0; y < box.height; y++)
        for (let x = 0; x < box.width; x++, i++) image[(y + box.top) * width + x + box.left] = change(outputs[name][i]);
      return image;
    };
    const risk = outputs.risk_mm && whole("risk_mm", (mm) => mm),
      trusted = trustedMask(noisy, risk, width, height, numbers.safeguards),
      probability = whole("probability", (p) => calibrated(p, unlikely, numbers.composites)).map((p, i) =>
        trusted[i] || (noisy[i] > 0 && p <= numbers.composites.unlikely) ? p : 0,
      ),
      depth = whole("depth_mm", (mm) => Math.max(mm, 0));
    return { depth: measuredSurfaces(depth, probability, noisy, width, height, numbers.composites), unchanged: false };
  }

  // The outputs of a box of the inputs, {name: float32 of the box}.
  async _run(inputs, width, box) {
    const session = await this.session,
      { size_multiple_px } = this.numbers,
      padded = [box.height, box.width].map((size) => Math.ceil(size / size_multiple_px) * size_multiple_px),
      [rows, columns] = padded,
      feeds = {};
    for (const [name, count] of Object.entries(this.facts.images)) {
      const data = new Float32Array(count * rows * columns);
      (inputs[name] || []).slice(0, count).forEach((image, n) => {
        for (let y = 0; y < box.height; y++) {
          const at = (y + box.top) * width + box.left;
          data.set(image.subarray(at, at + box.width), (n * rows + y) * columns);
        }
      });
      feeds[name] = new window.ort.Tensor("float32", data, [1, count, rows, columns]);
    }
    const found = await session.run(feeds),
      outputs = {};
    for (const [name, { data }] of Object.entries(found)) {
      const image = new Float32Array(box.width * box.height);
      for (let y = 0; y < box.height; y++) image.set(data.subarray(y * columns, y * columns + box.width), y * box.width);
      if (!image.every(Number.isFinite)) throw new Error("the network returns no numbers: its weights are damaged");
      outputs[name] = image;
    }
    return outputs;
  }
}
