// The list of a chain's stages, with a switch each, and the sliders of the selected stage.

const STEPS = 200,
  SPAN = 5;

export const make = (parent, tag, cls, content) => {
  const made = document.createElement(tag);
  if (cls) made.className = cls;
  if (content !== undefined) made.textContent = content;
  parent.append(made);
  return made;
};

export const short = (value) => String(Number(value.toPrecision(6)));

// The ends of a slider, [least, most, logarithmic]: those of the note; else up to five times the larger
// of default and value within the declared range, which is often far wider than its values.
export function ends(parameter, start) {
  const { low, high, slider, log_scale: log } = parameter;
  if (slider) return [...slider, log && slider[0] > 0];
  const size = Math.max(Math.abs(parameter.default), Math.abs(start));
  if (!size || log) return [low, high, log && low > 0];
  const span = parameter.type === "int" ? Math.max(Math.ceil(SPAN * size), 8) : Number((SPAN * size).toPrecision(1));
  return [Math.max(low, -span), Math.min(high, Math.max(span, size)), false];
}

function numberControl(row, parameter, value, start, change) {
  const [least, most, log] = ends(parameter, start);
  const toSlider = (v) => (log ? Math.log10(Math.max(v, least)) : v);
  const slider = make(make(row, "div", "slide"), "input"),
    whole = parameter.type === "int";
  slider.type = "range";
  slider.min = toSlider(least);
  slider.max = toSlider(most);
  slider.step = parameter.step || (whole ? 1 : "any");
  slider.value = toSlider(value);
  slider.title = parameter.help;
  slider.setAttribute("aria-label", `${parameter.name}, ${parameter.unit}`);
  const box = row.querySelector("input[type=number]");
  const set = (v) => {
    change(v);
    box.value = short(v);
  };
  slider.addEventListener("input", () => {
    const at = Number(slider.value),
      fine = (toSlider(most) - toSlider(least)) / STEPS;
    const digits = log ? 0 : Math.max(0, Math.ceil(-Math.log10(fine || 1)));
    const exact = log ? Number((10 ** at).toPrecision(3)) : Number(at.toFixed(digits));
    set(Math.min(parameter.high, Math.max(parameter.low, exact)));
  });
  slider.addEventListener("keydown", (e) => {
    // "any" has no step of its own
    const way = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[e.key];
    if (!way || slider.step !== "any") return;
    e.preventDefault();
    slider.value = Number(slider.value) + (way * (slider.max - slider.min)) / STEPS;
    slider.dispatchEvent(new Event("input"));
  });
  box.addEventListener("change", () => {
    const v = Math.min(parameter.high, Math.max(parameter.low, Number(box.value)));
    if (!Number.isFinite(v) || box.value === "") {
      box.value = short(value);
      return;
    }
    set(whole ? Math.round(v) : v);
    slider.value = toSlider(v);
  });
}

// One parameter: label, value box, unit, reset and slider (a switch for bool).
// own: {value, start, changed, drawn}: drawn is the text of a distribution.
function control(parent, parameter, own, change, reset) {
  const row = make(parent, "div", "control");
  row.dataset.parameter = parameter.name;
  const label = make(row, "label", "label", parameter.name);
  label.title = parameter.help;
  if (own.changed) make(label, "span", "was", `was ${short(own.start)}`);
  else if (own.drawn) make(label, "span", "was", own.drawn).title = `drawn anew for each camera: ${own.drawn}`;
  const box = make(row, "input", "value");
  if (parameter.type === "bool") {
    box.type = "checkbox";
    box.checked = own.value > 0.5;
    box.addEventListener("change", () => change(box.checked ? 1 : 0));
  } else {
    Object.assign(box, { type: "number", step: "any", min: parameter.low, max: parameter.high, value: short(own.value) });
  }
  box.setAttribute("aria-label", parameter.name);
  make(row, "span", "unit", parameter.unit === "1" ? "" : parameter.unit).title = parameter.unit;
  const back = make(row, "button", "reset", "↺");
  back.title = `back to ${short(own.start)}`;
  back.disabled = !own.changed;
  back.addEventListener("click", reset);
  if (parameter.type !== "bool") numberControl(row, parameter, own.value, own.start, change);
}

// Draw the panel. chain: [{name, title, array, parameters, changed}]; selected: name;
// own(stage, parameter): see control. on: {select, toggle, change, reset}.
export function drawPanel(root, chain, selected, own, on) {
  const scroll = root.scrollTop;
  root.textContent = "";
  make(root, "div", "section", "stages, in order");
  for (const stage of chain) {
    const enabled = own(stage, { name: "enabled", default: 1 }).value > 0.5;
    const row = make(root, "div", `stage-row${stage.name === selected ? " selected" : ""}`);
    const tick = make(row, "input");
    tick.type = "checkbox";
    tick.checked = enabled && !stage.array;
    tick.disabled = stage.array;
    tick.setAttribute("aria-label", `${stage.name} runs`);
    tick.addEventListener("change", () => on.toggle(stage, tick.checked));
    const name = make(row, "button", `name${enabled && !stage.array ? "" : " off"}`, stage.name);
    name.title = stage.title;
    name.setAttribute("aria-pressed", String(stage.name === selected));
    name.addEventListener("click", () => on.select(stage));
    if (stage.array) make(row, "span", "unit", "not running here").title = "a Python stage on arrays";
    if (stage.changed) make(row, "span", "changed").title = "changed";
  }
  const stage = chain.find((s) => s.name === selected);
  make(root, "div", "section", stage.name);
  const box = make(root, "div", "sliders");
  make(box, "p", "about", stage.title.slice(stage.title.indexOf(":") + 1).trim());
  for (const parameter of stage.parameters) {
    control(
      box,
      parameter,
      own(stage, parameter),
      (v) => on.change(stage, parameter, v),
      () => on.reset(stage, parameter),
    );
  }
  if (!stage.parameters.length) make(box, "p", "about", "no parameters");
  root.scrollTop = scroll;
}
