"""Make the table of docs/results/model_card.md: python -m scripts.model_card FOLDER.

Scores networks and filters (glsim eval) on still views of people that no training saw (glsim
generate --preset still-views); it resumes. BM3D is left out without ``glsim[bm3d]``.
"""

import argparse
import csv
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from glsim.cli import main as glsim
from glsim.core.files.markdown import markdown_table

_WALL: Final = "scene.wall_mm={ uniform = [1500, 2200] }"
_NEAR: Final = 'pose.distance_mm={ uniform = [300, 800], per = "sequence" }'
_FRONT: Final = 'pose.yaw_deg={ uniform = [-60, 60], per = "sequence" }'
#: Row -> its sensor, and what differs from the preset.
SETS: Final = {
    "bare heads, `kinect-v2`": ("kinect-v2", ["appearance.wear=never", _FRONT]),
    "dressed, `kinect-v2-sdk`, wall": ("kinect-v2-sdk", [_WALL]),
    "`azure-kinect`, `femto-bolt`": ("azure-kinect", []),
    "`kinect-v2-fast`": ("kinect-v2-fast", []),
    "`kinect-v2-fankhauser`, wall": ("kinect-v2-fankhauser", [_WALL]),
    "`kinect-v1`": ("kinect-v1", []),
    "`realsense-d435`": ("realsense-d435", [_NEAR]),
    "`oak-d-pro`": ("oak-d-pro", []),
}  # fmt: skip
_FILTERS: Final = ("guided:radius=1,epsilon_mm=5", "tgv", *(["bm3d"] if find_spec("bm3d") else []))
#: Network -> sensors of SETS that it was trained on (scripts/train_shipped.sh), marked †.
_TRAINED: Final[dict[str, tuple[str, ...]]] = {
    "face": ("kinect-v2", "kinect-v2-sdk"), "face-azure-kinect": ("kinect-v2", "azure-kinect"),
    "face-stereo": ("realsense-d435",),
}  # fmt: skip
#: Metric -> digits of its means.
_METRICS: Final = {"input_interior_median_mm": 2, "normal_mean_deg": 1, "ring_lost_pct": 0}


def scored(folder: Path, sensor: str, changes: list[str], methods: list[str]) -> dict[str, str]:
    """Generate and score a set; return method -> its means. Exits with the status of a failure."""
    data, scores = (str(folder / name) for name in ("data", "scores"))
    generate = ["generate", "-o", data, "--preset", "still-views", "--sensor", sensor]
    evaluate = ["eval", data, "-o", scores, "--truth", "expected", "--no-figures"]
    generate += [part for text in changes for part in ("--set", text)]
    evaluate += [part for method in methods for part in ("-d", method)]
    if status := glsim(generate) or glsim(evaluate):
        sys.exit(status)
    found: dict[str, dict[str, float]] = {}
    with Path(scores, "table.csv").open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            means = found.setdefault(row["method"].removesuffix(" [measured]"), {})
            means[row["metric"]] = float(row["mean"] or "nan")
    return {
        name: " / ".join(f"{means[metric]:.{digits}f}" for metric, digits in _METRICS.items())
        for name, means in found.items()
    }


def main() -> None:
    """Score all sets and print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="for 100 MB of data and the scores")
    parser.add_argument("networks", nargs="*", default=list(_TRAINED), help="default: the shipped")
    arguments = parser.parse_args()
    columns = ["noisy", *arguments.networks, *_FILTERS]
    rows = []
    for number, (name, (sensor, assignments)) in enumerate(SETS.items()):
        means = scored(arguments.folder / str(number), sensor, assignments, columns)
        for network, sensors in _TRAINED.items():
            means[network] = means.get(network, "") + " †" * (sensor in sensors)
        rows.append([name, *(means.get(column, "") for column in columns)])
    titles = ["", "raw", *(f"`{name}`" for name in columns[1:])]
    sys.stdout.write("\n".join(markdown_table(titles, rows)) + "\n")


if __name__ == "__main__":
    main()
