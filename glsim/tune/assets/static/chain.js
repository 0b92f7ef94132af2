// A sensor's stages on WebGL2: what glsim.noise.chain.ShaderChain does, with the same passes.

import { components, locate, StageError } from "./declarations.js";

// CRC-32 (zlib's), for the seeds of the stages.
const CRC = Uint32Array.from({ length: 256 }, (_, n) => {
  for (let k = 0; k < 8; k++) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
  return n;
});
function crc32(bytes, start = 0) {
  let c = ~start;
  for (const byte of bytes) c = CRC[(c ^ byte) & 255] ^ (c >>> 8);
  return ~c >>> 0;
}

// A stage's own 32-bit seed from a frame's 64-bit seed (glsim.noise.frame_context).
export function stageSeed(seed, stage) {
  const bytes = new Uint8Array(8);
  new DataView(bytes.buffer).setBigUint64(0, BigInt.asUintN(64, BigInt(seed)), true);
  return crc32(bytes, crc32(new TextEncoder().encode(stage)));
}

function ratio(text) {
  const [top, bottom] = text.split("/").map(Number);
  return top / (bottom || 1);
}

export class Engine {
  // sources: WebGL texts of the shared passes, {vertex, silhouette}.
  constructor(canvas, sources) {
    const gl = canvas.getContext("webgl2", { antialias: false, depth: false, powerPreference: "high-performance" });
    this.gl = gl;
    if (!gl) throw new Error("this browser has no WebGL2");
    if (!gl.getExtension("EXT_color_buffer_float")) throw new Error("this device cannot draw into float textures (EXT_color_buffer_float)");
    this.programs = new Map();
    this.vertex = this._shader(gl.VERTEX_SHADER, sources.vertex);
    this.silhouette = this.link(sources.silhouette, [{ file: "silhouette.frag", line: 1 }]);
    gl.bindVertexArray(gl.createVertexArray());
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  }

  _shader(kind, text) {
    const shader = this.gl.createShader(kind);
    this.gl.shaderSource(shader, text);
    this.gl.compileShader(shader);
    return shader;
  }

  // Compile a fragment shader; the same text is linked once. Raises StageError at the lines of `flat`.
  link(text, flat) {
    if (this.programs.has(text)) return this.programs.get(text);
    const { gl } = this,
      program = gl.createProgram(),
      fragment = this._shader(gl.FRAGMENT_SHADER, text);
    gl.attachShader(program, this.vertex);
    gl.attachShader(program, fragment);
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
      throw new StageError(locate(gl.getShaderInfoLog(fragment) || gl.getProgramInfoLog(program) || "", flat));
    }
    const uniforms = new Map();
    for (let n = 0; n < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); n++) {
      const { name, type } = gl.getActiveUniform(program, n);
      uniforms.set(name, { type, at: gl.getUniformLocation(program, name) });
    }
    this.programs.set(text, { program, uniforms });
    return this.programs.get(text);
  }

  texture(width, height, parts) {
    const { gl } = this,
      texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, { 1: gl.R32F, 2: gl.RG32F, 4: gl.RGBA32F }[parts], width, height);
    for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, gl.NEAREST);
    for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, key, gl.CLAMP_TO_EDGE);
    return texture;
  }

  framebuffer(textures, depth) {
    const { gl } = this,
      buffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    for (const [n, t] of textures.entries()) gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + n, gl.TEXTURE_2D, t, 0);
    if (depth) gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
    gl.drawBuffers(textures.length ? textures.map((_, n) => gl.COLOR_ATTACHMENT0 + n) : [gl.NONE]);
    if (gl.checkFramebufferStatus(gl.FRAMEBUFFER) !== gl.FRAMEBUFFER_COMPLETE) throw new Error("this device cannot draw these layers");
    return buffer;
  }

  set({ type, at }, value) {
    const { gl } = this;
    if (type === gl.FLOAT) gl.uniform1f(at, value);
    else if (type === gl.UNSIGNED_INT) gl.uniform1ui(at, value);
    else if (type === gl.FLOAT_VEC2) gl.uniform2fv(at, value);
    else if (type === gl.FLOAT_VEC3) gl.uniform3fv(at, value);
    else gl.uniform1i(at, value);
  }

  draw({ program }, [left, top, width, height]) {
    const { gl } = this;
    gl.useProgram(program);
    gl.viewport(left, top, width, height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}

// The captured layers of a scene for one rig, on the GPU, and the textures of its stages.
export class Scene {
  // rig: {width, height, focal_px, centre_px}; layers: float32 of `window`; side: samples along a pixel.
  constructor(engine, rig, window, layers, side = 1) {
    const { gl } = engine;
    Object.assign(this, { engine, rig, window, targets: new Map(), owned: [] });
    const { width, height } = rig;
    const upload = (data, parts, scale = 1) => {
      const texture = this._texture(width * scale, height * scale, parts);
      const [left, top, w, h] = window.map((v) => v * scale);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, left, top, w, h, { 1: gl.RED, 2: gl.RG, 4: gl.RGBA }[parts], gl.FLOAT, data);
      return texture;
    };
    const clean = upload(layers.clean, 1);
    this.layers = {
      clean,
      depth: clean,
      fine_seen: clean,
      uneven: clean,
      reason: this._texture(width, height, 1),
      normal: upload(layers.normal, 4),
      albedo: upload(layers.albedo, 1),
      lit: upload(layers.lit, 1),
      rays: this._rays(),
    };
    if (layers.uneven) {
      this.layers.uneven = upload(layers.uneven, 1);
      this.layers.fine_seen = upload(layers.fine_seen, 2, side);
    }
    this.skipsEmpty = window[2] < width || window[3] < height;
    this.depth = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, this.depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, width, height);
    if (this.skipsEmpty) this._mask();
    this.reader = gl.createFramebuffer();
  }

  _texture(width, height, parts) {
    const texture = this.engine.texture(width, height, parts);
    this.owned.push(texture);
    return texture;
  }

  _rays() {
    const {
        width,
        height,
        focal_px: [fx, fy],
        centre_px: [cx, cy],
      } = this.rig,
      { gl } = this.engine;
    const rays = new Float32Array(2 * width * height);
    for (let y = 0, i = 0; y < height; y++) {
      for (let x = 0; x < width; x++) {
        rays[i++] = (x + 0.5 - cx) / fx;
        rays[i++] = (y + 0.5 - cy) / fy;
      }
    }
    const texture = this._texture(width, height, 2);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RG, gl.FLOAT, rays);
    return texture;
  }

  // Pixels without a surface near them are made nearer than the passes, which then skip them.
  _mask() {
    const { gl, silhouette } = this.engine;
    const buffer = this.engine.framebuffer([], this.depth);
    gl.depthMask(true);
    gl.clearBufferfv(gl.DEPTH, 0, [1]);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.layers.uneven);
    gl.useProgram(silhouette.program);
    gl.uniform1i(silhouette.uniforms.get("u_seen").at, 0);
    gl.enable(gl.DEPTH_TEST);
    this.engine.draw(silhouette, this.window);
    gl.disable(gl.DEPTH_TEST);
    gl.deleteFramebuffer(buffer);
  }

  // The textures that a stage writes, kept for the next frame.
  _target(stage) {
    const key = `${stage.name} ${JSON.stringify(stage.writes)}`;
    if (!this.targets.has(key)) {
      const scale = ratio(stage.writes[0][2]),
        { width, height } = this.rig;
      const size = [Math.ceil(width * scale), Math.ceil(height * scale)];
      const textures = stage.writes.map(([, type]) => this._texture(...size, components(type)));
      const [left, top, w, h] = this.window;
      const x = Math.floor(left * scale),
        y = Math.floor(top * scale);
      const drawn = [x, y, Math.ceil((left + w) * scale) - x, Math.ceil((top + h) * scale) - y];
      const buffer = this.engine.framebuffer(textures, scale === 1 ? this.depth : null);
      this.targets.set(key, { textures, drawn, buffer });
    }
    return this.targets.get(key);
  }

  // Draw the stages that are switched on over the clean layers. stages: [{name, writes, reads, sparse,
  // linked}]; values: stage -> parameter -> number; uniforms: name -> number or array; seeds: name of a
  // seed -> 64-bit seed; blank: layer -> value of sparse stages in empty pixels, where it is not 0.
  run(stages, values, uniforms, seeds, blank) {
    const {
      engine,
      engine: { gl },
    } = this;
    const layers = { ...this.layers },
      empty = new Set(Object.keys(layers));
    gl.depthMask(false);
    for (const stage of stages) {
      if (!values[stage.name].enabled) continue;
      const { program, uniforms: active } = stage.linked,
        target = this._target(stage);
      const sparse = stage.sparse && stage.reads.every((name) => empty.has(name) || name === "pattern_map");
      for (const [name] of stage.writes) {
        if (sparse) empty.add(name);
        else empty.delete(name);
      }
      gl.useProgram(program);
      let unit = 0;
      for (const [name, place] of active) {
        if (place.type === gl.SAMPLER_2D) {
          const layer = name.slice(2);
          if (!(layer in layers))
            throw new StageError([
              {
                file: stage.file,
                line: 1,
                text: `${stage.name} reads the layer ${layer}, but the stage that writes it is switched off or missing`,
              },
            ]);
          gl.activeTexture(gl.TEXTURE0 + unit);
          gl.bindTexture(gl.TEXTURE_2D, layers[layer]);
          gl.uniform1i(place.at, unit++);
        } else if (name in seeds) engine.set(place, stageSeed(seeds[name], stage.name));
        else if (name in uniforms) engine.set(place, uniforms[name]);
        else if (name in values[stage.name]) engine.set(place, values[stage.name][name]);
        else throw new StageError([{ file: stage.file, line: 1, text: `glsim binds no uniform ${name}` }]);
      }
      gl.bindFramebuffer(gl.FRAMEBUFFER, target.buffer);
      const within = sparse && this.skipsEmpty;
      if (within) {
        gl.enable(gl.SCISSOR_TEST);
        gl.scissor(...target.drawn);
        for (const [n, [name]] of stage.writes.entries()) gl.clearBufferfv(gl.COLOR, n, new Float32Array(4).fill(blank[name] ?? 0));
        gl.disable(gl.SCISSOR_TEST);
        gl.enable(gl.DEPTH_TEST);
      }
      engine.draw(stage.linked, target.drawn);
      gl.disable(gl.DEPTH_TEST);
      stage.writes.forEach(([name], n) => {
        layers[name] = target.textures[n];
      });
    }
    return layers;
  }

  // The first number of each pixel of the window, float32.
  read(texture) {
    const { gl } = this.engine,
      [left, top, width, height] = this.window;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.reader);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    const four = new Float32Array(4 * width * height),
      one = new Float32Array(width * height);
    gl.readPixels(left, top, width, height, gl.RGBA, gl.FLOAT, four);
    for (let i = 0; i < one.length; i++) one[i] = four[4 * i];
    return one;
  }

  release() {
    const { gl } = this.engine;
    for (const texture of this.owned) gl.deleteTexture(texture);
    for (const { buffer } of this.targets.values()) gl.deleteFramebuffer(buffer);
    gl.deleteFramebuffer(this.reader);
    gl.deleteRenderbuffer(this.depth);
  }
}
