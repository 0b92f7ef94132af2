// A picture from the chain's layers, and its figures: what glsim.frame_assembly and
// glsim.tune.statistics do in Python.

const FACE_MM = 250,
  DISTANCE_MM = 20,
  ANGLE_DEG = 10,
  LEAST = 30,
  SURFACE_MM = 50,
  BINS = 40,
  LAGS = 8;

// Round to the nearest integer, halves to even, as NumPy does.
function rint(x) {
  const low = Math.floor(x),
    part = x - low;
  return part < 0.5 || (part === 0.5 && low % 2 === 0) ? low : low + 1;
}

function encodeDepth(metres) {
  return Uint16Array.from(metres, (d) => (d > 0 ? Math.min(Math.max(rint(Math.fround(d * 1000)), 1), 65535) : 0));
}

// Reason codes that agree with the depth. reasons: [{name, has_depth}] in the order of the codes.
function reconcile(clean, depth, reason, reasons) {
  const code = (name) => reasons.findIndex((r) => r.name === name);
  const [valid, none, dropped, grown] = ["VALID", "NO_SURFACE", "DROPPED", "GROWN"].map(code);
  return Uint8Array.from(reason, (r, i) => {
    let c = rint(r);
    if (!(c >= 0 && c < reasons.length)) c = dropped;
    const expects = reasons[c].has_depth,
      has = depth[i] > 0,
      surface = clean[i] > 0;
    if (!has && expects) c = surface ? dropped : none;
    if (has && !expects) c = valid;
    return has && c === valid && !surface ? grown : c;
  });
}

// layers: float32 clean, depth, reason and infrared (or null) of `window`.
export function pictureOf(rig, window, layers, reasons) {
  const [left, top, width, height] = window;
  const { clean, depth, reason, infrared } = layers;
  return {
    left,
    top,
    width,
    height,
    head: { width: rig.width, height: rig.height, focal_px: rig.focal_px, centre_px: rig.centre_px, depth_unit_mm: 1 },
    layers: {
      clean: encodeDepth(clean),
      noisy: encodeDepth(depth),
      reason: reconcile(clean, depth, reason, reasons),
      infrared: Uint16Array.from(infrared || clean, (v) => (infrared ? Math.max(0, Math.min(65535, rint(v))) : 0)),
    },
  };
}

const spread = (values, mean) => Math.sqrt(values.reduce((sum, v) => sum + (v - mean) ** 2, 0) / values.length);
const average = (values) => values.reduce((sum, v) => sum + v, 0) / values.length;
const known = (value) => (Number.isFinite(value) ? value : null);

// [middle of the bin, standard deviation of the error, pixels] of each bin with enough pixels.
function byBins(places, errors, width) {
  const bins = new Map();
  places.forEach((at, i) => {
    const n = Math.floor(at / width),
      bin = bins.get(n) || [0, 0, 0];
    bin[0]++;
    bin[1] += errors[i];
    bin[2] += errors[i] ** 2;
    bins.set(n, bin);
  });
  return [...bins]
    .filter(([, [count]]) => count >= LEAST)
    .sort(([a], [b]) => a - b)
    .map(([n, [count, sum, squares]]) => [(n + 0.5) * width, Math.sqrt(Math.max(squares / count - (sum / count) ** 2, 0)), count]);
}

// Bins are some whole units of depth wide, as in glsim.tune.statistics.
function histogram(values, unit) {
  if (values.length < LEAST) return { low_mm: -1, high_mm: 1, counts: [] };
  const sorted = Float64Array.from(values).sort(),
    middle = sorted[sorted.length >> 1];
  const away = Float64Array.from(sorted, (v) => Math.abs(v - middle)).sort();
  const wanted = Math.max(4 * 1.4826 * away[away.length >> 1], 0.5);
  const width = unit * Math.max(Math.round((2 * wanted) / unit / BINS), 1);
  const sides = Math.max(Math.ceil(wanted / width), 2),
    bins = 2 * sides + 1,
    reach = (sides + 0.5) * width;
  const counts = new Array(bins).fill(0);
  for (const v of values) counts[Math.min(bins - 1, Math.max(0, Math.floor((v + reach) / width)))]++;
  return { low_mm: -reach, high_mm: reach, counts };
}

// Correlation of the errors of face pixels with those `step` pixels away along a row and a column.
function autocorrelation(error, face, width) {
  const inside = error.filter((_, i) => face[i]);
  if (inside.length < LEAST) return { row: [], column: [] };
  const mean = average(inside),
    variance = spread(inside, mean) ** 2;
  const lag = (step, across) => {
    let sum = 0,
      pairs = 0;
    const apart = across ? step : step * width;
    for (let i = 0; i + apart < error.length; i++) {
      if (!face[i] || !face[i + apart] || (across && (i % width) + step >= width)) continue;
      sum += (error[i] - mean) * (error[i + apart] - mean);
      pairs++;
    }
    return pairs && variance ? sum / pairs / variance : null;
  };
  const lags = [...Array(LAGS + 1).keys()];
  return { row: lags.map((n) => lag(n, true)), column: lags.map((n) => lag(n, false)) };
}

// The figures of a picture, with the keys of glsim.tune.statistics.frame_statistics.
// normal: float32, 4 numbers a pixel.
export function statisticsOf(picture, normal, reasons, milliseconds) {
  const { clean, noisy, reason } = picture.layers,
    size = clean.length;
  let nearest = 65535,
    surface = 0,
    measured = 0;
  for (let i = 0; i < size; i++)
    if (clean[i]) {
      surface++;
      nearest = Math.min(nearest, clean[i]);
      if (noisy[i]) measured++;
    }
  const error = new Float64Array(size),
    face = new Uint8Array(size),
    values = [],
    own = [],
    depths = [],
    angles = [];
  for (let i = 0; i < size; i++) {
    if (!clean[i] || !noisy[i]) continue;
    error[i] = noisy[i] - clean[i];
    if (Math.abs(error[i]) > SURFACE_MM) continue;
    values.push(error[i]);
    if (clean[i] >= nearest + FACE_MM) continue;
    face[i] = 1;
    own.push(error[i]);
    depths.push(clean[i]);
    angles.push((Math.acos(Math.min(1, Math.max(0, -normal[4 * i + 2]))) * 180) / Math.PI);
  }
  const counts = new Array(reasons.length).fill(0);
  for (let i = 0; i < size; i++) if (clean[i]) counts[reason[i]]++;
  const rows = reasons.map(({ name, help }, code) => [name.toLowerCase(), help, counts[code], counts[code] / Math.max(surface, 1)]);
  return {
    surface_px: surface,
    measured_px: measured,
    beyond_px: measured - values.length,
    bias_mm: known(average(values)),
    sigma_mm: known(spread(values, average(values))),
    face_sigma_mm: known(spread(own, average(own))),
    milliseconds,
    distance: byBins(depths, own, DISTANCE_MM),
    angle: byBins(angles, own, ANGLE_DEG),
    histogram: histogram(values, picture.head.depth_unit_mm),
    autocorrelation: autocorrelation(error, face, picture.width),
    reasons: rows.filter(([, , pixels], code) => code && pixels).sort((a, b) => b[2] - a[2]),
  };
}
