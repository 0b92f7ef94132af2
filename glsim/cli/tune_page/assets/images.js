// Images of a picture's layers on 2D canvases with a common zoom, cursor and profile line.

import { DEPTH, DISPARITY, GREY, REASON_WORDS, SIGNED, word } from "./maps.js";

const EMPTY = word([27, 30, 36]);

// The smallest and the largest value above 0 of the pixels that `counts` accepts; from 0 without two.
function rangeOf(values, counts = () => true) {
  let low = Infinity,
    high = 0;
  for (let i = 0; i < values.length; i++) {
    const value = values[i];
    if (value > 0 && counts(i)) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  return low < high ? [low, high] : [0, Math.max(high, 1)];
}

// The values at the ends of the colours of all layers: {kind: [low, high]}. Depths reach from the nearest to
// the farthest clean surface, disparities over the pixels that found the right one.
export function endsOf(picture, differenceMm) {
  const { clean, reason, infrared, infrared_right: right, disparity } = picture.layers;
  const depths = rangeOf(clean),
    brightest = (image) => (image ? rangeOf(image)[1] : 0),
    light = [0, Math.max(brightest(infrared), brightest(right))];
  return {
    clean: depths,
    noisy: depths,
    difference: [-differenceMm, differenceMm],
    infrared: light,
    infrared_right: light,
    disparity: disparity && rangeOf(disparity, (i) => reason[i] === 0),
  };
}

// One RGBA word per pixel of the window. ends: of `endsOf`; reasons have none.
export function paint(picture, kind, ends, words) {
  const { clean, noisy, reason } = picture.layers;
  const [low, high] = ends || [0, 1];
  if (kind === "clean" || kind === "noisy" || kind === "disparity") {
    const values = picture.layers[kind],
      colours = kind === "disparity" ? DISPARITY : DEPTH,
      scale = 255 / (high - low);
    for (let i = 0; i < values.length; i++) {
      const v = values[i];
      words[i] = v === 0 ? EMPTY : colours[Math.max(0, Math.min(255, ((v - low) * scale) | 0))];
    }
  } else if (kind === "difference") {
    const scale = (127.5 * picture.head.depth_unit_mm) / high;
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
    const counts = picture.layers[kind];
    // A square root: the face and the dark background are both visible.
    for (let i = 0; i < counts.length; i++) {
      words[i] = GREY[(255 * Math.sqrt(Math.min(counts[i] / high, 1))) | 0];
    }
  }
}

export class LayerImage {
  // canvas: element to draw on; kind: a layer of the picture, or difference.
  constructor(canvas, kind) {
    this.canvas = canvas;
    this.kind = kind;
    this.source = document.createElement("canvas");
    this.pixels = null;
  }

  // Take a picture, or null. ends: of `endsOf`.
  set(picture, ends) {
    this.picture = picture;
    if (!picture) return;
    const { width, height } = picture;
    if (this.source.width !== width || this.source.height !== height || !this.pixels) {
      this.source.width = width;
      this.source.height = height;
      this.pixels = this.source.getContext("2d").createImageData(width, height);
    }
    paint(picture, this.kind, ends, new Uint32Array(this.pixels.data.buffer));
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
