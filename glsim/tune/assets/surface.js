// A surface in 3D, cut at jumps, and another one as a ghost over it: what is seen, and from where.
// A GPU draws a mesh; without one, points are drawn here.

import { alike } from "./packet.js";
import { MeshPainter } from "./surface_mesh.js";
import { PointPainter } from "./surface_points.js";

// Most points of a surface.
const MOST_POINTS = 60000;

const BACKGROUND = [27, 30, 36],
  SOLID = [[219, 214, 204], 1],
  GHOST = [[87, 156, 217], 0.3];

// Whether WebGL draws with the CPU, or does not draw at all.
function withoutGpu() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return true;
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  const name = gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|basic render/i.test(name);
}

// Where surfaces are seen from; those that share one turn together.
export class View {
  constructor(yaw, pitch) {
    Object.assign(this, { yaw, pitch, zoom: 1, surfaces: [] });
  }

  draw() {
    for (const surface of this.surfaces) surface.draw();
  }
}

export class Surface {
  // names: layers of a picture, the surface and perhaps its ghost. middle: the layer whose nearest part
  // is in the middle. mesh: draw with WebGL2 or not; default: where there is a GPU.
  constructor(canvas, view, names, middle, mesh = !withoutGpu()) {
    Object.assign(this, { canvas, view, names, middle });
    view.surfaces.push(this);
    this.ghost = names.length > 1;
    this.painter = mesh ? new MeshPainter(canvas.getContext("webgl2", { antialias: true })) : new PointPainter(canvas.getContext("2d"));
    this._turning(canvas);
  }

  _turning(canvas) {
    canvas.addEventListener("pointerdown", (e) => {
      this.held = [e.clientX, e.clientY];
      canvas.setPointerCapture(e.pointerId);
    });
    canvas.addEventListener("pointerup", () => {
      this.held = null;
    });
    canvas.addEventListener("pointermove", (e) => {
      if (!this.held) return;
      this.turn((e.clientX - this.held[0]) * 0.01, (e.clientY - this.held[1]) * 0.01);
      this.held = [e.clientX, e.clientY];
    });
    canvas.addEventListener(
      "wheel",
      (e) => {
        e.preventDefault();
        this.view.zoom = Math.min(8, Math.max(0.3, this.view.zoom * Math.exp(-e.deltaY * 0.001)));
        this.view.draw();
      },
      { passive: false },
    );
    canvas.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[e.key];
      if (step) {
        e.preventDefault();
        this.turn(...step);
      }
    });
  }

  turn(yaw, pitch) {
    this.view.yaw += yaw;
    this.view.pitch = Math.max(-1.5, Math.min(1.5, this.view.pitch + pitch));
    this.view.draw();
  }

  set(picture) {
    const before = this.picture;
    this.picture = picture;
    const step = Math.max(1, Math.ceil(Math.sqrt((picture.width * picture.height) / MOST_POINTS)));
    // A surface is cut where it is steeper than 83 degrees, and noise alone does not cut it.
    const jump = 1 + Math.max(0.02, (8 * step) / picture.head.focal_px[0]);
    const grid = { step, jump },
      { focal_px, centre_px, depth_unit_mm } = picture.head;
    const rest = JSON.stringify([grid, focal_px, centre_px, depth_unit_mm]);
    const { names } = this;
    const kept = names.map((name) => rest === this.rest && alike(before, picture, [name]));
    this.rest = rest;
    this.painter.set(
      picture,
      names.map((name) => picture.layers[name]),
      grid,
      kept,
    );
    this._measure(picture);
    this.draw();
  }

  // The middle and the size of the nearest 600 mm of surface: the person, not the wall.
  _measure(picture) {
    const depth = picture.layers[this.middle],
      unit = picture.head.depth_unit_mm;
    let low = 65535;
    for (let i = 0; i < depth.length; i++) if (depth[i] > 0 && depth[i] < low) low = depth[i];
    let left = 1e9,
      right = -1,
      top = 1e9,
      bottom = -1;
    for (let i = 0; i < depth.length; i += 3) {
      if (depth[i] === 0 || (depth[i] - low) * unit > 600) continue;
      const x = i % picture.width,
        y = (i / picture.width) | 0;
      left = Math.min(left, x);
      right = Math.max(right, x);
      top = Math.min(top, y);
      bottom = Math.max(bottom, y);
    }
    if (right < 0) return;
    const z = (low * unit + 80) / 1000;
    const [fx, fy] = picture.head.focal_px,
      [cx, cy] = picture.head.centre_px;
    this.centre = [(((left + right) / 2 + picture.left - cx) / fx) * z, (((top + bottom) / 2 + picture.top - cy) / fy) * z, z];
    this.radius = 0.42 * Math.max((right - left) / fx, (bottom - top) / fy) * z + 0.05;
  }

  draw() {
    const { canvas, picture } = this;
    if (!picture || !this.centre || !canvas.clientWidth) return;
    const ratio = window.devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * ratio),
      height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
    const [sy, cy, sx, cx] = [Math.sin(this.view.yaw), Math.cos(this.view.yaw), Math.sin(this.view.pitch), Math.cos(this.view.pitch)];
    const view = {
      centre: this.centre,
      turn: [cy, sx * sy, -cx * sy, 0, cx, sx, sy, -sx * cy, cx * cy],
      zoom: (4 * this.view.zoom) / 1.15,
      distance: 4 * this.radius,
    };
    this.painter.draw(width, height, view, BACKGROUND, this.ghost ? [SOLID, GHOST] : [SOLID]);
  }
}
