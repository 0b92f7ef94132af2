"""The list on the left: pose, rig, and the chain's stages; one of them is open."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui

from glsim.errors import GlsimError
from glsim.noise.stage import Stage
from glsim.sensors.sensor import Sensor, load_sensor
from glsim.settings.distribution import Distribution, constant
from glsim.tune.bench import DrawnFrame
from glsim.tune.controls import (
    Control,
    pose_controls,
    rig_controls,
    rig_values,
    stage_controls,
    wall_control,
)
from glsim.tune.desk import Desk
from glsim.tune.panel import ControlRow, own_value

_POSE, _RIG = "pose and scene", "rig"


class Sections:
    """Rows of the left, and the controls of the open one."""

    def __init__(
        self, page: Desk, new_stage: Callable[[], None], show_code: Callable[[DrawnFrame], None]
    ) -> None:
        """Take what asks for a new stage, and what shows the code of the selected one."""
        self._page, self._new_stage, self._show_code = page, new_stage, show_code
        self._own: tuple[str, Sensor] | None = None
        self._plan: object = None
        self._stale = False
        self._rows: dict[str, ControlRow] = {}
        self._switches: dict[str, Any] = {}
        self._dots: dict[str, Any] = {}
        self._root = ui.element("div")

    def refresh(self, picture: DrawnFrame) -> None:
        """Show a picture's stages and values; elements that still fit are kept."""
        page, sensor = self._page, picture.sensor
        if not page.selected or page.selected not in {
            *(s.name for s in sensor.stages),
            _POSE,
            _RIG,
        }:
            page.selected = sensor.stages[0].name if sensor.stages else _POSE
        declared = tuple((s.name, tuple(s.spec.parameters.items())) for s in sensor.stages)
        plan = (page.selected, declared, len(sensor.rig.emitters), page.history.now.sensor)
        if plan != self._plan:
            self._plan = plan
            self._fill(picture)
        for name, row in self._rows.items():
            row.set(self._value(name, picture))
        for stage in sensor.stages:
            on = stage.settings["enabled"].bounds()[1] > 0
            self._switches[stage.name].set_value(on)
            changed = stage.name in page.history.now.code or any(
                name.startswith(f"{stage.name}.") for name in page.history.now.values
            )
            self._dots[stage.name].set_visibility(changed)

    def reload(self) -> None:
        """Read the sensor's own values anew at the next picture."""
        self._stale, self._plan = True, None

    def _value(self, name: str, picture: DrawnFrame) -> Any:
        """The current value of a control: the user's, which may be newer than the picture's."""
        if name.startswith("rig:"):
            return next(c.start for c in rig_controls(picture.sensor) if c.label == name[4:])
        values = self._page.history.now.values
        return values[name] if name in values else own_value(self._rows[name].control)

    def _fill(self, picture: DrawnFrame) -> None:
        self._root.clear()
        self._rows, self._switches, self._dots = {}, {}, {}
        with self._root:
            ui.label("scene").classes("section")
            self._heading(_POSE)
            if self._page.selected == _POSE:
                with ui.element("div").classes("sliders"):
                    self._pose(picture)
            self._heading(_RIG)
            if self._page.selected == _RIG:
                with ui.element("div").classes("sliders"):
                    self._rig(picture)
            ui.label("noise, stage by stage").classes("section")
            for stage in picture.sensor.stages:
                self._stage(stage)
            ui.button("New stage", icon="add", on_click=self._new_stage).props(
                "flat dense size=sm"
            ).style("margin: 8px")

    def _heading(self, name: str) -> None:
        row = ui.element("div").classes("stage-row")
        row.props["data-section"] = name
        with row:
            button = ui.element("button").classes("name")
            with button:
                ui.label(name)
            button.on("click", lambda: self._open(name))
        if self._page.selected == name:
            row.classes("selected")

    def _stage(self, stage: Stage) -> None:
        row = ui.element("div").classes("stage-row")
        row.props["data-stage"] = stage.name
        with row:
            with ui.element("button").classes("name") as button:
                ui.label(stage.name)
            button.on("click", lambda: self._open(stage.name))
            button.tooltip(stage.spec.title).props("delay=600 max-width=280px")
            self._dots[stage.name] = ui.element("span").classes("changed").tooltip("changed")
            switch = ui.switch(
                value=stage.settings["enabled"].bounds()[1] > 0,
                on_change=lambda e: self._switched(stage.name, bool(e.value)),
            ).props("dense size=sm")
            switch.props["aria-label"] = f"{stage.name} on or off"
            self._switches[stage.name] = switch
        if self._page.selected == stage.name:
            row.classes("selected")
            with ui.element("div").classes("sliders"):
                for control in stage_controls(self._original(stage)):
                    self._row(control)
                if not stage.spec.parameters:
                    ui.label("no parameters").classes("unit")

    def _own_sensor(self) -> Sensor:
        """The sensor as its file says; the last good one while the file has a mistake."""
        name = self._page.history.now.sensor
        if self._own is None or self._own[0] != name or self._stale:
            try:
                self._own, self._stale = (name, load_sensor(name)), False
            except GlsimError:
                if self._own is None or self._own[0] != name:
                    raise
        return self._own[1]

    def _original(self, stage: Stage) -> Stage:
        """The stage with the sensor's own values, which the rows call "was"."""
        own = {s.name: s.settings for s in self._own_sensor().stages}.get(stage.name, {})
        defaults = {k: constant(p.default) for k, p in stage.spec.parameters.items()}
        return Stage(stage.name, stage.spec, defaults | {k: own[k] for k in defaults if k in own})

    def _row(self, control: Control) -> None:
        page = self._page
        value = page.history.now.values.get(control.name, own_value(control))
        self._rows[control.name] = ControlRow(control, value, page.set_value, page.history.settle)

    def _pose(self, picture: DrawnFrame) -> None:
        base = self._page.workshop.base
        for control in pose_controls(base):
            self._row(control)
        if picture.settings.scene.room == "none":
            self._row(wall_control(base))

    def _rig(self, picture: DrawnFrame) -> None:
        page = self._page
        now = {control.label: control.start for control in rig_controls(picture.sensor)}
        for one in rig_controls(self._own_sensor()):
            control = Control(
                f"rig:{one.label}", one.label, "float", one.least, one.most, one.least, one.most,
                one.unit, one.help, Distribution(constant=one.start),
            )  # fmt: skip
            self._rows[control.name] = ControlRow(
                control, now[one.label], self._rig_moved, page.history.settle
            )

    def _rig_moved(self, name: str, value: Any) -> None:
        page = self._page
        assert page.sensor is not None
        if value is None:
            page.set_value("rig.focal_px" if "focal" in name else "rig.emitter", None)
        elif not isinstance(value, dict):
            page.set_value(*rig_values(page.sensor, name[4:], float(value)))

    def _open(self, name: str) -> None:
        self._page.selected = name
        if self._page.picture is not None:
            self.refresh(self._page.picture)
            self._show_code(self._page.picture)

    def _switched(self, stage: str, on: bool) -> None:
        page = self._page
        shown = page.picture
        if shown is None:
            return
        now = {s.name: s for s in shown.sensor.stages}[stage].settings["enabled"].bounds()[1] > 0
        if now != on:
            page.set_value(f"{stage}.enabled", on)
