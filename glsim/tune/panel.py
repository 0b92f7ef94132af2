"""The left of the page: stages with their switches, and the sliders of the selected one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from html import escape
from typing import Any

from nicegui import ui

from glsim.settings.distribution import Distribution
from glsim.tune.controls import Control
from glsim.tune.faces import plain_value

#: Called with the name of ``--set`` and the new value; None resets.
Change = Callable[[str, Any], None]

#: The slider sends at most one change in this time, seconds; the last one always.
_THROTTLE = 0.04


def words(value: Any, unit: str = "") -> str:
    """Write a value for people: 1.5 mm, 1 to 3 mm; None is off."""
    if value is None:
        return "off"
    end = f" {unit}" if unit else ""
    if isinstance(value, Mapping):
        for kind, log in (("uniform", ""), ("loguniform", ", log")):
            if kind in value:
                return "{:g} to {:g}".format(*value[kind]) + end + log
        if "normal" in value:
            return "{:g} ± {:g}".format(*value["normal"]) + end
        return ", ".join(f"{v:g}" for v in value.get("choice", ())) + end
    return f"{float(value):g}{end}"


def own_value(control: Control) -> Any:
    """Return the start value of a control, before any change; None if it starts switched off."""
    return None if control.off else plain_value(control.start)


def _range_of(value: Any) -> str | None:
    """The kind of a distribution that has two ends."""
    kinds = [k for k in ("uniform", "loguniform") if isinstance(value, Mapping) and k in value]
    return kinds[0] if kinds else None


class ControlRow:
    """One control: label, box, slider, and a menu to reset it or to make it a distribution."""

    def __init__(self, control: Control, value: Any, change: Change, settle: Callable[[], None]):
        self.control, self._change, self._settle = control, change, settle
        self.value = value
        with ui.element("div").classes("control") as self._root:
            self._root.props["data-name"] = control.name
            self._fill()

    def set(self, value: Any) -> None:
        """Show another value, which came from elsewhere (undo, reset, a link)."""
        if value == self.value:
            return
        self.value = value
        self._root.clear()
        with self._root:
            self._fill()

    def _fill(self) -> None:
        control, value = self.control, self.value
        with ui.element("div").classes("label") as label:
            ui.html(f"<span>{escape(control.label)}</span>", sanitize=False)
            self._was = ui.label().classes("was").style("display: inline")
            ui.tooltip(control.help).props("delay=600 max-width=280px")
        label.props["title"] = control.name
        self._box: ui.number | None = None
        self._drawn: ui.label | None = None
        if isinstance(value, Mapping):
            self._drawn = ui.label().classes("label drawn")
        elif control.kind == "bool":
            switch = ui.switch(value=bool(value), on_change=lambda e: self._moved(float(e.value)))
            switch.props("dense").props["aria-label"] = control.name
        else:
            self._box = (
                ui.number(value=value, format="%.6g", placeholder="off", on_change=self._typed)
                .props("dense outlined debounce=300")
                .on("blur", self._left)
            )
            self._box.props["aria-label"] = f"{control.name} value"
        if not isinstance(value, Mapping):
            ui.label(control.unit).classes("unit")
        more = ui.button("⋮").props("flat dense")
        more.props["aria-label"] = f"menu of {control.name}"
        with more, ui.menu().props("auto-close"):
            ui.menu_item("Reset", lambda: self._change(control.name, None))
            if control.kind != "bool":
                ui.menu_item("One number", lambda: self._change(control.name, self._middle()))
                ui.menu_item("Drawn evenly from a range", self._to_uniform)
                ui.menu_item("Drawn from a normal distribution", self._to_normal)
        self._slide: ui.slider | None = None
        if control.kind != "bool":
            with ui.element("div").classes("slide"):
                self._slider(value)
        self._mark()

    def _slider(self, value: Any) -> None:
        control = self.control
        least, most = control.position(control.least), control.position(control.most)
        kind = _range_of(value)
        if kind is not None:
            low, high = (control.position(float(v)) for v in value[kind])
            ends = (
                ui.range(min=least, max=most, step=control.step, value={"min": low, "max": high})
                .props("dense")
                .on("update:model-value", self._range_moved, throttle=_THROTTLE)
                .on("change", self._settle)
            )
            ends.props["aria-label"] = control.name
        elif isinstance(value, Mapping) and "normal" in value:
            with ui.row().style("gap: 8px; flex-wrap: nowrap"):
                for number, text in enumerate(("mean", "deviation")):
                    ui.number(
                        text, value=value["normal"][number],
                        on_change=lambda e, n=number: self._normal_typed(n, e.value),
                    ).props("dense debounce=300").props["aria-label"] = (
                        f"{text} of {control.name}"
                    )  # fmt: skip
        elif not isinstance(value, Mapping):
            at = min(max(control.position(self._number()), least), most)
            self._slide = (
                ui.slider(min=least, max=most, step=control.step, value=at)
                .props("dense")
                .on("update:model-value", self._slid, throttle=_THROTTLE)
                .on("change", self._settle)
            )
            self._slide.props["aria-label"] = control.name
            for key, place in (("home", least), ("end", most)):
                self._slide.on(f"keydown.{key}.prevent", lambda at=place: self._to_end(at))

    def _mark(self) -> None:
        start = own_value(self.control)
        was = "" if start == self.value else f"was {words(start)}"
        self._was.set_text(was)
        self._was.props["title"] = was
        if self._drawn is not None:
            self._drawn.set_text(words(self.value, self.control.unit))

    def _moved(self, value: Any) -> None:
        if value == self.value:
            return
        self.value = value
        self._mark()
        self._change(self.control.name, value)

    def _slid(self, event: Any) -> None:
        value = self.control.value(float(event.args))
        if self._box is not None:
            self._box.set_value(value)
        self._moved(value)

    def _to_end(self, position: float) -> None:
        """Move the slider to one of its ends, as the keys Home and End do everywhere else."""
        if self._slide is not None:
            self._slide.set_value(position)
        value = self.control.value(position)
        if self._box is not None:
            self._box.set_value(value)
        self._moved(value)
        self._settle()

    def _left(self) -> None:
        """Show the value that counts when the box is left: it may be empty, or out of the range."""
        if self._box is not None and self._box.value != self.value:
            self._box.set_value(self.value)
        self._settle()

    def _typed(self, event: Any) -> None:
        if event.value is None or isinstance(self.value, Mapping):
            return
        value = min(max(float(event.value), self.control.low), self.control.high)
        if self.control.kind == "int":
            value = float(round(value))
        if self._slide is not None:
            self._slide.set_value(self.control.position(value))
        self._moved(value)

    def _range_moved(self, event: Any) -> None:
        kind = _range_of(self.value)
        if kind is not None:
            ends = [self.control.value(float(event.args[end])) for end in ("min", "max")]
            self._moved({**self.value, kind: ends})

    def _normal_typed(self, number: int, value: float | None) -> None:
        if value is None:
            return
        both = list(self.value["normal"])
        both[number] = float(value)
        self._moved({**self.value, "normal": both})

    def _number(self) -> float:
        """The value as a number; where the slider of an absent value stands."""
        return float(plain_value(self.control.start) if self.value is None else self.value)

    def _middle(self) -> float:
        if not isinstance(self.value, Mapping):
            return self._number()
        low, high = Distribution(**self.value).bounds()
        middle = 0.5 * (low + high)
        return float(round(middle)) if self.control.kind == "int" else middle

    def _to_uniform(self) -> None:
        middle, control = self._middle(), self.control
        low = max(control.low, middle - 0.5 * abs(middle or control.most))
        high = min(control.high, middle + 0.5 * abs(middle or control.most))
        self._change(control.name, {"uniform": [float(f"{low:.4g}"), float(f"{high:.4g}")]})

    def _to_normal(self) -> None:
        middle, control = self._middle(), self.control
        room = min(middle - control.low, control.high - middle) / 3
        deviation = float(f"{max(min(0.2 * abs(middle or control.most), room), 0.0):.3g}")
        self._change(control.name, {"normal": [middle, deviation]})
