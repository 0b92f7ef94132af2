"""The interface of denoising functions: arrays, results and command-line parameters."""

from __future__ import annotations

import dataclasses
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError, did_you_mean

#: A smaller depth, mm, is none from a camera: no depth camera measures nearer.
MIN_MEASURED_MM: Final = 50.0
#: Smallest depth that counts as depth, mm: a smaller one rounds to 0 in a 16-bit file in mm.
MIN_DEPTH_MM: Final = 0.5

#: (H, W) float32 millimetres along the optical axis; 0 = no depth.
Depth = NDArray[np.float32]
#: (H, W) bool: pixels with depth.
Mask = NDArray[np.bool_]
#: (H, W) float in [0, 1]: probability that a pixel has depth.
Probability = NDArray[np.floating]


class Denoised(NamedTuple):
    """A denoised depth map and its validity.

    Attributes:
        depth_mm: (H, W) millimetres.
        valid: (H, W) bool, or the probability of depth in [0, 1].
    """

    depth_mm: Depth
    valid: Mask | Probability


class DepthFunction(Protocol):
    """The interface of a denoising function: a filter, a network, or the user's own function.

    It takes (H, W) float32 millimetres, 0 = no return, and the (H, W) bool mask of returns. One
    with the attribute ``before`` or ``after`` (numbers of frames) takes a sequence, (T, H, W) each,
    and the index of the frame to denoise; the ends of a sequence have fewer neighbours. One whose
    attribute ``infrared`` is true also gets the keyword argument ``infrared``: (H, W) float32
    counts of that frame, or None.
    """

    def __call__(
        self, noisy_mm: Depth, valid: Mask, /, *now: int, **images: Any
    ) -> tuple[Any, ...]:
        """Return depth, mm, and its validity, a bool mask or a probability in [0, 1].

        One whose attribute ``uncertain`` is true also returns the standard deviation, mm.
        """
        ...


def parameter(default: float | None, low: float, high: float, help: str) -> Any:
    """Declare a dataclass field as a command-line parameter in the range [low, high].

    Its type, int or float, is that of the field. None is a default that a value replaces.
    """
    return dataclasses.field(default=default, metadata={"range": (low, high), "help": help})


def build(kind: type, text: dict[str, str], where: str) -> Any:
    """Make a dataclass whose fields are ``parameter`` from texts of the command line.

    Args:
        kind: the dataclass.
        text: parameter name -> value as text.
        where: the denoiser as it was given, for messages.

    Raises:
        ConfigError: for an unknown name, or a value that is no number in range.
    """
    fields = {field.name: field for field in dataclasses.fields(kind)}
    values: dict[str, float] = {}
    for name, written in text.items():
        field = fields.get(name)
        if field is None:
            raise ConfigError(
                f"--denoiser {where}: no such parameter {name!r} ({did_you_mean(name, fields)})"
            )
        whole = str(field.type).startswith("int")
        try:
            value = int(written) if whole else float(written)
        except ValueError:
            number = "a whole number" if whole else "a number"
            raise ConfigError(f"--denoiser {where}: {name} must be {number}") from None
        low, high = field.metadata["range"]
        if not low <= value <= high:
            raise ConfigError(f"--denoiser {where}: {name} must lie in [{low:g}, {high:g}]")
        values[name] = value
    return kind(**values)
