// Paints depth maps as points without WebGL, for browsers that have no GPU: a software rasteriser
// takes 2 us a triangle, a square of pixels with its own depth test a tenth of that.

export class PointPainter {
  constructor(context) {
    this.context = context;
    this.clouds = [];
    this.pixels = null;
  }

  // maps: the depth maps of a picture, in the order of painting. grid: {step, jump}: pixels between
  // points, and the depth ratio that cuts. A point is the first corner of a quad of one surface.
  // kept: per map, whether it is the last one.
  set(picture, maps, { step, jump }, kept) {
    const { width, height, left, top } = picture;
    const [fx, fy] = picture.head.focal_px,
      [cx, cy] = picture.head.centre_px;
    const unit = picture.head.depth_unit_mm / 1000;
    const most = Math.ceil(width / step) * Math.ceil(height / step);
    this.gap = step / Math.min(fx, fy); // between points at 1 m
    this.clouds = maps.map((depth, n) => {
      if (kept[n]) return this.clouds[n];
      const cloud = this.clouds[n]?.values.length >= 6 * most ? this.clouds[n] : { values: new Float32Array(6 * most), count: 0 };
      const { values } = cloud;
      let at = 0;
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
          const za = a * unit,
            zb = b * unit,
            zc = c * unit,
            zd = d * unit;
          const u = (x + left + 0.5 - cx) / fx,
            beside = (x + step + left + 0.5 - cx) / fx;
          const px = u * za,
            py = v * za;
          // The normal: one diagonal of the quad times the other.
          const rx = beside * zd - px,
            ry = below * zd - py,
            rz = zd - za;
          const dx = u * zc - beside * zb,
            dy = below * zc - v * zb,
            dz = zc - zb;
          const nx = ry * dz - rz * dy,
            ny = rz * dx - rx * dz,
            nz = rx * dy - ry * dx;
          const size = 1 / Math.sqrt(nx * nx + ny * ny + nz * nz);
          values[at] = px;
          values[at + 1] = py;
          values[at + 2] = za;
          values[at + 3] = nx * size;
          values[at + 4] = ny * size;
          values[at + 5] = nz * size;
          at += 6;
        }
      }
      cloud.count = at;
      return cloud;
    });
  }

  // Arguments as those of MeshPainter.draw.
  draw(width, height, view, background, layers) {
    if (this.pixels?.width !== width || this.pixels.height !== height) {
      this.pixels = this.context.createImageData(width, height);
      this.words = new Uint32Array(this.pixels.data.buffer);
      this.near = new Float32Array(width * height);
    }
    this.words.fill((0xff000000 | (background[2] << 16) | (background[1] << 8) | background[0]) >>> 0);
    this.near.fill(Infinity);
    for (const [n, layer] of layers.entries()) this._paint(this.clouds[n], width, height, view, ...layer);
    this.context.putImageData(this.pixels, 0, 0);
  }

  _paint({ values, count }, width, height, view, [red, green, blue], opacity) {
    const { words, near } = this,
      [ox, oy, oz] = view.centre,
      t = view.turn;
    // The light of the mesh's shader, (-0.4, -0.5, -0.8) normed, in the axes of the points.
    const [lx, ly, lz] = [0, 3, 6].map((c) => -0.3904 * t[c] - 0.488 * t[c + 1] - 0.7807 * t[c + 2]);
    const scale = (view.zoom * height) / 2,
      left = 1 - opacity;
    for (let i = 0; i < count; i += 6) {
      const px = values[i] - ox,
        py = values[i + 1] - oy,
        pz = values[i + 2] - oz;
      const far = t[2] * px + t[5] * py + t[8] * pz + view.distance;
      if (far < 0.05) continue;
      const grow = scale / far;
      const side = Math.min(8, Math.ceil(this.gap * values[i + 2] * grow * 1.2));
      const x0 = Math.round(width / 2 + (t[0] * px + t[3] * py + t[6] * pz) * grow - side / 2);
      const y0 = Math.round(height / 2 + (t[1] * px + t[4] * py + t[7] * pz) * grow - side / 2);
      if (x0 < 0 || y0 < 0 || x0 + side > width || y0 + side > height) continue;
      const light = 0.25 + 0.75 * Math.abs(lx * values[i + 3] + ly * values[i + 4] + lz * values[i + 5]);
      const r = red * light,
        g = green * light,
        b = blue * light;
      for (let y = y0; y < y0 + side; y++) {
        for (let k = y * width + x0, end = k + side; k < end; k++) {
          if (far >= near[k]) continue;
          near[k] = far;
          const old = words[k];
          words[k] =
            (0xff000000 |
              ((b * opacity + ((old >> 16) & 255) * left) << 16) |
              ((g * opacity + ((old >> 8) & 255) * left) << 8) |
              (r * opacity + (old & 255) * left)) >>>
            0;
        }
      }
    }
  }
}
