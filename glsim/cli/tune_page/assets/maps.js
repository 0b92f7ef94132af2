// Colour maps that colour-blind readers can tell apart, as tables of 256 RGBA words (little-endian).

const hex = (text) => [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16));

// 256 words through evenly spaced stops.
export function table(stops) {
  const colours = stops.map(hex);
  const words = new Uint32Array(256);
  for (let i = 0; i < 256; i++) {
    const at = (i / 255) * (colours.length - 1);
    const low = Math.min(Math.floor(at), colours.length - 2);
    const t = at - low;
    const rgb = [0, 1, 2].map((c) => Math.round(colours[low][c] * (1 - t) + colours[low + 1][c] * t));
    words[i] = word(rgb);
  }
  return words;
}

export const word = ([r, g, b]) => ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0;

// Depth: viridis (van der Walt and Smith 2015), its ten stops; near is bright.
export const DEPTH = table(["#fde725", "#b5de2b", "#6ece58", "#35b779", "#1f9e89", "#26828e", "#31688e", "#3e4989", "#482878", "#440154"]);
// Disparity: the same colours, for it is large where a surface is near.
export const DISPARITY = DEPTH.slice().reverse();
// Difference: nearer blue, farther red, grey where nothing differs (after ColorBrewer RdBu).
export const SIGNED = table(["#2166ac", "#67a9cf", "#e8e8e6", "#ef8a62", "#b2182b"]);
// A gradient of CSS through a table's colours, from low to high.
export const gradient = (words) =>
  `linear-gradient(to right, ${[0, 64, 128, 191, 255]
    .map((i) => {
      const w = words[i];
      return `rgb(${w & 255} ${(w >> 8) & 255} ${(w >> 16) & 255})`;
    })
    .join(", ")})`;
export const GREY = table(["#000000", "#ffffff"]);

// Reasons, in the order of glsim.core.reason.Reason. Holes differ in lightness as well as in hue
// (after Okabe and Ito's palette).
export const REASONS = [
  "#8a8f98",
  "#1b1e24",
  "#0072b2",
  "#6a3d9a",
  "#d55e00",
  "#e69f00",
  "#7f4f24",
  "#f0e442",
  "#009e73",
  "#7fd8be",
  "#ffffff",
  "#cc79a7",
  "#56b4e9",
];
export const REASON_WORDS = new Uint32Array(256).fill(word([255, 0, 255]));
REASONS.forEach((colour, code) => {
  REASON_WORDS[code] = word(hex(colour));
});
