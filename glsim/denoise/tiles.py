"""Run a network over a large frame in tiles, so that its memory is that of one tile.

The shipped network takes about 1.2 kB a pixel with OpenCV (measured: 1.3 GB for the 1024 x 1024 of
a tile, so 5 GB for 2048 x 2048 pixels at once) and half of that with onnxruntime.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

_Image = NDArray[np.float32]

#: Largest frame that is run at once, pixels, and side of a tile: 1.3 GB with the shipped network,
#: by measurement. Frames of depth cameras (1024 x 1024 and less) are never divided.
TILE_PX: Final = 1024
#: Pixels at a tile's inner borders that are computed and not used. The shipped network sees 122 px
#: to each side: its features 36 (a Gaussian of radius 24, three of 4), its convolutions 62, and the
#: mean that is taken from its correction 24.
#: A multiple of 16, as TILE_PX, since networks halve the size up to four times.
MARGIN_PX: Final = 128


class _Span(NamedTuple):
    """Rows or columns of a tile, [first, last), and the part of them that is used."""

    first: int
    last: int
    used_first: int
    used_last: int


def run_tiled(
    network: Callable[[_Image], Mapping[str, _Image]],
    frame_mm: _Image,
    tile_px: int = TILE_PX,
    margin_px: int = MARGIN_PX,
) -> dict[str, _Image]:
    """Run a network on inputs of (H, W) or (C, H, W); its outputs, (H, W) float32 each, by name.

    A frame of more than tile_px^2 pixels is divided into overlapping tiles. The result is that of
    the whole frame, up to rounding, for a network that sees at most margin_px to each side; one
    that averages over the whole frame gets the averages of tiles. H, W, tile_px and margin_px are
    multiples of ``glsim.denoise.network.SIZE_MULTIPLE_PX``.
    """
    height, width = frame_mm.shape[-2:]
    if height * width <= tile_px**2:
        return dict(network(frame_mm))
    outputs: dict[str, _Image] = {}
    for rows in _spans(height, tile_px, margin_px):
        for columns in _spans(width, tile_px, margin_px):
            tile = frame_mm[..., rows.first : rows.last, columns.first : columns.last]
            for name, image in network(np.ascontiguousarray(tile)).items():
                whole = outputs.setdefault(name, np.empty((height, width), np.float32))
                whole[rows.used_first : rows.used_last, columns.used_first : columns.used_last] = (
                    image[_used(rows), _used(columns)]
                )
    return outputs


def _spans(size: int, tile_px: int, margin_px: int) -> Iterator[_Span]:
    """Divide [0, size) into spans of the same length, so that a runtime plans its memory once."""
    used = 0
    for first in range(0, size, tile_px - 2 * margin_px):
        if first + tile_px >= size:
            first = max(0, size - tile_px)
            yield _Span(first, size, used, size)
            return
        last = first + tile_px
        yield _Span(first, last, used, last - margin_px)
        used = last - margin_px


def _used(span: _Span) -> slice:
    return slice(span.used_first - span.first, span.used_last - span.first)
