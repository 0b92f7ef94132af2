// Sine, cosine and logarithm in float32 arithmetic. WebGL allows errors of 2^-11 in the browser's own
// (SwiftShader: 2e-4), which noise shows; the engine's are within 1e-7.
//
// Cody and Waite's reduction to a quarter turn, and minimax polynomials (Cephes sinf, cosf, logf).
const SCALARS = `float precise_sine(float x, int quarter) {
  if (!(abs(x) < 8192.0)) return quarter == 0 ? sin(x) : cos(x);
  float turns = floor(x * 0.636619772 + 0.5);
  float r = ((x - turns * 1.5703125) - turns * 4.837512969970703125e-4) - turns * 7.54978995489188216e-8;
  int n = int(turns) + quarter;
  float z = r * r;
  float odd = r + r * z * (-1.6666654611e-1 + z * (8.3321608736e-3 - z * 1.9515295891e-4));
  float even = 1.0 - 0.5 * z + z * z * (4.166664568298827e-2 + z * (-1.388731625493765e-3 + z * 2.443315711809948e-5));
  float value = (n & 1) == 0 ? odd : even;
  return (n & 2) == 0 ? value : -value;
}
float precise_sin(float x) { return precise_sine(x, 0); }
float precise_cos(float x) { return precise_sine(x, 1); }
float precise_log(float x) {
  if (!(x >= 1.17549435e-38 && x <= 3.4e38)) return log(x);
  int bits = floatBitsToInt(x), e = ((bits >> 23) & 255) - 126;
  float m = intBitsToFloat((bits & 0x7fffff) | 0x3f000000);
  if (m < 0.70710678) { e -= 1; m += m; }
  m -= 1.0;
  float z = m * m;
  float p = ((((((((7.0376836292e-2 * m - 1.1514610310e-1) * m + 1.1676998740e-1) * m - 1.2420140846e-1) * m
    + 1.4249322787e-1) * m - 1.6668057665e-1) * m + 2.0000714765e-1) * m - 2.4999993993e-1) * m + 3.3333331174e-1) * m * z;
  p += -2.12194440e-4 * float(e) - 0.5 * z;
  return m + p + 0.693359375 * float(e);
}
`;
const NAMES = ["sin", "cos", "log"];
const ofVector = (name, type) =>
  `${type} precise_${name}(${type} v) { return ${type}(${[..."xyzw"]
    .slice(0, Number(type[3]))
    .map((c) => `precise_${name}(v.${c})`)
    .join(", ")}); }`;

// Lines of GLSL to put before a stage.
export const FUNCTIONS = [
  ...SCALARS.trim().split("\n"),
  ...NAMES.flatMap((name) => ["vec2", "vec3", "vec4"].map((type) => ofVector(name, type))),
  ...NAMES.map((name) => `#define ${name}(x) precise_${name}(x)`),
];
