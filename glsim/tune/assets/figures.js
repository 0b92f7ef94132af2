// The statistics of a frame as small charts and tables, beside a recording's.

import { ceiling, chart, text } from "./charts.js";
import { REASONS } from "./maps.js";

const NAMES = [
  "valid",
  "no_surface",
  "shadow",
  "out_of_range",
  "low_signal",
  "edge",
  "dropped",
  "window",
  "moved",
  "grown",
  "saturated",
  "unwrap",
  "mixed",
];

const element = (parent, tag, cls, content) => {
  const made = document.createElement(tag);
  if (cls) made.className = cls;
  if (content !== undefined) made.textContent = content;
  parent.append(made);
  return made;
};

export class Figures {
  constructor(root) {
    root.textContent = "";
    this.summary = element(root, "dl", "facts");
    this.charts = {};
    for (const [key, title] of [
      ["distance", "σ over distance, mm"],
      ["angle", "σ over angle of the surface, mm"],
      ["histogram", "error, noisy − clean"],
      ["correlation", "correlation along rows —, columns - -"],
    ]) {
      element(root, "h3", "", title);
      this.charts[key] = element(root, "canvas", "chart");
      this.charts[key].setAttribute("aria-label", title);
      this.charts[key].setAttribute("role", "img");
    }
    element(root, "h3", "", "lost and moved pixels, share of the surface");
    this.reasons = element(root, "table", "reasons");
    element(root, "h3", "", "silhouettes");
    this.edges = element(root, "table", "edges");
    this.realTitle = element(root, "h3", "", "");
    this.real = element(root, "table", "real");
  }

  fact(name, value) {
    element(this.summary, "dt", "", name);
    element(this.summary, "dd", "", value);
  }

  show(now, other) {
    this.now = now;
    this.other = other;
    this.summary.textContent = "";
    this.fact("σ on the face", `${text(now.face_sigma_mm)} mm`);
    this.fact("mean error", `${text(now.bias_mm)} mm`);
    this.fact("measured", now.surface_px ? `${((100 * now.measured_px) / now.surface_px).toFixed(1)} %` : "–");
    this.fact("a frame", `${text(now.milliseconds)} ms`);
    this.draw();
    this.reasons.textContent = "";
    for (const [name, help, pixels, share] of now.reasons) {
      const row = element(this.reasons, "tr");
      const cell = element(row, "td", "", name.replaceAll("_", " "));
      const key = document.createElement("i");
      key.style.background = REASONS[NAMES.indexOf(name)];
      cell.prepend(key);
      cell.title = help;
      element(row, "td", "number", `${(100 * share).toFixed(2)} %`).title = `${pixels} pixels`;
    }
    if (!now.reasons.length) element(element(this.reasons, "tr"), "td", "", "none");
    this.edges.textContent = "";
    this.edges.previousSibling.hidden = !now.silhouettes; // the page without a server has none
    for (const side of now.silhouettes ? ["left", "right"] : []) {
      const row = element(this.edges, "tr"),
        edge = now.silhouettes[side];
      element(row, "td", "", `gap, ${side}`);
      const width = edge.width_px === null ? "no background" : `${text(edge.width_px)} px`;
      element(row, "td", "number", width).title = `median of ${edge.edges} edges`;
    }
  }

  draw() {
    const { now, other } = this;
    if (!now) return;
    for (const [key, unit] of [
      ["distance", "mm"],
      ["angle", "°"],
    ]) {
      const points = now[key].map(([at, sigma]) => [at, sigma]);
      const second = other ? other[key].map(([at, sigma]) => [at, sigma]) : [];
      const all = [...points, ...second];
      if (!all.length) {
        chart(this.charts[key], [], [0, 1], [0, 1], unit);
        continue;
      }
      const x = key === "angle" ? [0, 90] : [Math.min(...all.map((p) => p[0])), Math.max(...all.map((p) => p[0]))];
      chart(
        this.charts[key],
        [
          { points: second, colour: "--second", dashed: true },
          { points, colour: "--accent", dots: true },
        ],
        x,
        [0, ceiling(Math.max(...all.map((p) => p[1])))],
        unit,
      );
    }
    const h = now.histogram,
      n = h.counts.length;
    const bars = h.counts.map((count, i) => [h.low_mm + ((i + 0.5) / n) * (h.high_mm - h.low_mm), count]);
    chart(
      this.charts.histogram,
      [{ points: bars, colour: "--accent", bars: true }],
      [h.low_mm, h.high_mm],
      [0, ceiling(Math.max(1, ...h.counts))],
      "mm",
    );
    const lags = (values) => values.map((v, i) => [i, v]);
    const { row, column } = now.autocorrelation;
    const least = Math.min(0, ...row, ...column);
    chart(
      this.charts.correlation,
      [
        { points: lags(row), colour: "--accent", dots: true },
        { points: lags(column), colour: "--second", dashed: true },
      ],
      [0, 8],
      [least < -0.05 ? -0.5 : 0, 1],
      "px",
    );
  }

  showReal(real, here) {
    this.realTitle.textContent = real ? `recording ${real.title} (${real.frames} frames) and this` : "";
    this.real.textContent = "";
    if (!real) return;
    const head = element(this.real, "tr");
    for (const name of ["", "real", "this"]) element(head, "th", "", name);
    real.rows.forEach(([name, unit, value], i) => {
      const row = element(this.real, "tr");
      element(row, "td", "", unit ? `${name}, ${unit}` : name);
      element(row, "td", "number", text(value));
      element(row, "td", "number", here ? text(here.rows[i][2]) : "…");
    });
  }
}
