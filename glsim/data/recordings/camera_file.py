"""The stated camera of a recording, from ``camera.toml`` beside the frames or from its files.

docs/howto/recordings.md shows its keys; the lens of [distortion] is not removed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, Final, Literal, get_args

from pydantic import Field, model_validator

from glsim.core.camera import Distortion, Intrinsics
from glsim.core.errors import ConfigError, DatasetError, did_you_mean
from glsim.core.files.atomic import write_atomic
from glsim.core.files.regular import MOST_HELD, read_data
from glsim.settings.toml_tables import TomlTable, parse_table, read_toml, toml_value

#: The file that describes the camera, beside the frames.
CAMERA_FILE = "camera.toml"
#: First line of a file that glsim wrote and may replace.
_WRITTEN: Final = b"# written by glsim beside its maps, which it describes"

_Focal = Annotated[float, Field(ge=1, le=1e6)]
_Coefficient = Literal["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]
_Pixels = Annotated[float, Field(ge=-1e6, le=1e6)]


@dataclass(frozen=True)
class StatedCamera:
    """A camera as files state it, by the keys of ``camera.toml``.

    A value that is not stated is None or empty. Distortion is in OpenCV's order: k1, k2, p1, p2,
    k3, and k4, k5, k6 if stated.
    """

    intrinsics: Intrinsics | None = None
    distortion: tuple[float, ...] = ()
    unit_mm: float | None = None
    baseline_m: float | None = None
    name: str = ""
    sensor: str = ""
    channel: str = ""
    along_ray: bool = False

    def over(self, other: StatedCamera) -> StatedCamera:
        """Return this camera, with missing values taken from ``other``.

        Lens and intrinsics belong together and come from the same file.
        """
        said = {f.name for f in fields(self) if getattr(self, f.name) != f.default}
        if self.intrinsics is not None:
            said.add("distortion")
        return replace(other, **{name: getattr(self, name) for name in said})


class _CameraTable(TomlTable, allow_inf_nan=False):
    name: str = ""
    sensor: str = ""
    channel: str = ""
    along_ray: bool = False
    unit_mm: float | None = Field(None, gt=0, le=1000)
    width: int | None = Field(None, ge=8, le=8192)
    height: int | None = Field(None, ge=8, le=8192)
    focal_px: tuple[_Focal, _Focal] | None = None
    centre_px: tuple[_Pixels, _Pixels] | None = None
    baseline_m: float | None = Field(None, gt=0, le=10)
    distortion: Mapping[_Coefficient, float] = Field({})

    @model_validator(mode="after")
    def _check(self) -> _CameraTable:
        own = {name: getattr(self, name) for name in ("width", "height", "focal_px")}
        missing = [name for name, value in own.items() if value is None]
        if 0 < len(missing) < len(own):
            raise ValueError(f"{' and '.join(missing)} missing: give width, height and focal_px")
        if missing and (self.centre_px is not None or self.distortion):
            raise ValueError("centre_px and distortion need width, height and focal_px")
        return self


def read_camera_file(file: Path) -> StatedCamera:
    """Read a ``camera.toml``.

    Raises ConfigError: the file cannot be read, has an unknown key or an impossible value.
    """
    table = parse_table(_CameraTable, read_toml(file), str(file))
    intrinsics = None
    if table.width is not None and table.height is not None and table.focal_px is not None:
        centre = table.centre_px or (table.width / 2, table.height / 2)
        intrinsics = Intrinsics(table.width, table.height, *table.focal_px, *centre)
    lens = Distortion(**dict(table.distortion))
    own = StatedCamera(
        intrinsics, opencv_order(lens), table.unit_mm, table.baseline_m, table.name, table.sensor,
        table.channel, table.along_ray,
    )  # fmt: skip
    return own.over(sensor_camera(table.sensor, file)) if table.sensor else own


def write_camera_file(camera: StatedCamera, folder: Path) -> None:
    """Write a camera's known values to ``camera.toml``; never replace a file of the user's.

    The sensor stands in the name: the key ``sensor`` would also state intrinsics.
    """
    title = ": ".join(dict.fromkeys(filter(None, (camera.sensor, *camera.name.split(": ")))))
    values: dict[str, Any] = {"name": title, "unit_mm": camera.unit_mm}
    values["baseline_m"] = camera.baseline_m
    if (own := camera.intrinsics) is not None:
        values |= {"width": own.width, "height": own.height}
        values |= {"focal_px": (own.fx, own.fy), "centre_px": (own.cx, own.cy)}
        if len(camera.distortion) <= len(names := get_args(_Coefficient)):
            values["distortion"] = dict(zip(names, camera.distortion, strict=False))
    file, lines = folder / CAMERA_FILE, [f"{k} = {toml_value(v)}" for k, v in values.items() if v]
    if lines and (not file.exists() or read_data(file, MOST_HELD).startswith(_WRITTEN)):
        write_atomic("\n".join([_WRITTEN.decode(), *lines, ""]).encode(), file)


def sensor_camera(name: str, where: Path) -> StatedCamera:
    """Return the camera of a shipped sensor: intrinsics, distortion, step, baseline, title.

    Raises ConfigError, which names the file ``where``, for other sensors.
    """
    from glsim.sensors.sensor import load_sensor, shipped_sensors

    if name not in shipped_sensors():  # a sensor file may run code
        raise ConfigError(
            f"{where}: sensor: {name!r} is no sensor that glsim ships "
            f"({did_you_mean(name, shipped_sensors())}); name your own in the command"
        )
    sensor = load_sensor(name)
    rig, matcher = sensor.rig, sensor.matcher
    unit = None if matcher is None else matcher.settings["depth_unit_mm"].bounds()[0]
    lens, baseline_m = opencv_order(rig.distortion), rig.baseline_m or None
    return StatedCamera(rig.intrinsics, lens, unit, baseline_m, sensor.title)


def opencv_order(lens: Distortion) -> tuple[float, ...]:
    """Return the coefficients of a lens in OpenCV's order; empty for none."""
    simple = (lens.k1, lens.k2, lens.p1, lens.p2, lens.k3)
    if lens.is_rational:
        return (*simple, lens.k4, lens.k5, lens.k6)
    return simple if any(simple) else ()


def check_size(camera: StatedCamera, shape: tuple[int, ...], where: Path | str) -> None:
    """Raise DatasetError if a stated camera has another size than an (H, W) image."""
    own = camera.intrinsics
    if own is not None and (own.height, own.width) != shape:
        raise DatasetError(
            f"{where}: says {own.width}x{own.height}, but the frames are {shape[1]}x{shape[0]}: "
            "correct width, height, focal_px and centre_px"
        )
