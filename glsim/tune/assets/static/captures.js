// Unpack the clean layers of a scene (glsim/tune/static_captures.py says how they are packed).

// Python's base 85, with . for <: five characters are four bytes.
const DIGITS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%&()*+-;.=>?@^_`{|}~";
const PLACE = new Uint8Array(128);
[...DIGITS].forEach((c, n) => {
  PLACE[c.charCodeAt(0)] = n;
});

function bytesOf(text, size) {
  const bytes = new Uint8Array(size + 4),
    view = new DataView(bytes.buffer);
  for (let i = 0, at = 0; i < text.length; i += 5, at += 4) {
    let word = 0;
    for (let k = 0; k < 5; k++) word = word * 85 + (i + k < text.length ? PLACE[text.charCodeAt(i + k)] : 84);
    view.setUint32(at, word % 4294967296);
  }
  return bytes.subarray(0, size);
}

async function inflate(text, size) {
  const packed = bytesOf(text, size);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

const unsign = (n) => (n >>> 1) ^ -(n & 1);

// The integers of a blob, plane after plane.
export async function unpackBlob(blob) {
  const [planes, height, width] = blob.shape,
    size = planes * height * width;
  const bytes = await inflate(blob.data, blob.bytes);
  const values = blob.bits === 16 ? new Uint16Array(size) : new Uint8Array(size);
  for (let i = 0; i < size; i++) values[i] = unsign(blob.bits === 16 ? bytes[i] | (bytes[size + i] << 8) : bytes[i]);
  if (!blob.predicted) return values;
  for (let p = 0, i = 0; p < planes; p++) {
    for (let y = 0; y < height; y++) {
      for (let x = 0; x < width; x++, i++) {
        const left = x ? values[i - 1] : 0,
          above = y ? values[i - width] : 0;
        values[i] += left + above - (x && y ? values[i - width - 1] : 0); // modulo 2^bits
      }
    }
  }
  return values;
}

// Float32 layers of a capture's window: {clean, normal, albedo, lit, uneven, fine_seen}, the last two
// for rigs that supersample. units: the steps of the integers.
export async function unpackCapture(capture, blobs, units) {
  const read = async (name) => (name in capture.layers ? unpackBlob(blobs[capture.layers[name]]) : null);
  const [depth, shape, light, uneven, samples, sampleAlbedo] = await Promise.all(
    ["clean", "shape", "lit", "uneven", "samples", "sample_albedo"].map(read),
  );
  const [, , width, height] = capture.window,
    size = width * height;
  const times = (from, step) => Float32Array.from(from, (v) => Math.fround(v) * Math.fround(step));
  const layers = { clean: times(depth, units.depth_m), lit: times(light, units.lit) };
  layers.albedo = times(shape.subarray(2 * size), units.albedo);
  layers.normal = new Float32Array(4 * size);
  for (let i = 0; i < size; i++) {
    if (!depth[i]) continue;
    const x = (shape[i] - units.normal) / units.normal,
      y = (shape[size + i] - units.normal) / units.normal;
    layers.normal.set([x, y, -Math.sqrt(Math.max(1 - x * x - y * y, 0)), layers.albedo[i]], 4 * i);
  }
  if (uneven) {
    layers.uneven = times(uneven, units.uneven_m);
    const mixed = { depth, albedo: shape.subarray(2 * size), uneven, samples, sampleAlbedo };
    layers.fine_seen = fineLayer(mixed, width, height, capture.side, units);
  }
  return layers;
}

// Depth and albedo of side x side samples a pixel. Even pixels have those of their centre everywhere.
function fineLayer(m, width, height, side, units) {
  const fine = new Float32Array(2 * side * side * width * height);
  const mixedPixels = m.uneven.reduce((n, u) => n + (u > units.mixed_above), 0);
  const step = Math.fround(units.depth_m),
    albedoStep = Math.fround(units.albedo),
    middle = (side * side - 1) / 2;
  for (let i = 0, n = 0; i < width * height; i++) {
    const mixed = m.uneven[i] > units.mixed_above;
    const x = (i % width) * side,
      y = Math.floor(i / width) * side;
    for (let k = 0, other = 0; k < side * side; k++) {
      let depth = m.depth[i],
        albedo = m.albedo[i];
      if (mixed && k !== middle) {
        const at = other++ * mixedPixels + n;
        depth = (depth + m.samples[at]) & 0xffff;
        albedo = (albedo + m.sampleAlbedo[at]) & 0xff;
      }
      const to = 2 * ((y + Math.floor(k / side)) * width * side + x + (k % side));
      fine[to] = depth * step;
      fine[to + 1] = albedo * albedoStep;
    }
    if (mixed) n++;
  }
  return fine;
}
