"""Denoisers on planes before real cameras: python -m benchmarks.real_planes RECORDINGS [-d SPEC].

RECORDINGS holds the folders truedepth_zeiss, d435_wall_2frames and azure_kinect_mug of 16-bit PNG
files. Prints a Markdown table; the settings of each filter are those with the least residual on
these very frames.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glsim.data.recordings.files import read_map_mm
from glsim.denoise.denoiser import Denoiser
from glsim.denoise.registry import GRIDS, load_denoiser, tuning_specs

#: Side of the tiles that planes are fitted to, px: wider than any noise, narrower than what the
#: calibration of the cameras bends. Chosen.
_TILE_PX: Final = 80


class _Plane(NamedTuple):
    """Frames of a plane: title, files, their step in mm, rows and columns that show it alone."""

    title: str
    pattern: str
    unit_mm: float
    rows: slice
    columns: slice


#: Rows and columns are chosen by eye.
_PLANES: Final = (
    _Plane("TrueDepth, iPhone 11 Pro, board at 0.20 m", "truedepth_zeiss/eval_iPhone*/depth_*.png",
           0.1, slice(40, 280), slice(80, 560)),
    _Plane("TrueDepth, iPad Pro, board at 0.20 m", "truedepth_zeiss/eval_iPad*/depth_*.png",
           0.1, slice(40, 440), slice(40, 600)),
    _Plane("D435, wall at 1.6 to 1.9 m", "d435_wall_2frames/depth_*.png",
           1.0, slice(40, 280), slice(40, 280)),
    _Plane("Azure Kinect, door at 1.8 to 2 m", "azure_kinect_mug/depth.png",
           1.0, slice(90, 330), slice(420, 580)),
)  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the residual from planes and the shift of each denoiser, mm."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.real_planes", description=__doc__)
    parser.add_argument("recordings", type=Path)
    parser.add_argument("-d", "--denoiser", action="append", default=["face"])
    options = parser.parse_args(arguments)
    print("| recording | method | residual from planes [mm] | shift [mm] | pixels lost |")
    print("|---|---|---|---|---|")
    for plane in _PLANES:
        files = sorted(options.recordings.glob(plane.pattern))
        if not files:
            parser.error(f"{options.recordings}: has no {plane.pattern}")
        maps = [read_map_mm(file, plane.unit_mm) for file in files]
        tried = [_best(plane, maps, tuning_specs(name, (0,))) for name in GRIDS]
        best = min(tried, key=lambda spec: _measure(plane, maps, spec)[0])
        for spec in ("noisy", best, *options.denoiser):
            residual_mm, shift_mm, lost = _measure(plane, maps, spec)
            cells = f"{residual_mm:.3f} | {shift_mm:+.3f} | {100 * lost:.2f} %"
            print(f"| {plane.title} | `{spec.removesuffix(',cleanup=0')}` | {cells} |", flush=True)


def _best(plane: _Plane, maps: list[NDArray[np.float32]], specs: list[str]) -> str:
    """Return the spec with the least residual on the first map."""
    return min(specs, key=lambda spec: _measure(plane, maps[:1], spec)[0])


def _measure(
    plane: _Plane, maps: list[NDArray[np.float32]], spec: str
) -> tuple[float, float, float]:
    """Return the residual from planes, the mean shift, mm, and the share of lost pixels."""
    denoiser: Denoiser = load_denoiser(spec)
    squares, moved, lost = [], [], []
    for noisy in maps:
        denoised = denoiser(noisy).depth_mm
        raw, result = (image[plane.rows, plane.columns] for image in (noisy, denoised))
        both = (raw > 0) & (result > 0)
        moved.append(float((result - raw)[both].mean(dtype=np.float64)))
        lost.append(float(((raw > 0) & (result <= 0)).sum() / (raw > 0).sum()))
        squares += [residual for tile in _tiles(result) for residual in [_residual_mm2(tile)]]
    return float(np.sqrt(np.mean(squares))), float(np.mean(moved)), float(np.mean(lost))


def _tiles(depth_mm: NDArray[np.float32]) -> Iterator[NDArray[np.float32]]:
    height, width = depth_mm.shape
    for top in range(0, height - _TILE_PX + 1, _TILE_PX):
        for left in range(0, width - _TILE_PX + 1, _TILE_PX):
            yield depth_mm[top : top + _TILE_PX, left : left + _TILE_PX]


def _residual_mm2(depth_mm: NDArray[np.float32]) -> float:
    """Return the mean square distance from a plane along the ray: planes are linear in 1/depth."""
    rows, columns = np.nonzero(depth_mm)
    depth = depth_mm[rows, columns].astype(np.float64)
    design = np.stack([np.ones(depth.size), rows, columns], axis=1)
    fitted = design @ np.linalg.lstsq(design, 1 / depth, rcond=None)[0]
    return float(np.mean((depth - 1 / fitted) ** 2))


if __name__ == "__main__":
    main()
