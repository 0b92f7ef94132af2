"""The result of a fit: a shipped sensor with fitted values, written as a TOML file."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Intrinsics
from glsim.core.errors import ConfigError
from glsim.core.files.atomic import write_atomic
from glsim.sensors.sensor import Sensor
from glsim.settings.toml_tables import toml_value

#: Stands in the text of a sensor for the name of the map's file.
PATTERN_MAP = "@fixed_pattern.npy"


@dataclass(frozen=True, eq=False)
class FittedSensor:
    """A sensor that was fitted to a recording.

    Attributes:
        lines: name of a result -> its text.
        map_mm: (H, W) float32 fixed pattern of the device, NaN = unknown. None: not measured.
    """

    text: str
    image: Intrinsics
    lines: Mapping[str, str]
    map_mm: NDArray[np.float32] | None = None


def write_fitted(fitted: FittedSensor, file: Path) -> list[Path]:
    """Write a sensor file, and beside it the map of the fixed pattern; return the files."""
    written = [file]
    if fitted.map_mm is not None:
        picture = io.BytesIO()
        np.save(picture, fitted.map_mm)
        written.append(map_of(file))
        write_atomic(picture.getvalue(), map_of(file))
    text = fitted.text.replace(PATTERN_MAP, map_of(file).name)
    write_atomic(text.encode(), file)
    return written


def map_of(file: Path) -> Path:
    """Return the file of the fixed pattern's map beside a sensor file."""
    return file.with_name(f"{file.stem}_fixed_pattern.npy")


def recording_camera(
    size: tuple[int, int], stated: Intrinsics | None, own: Intrinsics, focal_px: float | None,
    other_px: float | None = None,
) -> Intrinsics:  # fmt: skip
    """Choose the intrinsics of a recording.

    ``own``: of the base sensor, for a recording that states none of this size, (width, height).
    ``other_px``: focal length if neither has this size; None raises ConfigError.
    """
    known = [k for k in (stated, own) if k is not None and (k.width, k.height) == size]
    fx = fy = focal_px or other_px or 0.0
    if known and focal_px is None:
        fx, fy = known[0].fx, known[0].fy
    if min(fx, fy) < 1:
        raise ConfigError(
            f"the frames are {size[0]}x{size[1]}, base {own.width}x{own.height}: give --focal-px"
        )
    cx, cy = (known[0].cx, known[0].cy) if known else (size[0] / 2, size[1] / 2)
    return Intrinsics(*size, fx, fy, cx, cy)


def sensor_toml(
    comments: Sequence[str], sensor: Sensor, base: str, image: Intrinsics,
    rig: Mapping[str, Any], values: Mapping[str, float],
) -> str:  # fmt: skip
    """Write the text of a sensor file that extends ``sensor``, whose name or file is ``base``.

    ``rig``: further keys of [rig]; "imager" and "emitter" are lists of tables. ``values``: of
    STAGE.PARAMETER; they are cut to the parameter's range.
    """
    table = {
        "width": image.width, "height": image.height,
        "focal_px": [round(f, 4) for f in (image.fx, image.fy)],
        "centre_px": [round(c, 4) for c in (image.cx, image.cy)], **rig,
    }  # fmt: skip
    tables = [("rig." + name, table.pop(name, ())) for name in ("imager", "emitter")]
    for stage in sensor.stages:
        fitted = {}
        for key, declared in stage.spec.parameters.items():
            if (value := values.get(f"{stage.name}.{key}")) is not None:
                bounded = min(max(value, declared.low), declared.high)
                fitted[key] = round(bounded) if declared.type == "int" else bounded
        if fitted:
            tables.append(("stage", [{"use": stage.spec.name, "name": stage.name, **fitted}]))
    title = f"fitted to a recording, from {sensor.name}"
    lines = [f"# {comment}".rstrip() for comment in comments]
    lines += [*_entries({"extends": base, "title": title}), "", "[rig]", *_entries(table)]
    for name, group in tables:
        for entry in group:
            lines += ["", f"[[{name}]]", *_entries(entry)]
    return "\n".join(lines) + "\n"


def _entries(table: Mapping[str, Any]) -> list[str]:
    return [f"{key} = {toml_value(value)}" for key, value in table.items()]
