"""Depth and light beside printed edges: of a real Kinect V2, and of ours with the same board."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from glsim.geometry.camera import Intrinsics
from glsim.geometry.mesh import Mesh
from glsim.measures.frame import DepthFrame
from glsim.measures.print_edges import DISTANCES_PX, PrintEdges, measure_print_edges
from glsim.recordings.recording import read_frame_set
from glsim.validate.scenes import merge_meshes, quad
from glsim.validate.virtual_camera import VirtualCamera
from tests.support.real_cameras import REAL_CAMERAS, needs_real_cameras

#: 41 frames of a real Kinect V2 (IA), measured by ``measure_print_edges``.
REAL_PRINT_MM = (1.07, 3.35, 8.43, 11.66, 7.28, 4.00, 1.86)
REAL_PAPER_MM = (0.16, -0.37, -0.71, -0.47, 0.08, 0.37, 0.47)
REAL_PRINT_LIGHT = (0.295, 0.102, 0.069, 0.060, 0.056, 0.053, 0.052)
SQUARE_MM = 30.0


def board(z_mm: float) -> Mesh:
    """6 x 8 squares with a white margin, facing the camera."""
    squares = []
    for row in range(-5, 5):
        for column in range(-4, 4):
            x, y = column * SQUARE_MM, row * SQUARE_MM
            inner = -3 <= column < 3 and -4 <= row < 4
            albedo = 0.037 if inner and (row + column) % 2 else 1.0
            corners = [(x, y + 30, 0), (x + 30, y + 30, 0), (x + 30, y, 0), (x, y, 0)]
            squares.append(quad(np.array(corners, float) + np.array([3.0, -7.0, z_mm]), albedo))
    return merge_meshes(*squares)


def frames(
    context: moderngl.Context, distances_mm: tuple[float, ...], **taps: float
) -> list[DepthFrame]:
    camera = VirtualCamera("kinect-v2", context)
    found = []
    for z_mm in distances_mm:
        shot = camera.capture(
            board(z_mm), frames=4, crop=None, changes={"tof_taps": taps}, scene="board"
        )
        known = np.isfinite(shot.fine_mm).all(axis=0)
        depth = np.where(known, np.nan_to_num(shot.fine_mm).mean(axis=0), np.nan)
        infrared = shot.infrared.mean(axis=0)
        rig = camera.rig.intrinsics
        found.append(
            DepthFrame(f"{z_mm}", depth.astype(np.float32), infrared.astype(np.float32), rig, 1.0)
        )
    return found


def in_print(edges: PrintEdges) -> float:
    """Return the largest error of print, mm."""
    return float(np.nanmax(edges.print_error_mm))


def test_print_beside_paper_is_as_far_off_as_in_real_frames(context: moderngl.Context) -> None:
    edges = measure_print_edges(frames(context, tuple(np.arange(760.0, 1200.0, 47.0))))
    assert edges.frames == 10
    np.testing.assert_allclose(edges.print_error_mm[:6], REAL_PRINT_MM[:6], rtol=0.3, atol=0.4)
    np.testing.assert_allclose(edges.paper_error_mm, REAL_PAPER_MM, atol=0.35)
    # Within half a pixel it depends on where the edge lies between the pixels.
    np.testing.assert_allclose(edges.print_light[1:], REAL_PRINT_LIGHT[1:], rtol=0.2)


def test_without_the_delay_print_is_in_the_plane_of_the_paper(context: moderngl.Context) -> None:
    still = measure_print_edges(frames(context, (900.0, 1000.0), halo_delay_mm=0.0))
    assert np.abs(still.print_error_mm).max() < 1.0
    late = measure_print_edges(frames(context, (900.0, 1000.0), halo_delay_mm=140.0))
    usual = measure_print_edges(frames(context, (900.0, 1000.0)))
    assert in_print(late) == pytest.approx(2.0 * in_print(usual), rel=0.25)


def test_a_delay_leaves_even_surfaces_where_they_are(context: moderngl.Context) -> None:
    """A camera's calibration holds on even surfaces, so the mean of the delay is taken off."""
    camera, wall = VirtualCamera("kinect-v2", context), board(1000.0)
    white = Mesh(wall.vertices_mm, wall.faces, np.ones(len(wall.vertices_mm), np.float32))
    means = [
        np.nanmean(
            camera.capture(white, 8, 48, changes={"tof_taps": {"halo_delay_mm": d}}).residual_mm
        )
        for d in (0.0, 70.0)
    ]
    assert abs(means[1] - means[0]) < 0.5


def test_frames_without_a_board_give_nothing() -> None:
    camera = Intrinsics(80, 60, 70.0, 70.0, 40.0, 30.0)
    depth = np.full((60, 80), 900, np.float32)
    empty = measure_print_edges(
        [
            DepthFrame("no infrared", depth, None, camera, 1.0),
            DepthFrame("no board", depth, np.full((60, 80), 5000, np.float32), camera, 1.0),
        ]
    )
    assert empty.frames == 0
    assert len(empty.print_light) == len(DISTANCES_PX) - 1
    assert np.isnan(empty.print_error_mm).all()


@needs_real_cameras
def test_the_numbers_above_are_those_of_the_real_frames() -> None:
    real = read_frame_set(REAL_CAMERAS.parent / "kinect-v2-real")
    edges = measure_print_edges(real.frames)
    assert edges.frames == 41
    np.testing.assert_allclose(edges.print_error_mm, REAL_PRINT_MM, atol=0.01)
    np.testing.assert_allclose(edges.paper_error_mm, REAL_PAPER_MM, atol=0.01)
    np.testing.assert_allclose(edges.print_light, REAL_PRINT_LIGHT, atol=0.001)
