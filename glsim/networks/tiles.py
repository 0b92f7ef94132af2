"""Parts of a frame for a network: around its depth, its nearest head, tiles of a large frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Depth, Mask
from glsim.core.depth_map import FLYING_MM, NEIGHBOURS
from glsim.networks.record import AROUND_PX

#: Side of a tile, px. Chosen: frames of depth cameras (1024 x 1024 and less) are never divided. The
#: shipped network takes 1.2 kB a pixel with OpenCV, and half of that with onnxruntime.
TILE_PX: Final = 1024
#: Width of the borders of a tile that are discarded, px. Derived: the shipped network sees 122 px
#: to each side (features 36, convolutions 62, mean correction 24). face-stereo sees farther: its
#: depth differs by at most 0.0005 mm (848 x 480 pixels of an office, tiles of 448).
MARGIN_PX: Final = 128
#: Corners of boxes, and tiles, are at multiples of this, px: networks halve sizes up to four times.
GRID_PX: Final = 16

#: Height and width of the denoised part, mm. A head of the 99th percentile is 255 mm high (ANSUR
#: II, stature minus chin height) and 165 mm wide; the rest is for hair and turned heads.
HEAD_MM: Final = (280.0, 220.0)
#: Focal length over the width of the image: Kinect V2 0.71, Azure 0.79, D435 0.60, TrueDepth 0.68.
FOCAL_SHARE: Final = 0.7
#: Smallest area of a person (not of hands): share of the box HEAD_MM, and coarse pixels. Chosen.
_LEAST_SHARE, _LEAST_PX = 0.15, 20
#: Heads are searched in frames reduced by this factor.
_COARSE_PX: Final = 4
#: Denoised margin of the head's box, px. Chosen: the head's depth then differs by at most 0.1 mm.
_HEAD_MARGIN_PX: Final = 32

#: Rows and columns of a part of a frame.
Box = tuple[slice, slice]


def box_around(mask: Mask, margin_px: int = AROUND_PX) -> Box | None:
    """Return the box around a mask plus a margin, in the frame, on a grid of 16 px, or None."""
    box = []
    for axis, size in ((1, mask.shape[0]), (0, mask.shape[1])):
        (found,) = np.nonzero(mask.any(axis=axis))
        if not found.size:
            return None
        first = max(0, int(found[0]) - margin_px) // GRID_PX * GRID_PX
        last = -(-(int(found[-1]) + 1 + margin_px) // GRID_PX) * GRID_PX
        box.append(slice(first, min(size, last)))
    return box[0], box[1]


def head_box(depth_mm: Depth) -> Box | None:
    """Return the box around the nearest head with a margin; None without a head.

    The nearest connected surface that is large enough counts as a person, and its part within a
    head's height of its top counts as the head. Live streams thus need no detector.
    """
    coarse = np.ascontiguousarray(depth_mm[::_COARSE_PX, ::_COARSE_PX])
    labels = _pieces(coarse, coarse > 0)
    focal_px = FOCAL_SHARE * depth_mm.shape[1]
    nearest_mm, head = np.inf, None
    areas = np.bincount(labels.ravel())
    areas[0] = 0
    for label in np.flatnonzero(areas >= _LEAST_PX):
        piece = labels == label
        distance_mm = float(np.percentile(coarse[piece], 10))
        height, width = (focal_px / distance_mm / _COARSE_PX * size for size in HEAD_MM)
        if areas[label] >= _LEAST_SHARE * height * width and distance_mm < nearest_mm:
            nearest_mm, head = distance_mm, _head(piece, height, width)
    if head is None:
        return None
    whole = cv2.resize(head.astype(np.uint8), depth_mm.shape[::-1], interpolation=cv2.INTER_NEAREST)
    return box_around(whole > 0, _HEAD_MARGIN_PX)


def _pieces(depth_mm: Depth, valid: Mask) -> NDArray[np.int32]:
    """Label the 4-connected surfaces of an (H, W) map, with steps up to FLYING_MM; 0 = no depth."""
    # Connected components know a mask only, so steps become gaps between pixels at twice the size.
    height, width = valid.shape
    grid = np.zeros((2 * height - 1, 2 * width - 1), np.uint8)
    grid[::2, ::2] = valid
    for axis, target in ((0, grid[1::2, ::2]), (1, grid[::2, 1::2])):
        near, far = NEIGHBOURS[axis]
        step = np.abs(depth_mm[far] - depth_mm[near]) <= FLYING_MM
        target[...] = step & valid[near] & valid[far]
    _, labels = cv2.connectedComponents(grid, connectivity=4)
    return np.where(valid, labels[::2, ::2], 0).astype(np.int32)


def _head(piece: Mask, height: float, width: float) -> Mask:
    """Mark a box of ``height`` x ``width`` pixels, the size of a head, at the top of a surface."""
    rows = np.flatnonzero(piece.sum(axis=1) >= max(1.0, 0.15 * width))
    top = int(rows[0]) if rows.size else int(np.flatnonzero(piece.any(axis=1))[0])
    upper = piece[top : top + max(1, round(0.6 * height))]
    middle = int(np.median(np.nonzero(upper)[1]))
    head = np.zeros_like(piece)
    left = max(0, middle - round(width / 2))
    head[top : top + round(height), left : middle + round(width / 2) + 1] = True
    return head


def run_tiled(
    network: Callable[[Depth], Mapping[str, Depth]],
    frame_mm: Depth,
    tile_px: int = TILE_PX,
    margin_px: int = MARGIN_PX,
) -> dict[str, Depth]:
    """Run a network on a frame, in overlapping tiles if it has more than ``tile_px``^2 pixels.

    The result, output name -> (H, W) float32, equals that of the whole frame, up to rounding, for a
    network that sees at most ``margin_px`` to each side, the discarded borders of tiles. The frame
    is (H, W), or the (C, H, W) stack of all inputs; all sizes are multiples of SIZE_MULTIPLE_PX.
    """
    height, width = frame_mm.shape[-2:]
    if height * width <= tile_px**2:
        return dict(network(frame_mm))
    outputs: dict[str, Depth] = {}
    for rows, used_rows, inner_rows in _spans(height, tile_px, margin_px):
        for columns, used_columns, inner_columns in _spans(width, tile_px, margin_px):
            tile = np.ascontiguousarray(frame_mm[..., rows, columns])
            for name, image in network(tile).items():
                whole = outputs.setdefault(name, np.empty((height, width), np.float32))
                whole[used_rows, used_columns] = image[inner_rows, inner_columns]
    return outputs


def _spans(size: int, tile_px: int, margin_px: int) -> Iterator[tuple[slice, slice, slice]]:
    """Divide [0, size) into overlapping tiles of one length, so that a runtime plans memory once.

    Yields for each tile: its span, the span of its used part, and the used part within the tile.
    """
    used = 0
    while used < size:
        first = max(0, min(used - margin_px, size - tile_px))
        last = first + tile_px if first + tile_px < size else size
        end = size if last == size else last - margin_px
        yield slice(first, last), slice(used, end), slice(used - first, end - first)
        used = end
