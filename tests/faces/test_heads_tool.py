"""The shipped arrays of the embedded heads are what ``tools/heads`` sculpts."""

from pathlib import Path

import numpy as np
import pytest

from glsim.faces import procedural
from glsim.faces.procedural.model import HEADS_FILE

pytestmark = pytest.mark.long


def test_the_shipped_heads_are_those_that_the_tool_sculpts() -> None:
    """Floats to 0.001 mm, whole numbers exactly: exponentials differ by processor."""
    from tools.heads.bake import sculpt  # type: ignore[import-not-found]

    new = sculpt()
    with np.load(Path(procedural.__path__[0]) / HEADS_FILE) as stored:
        assert set(stored.files) == set(new)
        for name, array in new.items():
            shipped = stored[name]
            assert (shipped.dtype, shipped.shape) == (array.dtype, array.shape), name
            if array.dtype.kind == "f":
                np.testing.assert_allclose(shipped, array, rtol=0, atol=1e-3, err_msg=name)
            else:
                np.testing.assert_array_equal(shipped, array, err_msg=name)
