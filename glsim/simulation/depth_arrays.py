"""Depth arrays of other programs, NumPy or PyTorch: their maps, and an array for the results.

PyTorch is not imported: its tensors are known by their type's module and used by their methods.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError

#: The floating types that both NumPy and PyTorch have, by name.
_FLOATS = ("float16", "float32", "float64")


@dataclass(frozen=True, eq=False)
class DepthBatch:
    """Depth maps in a given array, and a new array of the same kind for the results.

    maps: (B, H, W) view of the given array; a copy only of a tensor on a GPU and of an array
        whose rows are not contiguous. results: (B, H, W) view of the array to return, unset.
    """

    maps: NDArray[np.floating[Any]]
    results: NDArray[np.floating[Any]]
    _answer: Any
    _device: Any = None

    def answer(self) -> Any:
        """Return the results in the form of the input: type, shape, number type and device."""
        return self._answer if self._device is None else self._answer.to(self._device)


def depth_batch(depth: Any, shape: tuple[int, int]) -> DepthBatch:
    """View an array or tensor of floating depth as maps of ``shape`` (height, width).

    Raises ConfigError for whole numbers, for another size and for what is no array.

    Args:
        depth: (H, W), (B, H, W), more leading axes, and any of them with a last axis of length 1.
    """
    kind = str(getattr(depth, "dtype", type(depth).__name__)).removeprefix("torch.")
    if kind not in _FLOATS or not hasattr(depth, "shape"):
        raise ConfigError(
            f"depth must be an array or a tensor of float metres ({', '.join(_FLOATS)}), "
            f"not {kind}: "
            "of whole millimetres give depth.astype('float32') / 1000"
        )
    full = tuple(int(side) for side in depth.shape)
    if full[-2:] != shape and full[-3:] != (*shape, 1):
        raise ConfigError(
            f"depth has the shape {full}: the camera has {shape[1]}x{shape[0]} pixels, so it must "
            f"be {shape}, (batch, {shape[0]}, {shape[1]}), or one of them with a last axis of 1"
        )
    stack = (-1, *shape)
    if type(depth).__module__.partition(".")[0] != "torch":
        array = np.asarray(depth)
        answer = np.empty(full, array.dtype)
        return DepthBatch(array.reshape(stack), answer.reshape(stack), answer)
    tensor = depth.detach()
    host = tensor.cpu()
    answer = host.new_empty(full)
    device = None if host is tensor or tensor.device == host.device else tensor.device
    return DepthBatch(host.numpy().reshape(stack), answer.numpy().reshape(stack), answer, device)


def refuse_millimetres(depth: NDArray[np.floating[Any]], near_m: float, far_m: float) -> None:
    """Raise ConfigError if all surfaces of some maps have a depth that makes sense in millimetres.

    In metres they would be beyond the sensor's far plane, and the result empty without a word. A
    background at one distance is none: simulators put their far plane there.

    Args:
        depth: of any shape.
        near_m, far_m: the sensor's clip planes.
    """
    seen = depth[(depth > 0) & (depth < np.inf)]
    if not seen.size:
        return
    nearest, farthest = float(seen.min()), float(seen.max())
    in_mm = 1000.0 * near_m <= nearest and float(np.median(seen)) <= 1000.0 * far_m
    if far_m < nearest < farthest and in_mm:
        raise ConfigError(
            f"depth is {nearest:g} to {farthest:g}: this is millimetres, and metres are wanted: "
            "give depth / 1000"
        )


def surface_depth(depth: NDArray[np.floating[Any]], far_m: float) -> NDArray[np.float32]:
    """Return depth as float32 metres with 0 where there is no surface.

    No surface is: NaN, infinity, zero, negative values and all beyond ``far_m``. Simulators use
    any of these for the empty background. Memory is shared where nothing has to be changed.
    """
    seen = (depth > 0) & (depth <= far_m)  # NaN compares as False
    if seen.all() and depth.dtype == np.float32:
        return np.ascontiguousarray(depth, np.float32)
    return np.where(seen, depth, 0).astype(np.float32)
