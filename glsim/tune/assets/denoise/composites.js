// The composite "measured" of glsim/denoise/composites.py: the sensor's mask without flying pixels, unlikely
// rims and small holes. numbers: the constants of that module.

// The narrow holes of an image, 1 in them: nowhere wider than reach_px, and inside the image.
function narrowHoles(depth, width, height, reach) {
  const label = new Int32Array(depth.length).fill(-1),
    narrow = [];
  const empty = (x, y) => x < 0 || y < 0 || x >= width || y >= height || depth[y * width + x] === 0;
  // A hole as wide as the square of reach + 1 pixels around a pixel; places outside count as empty.
  const wide = (x, y) => {
    const from = -(reach >> 1);
    for (let v = from; v <= from + reach; v++) for (let u = from; u <= from + reach; u++) if (!empty(x + u, y + v)) return false;
    return true;
  };
  for (let start = 0; start < depth.length; start++) {
    if (depth[start] !== 0 || label[start] >= 0) continue;
    const stack = [start],
      own = narrow.length;
    narrow.push(1);
    label[start] = own;
    while (stack.length) {
      const i = stack.pop(),
        x = i % width,
        y = (i / width) | 0;
      if (x === 0 || y === 0 || x === width - 1 || y === height - 1 || wide(x, y)) narrow[own] = 0;
      for (const [u, v] of [
        [x - 1, y],
        [x + 1, y],
        [x, y - 1],
        [x, y + 1],
      ]) {
        const k = v * width + u;
        if (u >= 0 && v >= 0 && u < width && v < height && depth[k] === 0 && label[k] < 0) {
          label[k] = own;
          stack.push(k);
        }
      }
    }
  }
  return (i) => label[i] >= 0 && narrow[label[i]] === 1;
}

// A network's probability of depth, moved so that its bound for pixels beside holes is numbers.unlikely.
export function calibrated(probability, bound, { unlikely, doubt }) {
  const p = Math.min(Math.max(probability, 0), 1);
  if (p >= doubt) return p;
  return p <= bound ? (p * unlikely) / bound : unlikely + ((p - bound) * (doubt - unlikely)) / (doubt - bound);
}

// depth, probability: of the network, mm; noisy: its input, mm. Returns depth in mm, 0 = none.
export function measuredSurfaces(depth, probability, noisy, width, height, numbers) {
  const reach = numbers.reach_px,
    sure = (i) => probability[i] > numbers.doubt,
    tolerance = (mm) => numbers.same_surface_mm + numbers.same_surface_mm_per_m * 0.001 * mm;
  // Call visit(neighbour) for each pixel of the image within `far` pixels of pixel i.
  const around = (i, far, visit) => {
    const x = i % width,
      y = (i / width) | 0;
    for (let v = Math.max(0, y - far); v <= Math.min(height - 1, y + far); v++)
      for (let u = Math.max(0, x - far); u <= Math.min(width - 1, x + far); u++) if (u !== x || v !== y) visit(v * width + u);
  };
  const onSurface = (i) => {
    const allowed = tolerance(noisy[i]);
    let alike = 0,
      surely = 0,
      places = 0;
    around(i, reach, (k) => {
      places++;
      if (!(noisy[k] > 0) || Math.abs(noisy[k] - noisy[i]) > allowed) return;
      alike++;
      if (sure(k)) surely++;
    });
    return surely >= numbers.least_sure || alike >= numbers.least_patch * places;
  };
  const unlikely = (i) => {
    if (!(probability[i] > 0) || probability[i] > numbers.unlikely) return false;
    let beside = false;
    around(i, numbers.beside_px, (k) => {
      if (noisy[k] === 0) beside = true;
    });
    return beside;
  };
  const kept = Uint8Array.from(noisy, (mm, i) => (mm > 0 && !unlikely(i) && (sure(i) || onSurface(i)) ? 1 : 0)),
    narrow = narrowHoles(noisy, width, height, reach);
  const closes = (i) => {
    if (noisy[i] > 0 || !sure(i) || !(depth[i] > 0) || !narrow(i)) return false;
    const allowed = tolerance(depth[i]);
    let one = true,
      touching = 0;
    around(i, reach, (k) => {
      if (noisy[k] > 0 && Math.abs(noisy[k] - depth[i]) > allowed) one = false;
    });
    around(i, 1, (k) => {
      touching += kept[k];
    });
    return one && touching >= numbers.least_touching;
  };
  return Float32Array.from(noisy, (mm, i) => {
    if (kept[i]) return sure(i) || Math.abs(depth[i] - mm) <= tolerance(mm) ? depth[i] : mm;
    return closes(i) ? depth[i] : 0;
  });
}
