"""Move depth that an imager beside the camera measured into the camera's view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.geometry.camera import Point

Image = NDArray[np.float32]


def warp_to_camera(depth_m: Image, imager_m: Point, focal_px: float) -> Image:
    """Return what of a depth map a camera at the origin sees, in pixels of the same grid.

    Pixels shift by focal length times offset over depth; a nearer one covers farther ones. Each is
    drawn into the two pixels that it falls between, so that a slanted surface has no cracks.

    Args:
        depth_m: (H, W) seen by the imager, metres, 0 = none.
        imager_m: its place, with z = 0.

    Returns:
        (H, W) metres, 0 where nothing is seen: what the imager does not see stays empty.
    """
    height, width = depth_m.shape
    row, column = np.nonzero(depth_m)
    depth = depth_m[row, column]
    # Farthest first: of several values for one pixel NumPy keeps the last.
    order = np.argsort(-depth, kind="stable")
    row, column, depth = row[order], column[order], depth[order]
    shift = np.float64(focal_px) / depth
    x, y = column + shift * imager_m[0], row + shift * imager_m[1]
    seen = np.zeros_like(depth_m)
    upright = abs(imager_m[1]) > abs(imager_m[0])
    along = np.floor(y if upright else x).astype(np.int64)
    across = np.rint(x if upright else y).astype(np.int64)
    # Per pixel both neighbours are written before any nearer one.
    along = np.stack([along, along + 1], axis=1).ravel()
    across, depth = np.repeat(across, 2), np.repeat(depth, 2)
    rows, columns = (along, across) if upright else (across, along)
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    seen[rows[inside], columns[inside]] = depth[inside]
    return seen
