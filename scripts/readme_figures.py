"""Draw the figures of docs/figures: python -m scripts.readme_figures [NAME ...].

One face seen by seven sensors, eight people of the presets office and living-room, one depth map
with the noise of nine sensors, hair and cloth after denoisers, and 64 people. Takes two minutes and
needs glsim fetch people. Seeds are chosen by eye; widths in captions hold at the head's distance.
"""

import sys
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim import DepthNoise, Frame, load_denoiser, load_settings, simulate
from glsim.core.files.atomic import write_atomic
from glsim.data.contact_sheet import Picture, brightness, shaded

_FIGURES: Final = Path(__file__).resolve().parents[1] / "docs" / "figures"
#: Sensor -> its caption and the distance of the face, mm: where each camera is used.
_SENSORS: Final = {
    "kinect-v2": ("Kinect V2", 700.0),
    "azure-kinect": ("Azure Kinect", 700.0),
    "realsense-d435": ("RealSense D435", 450.0),
    "realsense-d455": ("RealSense D455", 600.0),
    "realsense-d405": ("RealSense D405", 350.0),
    "truedepth": ("TrueDepth", 350.0),
    "kinect-v1-pattern": ("Kinect V1", 650.0),
}
_ROWS: Final = ("clean", "noisy", "denoised", "infrared")
#: Side of what is shown, mm at the face's distance, and of a tile, px.
_SHOWN_MM, _TILE_PX = 285.0, 230
_CAPTION_PX, _MARGIN_PX = 30, 92
#: Preset -> seed of its people and which of the twelve are shown.
_ROOMS: Final = {"office": (34, (7, 4, 5, 8)), "living-room": (42, (1, 3, 7, 11))}
#: Depths at the ends of the scale of colours, mm: near is bright, as in all pictures of depth.
_NEAR_MM, _FAR_MM = 600.0, 4500.0
#: Sensors of one_map, in reading order after the clean map.
_ON_ONE_MAP: Final = (
    "kinect-v2-fast", "kinect-v2", "azure-kinect", "realsense-d4xx-fast", "realsense-d435",
    "truedepth", "kinect-v1-pattern", "kinect-v2-fankhauser", "any-depth-camera",
)  # fmt: skip
#: Denoisers of form.
_ON_FORM: Final = ("face", "guided:radius=1,epsilon_mm=5", "tgv")


def _frames(preset: str | None, people: int, **overrides: Any) -> list[Frame]:
    one = {"subjects": people, "frames_per_subject": 1}
    settings = load_settings(preset=preset, overrides=overrides, source=one)
    return [frame for frame in simulate(settings) if isinstance(frame, Frame)]


def _caption(text: str, width: int, height: int = _CAPTION_PX, left: int = 6) -> Picture:
    field = np.full((height, width, 3), 255, np.uint8)
    at = (left, height // 2 + 6)
    cv2.putText(field, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.55, (0, 0, 0), 1, cv2.LINE_AA)
    return field


def _sensor_column(sensor: str, name: str, distance_mm: float) -> Picture:
    """Draw the square tiles of one sensor below its caption."""
    (frame,) = _frames(
        "office",
        1,
        sensor=sensor,
        seed=74,
        pose={"distance_mm": distance_mm, "x_mm": 0, "y_mm": 132, "yaw_deg": 14},
        scene={"camera_mm": 1240, "behind_mm": 900, "people": 0},
    )
    image = frame.intrinsics
    side = min(round(_SHOWN_MM * image.fx / distance_mm), image.width, image.height)
    top, left = (max(round(centre - side / 2), 0) for centre in (image.cy, image.cx))
    clean_m = np.zeros(frame.noisy.shape, np.float32)
    clean_m[frame.window.slices] = frame.clean_m
    depths_mm = (1000 * clean_m, frame.noisy, load_denoiser("face")(frame.noisy).depth_mm)
    pictures = [shaded((0.001 * d).astype(np.float32), image) for d in depths_mm]
    pictures.append(brightness(frame.infrared, frame.noisy.shape))
    how = cv2.INTER_CUBIC if side < _TILE_PX else cv2.INTER_AREA
    tiles = [
        cv2.resize(p[top : top + side, left : left + side], (_TILE_PX, _TILE_PX), interpolation=how)
        for p in pictures
    ]
    below = name, f"{0.001 * distance_mm:.2f} m, {_SHOWN_MM:.0f} mm wide"
    return np.vstack([*tiles, *(_caption(line, _TILE_PX) for line in below)])


def sensors() -> Picture:
    """Draw shaded clean, noisy and denoised depth and infrared of one face by all sensors."""
    names = [_caption(row, _MARGIN_PX, _TILE_PX) for row in _ROWS]
    names.append(_caption("", _MARGIN_PX, 2 * _CAPTION_PX))
    columns = [_sensor_column(name, *how) for name, how in _SENSORS.items()]
    return np.hstack([np.vstack(names), *columns])


def _colours(depth_mm: NDArray[Any]) -> Picture:
    share = np.clip((_FAR_MM - depth_mm) / (_FAR_MM - _NEAR_MM), 0, 1)
    picture = cv2.applyColorMap((255 * share).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    return np.where(depth_mm[..., None] > 0, picture, 0).astype(np.uint8)


def _room_row(frame: Frame, preset: str) -> Picture:
    """Draw shaded clean depth, noisy depth and infrared of a frame at half their size."""
    clean = shaded((0.001 * frame.clean).astype(np.float32), frame.intrinsics)
    joined = np.hstack([clean, _colours(frame.noisy), brightness(frame.infrared, clean.shape[:2])])
    row = cv2.resize(joined, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    assert frame.head_to_camera is not None
    distance_m = frame.head_to_camera[2, 3]
    width_m = frame.intrinsics.width * distance_m / frame.intrinsics.fx
    text = f"{preset}, kinect-v2: head at {distance_m:.1f} m, there {width_m:.1f} m wide"
    return np.vstack([row, _caption(text, row.shape[1])])


def rooms() -> Picture:
    """Draw the people of each preset in a column, and the scale of colours."""
    columns = []
    for preset, (seed, shown) in _ROOMS.items():
        frames = _frames(preset, 12, seed=seed)
        columns.append(np.vstack([_room_row(frames[person], preset) for person in shown]))
    sheet = np.hstack(columns)
    scale = _colours(np.tile(np.linspace(_NEAR_MM, _FAR_MM, sheet.shape[1] // 2), (_CAPTION_PX, 1)))
    end = sheet.shape[1] // 4
    near, far = (f"{0.001 * depth_mm:.1f} m" for depth_mm in (_NEAR_MM, _FAR_MM))
    row = np.hstack([_caption(near, end, left=end - 54), scale, _caption(far, end)])
    return np.vstack([sheet, row])


def one_map() -> Picture:
    """Draw one depth map, shaded, without noise and with that of several sensors."""
    pose = {"distance_mm": 800, "x_mm": 0, "y_mm": 132}
    scene = {"camera_mm": 1240, "behind_mm": 700, "people": 0}
    (frame,) = _frames("office", 1, sensor="ideal", seed=74, pose=pose, scene=scene)
    image, clean_m = frame.intrinsics, (0.001 * frame.clean).astype(np.float32)
    camera: Any = {"focal_px": (image.fx, image.fy), "centre_px": (image.cx, image.cy)}
    maps = {"clean": clean_m}
    for sensor in _ON_ONE_MAP:
        with DepthNoise(sensor, **camera) as noise:
            maps[sensor] = noise(clean_m, frame=2)
    tiles = []
    for name, depth_m in maps.items():
        picture = shaded(depth_m, image)[100:-100, 130:-130]
        tiles.append(np.vstack([picture, _caption(name, picture.shape[1])]))
    return np.vstack([np.hstack(tiles[:5]), np.hstack(tiles[5:])])


def form() -> Picture:
    """Draw shaded hair and a beard: clean depth, noisy depth, and after each denoiser."""
    rows = []
    for yaw_deg, seed in ((150, 5), (20, 8)):
        pose = {"distance_mm": 800, "y_mm": -10, "yaw_deg": yaw_deg, "motion": 0}
        output, wear = {"crop": 144, "depth_unit_mm": 0.1}, {"wear": "always"}
        (frame,) = _frames(None, 1, seed=seed, pose=pose, appearance=wear, output=output)
        noisy_mm = frame.noisy * np.float32(0.1)
        maps = {"clean": frame.clean * np.float32(0.1), "kinect-v2": noisy_mm}
        maps |= {name: load_denoiser(name)(noisy_mm).depth_mm for name in _ON_FORM}
        tiles = []
        for name, depth_mm in maps.items():
            picture = shaded((0.001 * depth_mm).astype(np.float32), frame.intrinsics)
            tile = cv2.resize(picture, (_TILE_PX, _TILE_PX), interpolation=cv2.INTER_CUBIC)
            tiles.append(np.vstack([tile, _caption(name, _TILE_PX)]))
        rows.append(np.hstack(tiles))
    return np.vstack(rows)


def heads() -> Picture:
    """Draw the shaded clean depth of 64 people of the preset heads, all at 0.7 m."""
    output = {"crop": 176, "depth_unit_mm": 0.1}
    frames = _frames("heads", 64, seed=3, pose={"distance_mm": 700}, output=output)
    shown = [shaded((1e-4 * f.clean).astype(np.float32), f.intrinsics) for f in frames]
    rows = [np.hstack(shown[k : k + 8]) for k in range(0, 64, 8)]
    return np.asarray(cv2.resize(np.vstack(rows), None, fx=0.7, fy=0.7, interpolation=3))


if __name__ == "__main__":
    figures = sensors, rooms, one_map, form, heads
    for draw in [draw for draw in figures if draw.__name__ in sys.argv[1:]] or figures:
        encoded = cv2.imencode(".webp", draw(), [cv2.IMWRITE_WEBP_QUALITY, 82])[1]
        write_atomic(encoded.tobytes(), _FIGURES / f"{draw.__name__}.webp")
