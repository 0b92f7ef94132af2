// Paints depth maps as meshes with WebGL2. Depth goes to the GPU as the raw uint16 of the packet. A
// vertex is a pixel and reads its depth from the texture; which quads are drawn is found here.

const VERTEX = `#version 300 es
precision highp float;
precision highp usampler2D;
uniform usampler2D u_depth;
uniform int u_width;       // pixels a row
uniform ivec2 u_origin;    // window in the frame
uniform vec4 u_camera;     // fx, fy, cx, cy, pixels
uniform float u_unit_m;
uniform vec3 u_centre_m;
uniform mat3 u_turn;
uniform vec3 u_frame;      // zoom, aspect, distance
out vec3 v_place;
void main() {
  ivec2 pixel = ivec2(gl_VertexID % u_width, gl_VertexID / u_width);
  float z = float(texelFetch(u_depth, pixel, 0).r) * u_unit_m;
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

// The pixels of two triangles for each quad of the depth map whose corners are one surface, as places
// in the map. step: pixels a quad; jump: depth ratio that cuts. Returns the number of them in `into`.
export function meshOf(depth, width, height, step, jump, into) {
  let count = 0;
  for (let y = 0; y + step < height; y += step) {
    for (let at = y * width, end = at + width - step; at < end; at += step) {
      const a = depth[at],
        b = depth[at + step],
        below = at + step * width;
      const c = depth[below],
        d = depth[below + step];
      const low = Math.min(a, b, c, d);
      if (low === 0 || Math.max(a, b, c, d) > low * jump) continue;
      into[count] = at;
      into[count + 1] = into[count + 3] = at + step;
      into[count + 2] = into[count + 5] = below;
      into[count + 4] = below + step;
      count += 6;
    }
  }
  return count;
}

export class MeshPainter {
  constructor(gl) {
    this.gl = gl;
    this.program = gl.createProgram();
    for (const [kind, code] of [
      [gl.VERTEX_SHADER, VERTEX],
      [gl.FRAGMENT_SHADER, FRAGMENT],
    ]) {
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
    this.meshes = [gl.createBuffer(), gl.createBuffer()];
    this.counts = [0, 0];
    this.places = new Uint32Array(0);
  }

  // maps: the depth maps of a picture, in the order of painting. grid: {step, jump}, see meshOf.
  // kept: per map, whether it is the last one.
  set(picture, maps, { step, jump }, kept) {
    const { gl } = this,
      { width, height } = picture;
    this.picture = picture;
    const most = 6 * Math.ceil(width / step) * Math.ceil(height / step);
    if (this.places.length < most) this.places = new Uint32Array(most);
    gl.bindVertexArray(this.array);
    maps.forEach((map, n) => {
      if (kept[n]) return;
      this.counts[n] = meshOf(map, width, height, step, jump, this.places);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.meshes[n]);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, this.places, gl.STREAM_DRAW, 0, this.counts[n]);
      gl.bindTexture(gl.TEXTURE_2D, this.textures[n]);
      gl.pixelStorei(gl.UNPACK_ALIGNMENT, 2);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.R16UI, width, height, 0, gl.RED_INTEGER, gl.UNSIGNED_SHORT, map);
      for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, gl.NEAREST);
      for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, key, gl.CLAMP_TO_EDGE);
    });
  }

  // view: {centre, turn (3x3, column after column), zoom, distance}; layers: [colour, opacity] a map.
  draw(width, height, view, background, layers) {
    const { gl, picture } = this;
    gl.viewport(0, 0, width, height);
    gl.clearColor(...background.map((c) => c / 255), 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.useProgram(this.program);
    gl.bindVertexArray(this.array);
    gl.uniform1i(this.at("u_width"), picture.width);
    gl.uniform2i(this.at("u_origin"), picture.left, picture.top);
    gl.uniform4f(this.at("u_camera"), ...picture.head.focal_px, ...picture.head.centre_px);
    gl.uniform1f(this.at("u_unit_m"), picture.head.depth_unit_mm / 1000);
    gl.uniform3f(this.at("u_centre_m"), ...view.centre);
    gl.uniformMatrix3fv(this.at("u_turn"), false, view.turn);
    gl.uniform3f(this.at("u_frame"), view.zoom, width / height, view.distance);
    gl.activeTexture(gl.TEXTURE0);
    gl.uniform1i(this.at("u_depth"), 0);
    layers.forEach(([colour, opacity], n) => {
      gl.bindTexture(gl.TEXTURE_2D, this.textures[n]);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.meshes[n]);
      gl.uniform4f(this.at("u_colour"), ...colour.map((c) => c / 255), opacity);
      gl.drawElements(gl.TRIANGLES, this.counts[n], gl.UNSIGNED_INT, 0);
    });
  }
}
