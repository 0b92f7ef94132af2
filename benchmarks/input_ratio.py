"""Divide the RMSE of denoised depth maps by the RMSE of the noisy maps that they were made from.

Usage: python -m benchmarks.input_ratio SET... -d SPEC...

SETs are data sets with the layers clean, expected and noisy. The table has one row for each
denoiser. Column "interior" is the RMSE of depth in the interior of surfaces, denoised over noisy;
"differences" is the same for the depth difference of two neighbouring pixels. 1 means no gain, 0 no
error. Both are geometric means over all frames; each set then has its own column "interior". The
truth is the layer "expected": a denoiser cannot remove systematic errors.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glsim.dataset import open_dataset
from glsim.denoise import load
from glsim.eval.metrics.prediction import edge_band, jump_edges

#: Frames with fewer pixels in the interior are left out. Chosen: a head at 2 m has 2,000.
_LEAST_PX = 500


def input_ratios(
    denoised_mm: NDArray[np.float32], noisy_mm: NDArray[np.float32], truth_mm: NDArray[np.float32]
) -> tuple[float, float] | None:
    """Divide the RMSE of a denoised map by the RMSE of its input, in the interior of surfaces.

    Args:
        denoised_mm: (H, W) millimetres.
        noisy_mm: (H, W) the input, 0 = no return.
        truth_mm: (H, W) what the sensor says without noise, 0 = no return.

    Returns:
        Two ratios without unit: of the RMSE of depth, and of the RMSE of the depth difference of
        two neighbouring pixels. None with fewer than 500 pixels in the interior.
    """
    valid = truth_mm > 0
    inside = valid & ~edge_band(valid, jump_edges(truth_mm)) & (noisy_mm > 0)
    if np.count_nonzero(inside) < _LEAST_PX:
        return None
    steps = inside[1:, 1:] & inside[:-1, 1:] & inside[1:, :-1] & inside[:-1, :-1]
    depth, differences = [], []
    for image in (denoised_mm, noisy_mm):
        error = image - truth_mm
        depth.append(np.square(error[inside]).mean())
        parts = (np.diff(error, axis=0)[:, :-1][steps], np.diff(error, axis=1)[:-1][steps])
        differences.append(np.square(np.concatenate(parts)).mean())
    return float(np.sqrt(depth[0] / depth[1])), float(np.sqrt(differences[0] / differences[1]))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the ratios of each denoiser (rows) on each data set (columns) as a Markdown table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.input_ratio", description=__doc__)
    parser.add_argument("sets", nargs="+", type=Path, help="data sets")
    parser.add_argument("-d", "--denoiser", action="append", required=True, help="as glsim eval")
    options = parser.parse_args(arguments)
    print(
        "| denoiser | interior | differences | " + " | ".join(s.name for s in options.sets) + " |"
    )
    print("|---" * (3 + len(options.sets)) + "|")
    for spec in options.denoiser:
        method = load(spec)
        sets = [
            [
                ratios
                for pair in open_dataset(path)
                if (
                    ratios := input_ratios(
                        method(pair.noisy_mm[None], 0).depth_mm, pair.noisy_mm, pair.expected_mm
                    )
                )
            ]
            for path in options.sets
        ]
        if empty := [path for path, found in zip(options.sets, sets, strict=True) if not found]:
            parser.error(f"{empty[0]}: no frame has {_LEAST_PX} pixels in the interior of surfaces")
        logs = np.log(np.concatenate(sets))
        cells = [*np.exp(logs.mean(axis=0)), *(np.exp(np.log(s)[:, 0].mean()) for s in sets)]
        print(
            f"| {method.label} | " + " | ".join(f"{cell:.3f}" for cell in cells) + " |", flush=True
        )


if __name__ == "__main__":
    main()
