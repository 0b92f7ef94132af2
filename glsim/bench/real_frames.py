"""AUC by which real frames are told from their replay through a shipped sensor."""

from __future__ import annotations

from pathlib import Path

from glsim.sensors.sensor import SENSOR_FOLDER, Sensor
from glsim.settings.toml_tables import read_toml

#: Sensor -> frames, and kind of patches -> AUC of the regression and of the trees.
_TABLE = Path(__file__).with_name("real_frames.toml")


def told_apart(sensor: Sensor) -> str:
    """Describe how well real frames are told from a shipped sensor's; "" if none were compared."""
    row = read_toml(_TABLE).get(sensor.name, {}) if sensor.file.parent == SENSOR_FOLDER else {}
    aucs = [
        f"{kind} {linear:.2f} / {boosted:.2f}"
        for kind, (linear, boosted) in row.get("auc", {}).items()
    ]
    return f"{', '.join(aucs)} ({row['frames']})" if row else ""
