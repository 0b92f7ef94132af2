"""Left column of the page: pose and stages with their switches, and sliders of one section."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from html import escape
from typing import Any

from nicegui import ui

from glsim.cli.tune_page.controls import Control, pose_controls, stage_controls, wall_control
from glsim.cli.tune_page.preview import Picture
from glsim.cli.tune_page.session import plain_value
from glsim.cli.tune_page.tab import TuneTab
from glsim.core.errors import GlsimError
from glsim.noise.stage import Stage
from glsim.sensors.sensor import Sensor, load_sensor
from glsim.settings.distribution import Distribution, constant

_POSE = "pose and scene"
#: A slider sends at most one change in this time, seconds; it always sends the last change.
_THROTTLE = 0.04


def words(value: Any, unit: str = "") -> str:
    """Format a value for the user, such as "1.5 mm" or "1 to 3 mm"; None becomes "off"."""
    if value is None:
        return "off"
    end = f" {unit}" if unit else ""
    if not isinstance(value, Mapping):
        return f"{float(value):g}{end}"
    if "normal" in value:
        return "{:g} ± {:g}".format(*value["normal"]) + end
    if "choice" in value:
        return ", ".join(f"{v:g}" for v in value["choice"]) + end
    return "{:g} to {:g}".format(*value[_range_of(value)]) + end


def own_value(control: Control) -> Any:
    """Return the start value of a control, before any change; None if it is off at the start."""
    return None if control.off else plain_value(control.start)


def _range_of(value: Any) -> str | None:
    """Return "uniform" or "loguniform" for a distribution with two ends; None for others."""
    kinds = [k for k in ("uniform", "loguniform") if isinstance(value, Mapping) and k in value]
    return kinds[0] if kinds else None


class ControlRow:
    """Row of a control: label, number box, slider, and a menu for reset or a random range."""

    def __init__(
        self, control: Control, value: Any, change: Callable[[str, Any], None],
        settle: Callable[[], None],
    ) -> None:  # fmt: skip
        """Build the elements of the row.

        Args:
            value: a number, a table of a distribution, or None (off).
            change: takes the control's name and its new value; None resets.
            settle: called when a movement of the slider ends.
        """
        self.control, self._change, self._settle = control, change, settle
        self.value = value
        with ui.element("div").classes("control") as self._root:
            self._root.props["data-name"] = control.name
            self._fill()

    def set(self, value: Any) -> None:
        """Show a value that was changed elsewhere (undo, reset, a file)."""
        if value != self.value:
            self.value = value
            self._root.clear()
            with self._root:
                self._fill()

    def _fill(self) -> None:
        control, value = self.control, self.value
        is_number = control.kind != "bool" and not isinstance(value, Mapping)
        with ui.element("div").classes("label") as label:
            ui.html(f"<span>{escape(control.label)}</span>", sanitize=False)
            self._was = ui.label().classes("was").style("display: inline")
            ui.tooltip(control.help).props("delay=600 max-width=280px")
        label.props["title"] = control.name
        self._box: ui.number | None = None
        self._range: ui.label | None = None
        if is_number:
            box = ui.number(
                value=value, format="%.6g", placeholder="off", on_change=lambda e: self._typed(e)
            ).props("dense outlined debounce=300")
            box.on("blur", lambda: (box.set_value(self.value), self._settle()))
            box.props["aria-label"] = f"{control.name} value"
            self._box = box
        elif isinstance(value, Mapping):
            self._range = ui.label().classes("label drawn")
        else:
            switch = ui.switch(value=bool(value), on_change=lambda e: self._move(float(e.value)))
            switch.props("dense").props["aria-label"] = control.name
        if self._range is None:
            ui.label(control.unit).classes("unit")
        with ui.button("⋮").props("flat dense") as more, ui.menu().props("auto-close"):
            more.props["aria-label"] = f"menu of {control.name}"
            ui.menu_item("Reset", lambda: self._change(control.name, None))
            if control.kind != "bool":
                ui.menu_item("One number", lambda: self._change(control.name, self._middle()))
                ui.menu_item("Drawn evenly from a range", self._to_range)
        self._slide: ui.slider | None = None
        with ui.element("div").classes("slide"):
            if is_number:
                self._add_slider()
            elif kind := _range_of(value):
                self._add_range(kind)
        self._mark()

    def _add_slider(self) -> None:
        control = self.control
        least, most = control.position(control.least), control.position(control.most)
        at = min(max(control.position(self._middle()), least), most)
        slide = ui.slider(min=least, max=most, step=control.step, value=at).props("dense")
        slide.on("update:model-value", lambda e: self._slid(e), throttle=_THROTTLE)
        slide.on("change", self._settle).props["aria-label"] = control.name
        self._slide = slide

    def _add_range(self, kind: str) -> None:
        control = self.control

        def moved(event: Any) -> None:
            ends = [control.value(float(event.args[end])) for end in ("min", "max")]
            self._move({**self.value, kind: ends})

        least, most = control.position(control.least), control.position(control.most)
        low, high = (control.position(float(v)) for v in self.value[kind])
        ends = ui.range(
            min=least, max=most, step=control.step, value={"min": low, "max": high}
        ).props("dense")
        ends.on("update:model-value", moved, throttle=_THROTTLE)
        ends.on("change", self._settle).props["aria-label"] = control.name

    def _mark(self) -> None:
        start = own_value(self.control)
        self._was.set_text("" if start == self.value else f"was {words(start)}")
        if self._range is not None:
            self._range.set_text(words(self.value, self.control.unit))

    def _move(self, value: Any) -> None:
        if value != self.value:
            self.value = value
            self._mark()
            self._change(self.control.name, value)

    def _slid(self, event: Any) -> None:
        value = self.control.value(float(event.args))
        if self._box is not None:
            self._box.set_value(value)
        self._move(value)

    def _typed(self, event: Any) -> None:
        if event.value is None:
            return
        value = min(max(float(event.value), self.control.low), self.control.high)
        if self.control.kind == "int":
            value = float(round(value))
        if self._slide is not None:
            self._slide.set_value(self.control.position(value))
        self._move(value)
        if not self.control.low <= float(event.value) <= self.control.high:
            bound = "at most" if float(event.value) > self.control.high else "at least"
            self._was.set_text(f"{bound} {value:g} {self.control.unit}".strip())

    def _middle(self) -> float:
        """Return the value as one number, which is the start value for a control that is off."""
        if not isinstance(self.value, Mapping):
            return float(plain_value(self.control.start) if self.value is None else self.value)
        middle = 0.5 * sum(Distribution(**self.value).bounds())
        return float(round(middle)) if self.control.kind == "int" else middle

    def _to_range(self) -> None:
        middle, control = self._middle(), self.control
        reach = 0.5 * abs(middle or control.most)
        ends = max(control.low, middle - reach), min(control.high, middle + reach)
        self._change(control.name, {"uniform": [float(f"{end:.4g}") for end in ends]})


class StageList:
    """Left column with a row for each stage, and the sliders of the selected stage."""

    def __init__(self, page: TuneTab, new_stage: Callable[[], Awaitable[None]]) -> None:
        """Create an empty list; ``new_stage`` asks the user for a new stage."""
        self._page, self._new_stage = page, new_stage
        self._own: tuple[str, Sensor] | None = None
        self._plan: object = None
        self._rows: dict[str, ControlRow] = {}
        self._switches: dict[str, ui.switch] = {}
        self._dots: dict[str, ui.element] = {}
        self._root = ui.element("div")

    def refresh(self, picture: Picture) -> None:
        """Show the stages and values of a picture; elements that still fit are kept."""
        page, sensor = self._page, picture.sensor
        names = [stage.name for stage in sensor.stages]
        if page.selected not in (*names, _POSE):
            page.selected = (*names, _POSE)[0]
        declared = tuple((s.name, tuple(s.spec.parameters.items())) for s in sensor.stages)
        plan = (page.selected, declared, page.history.now.sensor)
        if plan != self._plan:
            self._plan = plan
            self._fill(picture)
        values = page.history.now.values
        for name, row in self._rows.items():
            row.set(values[name] if name in values else own_value(row.control))
        for stage in sensor.stages:
            self._switches[stage.name].set_value(_is_on(stage))
            changed = any(name.startswith(f"{stage.name}.") for name in values)
            self._dots[stage.name].set_visibility(changed or stage.name in page.history.now.code)

    def reload(self) -> None:
        """Forget the sensor's own values, so that the next picture reads them again."""
        self._own = self._plan = None

    def _fill(self, picture: Picture) -> None:
        page = self._page
        self._root.clear()
        self._rows, self._switches, self._dots = {}, {}, {}
        own = self._own_sensor(picture)
        with self._root:
            ui.label("scene").classes("section")
            pose = pose_controls(page.session.base)
            if page.session.base.scene.room == "none":
                pose.append(wall_control(page.session.base))
            self._section(_POSE, pose)
            ui.label("noise, stage by stage").classes("section")
            for stage in picture.sensor.stages:
                self._section(stage.name, stage_controls(_with_values_of(stage, own)), stage)
            new = ui.button("New stage", icon="add", on_click=self._new_stage)
            new.props("flat dense size=sm").style("margin: 8px")

    def _section(self, name: str, controls: list[Control], stage: Stage | None = None) -> None:
        """Add the row of a stage or of the pose, with its sliders if it is selected."""
        page = self._page
        with ui.element("div").classes("stage-row") as row:
            row.props["data-section" if stage is None else "data-stage"] = name
            with ui.element("button").classes("name") as button:
                ui.label(name)
            button.on("click", lambda: self._select(name))
            if stage is not None:
                button.tooltip(stage.spec.title).props("delay=600 max-width=280px")
                self._dots[name] = ui.element("span").classes("changed").tooltip("changed")
                switch = ui.switch(
                    value=_is_on(stage), on_change=lambda e: self._switched(name, bool(e.value))
                ).props("dense size=sm")
                switch.props["aria-label"] = f"{name} on or off"
                self._switches[name] = switch
        if page.selected != name:
            return
        row.classes("selected")
        with ui.element("div").classes("sliders"):
            for control in controls:
                value = page.history.now.values.get(control.name, own_value(control))
                self._rows[control.name] = ControlRow(
                    control, value, page.set_value, page.history.settle
                )
            if not controls:
                ui.label("no parameters").classes("unit")

    def _own_sensor(self, picture: Picture) -> Sensor:
        """Load the sensor from its file; use the shown sensor while the file has an error."""
        name = self._page.history.now.sensor
        if self._own is None or self._own[0] != name:
            try:
                self._own = (name, load_sensor(name))
            except GlsimError:
                return picture.sensor
        return self._own[1]

    def _select(self, name: str) -> None:
        self._page.selected = name
        self._page.show_settings()

    def _switched(self, name: str, on: bool) -> None:
        if (picture := self._page.picture) is not None:
            (stage,) = (s for s in picture.sensor.stages if s.name == name)
            if _is_on(stage) != on:
                self._page.set_value(f"{name}.enabled", on)


def _is_on(stage: Stage) -> bool:
    return stage.settings["enabled"].bounds()[1] > 0


def _with_values_of(stage: Stage, sensor: Sensor) -> Stage:
    """Return the stage with the sensor's original values, which rows show after "was"."""
    own = {s.name: s.settings for s in sensor.stages}.get(stage.name, {})
    settings = {k: own.get(k, constant(p.default)) for k, p in stage.spec.parameters.items()}
    return Stage(stage.name, stage.spec, settings)
