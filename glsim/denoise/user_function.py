"""Adapter from a user's denoising function to the interface ``DepthFunction``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from glsim.core.array_types import Depth, Mask
from glsim.core.depth_protocol import check_protocol
from glsim.core.errors import DenoiserError, GlsimError, one_line
from glsim.networks.interface import DepthFunction


class UserFunction(DepthFunction):
    """A function of single frames, or of sequences if it has an attribute ``before`` or ``after``.

    It may have the other attributes of ``DepthFunction``, too. Its errors become DenoiserErrors.
    """

    def __init__(self, function: Callable[..., Any], label: str) -> None:
        """Read the attributes of a function; ``label`` names it in messages."""
        if not callable(function):
            raise DenoiserError(f"{label}: is no function of (noisy_mm, valid)")
        self._function, self._label = function, label
        with _errors_of(label):
            self._takes_sequences = hasattr(function, "before") or hasattr(function, "after")
            self.before = int(getattr(function, "before", 0))
            self.after = int(getattr(function, "after", 0))
            self.infrared = bool(getattr(function, "infrared", False))
            self.uncertain = bool(getattr(function, "uncertain", False))
            self.keep_clean = bool(getattr(function, "keep_clean", False))
        self.protocol = check_protocol(getattr(function, "protocol", None), f"{label}: protocol")

    def __call__(
        self, noisy_mm: Depth, valid: Mask, now: int, infrared: Depth | None = None
    ) -> Any:
        """Call the function with the arguments that it takes."""
        frame = (noisy_mm, valid, now) if self._takes_sequences else (noisy_mm[now], valid[now])
        images = {"infrared": infrared} if self.infrared else {}
        with _errors_of(self._label):
            return self._function(*frame, **images)


@contextmanager
def _errors_of(label: str) -> Iterator[None]:
    """Turn what the user's code raises in the block into a DenoiserError."""
    try:
        yield
    except (GlsimError, KeyboardInterrupt):
        raise
    except BaseException as error:  # it may raise anything, or exit
        raise DenoiserError(f"{label}: {one_line(error)}") from error
