"""Run a network over a large frame in tiles, so that its memory is that of one tile.

Measured: the shipped network takes 1.2 kB a pixel with OpenCV, and half of that with onnxruntime.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.denoise.record import AROUND_PX

_Image = NDArray[np.float32]

#: Side of a tile, px. Chosen: frames of depth cameras (1024 x 1024 and less) are never divided.
TILE_PX: Final = 1024
#: Width of the borders of a tile that are discarded, px. Derived: the shipped network sees 122 px
#: to each side (features 36, convolutions 62, mean correction 24). face-stereo sees farther: its
#: depth differs by at most 0.0005 mm (848 x 480 pixels of an office, tiles of 448).
#: A multiple of 16, as TILE_PX, since networks halve the size up to four times.
MARGIN_PX: Final = 128
#: Corners of boxes are at multiples of this, px: networks halve the size up to four times.
GRID_PX: Final = 16

#: Rows and columns of a part of a frame.
Box = tuple[slice, slice]


def box_around(mask: NDArray[np.bool_], margin_px: int = AROUND_PX) -> Box | None:
    """Return the box of a (H, W) mask and a margin, on the grid of networks; None without pixels.

    It ends at the frame.
    """
    box = []
    for axis, size in ((1, mask.shape[0]), (0, mask.shape[1])):
        (found,) = np.nonzero(mask.any(axis=axis))
        if not found.size:
            return None
        first = max(0, int(found[0]) - margin_px) // GRID_PX * GRID_PX
        last = -(-(int(found[-1]) + 1 + margin_px) // GRID_PX) * GRID_PX
        box.append(slice(first, min(size, last)))
    return box[0], box[1]


def run_tiled(
    network: Callable[[_Image], Mapping[str, _Image]],
    frame_mm: _Image,
    tile_px: int = TILE_PX,
    margin_px: int = MARGIN_PX,
) -> dict[str, _Image]:
    """Run a network; divide a frame of more than ``tile_px``^2 pixels into overlapping tiles.

    The result equals that of the whole frame, up to rounding, for a network that sees at most
    ``margin_px`` to each side. All sizes are multiples of
    ``glsim.denoise.network.SIZE_MULTIPLE_PX``.

    Args:
        network: the network.
        noisy_mm: (H, W), or the (C, H, W) stack of all inputs.
        tile_px: side of a tile.
        margin_px: width of the discarded borders of tiles.

    Returns:
        Output name -> (H, W) float32.
    """
    height, width = frame_mm.shape[-2:]
    if height * width <= tile_px**2:
        return dict(network(frame_mm))
    outputs: dict[str, _Image] = {}
    for rows, used_rows, inner_rows in _spans(height, tile_px, margin_px):
        for columns, used_columns, inner_columns in _spans(width, tile_px, margin_px):
            tile = np.ascontiguousarray(frame_mm[..., rows, columns])
            for name, image in network(tile).items():
                whole = outputs.setdefault(name, np.empty((height, width), np.float32))
                whole[used_rows, used_columns] = image[inner_rows, inner_columns]
    return outputs


def _spans(size: int, tile_px: int, margin_px: int) -> Iterator[tuple[slice, slice, slice]]:
    """Divide [0, size) into tiles of one length, so that a runtime plans its memory once.

    Yields each tile, the part of it that is used, and the place of that part in the tile.
    """
    used = 0
    while used < size:
        first = max(0, min(used - margin_px, size - tile_px))
        last = first + tile_px if first + tile_px < size else size
        end = size if last == size else last - margin_px
        yield slice(first, last), slice(used, end), slice(used - first, end - first)
        used = end
