"""Draw docs/figures/sensors.webp: python scripts/sensor_gallery.py.

One face seen by seven sensors: shaded clean depth, noisy depth, what the shipped network makes of
it, and the infrared. Takes under a minute and needs glsim fetch people.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim import Frame, load_denoiser, load_settings, simulate
from glsim.files.atomic import write_atomic
from glsim.preview import Picture, brightness, shaded

FIGURE = Path(__file__).resolve().parents[1] / "docs" / "figures" / "sensors.webp"
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
#: Seed of the person, and how far the base of the neck, which the pose places, is below the view.
_SEED, _NECK_MM = 74, 132.0
_ROWS: Final = ("clean", "noisy", "denoised", "infrared")
#: Side of what is shown, mm at the face's distance, and of a tile, px.
_SHOWN_MM, _TILE_PX = 285.0, 230
_CAPTION_PX, _MARGIN_PX = 30, 92
#: Quality of WebP, percent.
_QUALITY: Final = 82


def tile(picture: Picture) -> Picture:
    """Scale a square picture to a tile."""
    small = picture.shape[0] < _TILE_PX
    how = cv2.INTER_CUBIC if small else cv2.INTER_AREA
    return np.asarray(cv2.resize(picture, (_TILE_PX, _TILE_PX), interpolation=how))


def caption(text: str, width: int, height: int) -> Picture:
    """Return a white field with a text."""
    field = np.full((height, width, 3), 255, np.uint8)
    at = (6, height // 2 + 6)
    cv2.putText(field, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.55, (0, 0, 0), 1, cv2.LINE_AA)
    return field


def column(sensor: str, name: str, distance_mm: float) -> Picture:
    """Return the tiles of one sensor below its caption."""
    settings = load_settings(
        preset="office",
        overrides={
            "sensor": sensor,
            "seed": _SEED,
            "pose": {"distance_mm": distance_mm, "x_mm": 0, "y_mm": _NECK_MM, "yaw_deg": 14},
            "scene": {"camera_mm": 1240, "behind_mm": 900, "people": 0},
        },
        source={"subjects": 1, "frames_per_subject": 1},
    )
    (frame,) = simulate(settings)
    assert isinstance(frame, Frame)
    image = frame.intrinsics
    side = min(round(_SHOWN_MM * image.fx / distance_mm), image.width, image.height)
    left, top = (round(centre - side / 2) for centre in (image.cx, image.cy))
    shown = slice(max(top, 0), max(top, 0) + side), slice(max(left, 0), max(left, 0) + side)

    def surface(depth_m: NDArray[np.float32]) -> Picture:
        return tile(shaded(depth_m, image)[shown])

    clean_m = np.zeros(frame.noisy.shape, np.float32)
    clean_m[frame.window.slices] = frame.clean_m
    denoised = load_denoiser("face")(frame.noisy)
    return np.vstack(
        [
            caption(name, _TILE_PX, _CAPTION_PX),
            surface(clean_m),
            surface((0.001 * frame.noisy).astype(np.float32)),
            surface((0.001 * denoised.depth_mm).astype(np.float32)),
            tile(brightness(frame.infrared, frame.noisy.shape)[shown]),
        ]
    )


def main() -> None:
    """Render the sensors and write the figure."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    names = [caption("", _MARGIN_PX, _CAPTION_PX)]
    names += [caption(row, _MARGIN_PX, _TILE_PX) for row in _ROWS]
    columns = [column(name, *how) for name, how in _SENSORS.items()]
    picture = np.hstack([np.vstack(names), *columns])
    written = cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, _QUALITY])[1]
    write_atomic(written.tobytes(), FIGURE)


if __name__ == "__main__":
    main()
