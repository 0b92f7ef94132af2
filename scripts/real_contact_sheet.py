"""Draw a simulated frame of a sensor beside a real frame of the same camera.

    python -m scripts.real_contact_sheet DEPTH.png --sensor realsense-d435-vga --focal-px 390 -o OUT

The picture shows the real frame, and what the sensor makes of the same scene: the real depth with
its holes filled and its noise smoothed away is taken as the surface. Right of each stands a detail,
three times as large. Pictures hold data of others: look at them, and do not publish them.
"""

import argparse
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from glsim import DepthNoise, load_settings
from glsim.core.array_types import Depth
from glsim.core.files.atomic import write_atomic
from glsim.data.contact_sheet import Picture, shaded
from glsim.data.recordings.files import read_map_mm
from glsim.noise.realsense_filters import fill_holes

#: Side of a detail, px, and how much larger it is drawn.
_DETAIL_PX, _LARGER = 160, 3
#: Sigma of the smoothing across a surface, px, and the share of the depth that is another one.
_SMOOTH_PX, _STEP = 6.0, 0.04
_TITLE: Final = (cv2.FONT_HERSHEY_SIMPLEX, 0.6, (0, 160, 255), 2, cv2.LINE_AA)


def surface(depth_m: Depth) -> Depth:
    """Estimate the surface before the camera: holes filled from behind, noise smoothed."""
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


def _row(picture: Picture, title: str) -> Picture:
    """Return a picture with its enlarged centre on its right."""
    top, left = ((side - _DETAIL_PX) // 2 for side in picture.shape[:2])
    part = picture[top : top + _DETAIL_PX, left : left + _DETAIL_PX]
    side = _DETAIL_PX * _LARGER
    large = cv2.resize(part, (side, side), interpolation=cv2.INTER_NEAREST)
    size = (round(side / picture.shape[0] * picture.shape[1]), side)
    whole = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    cv2.putText(whole, title, (8, 22), *_TITLE)
    return np.hstack([whole, large])


def main() -> None:
    """Read a depth map and draw the sheet."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("depth", type=Path, help="depth map of a real camera")
    parser.add_argument("--sensor", required=True)
    parser.add_argument("--focal-px", type=float, required=True)
    parser.add_argument("--unit-mm", type=float, default=1.0, help="step of the map")
    parser.add_argument("-o", "--out", type=Path, required=True, help="PNG")
    arguments = parser.parse_args()
    real = 0.001 * read_map_mm(arguments.depth, arguments.unit_mm)
    settings = load_settings(
        overrides={"sensor": arguments.sensor, "output": {"depth_unit_mm": arguments.unit_mm}}
    )
    focal = (arguments.focal_px, arguments.focal_px)
    with DepthNoise(settings, focal_px=focal) as noise:
        ours = noise.corrupt_depth(surface(real), sequence=arguments.depth.name)
        camera = noise.rig((real.shape[0], real.shape[1])).intrinsics
        noisy = (0.001 * ours.depth_unit_mm * ours.noisy).astype(np.float32)
    rows = [_row(shaded(real, camera), "real"), _row(shaded(noisy, camera), arguments.sensor)]
    write_atomic(cv2.imencode(".png", np.vstack(rows))[1].tobytes(), arguments.out)


if __name__ == "__main__":
    main()
