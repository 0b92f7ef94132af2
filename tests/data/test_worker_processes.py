"""Test the number of worker processes that ``--workers`` asks for."""

from __future__ import annotations

import pytest

from glsim.core.errors import ConfigError
from glsim.data.worker_processes import available_workers, worker_count


def test_the_option_workers_is_a_number_or_auto() -> None:
    assert worker_count("3") == 3
    assert worker_count("auto") == available_workers() >= 1


@pytest.mark.parametrize("text", ["0", "-1", "none", "1.5", ""])
def test_other_values_are_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=f"^--workers {text}: give a number of at least 1, or a"):
        worker_count(text)
