"""Fit the numbers of kinect-v2 to real frames: ``python -m benchmarks.fit_kinect_v2 REAL -o DIR``.

REAL: frames with infrared, some of them with the chessboard of ``glsim.measures.boards``. Half of
the frames (every second run of four) are replayed through the sensor, again and again, until the
features of their patches and the profiles of depth and light beside printed edges agree with the
real ones by least squares, all numbers together. The other half judges: patches of it are told from
its replay before and after the fit. Writes DIR/table.md and DIR/fitted.toml.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import moderngl
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from benchmarks.reality import board, board_pose, mirrored
from glsim.compare.classifier import tell_apart
from glsim.compare.patches import KINDS, Patches, edge_patches, surface_patches
from glsim.compare.replayer import Replayer
from glsim.files.atomic import write_atomic
from glsim.geometry.mesh import Mesh
from glsim.gl.context import open_context
from glsim.measures.boards import find_corners
from glsim.measures.frame import DepthFrame, FrameSet
from glsim.measures.print_edges import PrintEdges, measure_print_edges
from glsim.measures.silhouettes import measure_silhouettes
from glsim.measures.static import view_numbers
from glsim.recordings.recording import read_frame_set
from glsim.sensors.sensor import load_sensor
from glsim.validate.virtual_camera import VirtualCamera

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Parameter:
    """A number of a sensor's stage and the range that it is sought in."""

    stage: str
    name: str
    least: float
    most: float


#: What is fitted. The decoder's own constants are libfreenect2's and stay; shares and places of the
#: emitters were measured on five devices.
PARAMETERS: Final = (
    Parameter("tof_light", "indirect", 0.002, 0.15),
    Parameter("tof_light", "indirect_mm", 20.0, 800.0),
    Parameter("tof_light", "indirect_spread_mm", 20.0, 800.0),
    Parameter("tof_taps", "halo", 0.02, 0.4),
    Parameter("tof_taps", "halo_delay_mm", 10.0, 200.0),
    Parameter("tof_taps", "haze", 0.002, 0.08),
    Parameter("tof_taps", "read_variance", 4.0, 60.0),
    Parameter("tof_floor", "sigma_mm", 0.5, 1.6),
    Parameter("fixed_pattern", "pixel_sigma_mm", 0.05, 0.6),
    Parameter("fixed_pattern", "column_sigma_mm", 0.02, 0.4),
    Parameter("fixed_pattern", "row_sigma_mm", 0.02, 0.6),
    Parameter("fixed_pattern", "row_alternation_mm", 0.1, 1.2),
)
#: Quantiles of each feature that are to agree.
_QUANTILES: Final = (0.1, 0.25, 0.5, 0.75, 0.9)
#: Differences that weigh as much as an interquartile range of a feature: of depth beside printed
#: edges, mm, and of light there, share. Chosen: a tenth of what is seen.
_EDGE_MM, _EDGE_LIGHT = 1.2, 0.03
#: Frames with a board whose printed edges are rendered.
_BOARDS: Final = 8
#: Step of the differences that stand for derivatives, share of a value; chosen: the noise of the
#: features is the same in all renderings, but which patches there are is not.
_STEP: Final = 0.15
#: A parameter counts as known within the change that costs this share of the sum of squares.
_COST: Final = 0.02

_Values = dict[tuple[str, str], float]


class Fit:
    """The real half that is fitted, its replays, and what is compared."""

    def __init__(self, real: FrameSet, sensor: str, context: moderngl.Context) -> None:
        """Measure the real frames and find their surfaces."""
        self._real = real
        self._replayer = Replayer(real, sensor, context)
        scene_of = view_numbers(real.frames)
        self._scenes = [self._replayer.scene(real.frames[k]) for k in scene_of]
        self._shadow_side = measure_silhouettes(real.frames).shadow_side
        self.patches = self.cut(real.frames)
        self._boards = VirtualCamera(sensor, context)
        self._meshes: list[Mesh] = []
        shown: list[DepthFrame] = []
        for frame in real.frames:
            corners = None if frame.infrared is None else find_corners(frame.infrared)
            if corners is not None and len(shown) < _BOARDS:
                self._meshes.append(mirrored(board(board_pose(frame, corners))))
                shown.append(frame)
        self.edges = measure_print_edges(shown)

    def cut(self, frames: Sequence[DepthFrame]) -> dict[str, Patches]:
        """Cut the patches of all kinds out of frames."""
        return surface_patches(frames) | edge_patches(frames, self._shadow_side)

    def replay(self, values: _Values) -> list[DepthFrame]:
        """Render the counterparts of all frames."""
        changes = _changes(values)
        return [
            self._replayer.frame(frame, scene, changes)
            for frame, scene in zip(self._real.frames, self._scenes, strict=True)
        ]

    def board_edges(self, values: _Values) -> PrintEdges:
        """Render boards and measure their printed edges."""
        frames = []
        for number, mesh in enumerate(self._meshes):
            shot = self._boards.capture(
                mesh, frames=1, crop=None, scene=f"board {number}", changes=_changes(values)
            )
            depth, light = (np.ascontiguousarray(i[0, :, ::-1], np.float32)
                            for i in (shot.fine_mm, shot.infrared))  # fmt: skip
            camera = self._real.camera
            frames.append(DepthFrame(f"board {number}", depth, light, camera, 1.0))
        return measure_print_edges(frames)

    def differences(self, values: _Values) -> Array:
        """Compare the real half with its replay: the residuals of the least squares.

        Returns:
            (N,) simulated minus real quantiles of patch features, in interquartile ranges of the
            real ones, and simulated minus real depth and light beside printed edges, over
            ``_EDGE_MM`` and ``_EDGE_LIGHT``. Each kind of patch has the same total weight, and so
            have the printed edges.
        """
        parts = []
        simulated = self.cut(self.replay(values))
        for kind in KINDS:
            real, ours = self.patches[kind].features, simulated[kind].features
            if min(len(real), len(ours)) == 0:
                continue
            wanted, found = (np.quantile(f, _QUANTILES, axis=0) for f in (real, ours))
            spread = np.maximum(np.subtract(*np.percentile(real, (75, 25), axis=0)), 0.05)
            parts.append(((found - wanted) / spread).ravel())
        real_edges, edges = self.edges, self.board_edges(values)
        if real_edges.frames and edges.frames:
            parts.append(
                np.concatenate(
                    [
                        (edges.print_error_mm - real_edges.print_error_mm) / _EDGE_MM,
                        (edges.paper_error_mm - real_edges.paper_error_mm) / (0.2 * _EDGE_MM),
                        (edges.print_light - real_edges.print_light) / _EDGE_LIGHT,
                        (edges.paper_light - real_edges.paper_light) / _EDGE_LIGHT,
                    ]
                )
            )
        return np.concatenate([np.nan_to_num(p) / np.sqrt(p.size) for p in parts])


def halves(real: FrameSet) -> tuple[FrameSet, FrameSet]:
    """Split frames into those that are fitted and those that judge, every second run of four."""
    runs = [(number // 4) % 2 for number in range(len(real.frames))]
    fitted, judging = (
        tuple(f for f, run in zip(real.frames, runs, strict=True) if run == k) for k in (0, 1)
    )
    return FrameSet(f"{real.title}, fitted", fitted), FrameSet(f"{real.title}, judging", judging)


def typical_values(sensor: str) -> _Values:
    """Return the parameters' values of a sensor; of those that are drawn, the typical ones."""
    stages = {stage.name: stage for stage in load_sensor(sensor).stages}
    return {(p.stage, p.name): stages[p.stage].settings[p.name].typical for p in PARAMETERS}


def _changes(values: _Values) -> dict[str, dict[str, float]]:
    changes: dict[str, dict[str, float]] = {}
    for (stage, name), value in values.items():
        changes.setdefault(stage, {})[name] = value
    return changes


def fit(half: Fit, start: _Values, rounds: int) -> tuple[_Values, dict[tuple[str, str], float]]:
    """Find the least squares of the differences over the logarithms of the parameters.

    Returns:
        The values, and by which factor each is known.

    """
    keys = [(p.stage, p.name) for p in PARAMETERS]
    first = np.array([np.clip(start[k], p.least, p.most)
                      for k, p in zip(keys, PARAMETERS, strict=True)])  # fmt: skip
    count = 0

    def values_at(x: Array) -> _Values:
        return dict(zip(keys, (float(v) for v in first * np.exp(x - 1.0)), strict=True))

    def differences(x: Array) -> Array:
        nonlocal count
        count += 1
        found = half.differences(values_at(x))
        print(f"rendering {count}: {0.5 * float(found @ found):.4f}", flush=True)
        return found

    bounds = [
        1.0 + np.log(np.array([getattr(p, end) for p in PARAMETERS]) / first)
        for end in ("least", "most")
    ]
    bounds = [bounds[0] - 1e-9, bounds[1] + 1e-9]
    found = least_squares(
        differences, np.ones(len(keys)), bounds=bounds, diff_step=_STEP, max_nfev=rounds
    )
    curvature = np.maximum((found.jac**2).sum(axis=0), 1e-12)
    known = np.exp(np.sqrt(2.0 * _COST * found.cost / curvature))
    return values_at(found.x), dict(zip(keys, (float(k) for k in known), strict=True))


def judge(half: Fit, real: FrameSet, values: _Values) -> dict[str, tuple[float, float]]:
    """Tell the real patches from the replayed ones: AUC of the line and of trees, each kind."""
    views = view_numbers(real.frames)
    simulated = half.cut(half.replay(values))
    verdicts = {k: tell_apart(half.patches[k], simulated[k], views, views) for k in KINDS}
    return {kind: (v.auc, v.boosted_auc) for kind, v in verdicts.items()}


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit the sensor to half of the frames, compare both with the other half, write the results."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fit_kinect_v2", description=__doc__)
    parser.add_argument("real", type=Path)
    parser.add_argument("-o", "--out", type=Path, default=Path("fit_kinect_v2"))
    parser.add_argument("--sensor", default="kinect-v2")
    parser.add_argument(
        "--rounds", type=int, default=4, help="each takes 13 renderings of the half"
    )
    options = parser.parse_args(arguments)
    fitted, judging = halves(read_frame_set(options.real))
    start = typical_values(options.sensor)
    context = open_context()
    values, known = fit(Fit(fitted, options.sensor, context), start, options.rounds)
    other = Fit(judging, options.sensor, context)
    before, after = (judge(other, judging, v) for v in (start, values))
    lines = ["| parameter | sensor | fitted | known within |", "|---|---|---|---|"]
    lines += [
        f"| {stage}.{name} | {start[stage, name]:.4g} | {value:.4g} | x {known[stage, name]:.2f} |"
        for (stage, name), value in values.items()
    ]
    lines += ["", "| judging half, AUC | sensor | fitted |", "|---|---|---|"]
    lines += [
        f"| {kind} | {before[kind][0]:.2f} / {before[kind][1]:.2f} "
        f"| {after[kind][0]:.2f} / {after[kind][1]:.2f} |"
        for kind in KINDS
    ]
    table = "\n".join(lines) + "\n"
    stages = [
        f'\n[[stage]]\nuse = "{stage}"\n' + "".join(f"{n} = {v:.4g}\n" for n, v in own.items())
        for stage, own in _changes(values).items()
    ]
    sensor_file = f'extends = "{options.sensor}"\ntitle = "fitted to {fitted.title}"\n'
    write_atomic(table.encode(), options.out / "table.md")
    write_atomic((sensor_file + "".join(stages)).encode(), options.out / "fitted.toml")
    print(table)


if __name__ == "__main__":
    main()
