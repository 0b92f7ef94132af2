// What glsim/denoise/safeguards.py does: frames without noise stay as they are, and pixels between
// two surfaces or far from measured ones are not trusted. numbers: the constants of that module.

// For each pixel the smallest or largest value within `reach` pixels, inside the image. pick: Math.min or max.
function within(image, width, height, reach, pick) {
  const rows = new Float32Array(image.length),
    out = new Float32Array(image.length);
  for (let y = 0, i = 0; y < height; y++)
    for (let x = 0; x < width; x++, i++) {
      let value = image[i];
      for (let k = Math.max(0, x - reach); k <= Math.min(width - 1, x + reach); k++) value = pick(value, image[i - x + k]);
      rows[i] = value;
    }
  for (let y = 0, i = 0; y < height; y++)
    for (let x = 0; x < width; x++, i++) {
      let value = rows[i];
      for (let k = Math.max(0, y - reach); k <= Math.min(height - 1, y + reach); k++) value = pick(value, rows[k * width + x]);
      out[i] = value;
    }
  return out;
}

// Standard deviation of the noise between every step-th pixel, mm; null with too few surfaces.
export function estimateNoise(depth, width, height, step, numbers) {
  const low = within(depth, width, height, step, Math.min),
    high = within(depth, width, height, step, Math.max);
  let roots = 0,
    windows = 0;
  for (let y = step; y < height - step; y++)
    for (let x = step; x < width - step; x++) {
      const i = y * width + x;
      if (!(depth[i] > 0) || high[i] - low[i] >= numbers.edge_mm * step) continue;
      const [up, down] = [i - step * width, i + step * width];
      const bend =
        depth[up - step] +
        depth[up + step] +
        depth[down - step] +
        depth[down + step] +
        4 * depth[i] -
        2 * (depth[up] + depth[down] + depth[i - step] + depth[i + step]);
      roots += Math.sqrt(Math.abs(bend));
      windows++;
    }
  return windows < numbers.least_windows ? null : (roots / windows / numbers.mean_root) ** 2 / numbers.gain;
}

// The step of a map's values, mm, at most 1.
export function valueStep(depth, numbers) {
  const sorted = depth.filter((d) => d > 0).sort();
  let step = 1;
  for (let i = 1; i < sorted.length; i++) {
    const gap = sorted[i] - sorted[i - 1];
    if (gap > numbers.same_mm && gap < step) step = gap;
  }
  return step;
}

// Whether noise moves pixels between two of one depth across the border of a step.
function isDithered(depth, width, height, step, numbers) {
  if (step < numbers.dither_least_mm) return false;
  let places = 0,
    dithered = 0,
    measured = 0;
  for (let y = 0, i = 0; y < height; y++)
    for (let x = 0; x < width; x++, i++) {
      if (!(depth[i] > 0)) continue;
      measured++;
      for (const by of [x > 0 && x < width - 1 && 1, y > 0 && y < height - 1 && width]) {
        if (!by || depth[i - by] !== depth[i + by] || !(depth[i - by] > 0)) continue;
        const apart = Math.abs(depth[i] - depth[i - by]);
        if (apart >= numbers.dither_steps * step) continue;
        places++;
        if (apart > numbers.same_mm) dithered++;
      }
    }
  const side = Math.sqrt(measured);
  return dithered > numbers.dither_side * side && dithered ** 2 > numbers.dither_density * side * places;
}

// Whether rounding and the form of surfaces explain all noise of a map.
export function isClean(depth, width, height, numbers) {
  const [near, far, farther] = [1, 2, 4].map((step) => () => estimateNoise(depth, width, height, step, numbers));
  const nearMm = near(),
    farMm = far(),
    [nearMost, farMost] = numbers.clean_mm;
  if (nearMm === null || farMm === null || nearMm >= nearMost || farMm >= farMost) return false;
  const step = valueStep(depth, numbers);
  if (isDithered(depth, width, height, step, numbers)) return false;
  if (nearMm < nearMost * step && farMm < farMost * step) return true;
  const fartherMm = farther();
  if (fartherMm === null) return true;
  const rounding = step ** 2 / 12,
    least = numbers.form_growth.find(([most]) => step <= most + numbers.same_mm)[1];
  return fartherMm ** 2 - rounding >= least ** 2 * (nearMm ** 2 - rounding);
}

// 1 where the network's depth is trusted: near measured depth, and of a low risk (or no risk is known).
export function trustedMask(depth, risk, width, height, numbers) {
  const measured = Float32Array.from(depth, (d) => (d > 0 ? 1 : 0)),
    near = within(measured, width, height, numbers.reach_px, Math.max);
  return Uint8Array.from(near, (n, i) =>
    n && (!risk || risk[i] < (measured[i] ? numbers.measured_risk_mm : numbers.hole_risk_mm)) ? 1 : 0,
  );
}
