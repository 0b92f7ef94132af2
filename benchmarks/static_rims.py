"""Denoised static frames against the sensor's own mean and the truth, by distance from rims.

``python -m benchmarks.static_rims [SENSOR] [-d DENOISER]`` simulates static views of boards and
heads before walls and prints a table. Real recordings have no truth: ``glsim eval-real`` measures
against the mean of the frames, which keeps what is systematic, such as the pixels of a rim that
mix two surfaces.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from itertools import pairwise
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.denoise import MapDenoiser, load
from glsim.geometry.mesh import Mesh
from glsim.gl.context import open_context
from glsim.validate.scenes import depth_edge, faces, merge_meshes, wall
from glsim.validate.virtual_camera import Capture, VirtualCamera

#: Distances of the nearest surface, mm.
DISTANCES_MM: Final = (700.0, 1000.0, 1250.0)
#: Depth step between neighbours of a rim, mm, and bounds of the rings beside it, px. Chosen.
_STEP_MM, _RINGS_PX = 40.0, (0.0, 2.0, 4.0, np.inf)
#: Largest error that counts in full, mm: a pixel may lie on the other surface.
_MOST_MM: Final = 60.0
#: Albedo of skin in infrared, and of walls. Chosen.
_SKIN, _WALL = 0.5, 0.6


class Ring(NamedTuple):
    """RMSE of the pixels of a ring, mm: raw and denoised, against the mean and the truth."""

    near_px: float
    far_px: float
    pixels: int
    raw_mean: float
    denoised_mean: float
    raw_truth: float
    denoised_truth: float


def scenes(distance_mm: float) -> Iterator[tuple[str, Mesh]]:
    """Yield names and meshes of static views."""
    yield "wall", wall(distance_mm, _WALL)
    yield "board, 0.1 m before a wall", depth_edge(distance_mm, distance_mm + 100, _WALL)
    yield "board, 0.5 m before a wall", depth_edge(distance_mm, distance_mm + 500, _WALL)
    yield "head", _head(distance_mm)
    yield "head, 0.3 m before a wall", head_before_wall(distance_mm, 300)
    yield "head, 1 m before a wall", head_before_wall(distance_mm, 1000)


def head_before_wall(distance_mm: float, behind_mm: float) -> Mesh:
    """Return a head and a wall behind it."""
    return merge_meshes(_head(distance_mm), wall(distance_mm + behind_mm, _WALL))


def _head(distance_mm: float) -> Mesh:
    (head,) = faces(1, distance_mm, 5)
    return Mesh(head.vertices_mm, head.faces, np.full(len(head.vertices_mm), _SKIN, np.float32))


def rings(capture: Capture, denoiser: MapDenoiser) -> list[Ring]:
    """Measure the first frame of a capture in rings beside rims and in all that is farther."""
    stack = np.nan_to_num(capture.frames_mm).astype(np.float32)
    frame, seen = stack[0], stack > 0
    mean = np.where(seen.mean(0) > 0.9, stack.sum(0) / np.maximum(seen.sum(0), 1), 0)
    truth = np.nan_to_num(capture.clean_mm)
    denoised = denoiser(frame)[0]
    # As glsim eval-real: what is lost keeps the input's depth.
    lost = (denoised <= 0) | (np.abs(denoised - frame) > 50)
    denoised = np.where(lost, frame, denoised)
    square = np.ones((3, 3), np.uint8)
    mean32 = mean.astype(np.float32)
    rim = cv2.dilate(mean32, square) - cv2.erode(mean32, square) > _STEP_MM
    away_px = cv2.distanceTransform((~rim).astype(np.uint8), cv2.DIST_L2, 5)
    known = (mean > 0) & (frame > 0) & (truth > 0)
    found = []
    for near, far in pairwise(_RINGS_PX):
        ring = known & (away_px <= far) & (away_px > near if near else True)
        found.append(
            Ring(near, far, int(ring.sum()), *(
                _rmse(image[ring] - against[ring])
                for against in (mean, truth) for image in (frame, denoised)
            ))
        )  # fmt: skip
    return found


def _rmse(error_mm: NDArray[np.floating]) -> float:
    clipped = np.clip(error_mm, -_MOST_MM, _MOST_MM)
    return float(np.sqrt(np.mean(clipped**2))) if clipped.size else float("nan")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sensor", nargs="?", default="kinect-v2-sdk")
    parser.add_argument("-d", "--denoiser", default="face")
    parser.add_argument("--frames", type=int, default=24, help="of each view, for its mean")
    given = parser.parse_args()
    denoiser = MapDenoiser(load(given.denoiser))
    context = open_context()
    camera = VirtualCamera(given.sensor, context, seed=3)
    print("| view | m | ring, px | raw, mean | denoised, mean | raw, truth | denoised, truth |")
    print("|---|---|---|---|---|---|---|")
    for distance_mm in DISTANCES_MM:
        for name, mesh in scenes(distance_mm):
            at_mm = (0.0, 0.0, distance_mm)
            capture = camera.capture(mesh, given.frames, None, at_mm=at_mm, scene=name)
            for ring in rings(capture, denoiser):
                place = f"| {name} | {distance_mm / 1000:g} | {ring.near_px:g} to {ring.far_px:g} |"
                print(place, " | ".join(f"{number:.2f}" for number in ring[3:]), "|", flush=True)
    context.release()


if __name__ == "__main__":
    main()
