"""What a reader of tables meets: plain numbers, no -0."""

from __future__ import annotations

import pytest

from glsim.eval.report.score_tables import format_number


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(-0.4, "px", "-0.40"), (-0.001, "mm", "0.00"), (-0.00001, "1", "-0.0000"), (0.0, "mm", "0"),
     (-12.3, "mm", "-12.30"), (1234.5, "mm", "1234"), (123.45, "mm", "123.5"),
     (float("nan"), "mm", "n/a"), (0.99123, "1", "0.9912")],
)  # fmt: skip
def test_numbers_have_digits_that_mean_something_and_none_is_minus_nothing(
    value: float, unit: str, text: str
) -> None:
    assert format_number(value, unit) == text.replace("-0.0000", "0.0000")
