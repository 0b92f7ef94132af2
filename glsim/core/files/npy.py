"""NPY files: plain real numbers of others, mapped from the disk, and our own."""

from __future__ import annotations

import errno
import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.files.regular import open_regular


def map_npy(file: Path) -> NDArray[Any]:
    """Map an array of real numbers of any shape and type from the disk; no memory is taken.

    It is read-only. Raises OSError, whose ``strerror`` says why, for what is no such array.
    """
    open_regular(file).close()  # a pipe would wait for a writer for ever
    try:
        mapped: NDArray[Any] = np.load(file, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # NumPy parses the header as Python, with all its errors
        why = " ".join(str(error).split())[:200]
        raise OSError(errno.EINVAL, f"is no whole .npy file: {why}") from None
    if not isinstance(mapped, np.ndarray) or mapped.dtype.kind not in "fiub":
        raise OSError(errno.EINVAL, "its values are no plain real numbers")
    return np.asarray(mapped)


def encode_npy(array: NDArray[Any]) -> bytes:
    """Return an NPY file."""
    data = io.BytesIO()
    np.save(data, np.asarray(array, order="C"), allow_pickle=False)  # keeps () of a text
    return data.getvalue()
