// The noisy surface in 3D, cut at jumps, over the clean one as a ghost. WebGL2; depth goes to the GPU
// as the raw uint16 of the packet and every vertex reads its pixel from the texture.

const VERTEX = `#version 300 es
precision highp float;
precision highp usampler2D;
uniform usampler2D u_depth;
uniform ivec2 u_grid;      // quads along x and y
uniform ivec2 u_origin;    // window in the frame
uniform int u_step;        // pixels a quad
uniform vec4 u_camera;     // fx, fy, cx, cy, pixels
uniform float u_unit_m;
uniform float u_jump;      // depth ratio that cuts the mesh
uniform vec3 u_centre_m;
uniform mat3 u_turn;
uniform vec3 u_frame;      // zoom, aspect, distance
out vec3 v_place;
float depth_of(ivec2 p) {
  return float(texelFetch(u_depth, min(p, textureSize(u_depth, 0) - 1), 0).r) * u_unit_m;
}
void main() {
  int quad = gl_VertexID / 6, corner = gl_VertexID - 6 * quad;
  ivec2 base = ivec2(quad % u_grid.x, quad / u_grid.x) * u_step;
  ivec2 offset = corner == 0 ? ivec2(0) : (corner == 1 || corner == 3) ? ivec2(1, 0)
    : (corner == 2 || corner == 5) ? ivec2(0, 1) : ivec2(1);
  float a = depth_of(base), b = depth_of(base + ivec2(u_step, 0));
  float c = depth_of(base + ivec2(0, u_step)), d = depth_of(base + ivec2(u_step));
  float low = min(min(a, b), min(c, d)), high = max(max(a, b), max(c, d));
  if (low <= 0.0 || high > low * u_jump) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
  ivec2 pixel = base + offset * u_step;
  float z = depth_of(pixel);
  vec2 ray = (vec2(pixel + u_origin) + 0.5 - u_camera.zw) / u_camera.xy;
  vec3 place = u_turn * (vec3(ray * z, z) - u_centre_m);
  v_place = place;
  float far = place.z + u_frame.z;
  gl_Position = vec4(place.x * u_frame.x / u_frame.y, -place.y * u_frame.x, far * 0.9 - 0.1, far);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 v_place;
uniform vec4 u_colour;
out vec4 colour;
void main() {
  vec3 n = normalize(cross(dFdx(v_place), dFdy(v_place)));
  float light = 0.25 + 0.75 * abs(dot(n, normalize(vec3(-0.4, -0.5, -0.8))));
  colour = vec4(u_colour.rgb * light * u_colour.a, u_colour.a);
}`;

// Most quads of a surface; a software rasteriser draws 60,000 in about 60 ms.
const MOST_QUADS = 60000;

export class Surface {
  constructor(canvas) {
    this.canvas = canvas;
    this.yaw = 0.5;
    this.pitch = 0.2;
    this.zoom = 1;
    this.ghost = true;
    const gl = (this.gl = canvas.getContext("webgl2", { antialias: true }));
    if (!gl) { this.missing = true; return; }
    this.program = gl.createProgram();
    for (const [kind, code] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, code);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) {
        throw new Error(gl.getShaderInfoLog(shader));
      }
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    this.at = (name) => gl.getUniformLocation(this.program, name);
    this.array = gl.createVertexArray();
    this.textures = [gl.createTexture(), gl.createTexture()];
    this._turning(canvas);
  }

  _turning(canvas) {
    canvas.addEventListener("pointerdown", (e) => { this.held = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
    canvas.addEventListener("pointerup", () => { this.held = null; });
    canvas.addEventListener("pointermove", (e) => {
      if (!this.held) return;
      this.turn((e.clientX - this.held[0]) * 0.01, (e.clientY - this.held[1]) * 0.01);
      this.held = [e.clientX, e.clientY];
    });
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      this.zoom = Math.min(8, Math.max(0.3, this.zoom * Math.exp(-e.deltaY * 0.001)));
      this.draw();
    }, { passive: false });
    canvas.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[e.key];
      if (step) { e.preventDefault(); this.turn(...step); }
    });
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.max(-1.5, Math.min(1.5, this.pitch + pitch));
    this.draw();
  }

  set(picture) {
    if (this.missing) return;
    const { gl } = this;
    this.picture = picture;
    ["noisy", "clean"].forEach((name, n) => {
      gl.bindTexture(gl.TEXTURE_2D, this.textures[n]);
      gl.pixelStorei(gl.UNPACK_ALIGNMENT, 2);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.R16UI, picture.width, picture.height, 0, gl.RED_INTEGER,
        gl.UNSIGNED_SHORT, picture.layers[name]);
      for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, gl.NEAREST);
      for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, key, gl.CLAMP_TO_EDGE);
    });
    this._measure(picture);
    this.draw();
  }

  // The middle and the size of the nearest 600 mm of surface: the person, not the wall.
  _measure(picture) {
    const clean = picture.layers.clean, unit = picture.head.depth_unit_mm;
    let low = 65535;
    for (let i = 0; i < clean.length; i++) if (clean[i] > 0 && clean[i] < low) low = clean[i];
    let left = 1e9, right = -1, top = 1e9, bottom = -1;
    for (let i = 0; i < clean.length; i += 3) {
      if (clean[i] === 0 || (clean[i] - low) * unit > 600) continue;
      const x = i % picture.width, y = (i / picture.width) | 0;
      left = Math.min(left, x); right = Math.max(right, x); top = Math.min(top, y); bottom = Math.max(bottom, y);
    }
    if (right < 0) return;
    const z = (low * unit + 80) / 1000;
    const [fx, fy] = picture.head.focal_px, [cx, cy] = picture.head.centre_px;
    this.centre = [
      (((left + right) / 2 + picture.left - cx) / fx) * z, (((top + bottom) / 2 + picture.top - cy) / fy) * z, z,
    ];
    this.radius = 0.42 * Math.max((right - left) / fx, (bottom - top) / fy) * z + 0.05;
  }

  draw() {
    const { gl, canvas, picture } = this;
    if (this.missing || !picture || !this.centre || !canvas.clientWidth) return;
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
    gl.viewport(0, 0, width, height);
    gl.clearColor(0.106, 0.118, 0.141, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.program);
    gl.bindVertexArray(this.array);
    const step = Math.max(1, Math.ceil(Math.sqrt((picture.width * picture.height) / MOST_QUADS)));
    const across = Math.floor((picture.width - 1) / step), down = Math.floor((picture.height - 1) / step);
    const [sy, cy, sx, cx] = [Math.sin(this.yaw), Math.cos(this.yaw), Math.sin(this.pitch), Math.cos(this.pitch)];
    gl.uniform2i(this.at("u_grid"), across, down);
    gl.uniform2i(this.at("u_origin"), picture.left, picture.top);
    gl.uniform1i(this.at("u_step"), step);
    gl.uniform4f(this.at("u_camera"), ...picture.head.focal_px, ...picture.head.centre_px);
    gl.uniform1f(this.at("u_unit_m"), picture.head.depth_unit_mm / 1000);
    // A surface is cut where it is steeper than 83 degrees, and noise alone does not cut it.
    gl.uniform1f(this.at("u_jump"), 1 + Math.max(0.02, (8 * step) / picture.head.focal_px[0]));
    gl.uniform3f(this.at("u_centre_m"), ...this.centre);
    gl.uniformMatrix3fv(this.at("u_turn"), false, [cy, sx * sy, -cx * sy, 0, cx, sx, sy, -sx * cy, cx * cy]);
    const distance = 4 * this.radius;
    gl.uniform3f(this.at("u_frame"), (this.zoom * distance) / this.radius / 1.15, width / height, distance);
    gl.activeTexture(gl.TEXTURE0);
    gl.uniform1i(this.at("u_depth"), 0);
    const pass = (texture, colour) => {
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.uniform4f(this.at("u_colour"), ...colour);
      gl.drawArrays(gl.TRIANGLES, 0, 6 * across * down);
    };
    gl.disable(gl.BLEND);
    pass(this.textures[0], [0.86, 0.84, 0.8, 1]);
    if (this.ghost) {
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      pass(this.textures[1], [0.34, 0.61, 0.85, 0.3]);
    }
  }
}
