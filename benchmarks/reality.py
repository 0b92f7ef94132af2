"""Simulated counterparts of real frames, compared: ``python -m benchmarks.reality REAL -o DIR``.

REAL: a calibration folder of iai_kinect2, NNNN_depth.png and NNNN_ir.png with the corners of the
chessboard in NNNN_ir_points.yaml. For every frame the board is put where the real one stood
(distance, place in the image, slant, roll), on a chair of boxes in a room of a near side wall, a
door 0.5 m behind the chair, a far wall and a floor. The scene is not that of the room, only like
it: shapes and albedos are chosen. Frames that are static in REAL are static here too. Writes
DIR/frames, DIR/table.md, DIR/table.json and DIR/figure.png.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glsim.compare.figure import draw_comparison
from glsim.compare.run import compare_sets
from glsim.files.atomic import write_atomic
from glsim.files.png import encode_png
from glsim.geometry.mesh import Mesh
from glsim.gl.context import open_context
from glsim.measures.frame import DepthFrame
from glsim.measures.static import static_pairs
from glsim.recordings.opencv_yaml import read_corners
from glsim.recordings.recording import read_frame_set
from glsim.validate.scenes import merge_meshes, quad
from glsim.validate.virtual_camera import VirtualCamera

Array = NDArray[np.float64]

#: Squares of the board and its white margin, mm (README of the recording).
SQUARE_MM, MARGIN_MM = 30.0, 20.0
SQUARES = (6, 8)
#: Albedos relative to a white wall, chosen: paper, print, a painted chair, doors, walls, floor.
PAPER, PRINT, CHAIR, DOOR, WALL, FLOOR = 1.0, 0.037, 0.75, 0.55, 0.9, 0.3
#: iai_kinect2's limits, mm: the real frames hold 103 to 12,000 mm.
DRIVER = {"range_gate": {"near_mm": 100.0, "far_mm": 12000.0}}


@dataclass(frozen=True)
class BoardPose:
    """Centre of the board in the camera frame, mm, and its axes: right, down, away (3, 3)."""

    centre_mm: Array
    axes: Array


def board_pose(frame: DepthFrame, corners_px: Array) -> BoardPose:
    """Find the board: a plane through the depths within its corners, (N, 2) px."""
    low, high = corners_px.min(axis=0).astype(int), corners_px.max(axis=0).astype(int) + 1
    part = np.s_[low[1] : high[1], low[0] : high[0]]
    z = frame.depth_mm[part].astype(np.float64)
    rays = frame.rays[part].astype(np.float64)
    known = np.isfinite(z)
    points = np.stack([rays[..., 0] * z, rays[..., 1] * z, z], axis=-1)[known]
    centre = np.median(points, axis=0)
    near = np.abs(points[:, 2] - centre[2]) < 120.0
    design = np.column_stack([points[near, :2] - centre[:2], np.ones(near.sum())])
    slope = np.linalg.lstsq(design, points[near, 2], rcond=None)[0]
    slope = np.clip(slope, -1.0, 1.0)  # 45 degrees: steeper ones are holes in the print
    away = np.array([-slope[0], -slope[1], 1.0])
    away /= np.linalg.norm(away)
    along = corners_px[4] - corners_px[0]
    if along[0] < 0:  # the corners were found upside down; nobody hung the camera so
        along = -along
    right = np.array([along[0], along[1], 0.0])
    right -= away * (right @ away)
    right /= np.linalg.norm(right)
    centre[2] += slope[2]
    return BoardPose(centre, np.stack([right, np.cross(away, right), away]))


def placed(mesh_corners: Array, pose: BoardPose, albedo: float) -> Mesh:
    """Place a quad, (4, 3) mm in the board's axes, in the camera frame."""
    return quad(pose.centre_mm + mesh_corners @ pose.axes, albedo)


def sheet(pose: BoardPose, x: tuple[float, float], y: tuple[float, float], z: float, albedo: float
          ) -> Mesh:  # fmt: skip
    """A rectangle in the plane z of the board's axes, seen from the camera."""
    corners = [(x[0], y[1], z), (x[1], y[1], z), (x[1], y[0], z), (x[0], y[0], z)]
    return placed(np.array(corners), pose, albedo)


def box(pose: BoardPose, low: tuple[float, float, float], high: tuple[float, float, float],
        albedo: float) -> Mesh:  # fmt: skip
    """A box with edges along the board's axes, its six sides facing outwards."""
    (a, b, c), (d, e, f) = low, high
    sides = [
        [(a, e, c), (d, e, c), (d, b, c), (a, b, c)],  # front
        [(d, e, f), (a, e, f), (a, b, f), (d, b, f)],  # back
        [(a, e, f), (a, e, c), (a, b, c), (a, b, f)],  # left
        [(d, e, c), (d, e, f), (d, b, f), (d, b, c)],  # right
        [(a, b, c), (d, b, c), (d, b, f), (a, b, f)],  # top
        [(a, e, f), (d, e, f), (d, e, c), (a, e, c)],  # bottom
    ]
    return merge_meshes(*(placed(np.array(s, float), pose, albedo) for s in sides))


def board(pose: BoardPose) -> Mesh:
    """The chessboard: its squares, and the margin around them."""
    columns, rows = SQUARES
    half_x, half_y = columns * SQUARE_MM / 2, rows * SQUARE_MM / 2
    parts = []
    for row in range(rows):
        for column in range(columns):
            x, y = column * SQUARE_MM - half_x, row * SQUARE_MM - half_y
            albedo = PRINT if (row + column) % 2 else PAPER
            parts.append(sheet(pose, (x, x + SQUARE_MM), (y, y + SQUARE_MM), 0.0, albedo))
    wide_x, wide_y = half_x + MARGIN_MM, half_y + MARGIN_MM
    parts += [
        sheet(pose, (-wide_x, wide_x), (-wide_y, -half_y), 0.0, PAPER),
        sheet(pose, (-wide_x, wide_x), (half_y, wide_y), 0.0, PAPER),
        sheet(pose, (-wide_x, -half_x), (-half_y, half_y), 0.0, PAPER),
        sheet(pose, (half_x, wide_x), (-half_y, half_y), 0.0, PAPER),
    ]
    return merge_meshes(*parts)


def upright(pose: BoardPose) -> BoardPose:
    """Return the board's pose without its slant: same centre and roll, facing the camera."""
    right = np.array([pose.axes[0, 0], pose.axes[0, 1], 0.0])
    right /= np.linalg.norm(right)
    away = np.array([0.0, 0.0, 1.0])
    return BoardPose(pose.centre_mm, np.stack([right, np.cross(away, right), away]))


def chair(pose: BoardPose) -> Mesh:
    """A chair whose back stands behind the board, its edges along the board's axes."""
    parts = [
        box(pose, (-190, -190, 15), (-150, 200, 40), CHAIR),  # posts of the back
        box(pose, (150, -190, 15), (190, 200, 40), CHAIR),
        box(pose, (-190, -190, 15), (190, -130, 40), CHAIR),  # rails
        box(pose, (-190, -60, 20), (190, -20, 35), CHAIR),
        box(pose, (-190, 60, 20), (190, 100, 35), CHAIR),
        box(pose, (-200, 180, -300), (200, 210, 60), CHAIR),  # seat
        box(pose, (-195, 210, -295), (-165, 620, -265), CHAIR),  # legs
        box(pose, (165, 210, -295), (195, 620, -265), CHAIR),
        box(pose, (-195, 210, 25), (-165, 620, 55), CHAIR),
        box(pose, (165, 210, 25), (195, 620, 55), CHAIR),
    ]
    return merge_meshes(*parts)


def room(pose: BoardPose) -> Mesh:
    """A door behind the chair's left half, a wall on the right, a far wall and a floor.

    Args:
        pose: upright. The wall stays 250 mm to the right of the camera at least.
    """
    wall = max(330.0, 250.0 - float(pose.centre_mm @ pose.axes[0]))
    parts = [
        box(pose, (-900, -1200, 500), (60, 620, 540), DOOR),
        box(pose, (wall, -1500, -900), (wall + 30, 620, 1300), WALL),
        sheet(pose, (-5000, 5000), (-4000, 700), 2300.0, WALL),
        placed(  # the floor, seen from above
            np.array(
                [(-5000, 620, -2000), (5000, 620, -2000), (5000, 620, 2300), (-5000, 620, 2300)],
                float,
            ),
            pose,
            FLOOR,
        ),
    ]
    return merge_meshes(*parts)


def scene_mesh(pose: BoardPose) -> Mesh:
    """Board, chair and room in the camera frame."""
    around = merge_meshes(chair(pose), room(upright(pose)))
    return merge_meshes(board(pose), in_view(split_long(around)))


def in_view(mesh: Mesh) -> Mesh:
    """Leave out triangles that come nearer than 200 mm to the plane of the camera."""
    nearest = mesh.vertices_mm[mesh.faces][..., 2].min(axis=1)
    kept = mesh.faces[nearest > 200.0]
    used, place = np.unique(kept, return_inverse=True)
    albedo = np.asarray(mesh.albedo, np.float32)[used]
    return Mesh(mesh.vertices_mm[used], place.reshape(-1, 3).astype(np.int32), albedo)


def mirrored(mesh: Mesh) -> Mesh:
    """Swap left and right; the faces still face outwards."""
    vertices = mesh.vertices_mm * np.array([-1, 1, 1], np.float32)
    return Mesh(vertices, np.ascontiguousarray(mesh.faces[:, ::-1]), mesh.albedo)


def split_long(mesh: Mesh, longest_mm: float = 400.0) -> Mesh:
    """Split triangles until no edge is longer, so that those behind the camera can be left out."""
    vertices, albedo = mesh.vertices_mm.astype(np.float64), np.asarray(mesh.albedo, np.float64)
    faces = mesh.faces
    for _ in range(12):
        corners = vertices[faces]
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        long = edges.max(axis=1) > longest_mm
        if not long.any():
            break
        turn = edges[long].argmax(axis=1)
        order = (turn[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(faces[long], order, axis=1).T
        middle = len(vertices) + np.arange(len(a))
        vertices = np.concatenate([vertices, 0.5 * (vertices[a] + vertices[b])])
        albedo = np.concatenate([albedo, 0.5 * (albedo[a] + albedo[b])])
        halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
        faces = np.concatenate([faces[~long], *halves])
    return Mesh(vertices.astype(np.float32), faces.astype(np.int32), albedo.astype(np.float32))


def simulate_counterparts(real: Path, out: Path, sensor: str, seed: int) -> None:
    """Write NNNN_depth.png and NNNN_ir.png of all frames of ``real`` that have board corners."""
    frames = read_frame_set(real).frames
    scene_of = list(range(len(frames)))
    for first, second in static_pairs(frames):
        scene_of[second] = scene_of[first]
    context = open_context()
    camera = VirtualCamera(sensor, context, seed=seed)
    try:
        for number, frame in enumerate(frames):
            stem = frame.name.removesuffix("_depth")
            scene = frames[scene_of[number]]
            corners = real / f"{scene.name.removesuffix('_depth')}_ir_points.yaml"
            if not corners.exists():
                continue
            pose = board_pose(scene, read_corners(corners))
            mesh = mirrored(scene_mesh(pose))
            shot = camera.capture(
                mesh, frames=1, crop=None, scene=f"reality {stem}", changes=DRIVER
            )
            depth = np.ascontiguousarray(shot.encoded[0, :, ::-1])
            infrared = np.rint(shot.infrared[0, :, ::-1]).clip(0, 65535).astype(np.uint16)
            write_atomic(encode_png(depth), out / f"{stem}_depth.png")
            write_atomic(encode_png(infrared), out / f"{stem}_ir.png")
    finally:
        context.release()


def main() -> None:
    """Render, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("real", type=Path)
    parser.add_argument("-o", "--out", type=Path, default=Path("reality"))
    parser.add_argument("--sensor", default="kinect-v2")
    parser.add_argument("--seed", type=int, default=0, help="of the virtual device and its noise")
    arguments = parser.parse_args()
    start = time.perf_counter()
    frames = arguments.out / "frames"
    simulate_counterparts(arguments.real, frames, arguments.sensor, arguments.seed)
    rendered = time.perf_counter()
    result = compare_sets(read_frame_set(arguments.real), read_frame_set(frames), progress=print)
    write_atomic(result.as_markdown().encode(), arguments.out / "table.md")
    text = json.dumps(result.as_json(), indent=1) + "\n"
    write_atomic(text.encode(), arguments.out / "table.json")
    write_atomic(draw_comparison(result), arguments.out / "figure.png")
    print(f"rendered in {rendered - start:.0f} s, compared in {time.perf_counter() - rendered:.0f}")


if __name__ == "__main__":
    main()
