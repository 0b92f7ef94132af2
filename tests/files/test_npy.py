"""Arrays of .npy files: those that numpy writes are read, damaged and dishonest ones refused."""

from __future__ import annotations

import struct
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.errors import ConfigError, DatasetError
from glsim.files.npy import map_npy
from glsim.recordings.files import open_stack
from glsim.recordings.recording import open_recording
from glsim.sensors.pattern_map import read_pattern_map


def with_header(file: Path, text: str, size: int = 128, version: bytes = b"\1\0") -> Path:
    """Write a header, padded as numpy pads it, and make the file ``size`` bytes of numbers."""
    header = text.encode() + b" " * (117 - len(text)) + b"\n"
    file.write_bytes(b"\x93NUMPY" + version + struct.pack("<H", len(header)) + header)
    with file.open("r+b") as opened:
        opened.truncate(opened.seek(0, 2) + size)
    return file


@pytest.mark.parametrize(
    "values",
    [
        np.arange(24, dtype=np.uint16).reshape(2, 3, 4),
        np.asfortranarray(np.arange(12, dtype=">f8").reshape(3, 4)),
        np.float32(3),
        np.zeros((0, 4, 4), np.float16),
        np.ones((5,), bool),
    ],
)
def test_what_numpy_writes_is_read(tmp_path: Path, values: NDArray[np.generic]) -> None:
    np.save(tmp_path / "a.npy", values)
    found = map_npy(tmp_path / "a.npy")
    assert found.dtype == values.dtype
    np.testing.assert_array_equal(found, values)


@pytest.mark.parametrize(
    ("header", "problem"),
    [
        ("{'descr': '<u2', 'fortran_order': False, 'shape': (4, 4, 4), ", None),
        ("{'descr': '<u2', 'fortran_order': False, 'shape': (4, 4, 4", "header is damaged"),
        ("{'descr': '<u2', 'fortran_order': False, 'shape': (-4, -4, 4), }", "header is damaged"),
        ("{'descr': '<u2', 'fortran_order': False, 'shape': (9, 4, 4), }", "are 288"),
        ("{'descr': '<u2', 'fortran_order': False, 'shape': (4, 4), }", "has 128 bytes of numbers"),
        ("{'descr': '<u2', 'fortran_order': False, 'shape': (" + "9" * 40 + ",), }", "damaged"),
        ("{'descr': '<u7', 'fortran_order': False, 'shape': (4,), }", "no numbers of type <u7"),
        ("{'descr': '|O', 'fortran_order': False, 'shape': (4,), }", "no plain real numbers"),
        ("{'descr': [('a', '<u2')], 'fortran_order': False, 'shape': (4,), }", "no plain"),
        ("(" * 110, "header is damaged"),
        ("'''", "header is damaged"),
    ],
)
def test_damaged_headers_are_refused(tmp_path: Path, header: str, problem: str | None) -> None:
    file = with_header(tmp_path / "a.npy", header)
    if problem is None:  # what is behind the three entries does not matter
        assert map_npy(file).shape == (4, 4, 4)
        return
    with pytest.raises(OSError, match=problem) as caught:
        map_npy(file)
    assert "\n" not in str(caught.value)


def test_other_files_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.npy"
    with file.open("wb") as opened:
        np.savez(opened, a=np.zeros(3))
    for place, problem in ((file, "does not begin"), (Path("/dev/zero"), "a device")):
        with pytest.raises(OSError, match=problem):
            map_npy(place)
    good = "{'descr': '<u2', 'fortran_order': False, 'shape': (64,), }"
    for version in (b"\0\0", b"\4\0", b"\1\7"):
        with pytest.raises(OSError, match="version"):
            map_npy(with_header(file, good, version=version))
    file.write_bytes(b"\x93NUMPY\2\0" + struct.pack("<I", 2**31))
    with pytest.raises(OSError, match="its header has 2147483648 bytes"):
        map_npy(file)


def test_files_of_holes_take_neither_time_nor_memory(tmp_path: Path) -> None:
    started = time.process_time()
    text = "{'descr': '<u2', 'fortran_order': False, 'shape': (20000000, 1, 1), }"
    stack = with_header(tmp_path / "stack.npy", text, 40_000_000)
    assert len(open_stack(stack)) == 20_000_000
    with pytest.raises(DatasetError, match="more than 250000 frames"):
        open_recording(tmp_path)
    text = "{'descr': '<f4', 'fortran_order': False, 'shape': (31250, 31250), }"
    sparse = with_header(tmp_path / "map.npy", text, 4 * 31_250**2)
    with pytest.raises(ConfigError, match="the map of the fixed pattern is 31250x31250"):
        read_pattern_map(sparse, (424, 512))
    assert time.process_time() - started < 1
