"""Reading of a data set (PNG files or shards): records, and depth maps in millimetres.

Everything is checked: the header and each record against ``glsim.data.record_schema``, the
manifest against its checksum in the header, the header against its checksum in ``.glsim``; and
every file that a record names must be a regular file inside the data set.
"""

from __future__ import annotations

import logging
import zlib
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from glsim.core.camera import Distortion
from glsim.core.depth_frame import DepthFrame, FrameKey, Frames
from glsim.core.depth_protocol import DepthProtocol, stored_protocol
from glsim.core.errors import DatasetError, did_you_mean
from glsim.core.files.cloud import open_store
from glsim.data.disk_format import HEADER, MANIFEST
from glsim.data.header import REPAIR, manifest_problem, open_header
from glsim.data.stored_frame import stored_frame
from glsim.settings.schema import SPLIT_NAMES
from glsim.simulation.frame import WRITABLE

log = logging.getLogger(__name__)


class Dataset:
    """A complete data set on disk or in object storage, cheap to pickle.

    Opening reads the manifest once for its checksum.
    Raises DatasetError if the folder holds no complete data set, one of a newer version of glsim,
    or one whose header or manifest is damaged or was changed.

    Attributes:
        path: its folder. For object storage: a folder with copies of header and manifest in the
            cache of glsim ($GLSIM_CACHE, else ~/.cache/glsim).
        is_remote: whether the images are in object storage.
    """

    def __init__(self, path: Path | str) -> None:
        self._store = open_store(path)
        self.is_remote = self._store.is_remote
        self.header, problem, self._manifest = open_header(self._store)
        self.depth_unit_mm = float(self.header["depth_unit_mm"])
        if problem:
            raise DatasetError(f"{self._store.where(HEADER)}: {problem}: {REPAIR}")
        if problem := manifest_problem(self.header, self._manifest):
            raise DatasetError(f"{self._store.where(MANIFEST)}: {problem}: {REPAIR}")
        self.path = self._manifest.path.parent
        if MANIFEST not in self.header["files"]:
            log.warning("%s: has no checksum in %s: changes are not noticed", MANIFEST, HEADER)

    def __str__(self) -> str:
        return str(self._store)

    def __len__(self) -> int:
        return sum(self.header["frames"].values())

    def __iter__(self) -> Iterator[DepthFrame]:
        return iter(self.frames())

    def frames(self) -> Frames:
        """Return all frames in the order of the manifest: train, val, test."""
        return self._part(0, len(self), "all")

    def split(self, name: str) -> Frames:
        """Return the frames of a split, possibly none. Raises DatasetError if unknown."""
        if name not in SPLIT_NAMES:
            raise DatasetError(f"no such split {name!r}: {did_you_mean(name, SPLIT_NAMES)}")
        counts = self.header["frames"]
        before = SPLIT_NAMES[: SPLIT_NAMES.index(name)]
        return self._part(sum(counts[split] for split in before), counts[name], name)

    def _part(self, first: int, count: int, name: str) -> Frames:
        header = zlib.crc32((self.path / HEADER).read_bytes())
        return Frames(
            count, partial(self._load, first), partial(self._key, first), title=f"{self} {name}",
            identity=f"{header:08x} {name}", regions=self.regions,
        )  # fmt: skip

    def shards(self, split: str) -> list[str]:
        """Return the paths or URLs of a split's shards, for readers such as webdataset."""
        names = (name for name in self.header["files"] if name.endswith(".tar"))
        return [self._store.where(name) for name in names if name.startswith(f"{split}-")]

    def require(self, layer: str) -> None:
        """Raise DatasetError if the data set has no layer with this name."""
        if layer in self.layers:
            return
        wanted = ",".join(sorted({"clean", "noisy", layer}))
        advice = f"generate it with --set output.layers={wanted}"
        if layer == "clean":
            advice += " (recordings have none: glsim eval-real, compare and denoise take them)"
        raise DatasetError(f"{self}: has no layer {layer!r}: {advice}")

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of the layers that each frame has."""
        written = self.header["settings"]["output"]["layers"]
        return tuple(layer for layer in WRITABLE if layer in written)

    @property
    def protocol(self) -> DepthProtocol:
        """Depth protocol of the files: measured depths, or depths shifted to 1 mm ("paper").

        Maps of a frame in millimetres are always measured depths.
        """
        return stored_protocol(self.header["settings"]["output"].get("nearest_to_mm"))

    @property
    def regions(self) -> dict[str, int]:
        """Numbers of the face regions, name -> number; empty without the layer "regions"."""
        return dict(self.header.get("regions", {}))

    @property
    def sensor_title(self) -> str:
        """Description of the sensor in one line, or else its name; changed by settings or not."""
        sensor, settings = self.header.get("sensor", {}), self.header.get("settings", {})
        changed = ", changed" if settings.get("stage") or settings.get("rig") else ""
        return f"{sensor.get('title', sensor.get('name', 'unknown sensor'))}{changed}"

    def _key(self, first: int, number: int) -> FrameKey:
        record = self._manifest.record(first + number)
        return FrameKey(str(record["subject"]), str(record["sequence"]), int(record["frame"]))

    def _load(self, first: int, number: int) -> DepthFrame:
        """Load frame ``first + number``; its split must agree with the counts in the header."""
        number += first
        record = self._manifest.record(number)
        counts = self.header["frames"]
        end = 0
        for expected in SPLIT_NAMES:
            end += counts[expected]
            if number < end:
                break
        if record["split"] != expected:
            raise self._manifest.damage(
                number, f"split: is {record['split']}, {HEADER} counts this frame to {expected}"
            )
        for layer in self.header["settings"]["output"]["layers"]:
            if layer not in record["files"]:
                raise self._manifest.damage(number, f"files: it lacks the layer {layer!r}")
        return stored_frame(self._store, record, self.depth_unit_mm, kept_lens(self.header))


def kept_lens(header: Mapping[str, Any]) -> Distortion:
    """Return the lens distortion in the images of a data set; none if they are undistorted."""
    sensor = header.get("sensor", {})
    if sensor.get("deliver") != "raw":
        return Distortion()
    given = sensor.get("distortion", {})
    return Distortion(**{name: float(given.get(name, 0.0)) for name in vars(Distortion())})


def open_dataset(path: Path | str) -> Dataset:
    """Open a complete data set: a folder, or a URL of object storage such as s3://bucket/faces.

    Raises DatasetError as ``Dataset`` does.
    """
    return Dataset(path)
