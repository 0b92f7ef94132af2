"""Draw docs/figures/rooms.webp: python scripts/rooms_figure.py.

Ten people of the presets office and living-room: shaded clean depth, noisy depth, infrared. Takes
under a minute and needs glsim fetch people.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from glsim import Frame, load_settings, simulate
from glsim.files.atomic import write_atomic
from glsim.preview import Picture, brightness, shaded

FIGURE = Path(__file__).resolve().parents[1] / "docs" / "figures" / "rooms.webp"
#: Preset -> seed of its people.
_SEEDS: Final = {"office": 11, "living-room": 12}
_PEOPLE: Final = 5
#: Quality of WebP, percent.
_QUALITY: Final = 82
#: Depths at the ends of the colour scale, mm.
_NEAR_MM, _FAR_MM = 600.0, 4500.0


def row(frame: Frame) -> Picture:
    """Return the three pictures of a frame side by side, at half their size."""
    depth_mm = frame.noisy.astype(np.float32)
    share = np.clip((_FAR_MM - depth_mm) / (_FAR_MM - _NEAR_MM), 0, 1)
    noisy = cv2.applyColorMap((255 * share).astype(np.uint8), cv2.COLORMAP_TURBO)
    noisy[depth_mm == 0] = 0
    clean = shaded((0.001 * frame.clean).astype(np.float32), frame.intrinsics)
    infrared = brightness(frame.infrared, depth_mm.shape)
    joined = np.hstack([clean, noisy, infrared])
    return np.asarray(cv2.resize(joined, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))


def main() -> None:
    """Render the people and write the figure."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    columns = []
    for preset, seed in _SEEDS.items():
        settings = load_settings(
            preset=preset,
            overrides={"seed": seed},
            source={"subjects": _PEOPLE, "frames_per_subject": 1},
        )
        rows = [row(frame) for frame in simulate(settings) if isinstance(frame, Frame)]
        columns.append(np.vstack(rows))
    picture, quality = np.hstack(columns), [cv2.IMWRITE_WEBP_QUALITY, _QUALITY]
    write_atomic(cv2.imencode(".webp", picture, quality)[1].tobytes(), FIGURE)


if __name__ == "__main__":
    main()
