// The noisy surface in 3D, cut at jumps, with the clean one as a ghost over it. Points are painted on
// a 2D canvas: a browser without a GPU takes 2 us for a triangle of WebGL, a tenth of that for a
// square of pixels with its own depth test.

// Most points of a surface.
const MOST_POINTS = 60000;
const BACKGROUND = 0xff241e1b; // RGBA word, little-endian
const SOLID = [[219, 214, 204], 1],
  GHOST = [[87, 156, 217], 0.3];

export class Surface {
  constructor(canvas) {
    Object.assign(this, { canvas, yaw: 0.5, pitch: 0.2, zoom: 1, ghost: true, clouds: [] });
    this.context = canvas.getContext("2d");
    canvas.addEventListener("pointerdown", (e) => {
      this.held = [e.clientX, e.clientY];
      canvas.setPointerCapture(e.pointerId);
    });
    canvas.addEventListener("pointerup", () => {
      this.held = null;
    });
    canvas.addEventListener("pointermove", (e) => {
      if (!this.held) return;
      this.turn((e.clientX - this.held[0]) * 0.01, (e.clientY - this.held[1]) * 0.01);
      this.held = [e.clientX, e.clientY];
    });
    canvas.addEventListener(
      "wheel",
      (e) => {
        e.preventDefault();
        this.zoom = Math.min(8, Math.max(0.3, this.zoom * Math.exp(-e.deltaY * 0.001)));
        this.draw();
      },
      { passive: false },
    );
    canvas.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[e.key];
      if (!step) return;
      e.preventDefault();
      this.turn(...step);
    });
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.max(-1.5, Math.min(1.5, this.pitch + pitch));
    this.draw();
  }

  set(picture) {
    this.clouds = ["noisy", "clean"].map((name) => cloudOf(picture, name));
    this._measure(picture);
    this.draw();
  }

  // The middle and the size of the nearest 600 mm of clean surface: the person, not the wall.
  _measure(picture) {
    const depth = picture.layers.clean,
      unit = picture.head.depth_unit_mm;
    let low = 65535;
    for (let i = 0; i < depth.length; i++) if (depth[i] > 0 && depth[i] < low) low = depth[i];
    let left = 1e9,
      right = -1,
      top = 1e9,
      bottom = -1;
    for (let i = 0; i < depth.length; i += 3) {
      if (depth[i] === 0 || (depth[i] - low) * unit > 600) continue;
      const x = i % picture.width,
        y = (i / picture.width) | 0;
      left = Math.min(left, x);
      right = Math.max(right, x);
      top = Math.min(top, y);
      bottom = Math.max(bottom, y);
    }
    if (right < 0) return;
    const z = (low * unit + 80) / 1000;
    const [fx, fy] = picture.head.focal_px,
      [cx, cy] = picture.head.centre_px;
    this.centre = [(((left + right) / 2 + picture.left - cx) / fx) * z, (((top + bottom) / 2 + picture.top - cy) / fy) * z, z];
    this.radius = 0.42 * Math.max((right - left) / fx, (bottom - top) / fy) * z + 0.05;
  }

  draw() {
    const { canvas } = this;
    if (!this.centre || !canvas.clientWidth) return;
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * ratio),
      height = Math.round(canvas.clientHeight * ratio);
    if (this.pixels?.width !== width || this.pixels.height !== height) {
      Object.assign(canvas, { width, height });
      this.pixels = this.context.createImageData(width, height);
      this.words = new Uint32Array(this.pixels.data.buffer);
      this.near = new Float32Array(width * height);
    }
    this.words.fill(BACKGROUND);
    this.near.fill(Infinity);
    this._paint(this.clouds[0], ...SOLID);
    if (this.ghost) this._paint(this.clouds[1], ...GHOST);
    this.context.putImageData(this.pixels, 0, 0);
  }

  _paint({ values, count, gap }, [red, green, blue], opacity) {
    const { words, near } = this,
      { width, height } = this.pixels,
      [ox, oy, oz] = this.centre;
    const [sy, cy, sx, cx] = [Math.sin(this.yaw), Math.cos(this.yaw), Math.sin(this.pitch), Math.cos(this.pitch)];
    const t = [cy, sx * sy, -cx * sy, 0, cx, sx, sy, -sx * cy, cx * cy]; // column after column
    const distance = 4 * this.radius,
      scale = ((4 * this.zoom) / 1.15) * (height / 2),
      left = 1 - opacity;
    // Light from (-0.4, -0.5, -0.8), normed, in the axes of the points.
    const [lx, ly, lz] = [0, 3, 6].map((c) => -0.3904 * t[c] - 0.488 * t[c + 1] - 0.7807 * t[c + 2]);
    for (let i = 0; i < count; i += 6) {
      const px = values[i] - ox,
        py = values[i + 1] - oy,
        pz = values[i + 2] - oz;
      const far = t[2] * px + t[5] * py + t[8] * pz + distance;
      if (far < 0.05) continue;
      const grow = scale / far;
      const side = Math.min(8, Math.ceil(gap * values[i + 2] * grow * 1.2));
      const x0 = Math.round(width / 2 + (t[0] * px + t[3] * py + t[6] * pz) * grow - side / 2);
      const y0 = Math.round(height / 2 + (t[1] * px + t[4] * py + t[7] * pz) * grow - side / 2);
      if (x0 < 0 || y0 < 0 || x0 + side > width || y0 + side > height) continue;
      const light = 0.25 + 0.75 * Math.abs(lx * values[i + 3] + ly * values[i + 4] + lz * values[i + 5]);
      const own = opacity * light,
        r = red * own,
        g = green * own,
        b = blue * own;
      for (let y = y0; y < y0 + side; y++) {
        for (let k = y * width + x0, end = k + side; k < end; k++) {
          if (far >= near[k]) continue;
          near[k] = far;
          const old = words[k];
          words[k] =
            (0xff000000 | ((b + ((old >> 16) & 255) * left) << 16) | ((g + ((old >> 8) & 255) * left) << 8) | (r + (old & 255) * left)) >>>
            0;
        }
      }
    }
  }
}

// The points of a depth layer: {values: x, y, z (metres) and normal of each, count of the values, gap
// between points at 1 m}. A point is the first corner of a quad whose corners are one surface.
function cloudOf(picture, name) {
  const { width, height, left, top } = picture,
    depth = picture.layers[name];
  const [fx, fy] = picture.head.focal_px,
    [cx, cy] = picture.head.centre_px;
  const unit = picture.head.depth_unit_mm / 1000;
  const step = Math.max(1, Math.ceil(Math.sqrt((width * height) / MOST_POINTS)));
  // A surface is cut where it is steeper than 83 degrees, and noise alone does not cut it.
  const jump = 1 + Math.max(0.02, (8 * step) / fx);
  const values = new Float32Array(6 * Math.ceil(width / step) * Math.ceil(height / step));
  let count = 0;
  for (let y = 0; y + step < height; y += step) {
    const v = (y + top + 0.5 - cy) / fy,
      below = (y + step + top + 0.5 - cy) / fy;
    for (let x = 0; x + step < width; x += step) {
      const i = y * width + x,
        under = i + step * width;
      const a = depth[i],
        b = depth[i + step],
        c = depth[under],
        d = depth[under + step];
      const low = Math.min(a, b, c, d);
      if (low === 0 || Math.max(a, b, c, d) > low * jump) continue;
      const u = (x + left + 0.5 - cx) / fx,
        beside = (x + step + left + 0.5 - cx) / fx;
      // The normal: one diagonal of the quad times the other.
      const rx = beside * d - u * a,
        ry = below * d - v * a,
        rz = d - a;
      const dx = u * c - beside * b,
        dy = below * c - v * b,
        dz = c - b;
      const nx = ry * dz - rz * dy,
        ny = rz * dx - rx * dz,
        nz = rx * dy - ry * dx;
      const size = 1 / Math.sqrt(nx * nx + ny * ny + nz * nz);
      values[count] = u * a * unit;
      values[count + 1] = v * a * unit;
      values[count + 2] = a * unit;
      values[count + 3] = nx * size;
      values[count + 4] = ny * size;
      values[count + 5] = nz * size;
      count += 6;
    }
  }
  return { values, count, gap: step / Math.min(fx, fy) };
}
