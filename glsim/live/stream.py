"""Measured frames and what a denoiser makes of them, packed for the browser."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.denoise import MapDenoiser
from glsim.errors import ConfigError
from glsim.live.source import LiveFrame, Source
from glsim.tune.packet import pack_layers

#: Step of the depths in the browser, mm: 16 bits end at 13 m, beyond all cameras that glsim knows.
STEP_MM: Final = 0.2
#: Share of a new frame in the ends of the colours, so that a flying pixel does not make them jump.
#: Chosen: they follow within half a second at 20 frames a second.
_SHARE: Final = 0.1
#: Percentiles of the measured depths that are the ends of the colours.
_ENDS: Final = (1.0, 99.0)


class LiveStream:
    """The frames of a source, each denoised with those before it. Use it on one thread.

    Attributes:
        source: of the frames.
        spec: the denoiser, as on the command line.
        around: "face" or None.
    """

    def __init__(
        self,
        source: Source,
        load: Callable[[str, str | None], MapDenoiser],
        spec: str,
        around: str | None,
    ) -> None:
        """Read and denoise a first frame, so that mistakes are said at once.

        Args:
            source: of the frames.
            load: makes a denoiser of ``spec`` and ``around``; see there.
            spec: the first denoiser.
            around: where it works.

        Raises:
            ConfigError: the denoiser is unknown, or needs what the source has not.
            GlsimError: what ``load`` and the source raise.
        """
        self.source, self._load = source, load
        self._frame = source.next()
        self._ends: NDArray[np.float64] | None = None
        self.choose(spec, around)

    def choose(self, spec: str, around: str | None) -> None:
        """Change the denoiser; errors as of the class, and the former one stays."""
        denoiser = self._load(spec, around)
        method = denoiser.method
        method.check_protocol("depth")
        if method.infrared and self._frame.infrared is None:
            raise ConfigError(
                f"{method.label}: uses infrared, which {self.source.title} does not give: choose "
                "another denoiser"
            )
        stream = denoiser.stream()
        stream.push(self._frame.depth_mm, self._frame.infrared)
        self.spec, self.around, self._stream = spec, around, stream

    def next(self, number: int) -> bytes:
        """Read the next frame and denoise it; return its packet. Raises what the source raises.

        number: of the packet.
        """
        before, self._frame = self._frame, self.source.next()
        if self._frame.number <= before.number:
            self._stream.reset()  # the recording begins again
        return self._denoised(number)

    def again(self, number: int) -> bytes:
        """Denoise the present frame once more, after ``choose``; return its packet."""
        self._stream.reset()
        return self._denoised(number)

    def _denoised(self, number: int) -> bytes:
        frame = self._frame
        start_s = time.perf_counter()
        denoised_mm = self._stream.push(frame.depth_mm, frame.infrared).depth_mm
        milliseconds = 1000 * (time.perf_counter() - start_s)
        layers = {"noisy": _in_steps(frame.depth_mm), "clean": _in_steps(denoised_mm)}
        if frame.infrared is not None:
            counts = np.clip(np.rint(frame.infrared), 0, np.iinfo(np.uint16).max)
            layers["infrared"] = counts.astype(np.uint16)
        return pack_layers(
            frame.camera, layers, STEP_MM, number=number, source_frame=frame.number,
            milliseconds=round(milliseconds, 1), depth_ends=self._follow_ends(frame),
        )  # fmt: skip

    def _follow_ends(self, frame: LiveFrame) -> list[float]:
        """Return the depths at the ends of the colours, steps, which follow the frames slowly."""
        depths = frame.depth_mm[::4, ::4]
        depths = depths[depths > 0]
        if depths.size:
            new = np.asarray(np.percentile(depths, _ENDS) / STEP_MM, np.float64)
            before = new if self._ends is None else self._ends
            self._ends = np.asarray(before + _SHARE * (new - before), np.float64)
        if self._ends is None:
            return [0.0, 1.0]
        return [round(float(end), 1) for end in self._ends]


def _in_steps(depth_mm: NDArray[np.floating]) -> NDArray[np.uint16]:
    steps = np.rint(np.asarray(depth_mm, np.float32) / np.float32(STEP_MM))
    most = np.iinfo(np.uint16).max
    return np.asarray(np.minimum(steps, most), np.uint16)
