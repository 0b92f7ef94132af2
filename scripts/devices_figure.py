"""Draw docs/figures/devices.png: python -m scripts.devices_figure REAL.

Rows of a Kinect V2 alternate by an amount that is the device's and the decoder's own. REAL is a
folder of frames of a real device through libfreenect2, which is measured here; three devices
through Microsoft's SDK are the numbers of docs/time_of_flight.md. Beside them eight devices that
are drawn, measured in the same way on heads before a wall. Takes half a minute.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Final

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from glsim import Frame, load_settings, simulate
from glsim.files.atomic import write_atomic
from glsim.measures.frame import DepthFrame
from glsim.measures.pattern import BANDS, measure_pattern
from glsim.recordings.recording import read_frame_set

FIGURE = Path(__file__).resolve().parents[1] / "docs" / "figures" / "devices.png"
#: Devices that are drawn, and frames of each. Device 0 is the typical one and is left out.
_DEVICES, _FRAMES = 8, 5
#: Half the step from even to odd rows, mm, at even distances from the top to the bottom of the
#: image: measured for this project on frames that are not at hand.
_THROUGH_SDK: Final = {
    "KS": (0.0, 0.0),
    "ZC": (0.0, 0.54, 0.07),
    "HM": (0.35, 0.23, -0.18, -0.36, 0.40, -0.07, -0.32),
}
_ROWS: Final = 424

Profile = NDArray[np.float64]


def drawn_devices(sensor: str) -> list[Profile]:
    """Return (BANDS,) half steps from even to odd rows of each drawn device, mm."""
    settings = load_settings(
        overrides={
            "sensor": sensor,
            "devices": _DEVICES + 1,
            "output": {"depth_unit_mm": 0.1},
            "scene": {"wall_mm": 1300},
            "pose": {"distance_mm": 900},
        },
        source={"subjects": _DEVICES + 1, "frames_per_subject": _FRAMES},
    )
    frames: dict[str, list[DepthFrame]] = {}
    for frame in simulate(settings):
        if isinstance(frame, Frame):
            depth_mm = frame.noisy.astype(np.float32) * np.float32(frame.depth_unit_mm)
            depth_mm[depth_mm == 0] = np.nan
            image = DepthFrame(str(frame.key), depth_mm, None, frame.intrinsics, 0.1)
            frames.setdefault(frame.key.subject, []).append(image)
    of_device = [images for _, images in sorted(frames.items())]  # the first is device 0
    return [np.array(measure_pattern(images).alternation_mm) for images in of_device[1:]]


def main() -> None:
    """Measure, and write the figure."""
    real = np.array(measure_pattern(read_frame_set(Path(sys.argv[1])).frames).alternation_mm)
    rows = (np.arange(BANDS) + 0.5) * _ROWS / BANDS
    figure, axes = plt.subplots(1, 2, figsize=(8.0, 4.2), sharex=True, sharey=True)
    for axis, sensor in zip(axes, ("kinect-v2", "kinect-v2-sdk"), strict=True):
        for number, profile in enumerate(drawn_devices(sensor)):
            label = f"eight devices of {sensor}" if number == 0 else None
            axis.plot(profile, rows, color="#9aa7b5", linewidth=1.0, label=label)
        axis.axvline(0, color="#dddddd", linewidth=0.6, zorder=0)
        axis.set_xlabel("half step from even to odd rows [mm]")
    axes[0].plot(real, rows, "o-", color="#c1432e", markersize=3, label="real device (IA)")
    axes[0].set_title("libfreenect2", fontsize=10)
    axes[0].set_ylabel("row")
    axes[0].invert_yaxis()
    for (name, values), color in zip(
        _THROUGH_SDK.items(), ("#c1432e", "#2e6fc1", "#2e8b57"), strict=True
    ):
        at = np.linspace(0, _ROWS, len(values))
        axes[1].plot(values, at, "o-", color=color, markersize=3, label=f"real device ({name})")
    axes[1].set_title("Microsoft's SDK", fontsize=10)
    for axis in axes:
        axis.legend(
            fontsize=7, frameon=False, loc="lower center", bbox_to_anchor=(0.5, -0.42), ncols=2
        )
    figure.tight_layout()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130, bbox_inches="tight")
    write_atomic(buffer.getvalue(), FIGURE)


if __name__ == "__main__":
    main()
