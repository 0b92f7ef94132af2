"""Read .npy files that others made: plain numbers, no larger in memory than on the disk.

numpy's own reader evaluates the header as Python and believes its shape. Here the header's three
entries are matched as text, and the shape must be that of the file's bytes. The format:
numpy.lib.format, versions 1 to 3.
"""

from __future__ import annotations

import errno
import math
import os
import re
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
from numpy.typing import NDArray

from glsim.files.regular import open_regular

_MAGIC = b"\x93NUMPY"
#: Longest header, characters, that is read; numpy pads those of a few numbers to 128.
_MAX_HEADER = 4096
_ENTRIES = tuple(
    re.compile(pattern, re.ASCII)
    for pattern in (
        r"""['"]descr['"]\s*:\s*['"]([<>|=]?[fiub]\d{1,2})['"]""",
        r"""['"]fortran_order['"]\s*:\s*(True|False)\b""",
        r"""['"]shape['"]\s*:\s*\(\s*((?:\d{1,15}L?\s*,\s*){0,8}(?:\d{1,15}L?\s*)?)\)""",
    )
)


def map_npy(file: Path) -> NDArray[Any]:
    """Map an array of real numbers from the disk, read-only: no memory is taken.

    Args:
        file: a .npy file.

    Returns:
        The array, of any shape and any type of real numbers; check both before it is copied.

    Raises:
        OSError: there is no such file, or it is no such array; ``strerror`` says why.
    """
    with open_regular(file) as opened:
        dtype, fortran, shape = _read_header(opened)
        start = opened.tell()
        size, expected = os.fstat(opened.fileno()).st_size - start, math.prod(shape)
        expected *= dtype.itemsize
        if size != expected:
            raise _damaged(f"has {size} bytes of numbers; {dtype} {shape} are {expected}")
        order: Literal["F", "C"] = "F" if fortran else "C"
        if not expected:  # nothing can be mapped
            return np.zeros(shape, dtype, order)
        handle: Any = opened  # NumPy's stubs want writable ones
        mapped: Any = np.memmap(handle, dtype, "r", start, shape, order)
        return np.asarray(mapped.view(np.ndarray))


def _read_header(opened: IO[bytes]) -> tuple[np.dtype[Any], bool, tuple[int, ...]]:
    """Return type, Fortran order and shape; the file is then at its first number."""
    start = opened.read(len(_MAGIC) + 2)
    if start[: len(_MAGIC)] != _MAGIC or start[len(_MAGIC) :] not in (b"\1\0", b"\2\0", b"\3\0"):
        raise _damaged("does not begin as a .npy file of version 1, 2 or 3")
    length = int.from_bytes(opened.read(2 if start[-2] == 1 else 4), "little")
    if length > _MAX_HEADER:
        raise _damaged(f"its header has {length} bytes, more than {_MAX_HEADER}")
    header = opened.read(length)
    found = [entry.findall(header.decode("latin-1")) for entry in _ENTRIES]
    if len(header) < length or any(len(values) != 1 for values in found):
        raise _damaged("its header is damaged, or its values are no plain real numbers")
    (kind,), (fortran,), (shape,) = found
    try:
        dtype = np.dtype(kind)
    except TypeError:
        raise _damaged(f"has no numbers of type {kind}") from None
    return dtype, fortran == "True", tuple(int(side) for side in re.findall(r"\d+", shape))


def _damaged(reason: str) -> OSError:
    return OSError(errno.EINVAL, reason)
