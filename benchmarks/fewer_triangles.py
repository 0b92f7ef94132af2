"""Measure how fewer triangles move the clean depth: python -m benchmarks.fewer_triangles [--heads].

Clothes, and meshes where a pixel is larger than 4 mm, are drawn with a share of their triangles.
A row draws one frame of each subject with all triangles and with that share: the mean difference
of depth, mm, the share of pixels that differ by more than 2 mm, and of those with one depth only.
People and rooms need ``glsim fetch people``.
"""

import argparse
import math
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from glsim import frames, load_settings
from glsim.looks import cloth
from glsim.simulation import scenes

_HEADS, _PEOPLE = {"kind": "procedural"}, {"kind": "people", "framing": "bust"}
_WEAR = "appearance.wear=always"
#: Row -> (source, assignments).
_ROWS: dict[str, tuple[dict[str, Any], list[str]]] = {
    "dressed heads, 0.9 m, 160 px": (_HEADS, [_WEAR, "output.crop=160"]),
    "dressed heads, 0.9 m, whole": (_HEADS, [_WEAR]),
    "bare heads, 1.8 m, whole": (_HEADS, ["pose.distance_mm=1800"]),
    "people, 0.9 m, whole": (_PEOPLE, []),
    "people, 1.8 m, whole": (_PEOPLE, ["pose.distance_mm=1800"]),
    "people, 4 m, whole": (_PEOPLE, ["pose.distance_mm=4000"]),
    "office, whole": (_PEOPLE, ["scene.room=office"]),
}


def depths_mm(source: dict[str, Any], assignments: list[str], count: int) -> NDArray[np.float32]:
    """Draw one frame of each subject, (count, H, W) mm, 0 = no surface."""
    settings = load_settings(
        assignments=[*assignments, "output.depth_unit_mm=0.1"],
        source=source | {"subjects": count, "frames_per_subject": 1},
        preset="office" if "scene.room=office" in assignments else None,
    )
    return np.stack([frame.clean for frame in frames(settings)]) * np.float32(0.1)


def main() -> None:
    """Print a row for each kind of frame."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--subjects", type=int, default=12)
    parser.add_argument("--heads", action="store_true", help="no people: they need downloaded data")
    asked = parser.parse_args()
    for name, (source, assignments) in _ROWS.items():
        if asked.heads and source is not _HEADS:
            continue
        drawn = depths_mm(source, assignments, asked.subjects)
        with (
            patch.object(cloth, "_DRAWN_SHARE", 1.0),
            patch.object(scenes, "_FAR_PIXEL_MM", math.inf),
        ):
            full = depths_mm(source, assignments, asked.subjects)
        both, either = (drawn > 0) & (full > 0), (drawn > 0) | (full > 0)
        error = np.abs(drawn - full)[both]
        alone = 100 * (1 - both.sum() / either.sum())
        print(f"{name:32} {error.mean():.3f} mm  {100 * (error > 2).mean():.2f} %  {alone:.2f} %")


if __name__ == "__main__":
    main()
