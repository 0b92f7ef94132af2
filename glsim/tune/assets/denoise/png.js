// Grey PNG files of 16 bits: a canvas of the browser would cut them to 8. Text chunks state the step.

const SIGNATURE = [137, 80, 78, 71, 13, 10, 26, 10];
const latin = (bytes) => String.fromCharCode(...bytes);

async function through(bytes, stream) {
  return new Uint8Array(await new Response(new Blob([bytes]).stream().pipeThrough(stream)).arrayBuffer());
}

// The chunks of a file, [type, bytes]. Throws Error for a file that is cut off or no PNG.
function chunksOf(file) {
  if (SIGNATURE.some((byte, i) => file[i] !== byte)) throw new Error("is no PNG file");
  const view = new DataView(file.buffer, file.byteOffset, file.byteLength),
    chunks = [];
  for (let at = 8; at + 12 <= file.length; ) {
    const length = view.getUint32(at),
      type = latin(file.subarray(at + 4, at + 8));
    if (at + 12 + length > file.length) break;
    chunks.push([type, file.subarray(at + 8, at + 8 + length)]);
    if (type === "IEND") return chunks;
    at += 12 + length;
  }
  throw new Error("is cut off");
}

const nearest = (a, b, c) => {
  const guess = a + b - c,
    [da, db, dc] = [Math.abs(guess - a), Math.abs(guess - b), Math.abs(guess - c)];
  return da <= db && da <= dc ? a : db <= dc ? b : c;
};

// Undo the filters of the rows, in place. bytes: a row begins with the number of its filter.
function unfilter(bytes, width, height) {
  const row = 2 * width,
    above = new Uint8Array(row),
    out = new Uint8Array(row * height);
  for (let y = 0; y < height; y++) {
    const kind = bytes[y * (row + 1)],
      line = out.subarray(y * row, (y + 1) * row),
      upper = y ? out.subarray((y - 1) * row, y * row) : above;
    if (kind > 4) throw new Error("is damaged");
    for (let i = 0; i < row; i++) {
      const left = i > 1 ? line[i - 2] : 0,
        up = upper[i],
        corner = i > 1 ? upper[i - 2] : 0;
      const guess = [0, left, up, (left + up) >> 1, kind === 4 ? nearest(left, up, corner) : 0][kind];
      line[i] = bytes[y * (row + 1) + 1 + i] + guess;
    }
  }
  return out;
}

// {width, height, values: Uint16Array, texts: {keyword: text}} of a file's bytes. Throws Error.
export async function decodePng(file, mostPixels) {
  const chunks = chunksOf(file),
    head = chunks[0][1];
  if (chunks[0][0] !== "IHDR" || head.length !== 13) throw new Error("is damaged");
  const view = new DataView(head.buffer, head.byteOffset, 13),
    [width, height] = [view.getUint32(0), view.getUint32(4)],
    [bits, colour, , , interlace] = head.subarray(8);
  if (bits !== 16 || colour !== 0) throw new Error("is no depth map: it needs one channel of 16 bits");
  if (interlace) throw new Error("is interlaced: save it without");
  if (width * height > mostPixels) throw new Error(`has ${width} x ${height} pixels, more than ${mostPixels}`);
  const parts = chunks.filter(([type]) => type === "IDAT").map(([, bytes]) => bytes);
  const raw = await through(await new Blob(parts).arrayBuffer(), new DecompressionStream("deflate")).catch(() => []);
  if (raw.length !== (2 * width + 1) * height) throw new Error("is damaged");
  const samples = new DataView(unfilter(raw, width, height).buffer),
    values = new Uint16Array(width * height);
  for (let i = 0; i < values.length; i++) values[i] = samples.getUint16(2 * i);
  const texts = chunks.filter(([type]) => type === "tEXt").map(([, bytes]) => latin(bytes).split("\0"));
  return { width, height, values, texts: Object.fromEntries(texts) };
}

let table;
function crc(bytes) {
  table ||= Uint32Array.from({ length: 256 }, (_, n) => {
    for (let k = 0; k < 8; k++) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
    return n;
  });
  let sum = 0xffffffff;
  for (const byte of bytes) sum = table[(sum ^ byte) & 255] ^ (sum >>> 8);
  return (sum ^ 0xffffffff) >>> 0;
}

function chunk(type, bytes) {
  const made = new Uint8Array(12 + bytes.length),
    view = new DataView(made.buffer);
  view.setUint32(0, bytes.length);
  made.set(
    [...type].map((c) => c.charCodeAt(0)),
    4,
  );
  made.set(bytes, 8);
  view.setUint32(8 + bytes.length, crc(made.subarray(4, 8 + bytes.length)));
  return made;
}

// A file of whole numbers up to 65535. texts: {keyword: text} to state before the pixels.
export async function encodePng(width, height, values, texts) {
  const rows = new DataView(new ArrayBuffer((2 * width + 1) * height)); // of filter 0
  for (let y = 0, at = 0; y < height; y++) {
    at++;
    for (let x = 0; x < width; x++, at += 2) rows.setUint16(at, values[y * width + x]);
  }
  const head = new DataView(new ArrayBuffer(13));
  head.setUint32(0, width);
  head.setUint32(4, height);
  head.setUint8(8, 16);
  const stated = Object.entries(texts).map(([key, text]) => chunk("tEXt", new TextEncoder().encode(`${key}\0${text}`)));
  const pixels = await through(rows.buffer, new CompressionStream("deflate"));
  const chunks = [chunk("IHDR", new Uint8Array(head.buffer)), ...stated, chunk("IDAT", pixels), chunk("IEND", [])];
  return new Blob([new Uint8Array(SIGNATURE), ...chunks], { type: "image/png" });
}
