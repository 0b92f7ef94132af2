// Images of a picture's layers on 2D canvases with a common zoom, cursor and profile line.

import { DEPTH, GREY, REASON_WORDS, SIGNED, word } from "./maps.js";
import { alike } from "./packet.js";

const EMPTY = word([27, 30, 36]);

const LAYERS_OF = { difference: ["clean", "noisy"] };

// The range of depths that is worth colours: from the nearest to the farthest clean surface.
export function depthRange(picture) {
  const clean = picture.layers.clean;
  let low = 65535,
    high = 0;
  for (let i = 0; i < clean.length; i++) {
    const depth = clean[i];
    if (depth > 0) {
      if (depth < low) low = depth;
      if (depth > high) high = depth;
    }
  }
  return low < high ? [low, high] : [0, 1];
}

export function brightestOf(infrared) {
  let brightest = 1;
  for (let i = 0; i < infrared.length; i++) if (infrared[i] > brightest) brightest = infrared[i];
  return brightest;
}

// One RGBA word per pixel of the window.
export function paint(picture, kind, range, differenceMm, words) {
  const { clean, noisy, infrared, reason } = picture.layers;
  const [low, high] = range;
  const depthScale = 255 / Math.max(high - low, 1);
  const unit = picture.head.depth_unit_mm;
  if (kind === "clean" || kind === "noisy") {
    const depth = kind === "clean" ? clean : noisy;
    for (let i = 0; i < depth.length; i++) {
      const d = depth[i];
      words[i] = d === 0 ? EMPTY : DEPTH[Math.max(0, Math.min(255, ((d - low) * depthScale) | 0))];
    }
  } else if (kind === "difference") {
    const scale = (127.5 * unit) / differenceMm;
    for (let i = 0; i < clean.length; i++) {
      if (clean[i] === 0 || noisy[i] === 0) {
        words[i] = EMPTY;
        continue;
      }
      const at = 127.5 + (noisy[i] - clean[i]) * scale;
      words[i] = SIGNED[at < 0 ? 0 : at > 255 ? 255 : at | 0];
    }
  } else if (kind === "reason") {
    for (let i = 0; i < reason.length; i++) words[i] = REASON_WORDS[reason[i]];
  } else {
    const brightest = brightestOf(infrared);
    // A square root: the face and the dark background are both visible.
    for (let i = 0; i < infrared.length; i++) {
      words[i] = GREY[(255 * Math.sqrt(infrared[i] / brightest)) | 0];
    }
  }
}

export class LayerImage {
  // canvas: element to draw on; kind: clean, noisy, difference, reason or infrared.
  constructor(canvas, kind) {
    this.canvas = canvas;
    this.kind = kind;
    this.source = document.createElement("canvas");
    this.pixels = null;
  }

  set(picture, range, differenceMm) {
    const { width, height } = picture;
    const scale = this.kind === "difference" ? differenceMm : String(range);
    const before = this.picture;
    this.picture = picture;
    if (scale === this.scale && alike(before, picture, LAYERS_OF[this.kind] || [this.kind])) return;
    this.scale = scale;
    if (this.source.width !== width || this.source.height !== height || !this.pixels) {
      this.source.width = width;
      this.source.height = height;
      this.pixels = this.source.getContext("2d").createImageData(width, height);
    }
    paint(picture, this.kind, range, differenceMm, new Uint32Array(this.pixels.data.buffer));
    this.source.getContext("2d").putImageData(this.pixels, 0, 0);
  }

  // view: {x, y, scale}: frame pixel at the middle of the canvas, and its size on the screen.
  // other: the same layer of setting B, drawn to the right of the share `split` of the width.
  draw(view, cursor, line, other, split) {
    const { canvas } = this,
      ratio = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * ratio);
    const height = Math.round(canvas.clientHeight * ratio);
    if (!width || !height || !this.picture) return;
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
    const c = canvas.getContext("2d");
    const scale = view.scale * ratio;
    const toX = (x) => width / 2 + (x - view.x) * scale;
    const toY = (y) => height / 2 + (y - view.y) * scale;
    c.imageSmoothingEnabled = false;
    c.fillStyle = "#1b1e24";
    c.fillRect(0, 0, width, height);
    const put = (image) => {
      const q = image.picture;
      c.drawImage(image.source, toX(q.left), toY(q.top), q.width * scale, q.height * scale);
    };
    put(this);
    if (other?.picture) {
      const at = Math.round(split * width);
      c.save();
      c.beginPath();
      c.rect(at, 0, width - at, height);
      c.clip();
      c.fillRect(0, 0, width, height);
      put(other);
      c.restore();
      c.fillStyle = "#ffffff";
      c.fillRect(at, 0, ratio, height);
      c.font = `${11 * ratio}px system-ui, sans-serif`;
      c.textAlign = "right";
      c.fillText("A", at - 5 * ratio, height - 6 * ratio);
      c.textAlign = "left";
      c.fillText("B", at + 5 * ratio, height - 6 * ratio);
    }
    if (line) {
      c.strokeStyle = "#ffffff";
      c.lineWidth = ratio;
      c.beginPath();
      c.moveTo(toX(line[0] + 0.5), toY(line[1] + 0.5));
      c.lineTo(toX(line[2] + 0.5), toY(line[3] + 0.5));
      c.stroke();
    }
    if (cursor) {
      const size = Math.max(scale, 6 * ratio);
      const x = toX(cursor[0] + 0.5),
        y = toY(cursor[1] + 0.5);
      c.strokeStyle = "#000000";
      c.lineWidth = 3 * ratio;
      c.strokeRect(x - size / 2, y - size / 2, size, size);
      c.strokeStyle = "#ffffff";
      c.lineWidth = ratio;
      c.strokeRect(x - size / 2, y - size / 2, size, size);
    }
  }
}
