"""The frames to export, and the type of an export format."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.core import depth_map
from glsim.core.depth_frame import DepthFrame
from glsim.core.errors import ConfigError, did_you_mean
from glsim.data.reader import Dataset
from glsim.data.recordings.names import DEPTH_LAYERS


@dataclass(frozen=True)
class Export:
    """A file format for exported frames.

    Args:
        encode: returns the files of one frame, each as (end of its name, bytes).
        library: package that the format imports; the extra glsim[formats] installs it.
    """

    name: str
    help: str
    encode: Callable[[DepthFrame], Iterable[tuple[str, bytes]]]
    library: str = ""


def export_frames(
    dataset: Dataset,
    layers: Sequence[str] | None = None,
    split: str | None = None,
    count: int | None = None,
) -> Iterator[DepthFrame]:
    """Yield the frames of a data set in the order of its manifest, with the chosen depth layers.

    ``layers``: depth layers to export; ConfigError for a missing layer. Default: all depth layers.
    """
    there = [layer for layer in DEPTH_LAYERS if layer in dataset.layers]
    for layer in layers or ():
        if layer not in there:
            raise ConfigError(
                f"{dataset}: has no layer of depth {layer!r}: {did_you_mean(layer, there)}"
            )
    chosen = there if layers is None else [layer for layer in there if layer in layers]
    if not chosen:
        raise ConfigError(f"{dataset}: has no layer of depth to export")
    left_out = [f"{layer}_mm" for layer in there if layer not in chosen]
    frames = dataset.frames() if split is None else dataset.split(split)
    for frame in frames[:count]:
        yield frame.without(left_out)


def depth_layers(frame: DepthFrame) -> list[str]:
    """Return the names of a frame's depth layers, without "_mm", in the order of DEPTH_LAYERS."""
    return [layer for layer in DEPTH_LAYERS if f"{layer}_mm" in frame]


def surface_normals(frame: DepthFrame, layer: str) -> NDArray[np.float32]:
    """Return unit normals towards the camera, (H, W, 3) float32, 0 without depth.

    Clean depth has the mesh's normals if the data set stores them. Other normals are computed from
    differences of depth, and are as noisy as the depth.
    """
    if layer == "clean" and "normals" in frame:
        return frame.normals
    depth_m = frame.in_metres(f"{layer}_mm")
    normals = depth_map.normals(depth_m, frame.rays)
    return np.where(depth_m[..., None] > 0, normals, np.float32(0))
