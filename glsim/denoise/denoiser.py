"""The class of denoisers, for single depth maps, streams, and frames with neighbours in time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Depth, Mask, Probability
from glsim.core.camera import Intrinsics
from glsim.core.depth_protocol import MEANING, DepthProtocol
from glsim.core.errors import ConfigError, DenoiserError
from glsim.core.units import MM_PER_M
from glsim.denoise.user_function import UserFunction
from glsim.networks.composites import COMPOSITES, DEFAULT_COMPOSITE, check_composite, composed
from glsim.networks.interface import METRES_MM, MIN_MEASURED_MM, Denoised, DepthFunction
from glsim.networks.tiles import head_box

if TYPE_CHECKING:
    from glsim.denoise.calibration import DeviceCalibration


@dataclass(frozen=True, eq=False)
class Estimate:
    """The result of a denoiser for a frame, before a composite turns it into a depth map.

    Attributes:
        noisy_mm: (H, W) noisy depth of the frame, mm.
        depth_mm: (H, W) denoised depth, mm.
        valid: (H, W) bool mask of depth, or the probability of depth, float in [0, 1].
        sigma_mm: (H, W) float32 standard deviation, mm, from denoisers that predict it.
    """

    noisy_mm: Depth
    depth_mm: Depth
    valid: Mask | Probability
    sigma_mm: Depth | None = None

    def composite(self, name: str) -> NDArray[Any]:
        """Compute the depth map of a composite, (H, W) mm, 0 = none."""
        return composed((self.depth_mm, self.valid), self.noisy_mm, name)

    def composites(self) -> dict[str, NDArray[Any]]:
        """Compute all composites: name -> depth map. A bool mask gives a single one, named ""."""
        names = ("",) if self.valid.dtype.kind == "b" else COMPOSITES
        return {name: self.composite(name) for name in names}


class Denoiser:
    """A loaded denoiser of depth maps, as ``glsim.load_denoiser`` returns it.

    Attributes:
        label, version: name in tables; a text that changes if the denoiser's file changes.
        before, after, protocol: as of ``DepthFunction``.
        device: calibration that is subtracted from maps of ``__call__`` and ``push``; None: none.
        composite: one of COMPOSITES, for a probability of depth. None: the probability is returned.
    """

    def __init__(
        self,
        label: str,
        function: DepthFunction | Callable[..., Any],
        version: str = "",
        *,
        device: Path | str | None = None,
        composite: str | None = DEFAULT_COMPOSITE,
        around: str | None = None,
    ) -> None:
        """Make a denoiser of a filter, a network, or a function of the user (``UserFunction``).

        ``device`` is a sensor file. ``around="face"`` denoises only around the nearest head, see
        ``tiles.head_box``. Raises DenoiserError if ``function`` cannot be called; ConfigError for
        an unknown composite or ``around``, or an unusable device.
        """
        if composite is not None:
            check_composite(composite, "composite")
        if around not in (None, "face"):
            raise ConfigError(f"--around {around}: the only one is face")
        if not isinstance(function, DepthFunction):
            function = UserFunction(function, label)
        self.label, self.function, self.version = label, function, version
        self.before, self.after = function.before, function.after
        self.infrared, self.protocol = function.infrared, function.protocol
        self.uncertain = function.uncertain and around is None
        self.device: DeviceCalibration | None = None
        if device is not None:
            from glsim.denoise.calibration import DeviceCalibration  # it imports all sensors

            self.device = DeviceCalibration(device)
        self.composite = composite
        self._around_head = around is not None
        self._held: deque[Depth] = deque(maxlen=1 + self.before)

    def __call__(
        self, depth_mm: NDArray[Any], infrared: NDArray[Any] | None = None, *,
        intrinsics: Intrinsics | None = None,
    ) -> Denoised:  # fmt: skip
        """Denoise a single depth map, without neighbours in time.

        Args:
            depth_mm: (H, W), float or integer millimetres, 0 = no return. A network of the protocol
                paper takes maps with their nearest point at 1 mm, see ``core.depth_protocol``.
            infrared: (H, W) counts of the same pixels, for denoisers that use them.
            intrinsics: intrinsics of a crop of the device's image.

        Returns:
            (H, W) depth in millimetres, 0 = none, and the (H, W) bool mask of depth. Without a
            composite: the denoiser's own depth, and its mask or probability of depth in [0, 1].

        Raises:
            ConfigError: the array is no depth map, has another depth protocol than the network, or
                is no image or crop of the device.
            DenoiserError: if the denoiser does not return two images.
        """
        frame = self._frame(depth_mm, infrared, intrinsics)
        return self._finished(self.estimate(frame[None], 0, infrared))

    def push(
        self, depth_mm: NDArray[Any], infrared: NDArray[Any] | None = None, *,
        intrinsics: Intrinsics | None = None,
    ) -> Denoised:  # fmt: skip
        """Denoise the next frame of a stream, with the help of those before, as ``__call__``.

        A frame of another size begins a new sequence; a refused frame does not change the stream.
        """
        frame = self._frame(depth_mm, infrared, intrinsics)
        if self._held and self._held[-1].shape != frame.shape:
            self.reset()
        self._held.append(frame)
        return self._finished(self.estimate(np.stack(self._held), len(self._held) - 1, infrared))

    def reset(self) -> None:
        """Forget all pushed frames, so that the next frame starts a new sequence."""
        self._held.clear()

    def estimate(
        self, noisy_mm: Depth, now: int = 0, infrared: NDArray[Any] | None = None
    ) -> Estimate:
        """Denoise frame ``now`` of (T, H, W) measured depths, mm; no device is subtracted.

        Infrared is (H, W) counts. Raises DenoiserError for errors of the user's code, and if the
        result is not two images of the frame's size (three with an uncertainty).
        """
        if not self._around_head:
            return self._estimate(noisy_mm, now, infrared)
        frame = noisy_mm[now]
        box = head_box(frame)
        if box is None:
            return Estimate(frame, frame.astype(np.float32), frame > 0)
        counts = None if infrared is None else infrared[box]
        part = self._estimate(noisy_mm[:, *box], now, counts)
        depth_mm, valid = frame.astype(np.float32), (frame > 0).astype(part.valid.dtype)
        depth_mm[box], valid[box] = part.depth_mm, part.valid
        return Estimate(frame, depth_mm, valid)

    def check_protocol(self, protocol: DepthProtocol) -> None:
        """Raise ConfigError if the denoiser was trained under another protocol."""
        if self.protocol is not None and self.protocol != protocol:
            raise ConfigError(
                f"{self.label}: was trained under the protocol {self.protocol} "
                f"({MEANING[self.protocol]}), and this is {protocol}: give --protocol "
                f"{self.protocol}, or a network trained with --protocol {protocol}"
            )

    def _frame(
        self, depth_mm: NDArray[Any], infrared: NDArray[Any] | None, crop: Intrinsics | None
    ) -> Depth:
        """Check a user's depth map; return a calibrated float32 copy (cameras reuse buffers)."""
        kind = getattr(depth_mm, "dtype", type(depth_mm).__name__)
        usable = isinstance(kind, np.dtype) and kind.kind in "fiu"
        if not usable or depth_mm.ndim != 2 or not depth_mm.size:
            raise ConfigError(
                f"{self.label}: give depth of shape (H, W) in millimetres, float or integer, not "
                f"{getattr(depth_mm, 'shape', 'a')} {kind}"
            )
        if not (np.isfinite(depth_mm) & (depth_mm >= 0)).all():
            raise ConfigError(f"{self.label}: depth must be finite and at least 0 (0 = no return)")
        valid = depth_mm[depth_mm > 0]
        if self.protocol == "paper" and valid.size and valid.min() > MIN_MEASURED_MM:
            raise ConfigError(
                f"{self.label}: was trained with {MEANING['paper']}, and this map's is at "
                f"{valid.min():.0f} mm: subtract the difference (glsim denoise --protocol paper "
                "does), or train a network with --protocol depth"
            )
        floats = valid.size and depth_mm.dtype.kind == "f"
        if floats and np.quantile(valid, 0.9) < METRES_MM:  # a few wrong matches lie farther
            raise ConfigError(f"{self.label}: depth in metres? give millimetres (depth * 1000)")
        self._check_infrared(infrared, depth_mm.shape)
        frame = np.array(depth_mm, np.float32)
        return frame if self.device is None else self.device(frame, crop)

    def _check_infrared(self, infrared: NDArray[Any] | None, shape: tuple[int, ...]) -> None:
        if infrared is not None and np.shape(infrared) != shape:
            raise ConfigError(
                f"{self.label}: infrared of shape {np.shape(infrared)} for depth of shape {shape}: "
                "give the infrared of the same pixels"
            )

    def _finished(self, estimate: Estimate) -> Denoised:
        if self.composite is None:
            return Denoised(estimate.depth_mm, estimate.valid)
        depth_mm = estimate.composite(self.composite)
        return Denoised(depth_mm, depth_mm > 0)

    def _estimate(self, noisy_mm: Depth, now: int, infrared: NDArray[Any] | None) -> Estimate:
        """Call the denoising function, and check the arrays that it returns."""
        stack = noisy_mm.astype(np.float32)
        counts = None
        if self.infrared and infrared is not None:
            self._check_infrared(infrared, stack.shape[1:])
            counts = infrared.astype(np.float32)
        result = self.function(stack, stack > 0, now, counts)
        depth_mm, *others = self._checked(result, stack.shape[1:])
        # A thousandth of the input, give or take what was removed or filled.
        if 0.5 < MM_PER_M * float(np.mean(depth_mm)) / max(float(stack[now].mean()), 1.0) < 2:
            raise DenoiserError(f"{self.label}: returned metres? return millimetres (depth * 1000)")
        return Estimate(noisy_mm[now], depth_mm, *others)

    def _checked(self, result: Any, shape: tuple[int, ...]) -> list[NDArray[Any]]:
        names = ("depth_mm", "valid", "sigma_mm")[: 2 + self.function.uncertain]
        if not isinstance(result, tuple) or len(result) != len(names):
            raise DenoiserError(f"{self.label}: must return ({', '.join(names)})")
        images = [np.asarray(part) for part in result]
        for name, image in zip(names, images, strict=True):
            if image.shape != shape:
                raise DenoiserError(
                    f"{self.label}: returned {name} of shape {image.shape} for a frame of {shape}"
                )
        valid = images[1]
        if valid.dtype.kind not in "bf":
            raise DenoiserError(
                f"{self.label}: validity must be bool, or float in [0, 1], not {valid.dtype}"
            )
        if valid.dtype.kind == "f" and not ((valid >= 0) & (valid <= 1)).all():
            raise DenoiserError(f"{self.label}: the probability of depth must lie in [0, 1]")
        if not all((sigma_mm >= 0).all() for sigma_mm in images[2:]):
            raise DenoiserError(f"{self.label}: the standard deviation must be 0 mm or more")
        return images
