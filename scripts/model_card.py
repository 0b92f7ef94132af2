"""Model card: tables of a denoiser under conditions it was not tuned for, as Markdown.

    python -m scripts.model_card face > card.md                  about five minutes on two cores
    python -m scripts.model_card run/best.pt --only limits
    python -m scripts.model_card face --source ict-facekit --root FaceXModel

They are the tables of docs/model_card.md. Faces have another seed than the default data sets of
glsim. A row is scored on few frames: enough to find harm, too few to rank denoisers (use glsim
eval).
"""

from __future__ import annotations

import argparse
import sys
from collections import ChainMap
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim import Frame, load_settings, simulate
from glsim.core.errors import GlsimError
from glsim.core.files.markdown import markdown_table
from glsim.denoise.denoiser import Denoiser
from glsim.denoise.registry import load_denoiser
from glsim.eval.metrics.frame_score import score
from glsim.eval.metrics.scored_map import Truth

Depth = NDArray[np.float32]

#: Seed of heads that no other command makes by default.
_SEED: Final = 20_260_731
#: Side of a crop that holds a head at 0.6 m: 290 mm, 365 px * 290 mm / 600 mm = 176 px.
_NEAR_CROP: Final = 192
#: Metric -> title of its columns.
_COLUMNS: Final = {
    "both_rmse_mm": "RMSE [mm]",
    "both_interior_rmse_mm": "interior [mm]",
    "flips_px": "flips [px]",
    "flying_px": "flying [px]",
}
_SENSORS: Final = (
    *("kinect-v2", "kinect-v2-sdk", "kinect-v2-fast", "kinect-v2-fankhauser", "kinect-v2-paper"),
    *("kinect-v1", "azure-kinect", "realsense-d435", "truedepth", "led3d", "ideal"),
)
_POSE: Final = {"yaw_deg": {"uniform": [-30, 30]}, "pitch_deg": {"uniform": [-15, 15]}}
_WALL: Final = {"wall_mm": {"uniform": [1200, 2000]}}
_PARTS: Final[dict[str, dict[str, Any]]] = {
    "without the fixed pattern": {"fixed_pattern": {"enabled": 0}},
    "without the temporal floor": {"tof_floor": {"enabled": 0}},
    "without the point spread": {"tof_taps": {"psf_sigma_px": 0.0}},
}


@dataclass(frozen=True)
class CardRow:
    """A row of a table: changed settings of kinect-v2 at 0.9 m, and the crop, px."""

    name: str
    settings: dict[str, Any]
    crop: int = 128


def _distance(mm: int) -> CardRow:
    settings = {"pose": _POSE | {"distance_mm": mm}}
    return CardRow(f"{mm / 1000:.1f} m", settings, 128 if mm >= 900 else _NEAR_CROP)


#: Section -> its title and rows.
SECTIONS: Final[dict[str, tuple[str, list[CardRow]]]] = {
    "distances": (
        "Distance, `kinect-v2`, yaw up to 30°",
        [_distance(mm) for mm in range(600, 1400, 100)],
    ),
    "yaw": (
        "Head turned, `kinect-v2`, 0.9 m",
        [CardRow(f"{yaw}°", {"pose": {"yaw_deg": yaw}}) for yaw in (0, 15, 30, 45, 60)],
    ),
    "sensors": (
        "Sensors, 0.9 m, with and without a wall 0.3 to 1.1 m behind",
        [
            CardRow(f"{name}{title}", {"sensor": name, "pose": _POSE, "scene": scene})
            for name in _SENSORS
            for title, scene in (("", {}), (", wall", _WALL))
        ],
    ),
    "limits": (
        "What limits it: `kinect-v2` with a part of the noise switched off",
        [
            CardRow("kinect-v2 as it is", {}),
            *(CardRow(name, {"stage": stage}) for name, stage in _PARTS.items()),
            CardRow("without all three", {"stage": dict(ChainMap(*_PARTS.values()))}),
        ],
    ),
    "clean": (
        "Clean input in whole mm: how far the surface is moved",
        [_distance(mm) for mm in (600, 900, 1300)],
    ),
}  # fmt: skip


def frames(row: CardRow, source: dict[str, Any], count: int) -> Iterator[tuple[Depth, Truth]]:
    """Yield clean depth, mm, and truth with noisy depth, rounded as in files.

    Every frame shows another person.
    """
    people = {"subjects": count, "frames_per_subject": 1}
    base = {"sensor": "kinect-v2", "seed": _SEED, "output": {"crop": row.crop}}
    settings = load_settings(overrides=base | row.settings, source=source | people)
    for frame in simulate(settings, layers=("clean", "expected", "noisy")):
        if not isinstance(frame, Frame):
            raise SystemExit(f"{row.name}: {frame.why}")
        assert frame.expected_m is not None
        noisy = frame.noisy.astype(np.float32)
        clean, expected = np.zeros_like(noisy), np.zeros_like(noisy)
        clean[frame.window.slices] = 1000 * frame.clean_m
        expected[frame.window.slices] = 1000 * frame.expected_m
        yield clean, Truth(expected, noisy, frame.intrinsics.rays())


def score_row(
    method: Denoiser, row: CardRow, source: dict[str, Any], count: int, *, clean: bool = False
) -> dict[str, tuple[float, float]]:
    """Map each metric to its means before and after denoising; NaN if no frame defines it.

    Args:
        method: the denoiser.
        row: settings of the frames.
        source: settings of the face source.
        count: number of frames.
        clean: denoise clean maps in whole mm, which a denoiser should not change.
    """
    before, after = [], []
    for clean_mm, measured in frames(row, source, count):
        whole_mm = np.rint(clean_mm)
        truth = Truth(whole_mm, whole_mm, measured.rays) if clean else measured
        noisy_mm = whole_mm if clean else measured.noisy
        before.append(score(noisy_mm, truth))
        after.append(score(method(noisy_mm).depth_mm, truth))
    return {
        name: (_mean([s[name] for s in before]), _mean([s[name] for s in after]))
        for name in _COLUMNS
    }


def _mean(values: list[float]) -> float:
    known = np.asarray(values)[~np.isnan(values)]
    return float(known.mean()) if known.size else float("nan")


def main() -> None:
    """Read the command line and print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("denoiser", help="as for glsim denoise -d")
    parser.add_argument("--only", choices=SECTIONS, nargs="+", default=list(SECTIONS))
    parser.add_argument("--frames", type=int, default=32, help="frames per row")
    parser.add_argument("--source", default="procedural", help="face source")
    parser.add_argument("--root", help="folder of the face model")
    chosen = parser.parse_args()
    method = load_denoiser(chosen.denoiser)
    source = {"kind": chosen.source} | ({"root": chosen.root} if chosen.root else {})
    titles = [f"{metric}, {map_}" for metric in _COLUMNS.values() for map_ in ("noisy", "denoised")]
    for section in chosen.only:
        title, rows = SECTIONS[section]
        cells = []
        for row in rows:
            means = score_row(method, row, source, chosen.frames, clean=section == "clean")
            values = [f"{value:.2f}" for metric in _COLUMNS for value in means[metric]]
            before, after = means["both_rmse_mm"]
            cells.append([row.name, *values, "yes" if after <= before else "**no**"])
        lines = markdown_table(["", *titles, "RMSE no worse"], cells)
        sys.stdout.write("\n".join([f"## {title}\n", *lines, "\n"]))


if __name__ == "__main__":
    try:
        main()
    except GlsimError as error:
        sys.exit(f"model_card: {error}")
