"""Lines of a file, however long they are."""

from __future__ import annotations

import io

import pytest

from glsim.files.lines import bounded_lines


@pytest.mark.parametrize("end", [b"", b"\n"])
def test_a_long_line_is_cut_and_the_next_ones_are_whole(end: bytes) -> None:
    lines = [b"a" * 10 + b"\n", b"b" * 11 + b"\n", b"\n", b"c" * 1000 + b"\n", b"d" + end]
    found = list(bounded_lines(io.BytesIO(b"".join(lines)), 11))
    assert found == [lines[0], lines[1], lines[2], b"c" * 12, b"d" + end]
