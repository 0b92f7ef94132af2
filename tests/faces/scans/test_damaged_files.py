"""Damaged files are read or skipped with a reason; ``benchmarks.stress mutate``: more."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as quick
from hypothesis import strategies as st

from tests.support.mutations import Format, formats, mutate

NAMES = ("d3dfacs.ply", "d3dfacs-ascii.ply", "d3dfacs.obj", "shape.bs", "shape_0.obj",
         "pose_1.obj", "biwi.obj", "pose.txt", "depth.bin", "depth.cal")  # fmt: skip


@pytest.fixture(scope="module")
def all_formats(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Format]:
    found = formats(tmp_path_factory.mktemp("damage"))
    assert tuple(found) == NAMES
    return found


@pytest.mark.parametrize("name", NAMES)
def test_whole_files_are_used_and_200_damaged_ones_do_no_harm(
    all_formats: dict[str, Format], name: str
) -> None:
    whole = all_formats[name]
    assert whole.outcome(whole.data) is None
    skipped = 0
    for number in range(200):
        rng = np.random.default_rng([1, number])
        reason = whole.outcome(mutate(whole.data, rng), afresh=number % 20 == 0)
        assert reason is None or ("\n" not in reason and reason)
        skipped += reason is not None
    assert skipped > 20


@quick(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(name=st.sampled_from(NAMES), at=st.floats(0, 1), extra=st.binary(max_size=12))
def test_truncation_at_any_byte_does_no_harm(
    all_formats: dict[str, Format], name: str, at: float, extra: bytes
) -> None:
    whole = all_formats[name]
    data = whole.data[: int(at * len(whole.data))] + extra
    reason = whole.outcome(data, afresh=False)
    assert reason is None or "\n" not in reason
