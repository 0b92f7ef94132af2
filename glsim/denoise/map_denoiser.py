"""Denoisers of depth maps in memory: one map at a time, or the frames of a live stream."""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.denoise.around import only_around
from glsim.denoise.calibration import DeviceCalibration
from glsim.denoise.composites import DEFAULT_COMPOSITE, check_composite, composed
from glsim.denoise.interface import Denoised, Depth, Method
from glsim.errors import ConfigError
from glsim.geometry.camera import Intrinsics


class MapDenoiser:
    """A denoiser as a function of one depth map: what ``glsim.load_denoiser`` returns."""

    def __init__(
        self,
        method: Method,
        device: Path | str | None = None,
        composite: str | None = DEFAULT_COMPOSITE,
        around: str | None = None,
    ) -> None:
        """Prepare a denoiser for single maps.

        Args:
            method: the denoiser.
            device: sensor file whose fixed pattern and wiggling are subtracted first.
            composite: one of COMPOSITES, for denoisers with a probability of depth; None: return
                the denoiser's own result.
            around: "face": only around the nearest head, see ``glsim.denoise.around``.

        Raises:
            ConfigError: for an unknown composite or place, or an unusable device.
        """
        if composite is not None:
            check_composite(composite, "composite")
        self.method = only_around(method, around)
        self.device = None if device is None else DeviceCalibration(device)
        self._composite = composite

    def __call__(
        self,
        depth_mm: NDArray[Any],
        infrared: NDArray[Any] | None = None,
        *,
        intrinsics: Intrinsics | None = None,
    ) -> Denoised:
        """Denoise one depth map; a temporal denoiser gets no neighbours, see ``stream``.

        Args:
            depth_mm: (H, W), float or integer millimetres, 0 = no return. A network of the protocol
                paper (``method.protocol``) takes maps with their nearest point at 1 mm, see
                ``glsim.depth_protocol``.
            infrared: (H, W) counts of the same pixels, for denoisers that use them.
            intrinsics: intrinsics of a crop of the device's image.

        Returns:
            (H, W) depth in millimetres, 0 = none, and the (H, W) bool mask of depth. Without a
            composite: the denoiser's own depth, and its mask or probability of depth in [0, 1].

        Raises:
            ConfigError: for an array that is no depth map, is not moved as the network needs it, or
                is no image or crop of the device.
            DenoiserError: if the denoiser does not return two images.
        """
        return self.stream(intrinsics=intrinsics).push(depth_mm, infrared)

    def stream(self, *, intrinsics: Intrinsics | None = None) -> DepthStream:
        """Return a new stream of frames, which holds the neighbours that the denoiser needs.

        intrinsics: of a crop of the device's image, the same for all frames.
        """
        return DepthStream(self, intrinsics)

    def finished(self, denoised: Denoised, noisy_mm: Depth) -> Denoised:
        """Apply the composite to a result of ``method``. noisy_mm: (H, W) what it was given."""
        if self._composite is None:
            return denoised
        depth = composed(denoised, noisy_mm, self._composite)
        return Denoised(depth, depth > 0)


class DepthStream:
    """Denoises frames in the order of time, each with the frames before it.

    It is causal: a denoiser that would use later frames gets none. A frame of another size begins a
    new sequence.
    """

    def __init__(self, denoiser: MapDenoiser, intrinsics: Intrinsics | None) -> None:
        self._denoiser, self._intrinsics = denoiser, intrinsics
        self._held: deque[Depth] = deque(maxlen=1 + denoiser.method.before)

    def push(self, depth_mm: NDArray[Any], infrared: NDArray[Any] | None = None) -> Denoised:
        """Denoise the next frame; arguments, result and errors as of ``MapDenoiser``.

        A frame that is refused leaves the stream as it was.
        """
        method, device = self._denoiser.method, self._denoiser.device
        method.check_map(depth_mm)
        if infrared is not None and infrared.shape != depth_mm.shape:
            raise ConfigError(
                f"{method.label}: infrared of shape {infrared.shape} for depth of shape "
                f"{depth_mm.shape}: give the infrared of the same pixels"
            )
        frame = np.asarray(depth_mm, np.float32)
        if device is not None:
            frame = device(frame, self._intrinsics)
        elif frame is depth_mm:
            frame = frame.copy()  # cameras reuse their buffers
        if self._held and self._held[-1].shape != frame.shape:
            self.reset()
        self._held.append(frame)
        denoised = method(np.stack(self._held), len(self._held) - 1, infrared)
        return self._denoiser.finished(denoised, frame)

    def reset(self) -> None:
        """Forget the frames so far: the next one begins a new sequence."""
        self._held.clear()
