"""The type of a depth frame from any source, and the type of a set of depth frames.

Data sets, recordings, folders of files and arrays in memory are read as ``Frames``. Scoring,
denoising, training, fitting and comparing use ``Frames``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Distortion, Intrinsics, SensorRig
from glsim.core.depth_protocol import DepthProtocol
from glsim.core.errors import DatasetError, counted
from glsim.core.units import to_metres

DepthMap = NDArray[np.float32]
Stack = NDArray[np.float64]

#: A depth map or other layer, or a function that reads it.
Layer = NDArray[Any] | Callable[[], NDArray[Any]]

_NO_LENS = Distortion()


class FrameKey(NamedTuple):
    """The subject, the sequence and the number that identify a frame."""

    subject: str
    sequence: str
    frame: int

    def __str__(self) -> str:
        name = f"{self.sequence}_{self.frame:05d}"
        return f"{self.subject}/{name}" if self.subject else name


class DepthFrame(Mapping[str, Any]):
    """A measured depth map with its camera, and optionally the truth, infrared and other maps.

    A map in a file is read and checked at its first use, which can raise DatasetError. A map that
    the frame lacks raises DatasetError too; test for it by ``"clean_mm" in frame``. The frame is a
    mapping from names to maps and key parts, so that a DataLoader of PyTorch can batch it.

    Args:
        layers: name -> (H, W) map, or a function that reads it; "noisy_mm" is required. Depth is
            float32 millimetres, 0 = none. "infrared" is counts. "reason" and "regions" are uint8
            codes. "normals" is (H, W, 3).
        offset_mm: millimetres that were subtracted from the depths: 0 as measured; NaN if the
            distance from the camera is unknown.
        step_mm: step of the stored depths, whose rounding adds step^2 / 12 to a variance; 0 for
            depths that were not rounded.
        name: a name that is unique in its set; default: the key.
        lens: distortion of the maps; default: none, for maps of a pinhole camera.
    """

    def __init__(
        self,
        key: FrameKey,
        intrinsics: Intrinsics,
        layers: Mapping[str, Layer],
        *,
        offset_mm: float = 0.0,
        step_mm: float = 1.0,
        record: Mapping[str, Any] | None = None,
        name: str = "",
        lens: Distortion = _NO_LENS,
    ) -> None:
        self.key, self.intrinsics, self.lens = key, intrinsics, lens
        self.offset_mm, self.step_mm = offset_mm, step_mm
        self.record: Mapping[str, Any] = record or {}
        self.name = name or str(key)
        self._layers: dict[str, Any] = dict(layers)

    def __repr__(self) -> str:
        return f"DepthFrame({self.name})"

    def __getitem__(self, name: str) -> Any:
        """Return a map or a part of the key by its name. Raises KeyError for an unknown name."""
        if name in self._layers:
            return self.layer(name)
        if name in FrameKey._fields:
            return getattr(self.key, name)
        raise KeyError(name)

    def __iter__(self) -> Iterator[str]:
        return iter((*self._layers, *FrameKey._fields))

    def __len__(self) -> int:
        return len(self._layers) + len(FrameKey._fields)

    __hash__ = object.__hash__

    def __eq__(self, other: object) -> bool:
        return self is other

    @property
    def layers(self) -> tuple[str, ...]:
        """The names of the maps."""
        return tuple(self._layers)

    def layer(self, name: str) -> NDArray[Any]:
        """Return a map by its name. Raises DatasetError if it is missing or cannot be read."""
        if name not in self._layers:
            raise DatasetError(
                f"{self.name}: has no layer {name.removesuffix('_mm')!r}: it has "
                f"{', '.join(layer.removesuffix('_mm') for layer in self._layers)}"
            )
        if callable(self._layers[name]):
            self._layers[name] = self._layers[name]()
        found: NDArray[Any] = self._layers[name]
        return found

    @property
    def noisy_mm(self) -> DepthMap:
        """(H, W) float32 measured depth, mm, 0 = no return."""
        return self.layer("noisy_mm")

    @cached_property
    def measured_mm(self) -> DepthMap:
        """(H, W) float32 measured depth, mm, NaN = no return."""
        return np.where(self.noisy_mm > 0, self.noisy_mm, np.float32(np.nan))

    @property
    def rays(self) -> DepthMap:
        """(H, W, 2) float32 rays x/z and y/z of the pixels, undistorted if there is a lens."""
        return _rays(self.intrinsics, self.lens)

    def in_metres(self, layer: str) -> DepthMap:
        """Return a depth layer, such as "noisy_mm", as (H, W) float32 metres, 0 = no depth."""
        return to_metres(self.layer(layer))

    def points(self, layer: str) -> DepthMap:
        """Return a depth layer's points, (H, W, 3) float32 metres, camera frame, 0 = no depth."""
        z = self.in_metres(layer)[..., None]
        return np.concatenate([self.rays * z, z], axis=-1)

    @property
    def clean_mm(self) -> DepthMap:
        """(H, W) float32 true depth, mm, 0 = no surface."""
        return self.layer("clean_mm")

    @property
    def expected_mm(self) -> DepthMap:
        """(H, W) float32 true depth with the sensor's systematic error, mm, 0 = no surface."""
        return self.layer("expected_mm")

    @property
    def infrared(self) -> NDArray[Any] | None:
        """(H, W) infrared counts; None without an infrared image."""
        return self.layer("infrared") if "infrared" in self._layers else None

    @property
    def reason(self) -> NDArray[np.uint8]:
        """(H, W) uint8 codes of ``glsim.Reason``."""
        return self.layer("reason")

    @property
    def regions(self) -> NDArray[np.uint8]:
        """(H, W) uint8 numbers of face regions, as in ``Frames.regions``; 0 = no region."""
        return self.layer("regions")

    @property
    def normals(self) -> DepthMap:
        """(H, W, 3) float32 unit normals of the true surface, camera frame; 0 = no surface."""
        return self.layer("normals")

    def changed(
        self,
        layers: Mapping[str, Layer] | None = None,
        *,
        intrinsics: Intrinsics | None = None,
        offset_mm: float | None = None,
    ) -> DepthFrame:
        """Return a copy of the frame with other maps, another camera or another offset."""
        return DepthFrame(
            self.key,
            intrinsics or self.intrinsics,
            {**self._layers, **(layers or {})},
            offset_mm=self.offset_mm if offset_mm is None else offset_mm,
            step_mm=self.step_mm,
            record=self.record,
            name=self.name,
            lens=self.lens,
        )

    def without(self, layers: Sequence[str]) -> DepthFrame:
        """Return a copy of the frame that lacks some maps, by their names."""
        copy = self.changed()
        copy._layers = {name: value for name, value in copy._layers.items() if name not in layers}
        return copy


class Frames(Sequence[DepthFrame]):
    """A numbered set of depth frames of one camera; the frames of a sequence are consecutive.

    Args:
        load: number -> frame; raises DatasetError if it is missing or damaged.
        key: number -> key, without reading the frame; default: the key of the loaded frame.
        identity: a text that changes whenever the frames may have changed.
        note: a sentence for the user that says what was assumed or left out.
    """

    def __init__(
        self,
        count: int,
        load: Callable[[int], DepthFrame],
        key: Callable[[int], FrameKey] | None = None,
        *,
        title: str = "",
        identity: str = "",
        regions: Mapping[str, int] | None = None,
        protocol: DepthProtocol = "depth",
        note: str = "",
    ) -> None:
        self._count, self._load, self._key = count, load, key
        self.title, self.identity, self.protocol, self.note = title, identity, protocol, note
        self.regions: Mapping[str, int] = regions or {}

    @classmethod
    def of(cls, frames: Sequence[DepthFrame], title: str = "", note: str = "") -> Frames:
        """Make a set from frames in memory."""
        kept = tuple(frames)
        return cls(len(kept), kept.__getitem__, title=title, note=note)

    def __len__(self) -> int:
        return self._count

    def key(self, number: int) -> FrameKey:
        """Return the key of a frame, given its number."""
        return self.load(number).key if self._key is None else self._key(number)

    def load(self, number: int) -> DepthFrame:
        """Load a frame, given its number. Raises DatasetError if it is missing or damaged."""
        return self._load(number)

    @property
    def intrinsics(self) -> Intrinsics:
        """The pinhole camera of the first frame."""
        return self[0].intrinsics

    @cached_property
    def measured_mm(self) -> Stack:
        """(T, H, W) float64 measured depth of frames of equal size, mm, NaN = no return."""
        return np.stack([frame.measured_mm for frame in self]).astype(np.float64)

    @property
    def whole_mm(self) -> Stack:
        """(T, H, W) measured depth rounded to whole mm, NaN = no return."""
        return np.rint(self.measured_mm)

    @cached_property
    def truth_mm(self) -> Stack:
        """(H, W) true depth of a static scene, mm, NaN = no surface."""
        clean = self[0].clean_mm
        return np.where(clean > 0, clean, np.nan).astype(np.float64)

    @property
    def residual_mm(self) -> Stack:
        """(T, H, W) measured depth in whole mm minus the true depth of a static scene."""
        return self.whole_mm - self.truth_mm

    def stack(self, layer: str) -> NDArray[Any]:
        """Stack a layer of all frames, (T, H, W) or (T, H, W, components); sizes must be equal."""
        return np.stack([frame.layer(layer) for frame in self])

    def centre(self, width: int = 64, height: int | None = None) -> Frames:
        """Load all frames and crop them to ``width`` x ``height`` pixels in the centre."""
        own = self.intrinsics
        height = width if height is None else height
        left, top = (own.width - width) // 2, (own.height - height) // 2
        part = np.s_[top : top + height, left : left + width]
        camera = own.cropped(left, top, width, height)
        parts = ({name: frame.layer(name)[part] for name in frame.layers} for frame in self)
        cut = [f.changed(p, intrinsics=camera) for f, p in zip(self, parts, strict=True)]
        return Frames.of(cut, self.title)

    @overload
    def __getitem__(self, number: int) -> DepthFrame: ...
    @overload
    def __getitem__(self, number: slice) -> Frames: ...
    def __getitem__(self, number: int | slice) -> DepthFrame | Frames:
        """Return the frame at a position (negative: counted from the end), or a slice of frames."""
        if isinstance(number, slice):
            numbers = range(*number.indices(self._count))
            load, key = (partial(_at, get, numbers) for get in (self.load, self.key))
            return self._like(len(numbers), load, key, self.identity, self.protocol)
        position = number + self._count if number < 0 else number
        if not 0 <= position < self._count:
            count = counted(self._count, "frame")
            raise IndexError(f"{self.title or 'the set'} has {count}, not {number}")
        return self.load(position)

    def changed(
        self,
        change: Callable[[DepthFrame], DepthFrame],
        identity: str = "",
        protocol: DepthProtocol | None = None,
    ) -> Frames:
        """Return the set with ``change`` applied to each frame when read; ``identity`` names it."""
        load = partial(_then, self.load, change)
        name = f"{self.identity} {identity}".strip()
        return self._like(self._count, load, self.key, name, protocol or self.protocol)

    def _like(
        self,
        count: int,
        load: Callable[[int], DepthFrame],
        key: Callable[[int], FrameKey],
        identity: str,
        protocol: DepthProtocol,
    ) -> Frames:
        made = Frames(count, load, key, title=self.title, identity=identity, protocol=protocol)
        made.regions, made.note = self.regions, self.note
        return made


@lru_cache(maxsize=2)
def _rays(camera: Intrinsics, lens: Distortion) -> DepthMap:
    return SensorRig(camera, distortion=lens, deliver="raw").rays()


# These are functions of the module, because a set of frames is pickled for other processes.


def _at(get: Callable[[int], Any], numbers: Sequence[int], number: int) -> Any:
    return get(numbers[number])


def _then(
    load: Callable[[int], DepthFrame], change: Callable[[DepthFrame], DepthFrame], number: int
) -> DepthFrame:
    return change(load(number))
