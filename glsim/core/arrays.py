"""The functions of NumPy or of PyTorch, under NumPy's names, for code that runs on either.

Random words are uint32 in NumPy and int32 in PyTorch, whose uint32 has no arithmetic. Sums and
products wrap around in both, and so their bits are the same. A number that is combined with a
tensor must be a Python number: a ``numpy.float32`` to the left of a tensor makes a NumPy array.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Mask, Reals

#: Float32 arrays or Python numbers. The types are NumPy's; tensors are accepted as well.
Numbers = Reals | float
#: Whole numbers: 32-bit random words, or indices.
Words = NDArray[np.integer[Any]]
_Array = TypeVar("_Array", Reals, Words)

#: Functions of one argument. PyTorch's accept tensors only, no Python numbers.
_OF_ONE = ("sqrt", "exp", "log", "cos", "sin", "tanh", "floor", "abs", "sign", "arccos")


class Functions:
    """NumPy's functions; results of float32 arrays and Python numbers are float32."""

    sqrt: Callable[[Numbers], Reals]
    exp: Callable[[Numbers], Reals]
    log: Callable[[Numbers], Reals]
    cos: Callable[[Numbers], Reals]
    sin: Callable[[Numbers], Reals]
    tanh: Callable[[Numbers], Reals]
    floor: Callable[[Numbers], Reals]
    round: Callable[[Numbers], Reals]
    abs: Callable[[Numbers], Reals]
    sign: Callable[[Numbers], Reals]
    arccos: Callable[[Numbers], Reals]
    rad2deg: Callable[[Numbers], Reals]
    arctan2: Callable[[Numbers, Numbers], Reals]
    minimum: Callable[[Numbers, Numbers], Reals]
    maximum: Callable[[Numbers, Numbers], Reals]
    clip: Callable[[_Array, Any, Any], _Array]
    amin: Callable[[Reals, int], Reals]
    amax: Callable[[Reals, int], Reals]
    zeros_like: Callable[[Reals], Reals]
    flip: Callable[[Reals, tuple[int, ...]], Reals]
    roll: Callable[[_Array, int, int], _Array]
    stack: Callable[[Sequence[Reals], int], Reals]
    arange: Callable[[int, int], Words]
    float32: Any
    int32: Any
    nn: Any  # torch.nn.functional; PyTorch only

    if not TYPE_CHECKING:  # a type checker must report a misspelt name

        def __getattr__(self, name: str) -> Any:
            return getattr(np, name)

    def where(self, condition: Mask, one: Any, other: Any) -> Reals:
        """Choose from numbers and float32 arrays by a condition; the result is float32."""
        chosen: Reals = np.where(condition, one, other)
        return chosen.astype(np.float32) if chosen.dtype == np.float64 else chosen

    def vector(self, numbers: Sequence[float] | Reals, like: Any) -> Reals:
        """Return a 1D float32 array on the device of ``like``."""
        return np.array(numbers, np.float32)

    def floats(self, whole: Any) -> Reals:
        """Convert integers or truth values to float32."""
        return np.asarray(whole).astype(np.float32)

    def integers(self, whole: Numbers | Words) -> Words:
        """Convert float32 whole numbers to integers that can be indices."""
        return np.asarray(whole).astype(np.int64)

    def words(self, numbers: Any, like: Any = None) -> Words:
        """Convert whole numbers to an array of 32-bit words on the device of ``like``."""
        # The result is always an array, because NumPy warns when scalars overflow.
        return np.atleast_1d(np.asarray(numbers).astype(np.int64)).astype(np.uint32)

    def word(self, number: int) -> Any:
        """Return a 32-bit word of a Python integer, for arithmetic with words."""
        return np.uint32(number % 2**32)

    def shifted(self, words: Words, by: Words | int) -> Words:
        """Shift 32-bit words to the right; zeros come in."""
        return words >> (np.uint32(by) if isinstance(by, int) else by)

    def running_maximum(self, x: Reals, axis: int) -> Reals:
        """Return the running maximum of an array along an axis."""
        return np.maximum.accumulate(x, axis)

    def range(self, start: int, stop: int, like: Any) -> Words:
        """Return the integers from ``start`` up to ``stop`` on the device of ``like``."""
        return np.arange(start, stop)

    def plus(self, total: Numbers, weight: Numbers, part: Numbers, scale: Numbers = 1.0) -> Any:
        """Compute total + scale * weight * part; PyTorch does it in one operation."""
        return total + scale * weight * part


class _Torch(Functions):
    """PyTorch's functions under NumPy's names, also for Python numbers beside tensors."""

    def __init__(self) -> None:
        self._torch: Any = sys.modules["torch"]  # PyTorch is loaded, since there is a tensor
        for name in _OF_ONE:
            setattr(self, name, partial(self._of_one, name))

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            return getattr(self._torch, name)

    def _of_one(self, name: str, x: Any) -> Any:
        if isinstance(x, float):
            return float(getattr(np, name)(np.float32(x)))
        return getattr(self._torch, name)(x)

    def minimum(self, one: Any, other: Any) -> Any:
        return self._bounded("max", one, other)

    def maximum(self, one: Any, other: Any) -> Any:
        return self._bounded("min", one, other)

    def _bounded(self, bound: str, one: Any, other: Any) -> Any:
        """Clamp a tensor by a bound ("min" or "max") that is a number or a tensor."""
        if not isinstance(one, self._torch.Tensor):
            one, other = other, one
        if not isinstance(one, self._torch.Tensor):
            return max(one, other) if bound == "min" else min(one, other)
        return one.clamp(**{bound: other})

    def clip(self, x: Any, low: Any, high: Any) -> Any:
        return self.minimum(self.maximum(x, low), high)

    def where(self, condition: Any, one: Any, other: Any) -> Any:
        if isinstance(condition, bool):
            return one if condition else other
        return self._torch.where(condition, one, other)

    def stack(self, arrays: Sequence[Any], axis: int = 0) -> Any:
        """Stack along a new axis, but keep each array contiguous in memory."""
        return self._torch.stack(self._torch.broadcast_tensors(*arrays)).movedim(0, axis)

    def vector(self, numbers: Sequence[float] | Reals, like: Any) -> Any:
        # The vector is filled on its device: a copy from the CPU would wait for the GPU.
        f32 = self._torch.float32
        return self._torch.stack([like.new_full((), float(n), dtype=f32) for n in numbers])

    def floats(self, whole: Any) -> Any:
        if whole.dtype == self._torch.bool:
            whole = whole.view(self._torch.uint8)  # PyTorch converts uint8 4 times as fast as bool
        return whole.to(self._torch.float32)

    def integers(self, whole: Any) -> Any:
        return int(whole) if isinstance(whole, float) else whole.to(self._torch.int64)

    def words(self, numbers: Any, like: Any = None) -> Any:
        if isinstance(numbers, int):
            return like.new_full((1,), self.word(numbers), dtype=self._torch.int32)
        return numbers.to(self._torch.int32)

    def word(self, number: int) -> int:
        return (number + 2**31) % 2**32 - 2**31

    def shifted(self, words: Any, by: Any) -> Any:
        if isinstance(by, int):
            return (words >> by) & (2 ** (32 - by) - 1)
        return (words >> by) & ~(-2 << (31 - by))

    def running_maximum(self, x: Any, axis: int) -> Any:
        return x.cummax(axis).values

    def range(self, start: int, stop: int, like: Any) -> Any:
        return self._torch.arange(start, stop, dtype=self._torch.int32, device=like.device)

    def plus(self, total: Any, weight: Any, part: Any, scale: Any = 1.0) -> Any:
        tensor = self._torch.Tensor
        if not isinstance(total, tensor) or isinstance(scale, tensor):
            return total + scale * weight * part
        if isinstance(weight, tensor):
            return self._torch.addcmul(total, weight, part, value=scale)
        return self._torch.add(total, part, alpha=scale * weight)


_NUMPY = Functions()
_TORCH: list[_Torch] = []


def of(array: Any) -> Functions:
    """Return the functions for a NumPy array, a PyTorch tensor or a number."""
    if isinstance(array, np.ndarray | np.generic | float | int):
        return _NUMPY
    if not _TORCH:
        _TORCH.append(_Torch())
    return _TORCH[0]
