"""Reference of the shipped sensors, from their TOML files: every value with its source."""

from __future__ import annotations

import re
from itertools import takewhile
from textwrap import dedent

from glsim.noise.stage import Stage
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
    text += block(dedent(layout)) + toctree(f"sensors/{sensor.name}" for sensor in sensors)
    return {"sensors": text} | {f"sensors/{s.name}": _page(s) for s in sensors}


def _page(sensor: Sensor) -> str:
    text = sensor.file.read_text(encoding="utf-8")
    head = [line.lstrip("# ") for line in takewhile(lambda t: t.startswith("#"), text.splitlines())]
    rig_text, *stage_texts = re.split(r"^\[\[stage\]\]", text, flags=re.MULTILINE)
    parts = [f"# `{sensor.name}`\n\n{plain(sensor.title)}.\n\n{plain(' '.join(head))}\n\n"]
    parts.append("## Rig\n\n" + table(["key", "value", "source"], _rig_rows(rig_text)))
    rows = []
    for stage, stage_text in _stages_of(sensor, stage_texts):
        given = {key: comment for key, _, comment in _lines(stage_text)}
        link = f"[`{stage.name}`](../stages/{stage.spec.name}.md)"
        rows.append([link, "", "", plain(given["use"])])
        for name, setting in stage.settings.items():
            if name in given:
                parameter = stage.spec.parameters.get(name)
                unit = "" if parameter is None or parameter.unit == "1" else parameter.unit
                value = code(f"{_value(setting)} {unit}".strip())
                rows.append(["", code(name), value, plain(given[name])])
    if base := re.search(r'^extends = "([\w-]+)"', text, flags=re.MULTILINE):
        others = f"All else is that of [`{base[1]}`]({base[1]}.md)."
    else:
        others = "All other parameters have the stages' defaults."
    parts.append(f"## Chain\n\n{others}\n\n")
    parts.append(table(["stage", "parameter", "value", "source"], rows))
    parts.append("## File\n\n" + block(text, "toml"))
    return "".join(parts)


def _stages_of(sensor: Sensor, texts: list[str]) -> list[tuple[Stage, str]]:
    """Pair the tables of a sensor file with the sensor's stages."""
    if len(texts) == len(sensor.stages):
        return list(zip(sensor.stages, texts, strict=True))
    by_name = {stage.name: stage for stage in sensor.stages}
    named = [{key: value.strip('"') for key, value, _ in _lines(text)} for text in texts]
    return [(by_name[n.get("name", n["use"])], t) for n, t in zip(named, texts, strict=True)]


def _rig_rows(text: str) -> list[list[str]]:
    """Return key, value and source of the tables before the stages."""
    rows = []
    for section in re.split(r"^(?=\[)", text, flags=re.MULTILINE)[1:]:
        name = re.match(r"\[+([\w.]+)\]+[ \t]*(?:#\s*(.*))?", section)
        assert name is not None
        if name[2]:
            rows.append([code(f"{name[1]}"), "", plain(name[2])])
        rows += [
            [code(f"{name[1]}.{key}"), code(value), plain(source)]
            for key, value, source in _lines(section)
        ]
    return rows


def _value(setting: Distribution) -> str:
    if setting.constant is not None:
        return f"{setting.constant:g}"
    fields = setting.model_dump(exclude_none=True, exclude_defaults=True)
    return ", ".join(
        f"{kind} {list(v) if isinstance(v, tuple) else v}" for kind, v in fields.items()
    )


def _lines(text: str) -> list[tuple[str, str, str]]:
    """Return key, value and comment of each line in a part of a TOML file."""
    found = re.findall(r"^(\w+) = ([^#\n]*)(?:#\s*(.*))?$", text, flags=re.MULTILINE)
    return [(key, value.strip(), comment) for key, value, comment in found]
