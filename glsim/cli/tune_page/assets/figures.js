// The figures of a frame as small charts and tables, beside a recording's.

import { REASONS } from "./maps.js";

const style = (name) => getComputedStyle(document.body).getPropertyValue(name).trim();

export const element = (parent, tag, cls, content) => {
  const made = document.createElement(tag);
  if (cls) made.className = cls;
  if (content !== undefined) made.textContent = content;
  parent.append(made);
  return made;
};

// A number for people; "–" for none.
export const text = (value) => {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size >= 10000) return `${Number((value / 1000).toPrecision(3))}k`;
  if (size >= 100 || Number.isInteger(value)) return value.toFixed(0);
  return value.toFixed(size >= 10 ? 1 : 2);
};

// A round number of at least `value`: the end of an axis.
function ceiling(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 1.5, 2, 3, 4, 5, 7.5, 10].find((m) => m * power >= value * 0.999) * power;
}

// series: [{points: [[x, y], ...], colour: "--name", bars, dashed}]; x, y: [low, high] of the axes.
export function chart(canvas, series, [x0, x1], [y0, y1], unit) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth,
    height = canvas.clientHeight;
  if (!width || !height) return;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const c = canvas.getContext("2d");
  c.scale(ratio, ratio);
  const [left, right, top, bottom] = [30, 6, 6, 24];
  const toX = (v) => left + ((v - x0) / (x1 - x0 || 1)) * (width - left - right);
  const toY = (v) => height - bottom - ((v - y0) / (y1 - y0 || 1)) * (height - top - bottom);
  c.font = "10px system-ui, sans-serif";
  c.fillStyle = style("--soft");
  for (const v of [y0, (y0 + y1) / 2, y1]) {
    c.globalAlpha = 0.25;
    c.fillRect(left, Math.round(toY(v)), width - left - right, 1);
    c.globalAlpha = 1;
    c.textAlign = "right";
    c.fillText(text(v), left - 4, toY(v) + 3);
  }
  for (const [v, align] of [
    [x0, "left"],
    [(x0 + x1) / 2, "center"],
    [x1, "right"],
  ]) {
    c.textAlign = align;
    c.fillText(align === "right" ? `${text(v)} ${unit}` : text(v), toX(v), height - bottom + 14);
  }
  c.lineWidth = 1.5;
  for (const { points, colour, bars, dashed } of series) {
    c.strokeStyle = c.fillStyle = style(colour);
    c.setLineDash(dashed ? [4, 3] : []);
    c.beginPath();
    let pen = false;
    for (const [at, v] of points) {
      const known = v !== null && Number.isFinite(v);
      if (bars) {
        const wide = (toX(x1) - toX(x0)) / points.length;
        c.fillRect(toX(at) - wide / 2 + 0.5, toY(v), Math.max(wide - 1, 1), toY(y0) - toY(v));
      } else if (known && pen) c.lineTo(toX(at), toY(v));
      else if (known) c.moveTo(toX(at), toY(v));
      pen = known;
    }
    c.stroke();
  }
}

export class Figures {
  // reasons: [name, help] of each code.
  constructor(root, reasons) {
    this.names = reasons.map(([name]) => name);
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
    element(root, "h3", "", "gaps beside silhouettes");
    this.edges = element(root, "table");
    this.realTitle = element(root, "h3");
    this.real = element(root, "table");
  }

  // now, other: figures of `frame_figures`; other: of setting B, or null.
  show(now, other) {
    this.now = now;
    this.other = other;
    this.summary.textContent = this.reasons.textContent = this.edges.textContent = "";
    for (const [name, value] of [
      ["σ on the face", `${text(now.face_sigma_mm)} mm`],
      ["mean error", `${text(now.bias_mm)} mm`],
      ["measured", now.surface_px ? `${((100 * now.measured_px) / now.surface_px).toFixed(1)} %` : "–"],
      ["a frame", `${text(now.milliseconds)} ms`],
    ]) {
      element(this.summary, "dt", "", name);
      element(this.summary, "dd", "", value);
    }
    for (const [name, help, pixels, share] of now.reasons) {
      const row = tableRow(this.reasons, name.replaceAll("_", " "), `${(100 * share).toFixed(2)} %`);
      row.title = `${help}: ${pixels} pixels`;
      const key = document.createElement("i");
      key.style.background = REASONS[this.names.indexOf(name)];
      row.firstChild.prepend(key);
    }
    if (!now.reasons.length) tableRow(this.reasons, "none");
    for (const [side, edge] of Object.entries(now.silhouettes)) {
      const width = edge.width_px === null ? "no background" : `${text(edge.width_px)} px`;
      tableRow(this.edges, side, width).title = `median of ${edge.edges} edges`;
    }
    this.draw();
  }

  draw() {
    const { now, other, charts } = this;
    if (!now) return;
    for (const [key, unit] of [
      ["distance", "mm"],
      ["angle", "°"],
    ]) {
      const all = [...now[key], ...(other?.[key] ?? [])],
        places = all.map(([at]) => at);
      const series = [
        { points: other?.[key] ?? [], colour: "--second", dashed: true },
        { points: now[key], colour: "--accent" },
      ];
      const x = key === "angle" || !all.length ? [0, 90] : [Math.min(...places), Math.max(...places)];
      chart(charts[key], series, x, [0, ceiling(Math.max(0, ...all.map(([, sigma]) => sigma)))], unit);
    }
    const { counts, low_mm, high_mm } = now.histogram;
    const bars = counts.map((count, i) => [low_mm + ((i + 0.5) / counts.length) * (high_mm - low_mm), count]);
    const top = ceiling(Math.max(1, ...counts));
    chart(charts.histogram, [{ points: bars, colour: "--accent", bars: true }], [low_mm, high_mm], [0, top], "mm");
    const { row, column } = now.autocorrelation;
    const lags = [
      { points: row.map((v, i) => [i, v]), colour: "--accent" },
      { points: column.map((v, i) => [i, v]), colour: "--second", dashed: true },
    ];
    chart(charts.correlation, lags, [0, 8], [Math.min(0, ...row, ...column) < -0.05 ? -0.5 : 0, 1], "px");
  }

  // real: figures of `recording_figures`; here: of the shown frame, or null.
  showReal(real, here) {
    this.realTitle.textContent = `recording ${real.title} (${real.frames} frames) and this`;
    this.real.textContent = "";
    tableRow(this.real, "", "real", "this");
    real.rows.forEach(([name, unit, value], i) => {
      tableRow(this.real, unit ? `${name}, ${unit}` : name, text(value), here ? text(here.rows[i][2]) : "…");
    });
  }
}

function tableRow(table, name, ...numbers) {
  const row = element(table, "tr");
  element(row, "td", "", name);
  for (const number of numbers) element(row, "td", "number", number);
  return row;
}
