"""Draw docs/figures/sensors.png: python scripts/sensor_gallery.py.

One person seen by all kinds of sensors: infrared above, shaded noisy depth below. Takes under a
minute and needs glsim fetch people.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import cv2
import numpy as np

from glsim import Frame, load_settings, simulate
from glsim.files.atomic import write_atomic
from glsim.preview import Picture, brightness, shaded
from glsim.sensors.sensor import load_sensor

FIGURE = Path(__file__).resolve().parents[1] / "docs" / "figures" / "sensors.png"
#: Sensor -> its caption and the distance of the face, mm: where each camera is used.
_SENSORS: Final = {
    "kinect-v2": ("Kinect V2", 800.0),
    "azure-kinect": ("Azure Kinect", 800.0),
    "realsense-d435": ("RealSense D435", 600.0),
    "realsense-d455": ("RealSense D455", 700.0),
    "realsense-d415": ("RealSense D415", 700.0),
    "realsense-d405": ("RealSense D405", 400.0),
    "truedepth": ("TrueDepth", 400.0),
    "kinect-v1-pattern": ("Kinect V1", 700.0),
}
#: Side of what is shown, mm at the face's distance, and of a tile, px.
_SHOWN_MM, _TILE_PX = 420.0, 260
_COLUMNS: Final = 4
_CAPTION_PX = 26


def tile(picture: Picture) -> Picture:
    """Scale a square picture to a tile."""
    small = picture.shape[0] < _TILE_PX
    how = cv2.INTER_CUBIC if small else cv2.INTER_AREA
    return np.asarray(cv2.resize(picture, (_TILE_PX, _TILE_PX), interpolation=how))


def column(sensor: str, caption: str, distance_mm: float) -> Picture:
    """Return the tiles of one sensor below its caption."""
    image = load_sensor(sensor).rig.intrinsics
    side = min(round(_SHOWN_MM * image.fx / distance_mm), image.width, image.height)
    settings = load_settings(
        preset="office",
        overrides={
            "sensor": sensor,
            "seed": 12,
            "pose": {"distance_mm": distance_mm, "x_mm": 0, "y_mm": 120, "yaw_deg": 12},
            "scene": {"camera_mm": 1180, "behind_mm": 1000, "people": 0},
            "output": {"crop": side},
        },
        source={"subjects": 1, "frames_per_subject": 1},
    )
    (frame,) = simulate(settings)
    assert isinstance(frame, Frame)
    light = brightness(frame.infrared, frame.noisy.shape)
    depth = shaded((0.001 * frame.noisy).astype(np.float32), frame.intrinsics)
    head = np.full((_CAPTION_PX, _TILE_PX, 3), 255, np.uint8)
    cv2.putText(head, caption, (6, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
    return np.vstack([head, tile(light), tile(depth)])


def main() -> None:
    """Render the sensors and write the figure."""
    columns = [column(name, *how) for name, how in _SENSORS.items()]
    rows = [np.hstack(columns[k : k + _COLUMNS]) for k in range(0, len(columns), _COLUMNS)]
    write_atomic(cv2.imencode(".png", np.vstack(rows))[1].tobytes(), FIGURE)


if __name__ == "__main__":
    main()
