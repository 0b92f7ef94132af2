"""The frames to export: depth in metres, camera, lens, and the manifest's record."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core import depth_map
from glsim.core.camera import Distortion, Intrinsics, SensorRig
from glsim.core.depth_frame import DepthFrame
from glsim.core.errors import ConfigError, did_you_mean
from glsim.data.reader import Dataset

#: Layers of a data set that hold depth, the best known first.
DEPTH_LAYERS = ("clean", "noisy", "expected")


@dataclass(frozen=True, eq=False)
class ExportFrame:
    """One frame to export, with depth in metres.

    Args:
        stem: split/subject/sequence_frame.
        camera: in glsim's convention, see ``cameras``.
        lens: the distortion that the images keep; no distortion for pinhole images.
        depth_m: layer -> (H, W) float32 metres along the optical axis, 0 = none.
        infrared: (H, W) uint16 counts.
        reason, regions: (H, W) uint8; None if not in the data set.
        region_names: number -> name.
        record: the frame's line of the manifest.
        true_normals: (H, W, 3) float32 of the layer "normals", 0 without a surface; or None.
    """

    stem: str
    camera: Intrinsics
    lens: Distortion
    depth_m: Mapping[str, NDArray[np.float32]]
    infrared: NDArray[np.uint16] | None = None
    reason: NDArray[np.uint8] | None = None
    regions: NDArray[np.uint8] | None = None
    region_names: Mapping[int, str] = field(default_factory=dict)
    true_normals: NDArray[np.float32] | None = None
    record: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def rays(self) -> NDArray[np.float32]:
        """Slopes x/z and y/z of each pixel's ray, (H, W, 2) float32, including lens distortion."""
        return SensorRig(self.camera, distortion=self.lens, deliver="raw").rays()

    def points(self, layer: str) -> NDArray[np.float32]:
        """Return points (H, W, 3) float32 in camera-frame metres (y down), 0 without depth."""
        z = self.depth_m[layer][..., None]
        return np.concatenate([self.rays * z, z], axis=-1)

    def normals(self, layer: str) -> NDArray[np.float32]:
        """Return unit normals (H, W, 3) float32 towards the camera, 0 without depth.

        Of clean depth those of the mesh if the data set has them; else by differences of the depth,
        so that normals of noisy depth are as noisy as it.
        """
        depth = self.depth_m[layer]
        if layer == "clean" and self.true_normals is not None:
            return self.true_normals
        normals = depth_map.normals(depth, self.rays)
        return np.where(depth[..., None] > 0, normals, np.float32(0))


@dataclass(frozen=True)
class Export:
    """A file format for exported frames.

    Args:
        name: as in ``--to``.
        help: what the format is, in one line.
        encode: returns the files of one frame, each as the end of its name and its bytes.
        library: package that it imports; it comes with glsim[formats].
    """

    name: str
    help: str
    encode: Callable[[ExportFrame], Iterable[tuple[str, bytes]]]
    library: str = ""


def export_frames(
    dataset: Dataset,
    layers: Sequence[str] | None = None,
    split: str | None = None,
    count: int | None = None,
) -> Iterator[ExportFrame]:
    """Yield the frames of a data set in the order of its manifest.

    Args:
        layers: of depth; default: all that the data set has.
        split: only these.
        count: the first so many.

    Raises:
        ConfigError: a layer that is not there, and the errors of the reader.
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
    lens = kept_lens(dataset.header)
    names = {number: name for name, number in dataset.regions.items()}
    frames = dataset.frames() if split is None else dataset.split(split)
    for frame in frames[:count]:
        yield _frame(frame, chosen, lens, names)


def kept_lens(header: Mapping[str, Any]) -> Distortion:
    """Return the lens distortion in the images of a data set; none if they are undistorted."""
    sensor = header.get("sensor", {})
    if sensor.get("deliver") != "raw":
        return Distortion()
    given = sensor.get("distortion", {})
    return Distortion(**{name: float(given.get(name, 0.0)) for name in vars(Distortion())})


def _frame(
    frame: DepthFrame, layers: Sequence[str], lens: Distortion, names: Mapping[int, str]
) -> ExportFrame:
    images: dict[str, Any] = {
        layer: frame.layer(layer) for layer in ("infrared", "reason", "regions") if layer in frame
    }
    return ExportFrame(
        stem=frame.name,
        camera=frame.intrinsics,
        lens=lens,
        depth_m={
            layer: np.asarray(frame.layer(f"{layer}_mm") / np.float32(1000), np.float32)
            for layer in layers
        },
        region_names=names,
        true_normals=frame.normals if "normals" in frame else None,
        record=frame.record,
        **images,
    )
