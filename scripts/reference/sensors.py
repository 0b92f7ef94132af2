"""Reference of the shipped sensors, from their TOML files."""

from __future__ import annotations

from textwrap import dedent

from glsim.bench.real_frames import told_apart
from glsim.sensors import sensor as sensor_module
from glsim.sensors.sensor import load_sensor, sensor_names
from scripts.reference.markdown import block, plain, table

_INTRODUCTION = """\
# Sensors

A sensor is a TOML file: a rig (intrinsics, lens, emitters) and a chain of [noise
stages](stages.md). Every number names its source in a comment of the file. `glsim render face.obj
--sensor my_sensor.toml` uses a file of your own; copy a shipped one to begin. The last
column says how well a classifier (logistic regression / boosted trees) tells real frames from
their replay; 0.5 is the goal.

"""


def pages() -> dict[str, str]:
    """Return page name -> Markdown: one page with a row per shipped sensor."""
    rows = []
    for sensor in map(load_sensor, sensor_names()):
        image, rig = sensor.rig.intrinsics, sensor.rig
        baseline = f"{rig.baseline_m * 1000:g} mm" if rig.emitters else "none"
        rows.append(
            [f"[`{sensor.name}`](../../glsim/sensors/{sensor.name}.toml)", plain(sensor.title),
             f"{image.width}x{image.height}", f"{image.fx:g} px", baseline, told_apart(sensor)]
        )  # fmt: skip
    text = _INTRODUCTION + table(
        ["sensor", "what it is", "image", "focal length", "baseline", "AUC, logistic / boosted"],
        rows,
    )
    layout = (sensor_module.__doc__ or "").split("\n\n", 1)[1]
    return {"sensors": text + "## Keys of a sensor file\n\n" + block(dedent(layout))}
