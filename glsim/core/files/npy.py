"""NPY files: map arrays of real numbers from the disk, and encode arrays."""

from __future__ import annotations

import errno
import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.files.regular import open_regular


def map_npy(file: Path) -> NDArray[Any]:
    """Map an array of real numbers of any shape and type from the disk, without copying it.

    The array is read-only. Raises OSError, whose ``strerror`` gives the reason, for other files.
    """
    open_regular(file).close()  # a pipe would wait for a writer for ever
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about headers of Python 2
            mapped: NDArray[Any] = np.load(file, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # NumPy evaluates the header as Python, which can raise any error
        why = " ".join(str(error).split())[:200]
        raise OSError(errno.EINVAL, f"is no whole .npy file: {why}") from None
    if not isinstance(mapped, np.ndarray) or mapped.dtype.kind not in "fiub":
        raise OSError(errno.EINVAL, "its values are no plain real numbers")
    return np.asarray(mapped)


def encode_npy(array: NDArray[Any]) -> bytes:
    """Encode an array as an NPY file, and return its bytes."""
    data = io.BytesIO()
    np.save(data, np.asarray(array, order="C"), allow_pickle=False)  # keeps a shape of ()
    return data.getvalue()
