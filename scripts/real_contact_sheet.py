"""Draw sensors beside real frames of their cameras: python scripts/real_contact_sheet.py REAL OUT.

REAL holds recordings of real cameras, one folder each; OUT gets a PNG per camera. Each shows a real
frame, and what the sensor makes of the same scene: the real depth with its holes filled and its
noise smoothed away is taken as the surface. Right of each stands a detail, three times as large.
The pictures hold data of others: look at them, and do not publish them. Takes a minute.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim import Frame, load_settings
from glsim.corrupt import Corrupter
from glsim.files.atomic import write_atomic
from glsim.files.png import decode_png
from glsim.geometry.camera import Intrinsics
from glsim.noise.realsense_filters import fill_holes
from glsim.preview import Picture, brightness, shaded

Depth = NDArray[np.float32]


@dataclass(frozen=True)
class Recording:
    """One frame of a real camera.

    Attributes:
        sensor: that is compared with it.
        unit_mm: of its depth.
        focal_px: of its depth image.
        centre_px: of its depth image; None: the middle.
        detail: left and top of the enlarged part, px.
        infrared: its infrared image, or "".
        stages: changes of the sensor's stages.
    """

    file: str
    sensor: str
    unit_mm: float
    focal_px: float
    centre_px: tuple[float, float] | None = None
    detail: tuple[int, int] = (240, 160)
    infrared: str = ""
    stages: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


#: Name of the picture -> what it shows. Focal lengths are those of the folders' README files.
RECORDINGS: Final[Mapping[str, Recording]] = {
    "d435_wall": Recording(
        "d435_wall_2frames/depth_0.png", "realsense-d435-vga", 1.0, 390.43, (331.4, 242.2)
    ),
    "d435_room": Recording(
        "d435_robot_room/depth_000.png", "realsense-d435-vga", 1.0, 381.4, detail=(160, 120)
    ),
    "d405_bed": Recording("d405_bed/depth_26.png", "realsense-d405", 0.1, 648.0, detail=(500, 300)),
    "truedepth_box": Recording(
        "truedepth_box_and_can/box_can/depth_01.png", "truedepth", 0.1, 434.8, detail=(220, 160)
    ),
    "truedepth_board": Recording(
        "truedepth_zeiss/board_iPhone11Pro_iOS14/depth_633291.png", "truedepth", 0.1, 434.6
    ),
    "azure_mug": Recording(
        "azure_kinect_mug/depth.png",
        "azure-kinect",
        1.0,
        504.6,
        (333.3, 349.3),
        infrared="azure_kinect_mug/infrared.png",
    ),
    "kinect_v1_table": Recording(
        "kinect_v1_tables/depth_learn0.png", "kinect-v1-pattern", 1.0, 525.0, (319.5, 239.5)
    ),
}
#: Side of a detail, px, and how much larger it is drawn.
_DETAIL_PX, _LARGER = 160, 3
#: Sigma of the smoothing across a surface, px, and the share of the depth that is another one.
_SMOOTH_PX, _STEP = 6.0, 0.04


def read_depth(file: Path, unit_mm: float) -> Depth:
    """Read a depth image as metres, 0 = none; what the file clips is none."""
    image = decode_png(file.read_bytes())
    assert image is not None, file
    depth = image.astype(np.float32)
    return np.where(depth < 65535, depth * np.float32(0.001 * unit_mm), np.float32(0))


def surface(depth_m: Depth) -> Depth:
    """Return what the camera looked at, about: holes filled from behind, noise smoothed away."""
    filled = depth_m
    for _ in range(2):  # from the left and from the right
        filled = fill_holes(np.ascontiguousarray(filled), 1)[:, ::-1]
    inverse = np.where(filled > 0, 1 / np.maximum(filled, 0.05), 0).astype(np.float32)
    inverse = np.asarray(cv2.medianBlur(cv2.medianBlur(inverse, 5), 5), np.float32)
    # The logarithm of depth: a step is a share of it.
    smooth = np.log(np.maximum(inverse, 1e-3)).astype(np.float32)
    for _ in range(3):
        smooth = np.asarray(cv2.bilateralFilter(smooth, 0, _STEP, _SMOOTH_PX), np.float32)
    known = cv2.erode((inverse > 0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return np.where(known, np.exp(-smooth), 0).astype(np.float32)


def simulated(recording: Recording, clean_m: Depth) -> tuple[Frame, Intrinsics]:
    """Return what the sensor makes of a surface, and the camera of both."""
    settings = load_settings(
        overrides={
            "sensor": recording.sensor,
            "stage": dict(recording.stages),
            "output": {"depth_unit_mm": recording.unit_mm},
        }
    )
    height, width = clean_m.shape
    centre = recording.centre_px or (0.5 * width, 0.5 * height)
    focal = (recording.focal_px, recording.focal_px)
    with Corrupter(settings, (height, width), None, focal, centre) as corrupter:
        frame = corrupter.corrupt_depth(clean_m, sequence=recording.file)
        return frame, corrupter.rig.intrinsics


def sheet(root: Path, recording: Recording) -> Picture:
    """Draw a real frame, the sensor's, a detail of each, and their infrared if both have it."""
    real = read_depth(root / recording.file, recording.unit_mm)
    frame, camera = simulated(recording, surface(real))
    ours = (0.001 * frame.depth_unit_mm * frame.noisy).astype(np.float32)
    rows = [_row(shaded(d, camera), recording.detail, t) for d, t in
            ((real, "real"), (ours, recording.sensor))]  # fmt: skip
    if recording.infrared:
        image = decode_png((root / recording.infrared).read_bytes())
        for light, title in ((image, "real"), (frame.infrared, recording.sensor)):
            assert light is not None
            seen = brightness(light.astype(np.uint16), light.shape)
            rows.append(_row(seen, recording.detail, f"{title}, infrared"))
    return np.vstack(rows)


def infrared_sheet(root: Path) -> Picture:
    """Draw a real D435's two infrared images above those of the sensor."""
    images = [decode_png((root / f"d435_ir_pair/{side}1.png").read_bytes()) for side in
              ("left", "right")]  # fmt: skip
    settings = load_settings(
        preset="office",
        overrides={"sensor": "realsense-d435", "seed": 3, "pose": {"distance_mm": 800}},
        source={"subjects": 1, "frames_per_subject": 1},
    )
    from glsim import simulate

    (frame,) = simulate(settings, layers=("clean", "noisy", "infrared", "infrared_right"))
    assert isinstance(frame, Frame)
    rows = []
    for pair, title in ((images, "real"), ((frame.infrared, frame.infrared_right), "ours")):
        parts = []
        for image in pair:
            assert image is not None
            grey = image if image.ndim == 2 else image[..., 0]
            picture = np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)
            parts.append(_row(picture, (340, 160), title))
        rows.append(np.hstack(parts))
    return np.vstack(rows)


def _row(picture: Picture, detail: tuple[int, int], title: str) -> Picture:
    """Return a picture with its detail on its right."""
    left, top = detail
    part = picture[top : top + _DETAIL_PX, left : left + _DETAIL_PX]
    side = _DETAIL_PX * _LARGER
    large = cv2.resize(part, (side, side), interpolation=cv2.INTER_NEAREST)
    scale = side / picture.shape[0]
    size = (round(scale * picture.shape[1]), side)
    whole = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    cv2.putText(whole, title, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (0, 160, 255), 2, cv2.LINE_AA)
    return np.hstack([whole, large])


def main() -> None:
    """Draw the sheets of the recordings that are there."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("real", type=Path, help="folder with recordings of real cameras")
    parser.add_argument("out", type=Path, help="folder for the pictures; made if missing")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    sheets = {
        name: sheet(arguments.real, recording)
        for name, recording in RECORDINGS.items()
        if (arguments.real / recording.file).is_file()
    }
    if (arguments.real / "d435_ir_pair/left1.png").is_file():
        sheets["d435_infrared"] = infrared_sheet(arguments.real)
    if not sheets:
        parser.error(
            f"{arguments.real}: holds none of {', '.join(r.file for r in RECORDINGS.values())}"
        )
    for name, picture in sheets.items():
        write_atomic(cv2.imencode(".png", picture)[1].tobytes(), arguments.out / f"{name}.png")


if __name__ == "__main__":
    main()
