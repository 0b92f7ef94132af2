// Small charts on a 2D canvas: lines, bars and an axis with few numbers.

const style = (name) => getComputedStyle(document.body).getPropertyValue(name).trim();

// A round number of at least `value`: the end of an axis.
export function ceiling(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 1.5, 2, 3, 4, 5, 7.5, 10].find((m) => m * power >= value * 0.999) * power;
}

export const text = (value) => {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size >= 10000) return `${Number((value / 1000).toPrecision(3))}k`;
  if (size >= 100 || Number.isInteger(value)) return value.toFixed(0);
  return value.toFixed(size >= 10 ? 1 : 2);
};

// series: [{points: [[x, y], ...], colour: "--name", bars, dashed}]; x, y: [low, high] of the axes.
export function chart(canvas, series, x, y, labels) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth,
    height = canvas.clientHeight;
  if (!width || !height) return;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const c = canvas.getContext("2d");
  c.scale(ratio, ratio);
  c.clearRect(0, 0, width, height);
  const left = 30,
    right = 6,
    top = 6,
    bottom = 24;
  const [x0, x1] = x,
    [y0, y1] = y;
  const toX = (v) => left + ((v - x0) / (x1 - x0 || 1)) * (width - left - right);
  const toY = (v) => height - bottom - ((v - y0) / (y1 - y0 || 1)) * (height - top - bottom);
  c.font = "10px system-ui, sans-serif";
  c.strokeStyle = style("--rule");
  c.fillStyle = style("--soft");
  c.lineWidth = 1;
  for (const v of [y0, (y0 + y1) / 2, y1]) {
    c.beginPath();
    c.moveTo(left, Math.round(toY(v)) + 0.5);
    c.lineTo(width - right, Math.round(toY(v)) + 0.5);
    c.stroke();
    c.textAlign = "right";
    c.fillText(text(v), left - 4, toY(v) + 3);
  }
  [
    [x0, "left"],
    [(x0 + x1) / 2, "center"],
    [x1, "right"],
  ].forEach(([v, align]) => {
    c.textAlign = align;
    const unit = align === "right" && labels ? ` ${labels}` : "";
    c.fillText(text(v) + unit, toX(v), height - bottom + 14);
  });
  for (const one of series) {
    c.strokeStyle = c.fillStyle = style(one.colour);
    c.lineWidth = 1.5;
    c.setLineDash(one.dashed ? [4, 3] : []);
    if (one.bars) {
      const wide = (toX(x1) - toX(x0)) / Math.max(one.points.length, 1);
      for (const [at, v] of one.points) {
        c.fillRect(toX(at) - wide / 2 + 0.5, toY(v), Math.max(wide - 1, 1), toY(y0) - toY(v));
      }
      continue;
    }
    c.beginPath();
    let pen = false;
    for (const [at, v] of one.points) {
      if (v === null || !Number.isFinite(v)) {
        pen = false;
        continue;
      }
      if (pen) c.lineTo(toX(at), toY(v));
      else c.moveTo(toX(at), toY(v));
      pen = true;
    }
    c.stroke();
    if (one.dots)
      for (const [at, v] of one.points) {
        c.beginPath();
        c.arc(toX(at), toY(v), 2, 0, 7);
        c.fill();
      }
  }
  c.setLineDash([]);
}
