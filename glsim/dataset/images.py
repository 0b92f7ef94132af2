"""PNG files of single layers. OpenCV is needed to read them only."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glsim.dataset.files import write_bytes
from glsim.dataset.png import encode_png
from glsim.errors import DatasetError
from glsim.frame import Frame

Image = NDArray[np.uint16] | NDArray[np.uint8]

#: The number type of each layer's pixels.
LAYER_TYPES: dict[str, np.dtype[np.generic]] = {
    "clean": np.dtype(np.uint16),
    "noisy": np.dtype(np.uint16),
    "infrared": np.dtype(np.uint16),
    "reason": np.dtype(np.uint8),
    "regions": np.dtype(np.uint8),
}


def decode_png(data: bytes, layer: str, where: str) -> Image:
    """The bytes of a PNG file to (H, W) in the layer's type. DatasetError if it is not that."""
    import cv2

    buffer = np.frombuffer(data, np.uint8)
    try:
        image = cv2.imdecode(buffer, cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:
        image = None
    if image is None:
        raise DatasetError(f"{where}: is no readable PNG image: it is damaged or incomplete")
    expected = LAYER_TYPES[layer]
    if image.dtype != expected:
        raise DatasetError(
            f"{where}: has {image.dtype.itemsize * 8} bits a pixel, {layer} needs "
            f"{expected.itemsize * 8}: another program saved it again"
        )
    if image.ndim != 2:
        raise DatasetError(f"{where}: has {image.shape[2]} channels instead of one")
    result: Image = image
    return result


def write_frame(frame: Frame, directory: Path, stem: str, layers: Sequence[str]) -> list[Path]:
    """Write ``<stem>_<layer>.png`` for each layer; the folder is made. Returns the paths.

    Existing files are replaced. Raises ConfigError for an unknown layer or a depth that does not
    fit 16 bits, DatasetError if a file cannot be written; no file is ever left half written.
    """
    images = {layer: encode_png(frame.image(layer)) for layer in layers}
    paths = {layer: directory / f"{stem}_{layer}.png" for layer in layers}
    for layer, path in paths.items():
        write_bytes(images[layer], path)
    return list(paths.values())
