"""Draw docs/figures/motion.png: python scripts/motion_figure.py.

A head that turns within the exposure of an Azure Kinect and of a Kinect V2, and before a rolling
shutter: the error of depth over the speed, and where it lies. Takes under a minute.
"""

from __future__ import annotations

import argparse
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from glsim import Frame, load_settings, simulate
from glsim.files.atomic import write_atomic
from glsim.sensors.sensor import load_sensor

FIGURE = Path(__file__).resolve().parents[1] / "docs" / "figures" / "motion.png"
#: Speeds, degrees per second. A head that is turned quickly reaches 200 to 400 (chosen range).
SPEEDS_DEG_S: Final = (0, 45, 90, 180, 270, 360)
#: Name in the figure -> sensor and its rig.
CAMERAS: Final[Mapping[str, tuple[str, Mapping[str, object]]]] = {
    "Azure Kinect, nine captures in 12.8 ms": ("azure-kinect", {}),
    "Kinect V2, nine captures in 14.5 ms (chosen)": ("kinect-v2", {}),
    "rolling shutter of 20 ms, no noise": ("ideal", {"exposure": {"read_out_ms": 20.0}}),
}
#: Heads whose errors are averaged.
_PEOPLE: Final = 6
#: Ends of the colour scale of the maps, mm.
_MOST_MM: Final = 8.0


def frames(sensor: str, rig: Mapping[str, object], speed_deg_s: float) -> list[Frame]:
    """Render the people; they turn about the middle of their neck."""
    rounds = any(s.name == "millimetre_quantise" for s in load_sensor(sensor).stages)
    settings = load_settings(
        overrides={
            "sensor": sensor,
            "stage": {"millimetre_quantise": {"enabled": False}} if rounds else {},
            "rig": rig,
            "pose": {"distance_mm": 900, "motion": 0},
            "motion": {"within_exposure": True, "yaw_deg_s": speed_deg_s},
        },
        source={"subjects": _PEOPLE, "frames_per_subject": 1},
    )
    return [frame for frame in simulate(settings) if isinstance(frame, Frame)]


def added_mm(moving: Frame, still: Frame) -> NDArray[np.float64]:
    """Return (h, w) depth of a moving frame minus that at rest, mm; NaN where one is missing.

    Both have the same noise, and the same place at the frame's instant.
    """
    whole = np.full((2, moving.intrinsics.height, moving.intrinsics.width), np.nan)
    for image, frame in zip(whole, (moving, still), strict=True):
        depth = frame.noisy_m.astype(float)
        image[frame.window.slices] = np.where(depth > 0, 1000.0 * depth, np.nan)
    difference: NDArray[np.float64] = whole[0] - whole[1]
    return difference


def measure(sensor: str, rig: Mapping[str, object]) -> NDArray[np.float64]:
    """Return (S, 3): 90th and 99th percentile of what motion adds, mm; pixels lost, %."""
    still = frames(sensor, rig, 0.0)
    rows = []
    for speed in SPEEDS_DEG_S:
        added = [added_mm(m, s) for m, s in zip(frames(sensor, rig, speed), still, strict=True)]
        sizes = np.abs(np.concatenate([a[np.isfinite(a)] for a in added]))
        seen = sum(int((s.noisy > 0).sum()) for s in still)
        changed = 100.0 * (1.0 - sizes.size / seen)
        rows.append((np.percentile(sizes, 90), np.percentile(sizes, 99), changed))
    return np.array(rows)


def draw() -> Figure:
    """Return the figure."""
    figure, axes = plt.subplots(1, 4, figsize=(13, 3.2), layout="constrained")
    for name, (camera, exposure) in CAMERAS.items():
        found = measure(camera, exposure)
        (line,) = axes[0].plot(SPEEDS_DEG_S, found[:, 1], "o-", label=name)
        axes[0].plot(SPEEDS_DEG_S, found[:, 0], "--", color=line.get_color())
        axes[1].plot(SPEEDS_DEG_S, found[:, 2], "o-")
    axes[0].set_ylabel("change of depth, mm\n99 % (lines), 90 % (dashes)")
    axes[1].set_ylabel("pixels that lose their depth, %")
    for axis in axes[:2]:
        axis.set_xlabel("turn of the head, degrees per second")
        axis.set_ylim(bottom=0)
    axes[0].legend(fontsize=6)
    for axis, sensor in zip(axes[2:], ("azure-kinect", "ideal"), strict=True):
        rig = next(own for of, own in CAMERAS.values() if of == sensor)
        moving, still = (frames(sensor, rig, speed)[0] for speed in (SPEEDS_DEG_S[-1], 0.0))
        added = added_mm(moving, still)
        shown = axis.imshow(added, cmap="RdBu_r", vmin=-_MOST_MM, vmax=_MOST_MM)
        axis.set_title(f"{sensor}, {SPEEDS_DEG_S[-1]} degrees per second", fontsize=8)
        rows, columns = np.nonzero(np.isfinite(added))
        axis.set_xlim(columns.min() - 5, columns.max() + 5)
        axis.set_ylim(rows.max() + 5, rows.min() - 5)
        axis.axis("off")
        figure.colorbar(shown, ax=axis, label="moving minus at rest, mm")
    return figure


def main() -> None:
    """Render, measure and write the figure."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    drawn = io.BytesIO()
    draw().savefig(drawn, format="png", dpi=120, metadata={"Software": "glsim"})
    write_atomic(drawn.getvalue(), FIGURE)


if __name__ == "__main__":
    main()
