"""Reference of the shipped sensors, from their TOML files: every value with its source."""

from __future__ import annotations

import re
from itertools import takewhile

from glsim.sensors import sensor as sensor_module
from glsim.sensors.sensor import Sensor, load_sensor, sensor_names
from glsim.settings.distribution import Distribution
from scripts.reference.markdown import block, code, plain, table, toctree

_INTRODUCTION = """\
# Sensors

A sensor is a TOML file: a rig (intrinsics, lens, emitters) and a chain of [noise
stages](stages.md). Every number names its source in a comment. `glsim render face.obj --sensor
my_sensor.toml` uses a file of your own; copy a shipped one to begin.

"""


def pages() -> dict[str, str]:
    """Return page name -> Markdown: an overview, and one page per shipped sensor."""
    sensors = [load_sensor(name) for name in sensor_names()]
    rows = []
    for sensor in sensors:
        image, rig = sensor.rig.intrinsics, sensor.rig
        baseline = f"{rig.baseline_m * 1000:g} mm" if rig.emitters else "none"
        rows.append(
            [f"[`{sensor.name}`](sensors/{sensor.name}.md)", plain(sensor.title),
             f"{image.width}x{image.height}", f"{image.fx:g} px", baseline]
        )  # fmt: skip
    text = _INTRODUCTION + table(
        ["sensor", "what it is", "image", "focal length", "baseline"], rows
    )
    text += "## Keys of a sensor file\n\n"
    layout = (sensor_module.__doc__ or "").split("\n\n", 1)[1]
    text += block(layout, "text") + toctree(f"sensors/{sensor.name}" for sensor in sensors)
    return {"sensors": text} | {f"sensors/{s.name}": _page(s) for s in sensors}


def _page(sensor: Sensor) -> str:
    text = sensor.file.read_text(encoding="utf-8")
    head = [line.lstrip("# ") for line in takewhile(lambda t: t.startswith("#"), text.splitlines())]
    sources = _comments(text)
    parts = [f"# `{sensor.name}`\n\n{plain(sensor.title)}.\n\n{plain(' '.join(head))}\n\n"]
    rows = []
    for stage in sensor.stages:
        link = f"[`{stage.name}`](../stages/{stage.spec.name}.md)"
        rows.append([link, "", "", plain(sources.get((stage.name, "use"), ""))])
        for name, setting in stage.settings.items():
            parameter = stage.spec.parameters.get(name)
            default = 1.0 if parameter is None else parameter.default
            if setting.is_constant and setting.constant == default:
                continue
            unit = "" if parameter is None or parameter.unit == "1" else parameter.unit
            source = sources.get((stage.name, name), "")
            rows.append(["", code(name), code(f"{_value(setting)} {unit}".strip()), plain(source)])
    parts.append(
        "## Chain\n\nParameters that the sensor sets; all others have the stages' defaults.\n\n"
    )
    parts.append(table(["stage", "parameter", "value", "source"], rows))
    parts.append("## File\n\n" + block(text, "toml"))
    return "".join(parts)


def _value(setting: Distribution) -> str:
    if setting.constant is not None:
        return f"{setting.constant:g}"
    fields = setting.model_dump(exclude_none=True, exclude_defaults=True)
    return ", ".join(
        f"{kind} {list(v) if isinstance(v, tuple) else v}" for kind, v in fields.items()
    )


def _comments(text: str) -> dict[tuple[str, str], str]:
    """Return (stage, key) -> the comment behind the key, for the tables [[stage]] of a file."""
    found: dict[tuple[str, str], str] = {}
    for part in re.split(r"^\[\[stage\]\]", text, flags=re.MULTILINE)[1:]:
        entries = re.findall(r"^(\w+) = ([^#\n]*)(?:#\s*(.*))?$", part, flags=re.MULTILINE)
        values = {key: value.strip().strip('"') for key, value, _ in entries}
        name = values.get("name", values.get("use", ""))
        found |= {(name, key): comment for key, _, comment in entries if comment}
    return found
