"""The interface of denoisers and their parameters."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from glsim.depth_protocol import MEANING, DepthProtocol
from glsim.errors import ConfigError, DenoiserError, GlsimError, did_you_mean

#: A smaller depth, mm, is none from a camera: no depth camera measures nearer.
MIN_MEASURED_MM: Final = 50.0
_LOG = logging.getLogger(__name__)

#: (H, W) float32 millimetres along the optical axis; 0 = no depth.
Depth = NDArray[np.float32]
#: (H, W) bool: pixels with depth.
Mask = NDArray[np.bool_]
#: (H, W) float in [0, 1]: probability that a pixel has depth.
Probability = NDArray[np.floating]


class Denoised(NamedTuple):
    """The result of a denoiser; a denoiser may return a plain pair instead.

    Attributes:
        depth_mm: (H, W) millimetres.
        valid: (H, W) bool, or the probability of depth in [0, 1].
    """

    depth_mm: Depth
    valid: Mask | Probability


class Denoiser(Protocol):
    """A denoiser of single frames.

    It takes (H, W) float32 millimetres, 0 = no return, and the (H, W) bool mask of returns. One
    whose attribute ``infrared`` is true also gets the keyword argument ``infrared``: (H, W) float32
    counts, or None. The same holds for a ``SequenceDenoiser``: the image of frame ``now``.
    """

    def __call__(self, noisy_mm: Depth, valid: Mask, /) -> tuple[Any, Any]:
        """Return depth in millimetres and its validity, bool or a probability in [0, 1]."""
        ...


class SequenceDenoiser(Protocol):
    """A denoiser that also sees up to ``before`` earlier and ``after`` later frames.

    Arrays are (T, H, W); ``now`` is the index of the frame to denoise. The ends of a sequence have
    fewer neighbours.
    """

    before: int
    after: int

    def __call__(self, noisy_mm: Depth, valid: Mask, now: int, /) -> tuple[Any, Any]:
        """Return depth in millimetres and validity, (H, W), of frame ``now``."""
        ...


def parameter(
    default: float | None, low: float, high: float, help: str, former_names: tuple[str, ...] = ()
) -> Any:
    """Declare a dataclass field as a command-line parameter in [low, high].

    Its type, int or float, is that of the field. None is a default that a value replaces.
    ``former_names`` are deprecated names that still set it.
    """
    metadata = {"range": (low, high), "help": help, "former_names": former_names}
    return dataclasses.field(default=default, metadata=metadata)


def build(kind: type, text: dict[str, str], where: str) -> Any:
    """Make a dataclass of ``parameter`` fields.

    Args:
        kind: the dataclass.
        text: parameter name -> value as text.
        where: the denoiser as it was given, for messages.

    Raises:
        ConfigError: for an unknown name, a name given twice, or a value that is no number in range.
    """
    fields = {field.name: field for field in dataclasses.fields(kind)}
    former = {old: field for field in fields.values() for old in field.metadata["former_names"]}
    values: dict[str, float] = {}
    for name, written in text.items():
        field = fields.get(name) or former.get(name)
        if field is None:
            raise ConfigError(
                f"--denoiser {where}: no such parameter {name!r} ({did_you_mean(name, fields)})"
            )
        if name in former:
            _log_renamed(name, field.name)
        whole = str(field.type).startswith("int")
        try:
            value = int(written) if whole else float(written)
        except ValueError:
            number = "a whole number" if whole else "a number"
            raise ConfigError(f"--denoiser {where}: {name} must be {number}") from None
        low, high = field.metadata["range"]
        if not low <= value <= high:
            raise ConfigError(f"--denoiser {where}: {name} must lie in [{low:g}, {high:g}]")
        if field.name in values:
            raise ConfigError(f"--denoiser {where}: {field.name} is given twice")
        values[field.name] = value
    return kind(**values)


@lru_cache
def _log_renamed(old: str, new: str) -> None:
    """Log a deprecated parameter name, once per process."""
    _LOG.warning("denoiser parameter %s= is deprecated: write %s=", old, new)


@dataclass(frozen=True)
class Method:
    """A loaded denoiser with its name in tables and the neighbours in time that it needs.

    Attributes:
        label: its name.
        function: the `Denoiser` or `SequenceDenoiser`.
        before: earlier frames that it uses.
        after: later frames that it uses.
        temporal: whether ``function`` is a `SequenceDenoiser`.
        version: identifies the source file of the denoiser.
        infrared: whether it uses infrared.
        protocol: where the depths of its training are counted from; None for both.
        own_code: whether the function is the user's, so that its errors are those of a denoiser.
    """

    label: str
    function: Callable[..., tuple[Any, Any]]
    before: int = 0
    after: int = 0
    temporal: bool = False
    version: str = ""
    infrared: bool = False
    protocol: DepthProtocol | None = None
    own_code: bool = False

    def check_protocol(self, protocol: DepthProtocol) -> None:
        """Raise ConfigError if the denoiser was trained under another protocol."""
        if self.protocol is not None and self.protocol != protocol:
            raise ConfigError(
                f"{self.label}: was trained under the protocol {self.protocol} "
                f"({MEANING[self.protocol]}), and this is {protocol}: give --protocol "
                f"{self.protocol}, or a network trained with --protocol {protocol}"
            )

    def __call__(
        self, noisy_mm: Depth, now: int = 0, infrared: NDArray[Any] | None = None
    ) -> Denoised:
        """Denoise a frame of a sequence; the denoiser gets copies, so it may work in place.

        Args:
            noisy_mm: (T, H, W) millimetres, 0 = no return.
            now: index of the frame.
            infrared: (H, W) counts of the frame, for denoisers that use them.

        Raises:
            DenoiserError: if the result is not two images of the frame's size, and for errors of
                the user's own code.
        """
        result = self._run(self.function, noisy_mm, now, infrared)
        return self._checked(result, noisy_mm.shape[1:])

    def _run(
        self,
        function: Callable[..., Any],
        noisy_mm: Depth,
        now: int,
        infrared: NDArray[Any] | None,
    ) -> Any:
        """Call a function of the denoiser with copies of the arrays that it takes."""
        stack = noisy_mm.astype(np.float32)
        valid = stack > 0
        arguments = (stack, valid, now) if self.temporal else (stack[now], valid[now])
        if not self.infrared:
            return self._call(function, arguments)
        if infrared is not None and infrared.shape != stack.shape[1:]:
            raise DenoiserError(
                f"{self.label}: infrared of shape {infrared.shape} for depth of shape "
                f"{stack.shape[1:]}: give the infrared image of the same camera and crop"
            )
        counts = None if infrared is None else infrared.astype(np.float32)
        return self._call(function, arguments, infrared=counts)

    def _call(
        self, function: Callable[..., Any], arguments: tuple[Any, ...], **keywords: Any
    ) -> Any:
        if not self.own_code:
            return function(*arguments, **keywords)
        try:
            return function(*arguments, **keywords)
        except GlsimError:
            raise
        except Exception as error:  # the user's code may raise anything
            text = " ".join(str(error).split())
            raise DenoiserError(f"{self.label}: {type(error).__name__}: {text}") from error

    def check_map(self, depth_mm: NDArray[Any]) -> None:
        """Raise ConfigError for an array that is no depth map, (H, W) millimetres."""
        if depth_mm.ndim != 2 or depth_mm.dtype.kind not in "fiu":
            raise ConfigError(
                f"{self.label}: give depth of shape (H, W) in millimetres, float or integer, not "
                f"{depth_mm.shape} {depth_mm.dtype}"
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

    def denoise_map(self, depth_mm: NDArray[Any]) -> Denoised:
        """Denoise one (H, W) depth map, float or integer millimetres, as a stack of one frame.

        Raises ConfigError for an array that is no depth map, DenoiserError as a call does.
        """
        self.check_map(depth_mm)
        return self(depth_mm[None])

    @property
    def uncertain(self) -> bool:
        """Whether the denoiser predicts its uncertainty; ``with_sigma`` needs it."""
        return bool(getattr(self.function, "uncertain", False))

    def with_sigma(
        self, noisy_mm: Depth, now: int = 0, infrared: NDArray[Any] | None = None
    ) -> tuple[Denoised, Depth]:
        """Denoise as a call does; also return the standard deviation, (H, W) float32 mm.

        Needs a ``function`` with the attribute ``uncertain`` and the method ``with_uncertainty``,
        which takes what a call takes and returns (depth_mm, valid, sigma_mm).

        Args:
            noisy_mm: (T, H, W), or one map (H, W).
            now: index of the frame.
            infrared: (H, W) counts of the frame.

        Raises:
            ConfigError: for a denoiser that does not predict its uncertainty.
            DenoiserError: as a call does.
        """
        if not self.uncertain:
            raise ConfigError(f"{self.label}: this denoiser does not predict its uncertainty")
        stack = noisy_mm[None] if noisy_mm.ndim == 2 else noisy_mm
        function: Any = self.function
        result = self._run(function.with_uncertainty, stack, now, infrared)
        if not isinstance(result, tuple) or len(result) != 3:
            raise DenoiserError(f"{self.label}: must return (depth_mm, valid, sigma_mm)")
        sigma = np.asarray(result[2], np.float32)
        if sigma.shape != stack.shape[1:] or not (np.isfinite(sigma) & (sigma >= 0)).all():
            raise DenoiserError(f"{self.label}: sigma must be finite, >= 0 and of the map's size")
        return self._checked(result[:2], stack.shape[1:]), sigma

    def _checked(self, result: Any, shape: tuple[int, ...]) -> Denoised:
        if not isinstance(result, tuple) or len(result) != 2:
            raise DenoiserError(f"{self.label}: must return a pair (depth_mm, valid)")
        depth, kept = (np.asarray(part) for part in result)
        if depth.shape != shape or kept.shape != shape:
            raise DenoiserError(
                f"{self.label}: returned depth of shape {depth.shape} and validity of shape "
                f"{kept.shape} for a frame of {shape}"
            )
        if kept.dtype.kind not in "bf":
            raise DenoiserError(
                f"{self.label}: validity must be bool, or float in [0, 1], not {kept.dtype}"
            )
        if kept.dtype.kind == "f" and not ((kept >= 0) & (kept <= 1)).all():
            raise DenoiserError(f"{self.label}: the probability of depth must lie in [0, 1]")
        return Denoised(depth, kept)


#: Smallest depth that counts as depth, mm: a smaller one rounds to 0 in a 16-bit file in mm.
MIN_DEPTH_MM: Final = 0.5
