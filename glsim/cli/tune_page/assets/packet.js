// Unpack what glsim/cli/tune_page/preview.py packs: {head, layers: {name: typed array of the window}}.

const TYPES = { u1: Uint8Array, u2: Uint16Array, f4: Float32Array };

export function unpack(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const [left, top, width, height] = head.window;
  const layers = {};
  let at = 4 + size;
  for (const [name, type] of head.layers) {
    const layer = new TYPES[type](buffer, at, width * height);
    layers[name] = layer;
    at += Math.ceil(layer.byteLength / 4) * 4;
  }
  return { head, layers, left, top, width, height };
}

// The value of a layer at a pixel of the frame; outside the window nothing is there.
export function valueAt(picture, name, x, y) {
  const column = x - picture.left,
    row = y - picture.top;
  if (column < 0 || row < 0 || column >= picture.width || row >= picture.height) {
    return name === "reason" ? 1 : 0;
  }
  return picture.layers[name][row * picture.width + column];
}
