"""The protocol of denoisers, their parameters, and what becomes of a soft validity."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError, DenoiserError, did_you_mean

from ..types import Depth, Mask, Probability


class Denoised(NamedTuple):
    """What a denoiser returns; a plain pair will do.

    depth_mm: (H, W) millimetres. valid: (H, W) bool, or in [0, 1] the probability of depth.
    """

    depth_mm: Depth
    valid: Mask | Probability


class Denoiser(Protocol):
    """Of single frames. (H, W) float32 millimetres with 0 = no return, and (H, W) bool."""

    def __call__(self, noisy_mm: Depth, valid: Mask, /) -> tuple[Any, Any]:
        """Depth in millimetres, and where it is valid: bool, or the probability in [0, 1]."""
        ...


class SequenceDenoiser(Protocol):
    """Of frames with their neighbours in time: up to ``before`` earlier and ``after`` later ones.

    Arrays are (T, H, W), ``now`` is the frame that is wanted; at the ends of a sequence there are
    fewer neighbours.
    """

    before: int
    after: int

    def __call__(self, noisy_mm: Depth, valid: Mask, now: int, /) -> tuple[Any, Any]:
        """Of frame ``now``: depth in millimetres, and where it is valid."""
        ...


def parameter(default: float, low: float, high: float, help: str) -> Any:
    """A dataclass field that is a parameter on the command line, [low, high]."""
    return dataclasses.field(default=default, metadata={"range": (low, high), "help": help})


def build(kind: type, text: dict[str, str], where: str) -> Any:
    """A dataclass of ``parameter`` fields from name -> text. ConfigError for what does not fit."""
    fields = {field.name: field for field in dataclasses.fields(kind)}
    values: dict[str, float] = {}
    for name, written in text.items():
        if name not in fields:
            raise ConfigError(
                f"--denoiser {where}: no such parameter {name!r} ({did_you_mean(name, fields)})"
            )
        whole = isinstance(fields[name].default, int)
        try:
            value = int(written) if whole else float(written)
        except ValueError:
            what = "a whole number" if whole else "a number"
            raise ConfigError(f"--denoiser {where}: {name} must be {what}") from None
        low, high = fields[name].metadata["range"]
        if not low <= value <= high:
            raise ConfigError(f"--denoiser {where}: {name} must lie in [{low:g}, {high:g}]")
        values[name] = value
    return kind(**values)


@dataclass(frozen=True)
class Method:
    """A denoiser as it is run: its name in tables, and the neighbours in time that it gets.

    temporal: whether ``function`` is a SequenceDenoiser.
    version: changes when the file that it comes from does.
    """

    label: str
    function: Callable[..., tuple[Any, Any]]
    before: int = 0
    after: int = 0
    temporal: bool = False
    version: str = ""

    def __call__(self, noisy_mm: Depth, now: int = 0) -> Denoised:
        """Denoise frame ``now`` of a (T, H, W) stack, millimetres, 0 = no return.

        Raises DenoiserError for a result that is not two images of the frame's size. Arrays are
        handed over as copies: a denoiser that works in place does no harm.
        """
        stack = noisy_mm.astype(np.float32)
        valid = stack > 0
        shape = stack.shape[1:]
        result = (
            self.function(stack, valid, now)
            if self.temporal
            else self.function(stack[now], valid[now])
        )
        return self._checked(result, shape)

    @property
    def uncertain(self) -> bool:
        """Whether it knows how sure it is: then ``with_sigma`` works."""
        return bool(getattr(self.function, "uncertain", False))

    def with_sigma(self, noisy_mm: Depth) -> tuple[Denoised, Depth]:
        """Denoise one (H, W) map, and the standard deviation of the depth, (H, W) float32 mm.

        The function has ``uncertain`` and ``with_uncertainty(noisy_mm, valid) -> (depth_mm, valid,
        sigma_mm)``. Raises ConfigError if it has not, DenoiserError as a call does.
        """
        if not self.uncertain:
            raise ConfigError(f"{self.label}: this denoiser does not say how sure it is")
        noisy = noisy_mm.astype(np.float32)
        function: Any = self.function
        result = function.with_uncertainty(noisy, noisy > 0)
        if not isinstance(result, tuple) or len(result) != 3:
            raise DenoiserError(f"{self.label}: must return (depth_mm, valid, sigma_mm)")
        sigma = np.asarray(result[2], np.float32)
        if sigma.shape != noisy.shape or not (np.isfinite(sigma) & (sigma >= 0)).all():
            raise DenoiserError(f"{self.label}: sigma must be finite, >= 0 and of the map's size")
        return self._checked(result[:2], noisy.shape), sigma

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


#: What a soft validity becomes: key -> what it means.
COMPOSITES: Final = {
    "soft": "depth times probability, what minimises the squared error",
    "hard": "depth where the probability exceeds 1/2",
    "input mask": "depth where the input has some: surface quality without guessing silhouettes",
}

#: Less than this is 0 in a 16-bit file in millimetres.
_HALF_MM = 0.5


def compose(denoised: Denoised, noisy_mm: Depth) -> dict[str, NDArray[Any]]:
    """Depth maps with 0 = no depth: one ("") for a hard validity, COMPOSITES for a soft one.

    A soft product below half a millimetre is no depth.
    """
    depth, valid = denoised
    if valid.dtype.kind == "b":
        return {"": np.where(valid, depth, depth.dtype.type(0))}
    soft = depth * valid
    return {
        "soft": np.where(soft >= _HALF_MM, soft, 0),
        "hard": np.where(valid > 0.5, depth, depth.dtype.type(0)),
        "input mask": np.where(noisy_mm > 0, depth, depth.dtype.type(0)),
    }
