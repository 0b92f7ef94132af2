// Unpack what glsim/tune/packet.py packs: {head, layers: {name: typed array of the window}}.

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

// Whether two pictures have equal values in these layers: what was made of them need not be made anew.
export function alike(one, other, names) {
  if (one === other) return true;
  if (!one || one.left !== other.left || one.top !== other.top) return false;
  if (one.width !== other.width || one.height !== other.height) return false;
  return names.every((name) => {
    const a = one.layers[name],
      b = other.layers[name];
    let i = 0;
    while (i < a.length && a[i] === b[i]) i++;
    return i === a.length;
  });
}
