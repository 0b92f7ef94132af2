"""Tests of the units of depth, and that no other module converts by a number of its own."""

import ast
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glsim.core.errors import ConfigError
from glsim.core.units import from_steps, to_metres, to_mm, to_steps
from tests.support.imports import all_modules

#: Modules that may write the number: one place for each unit. The noise stages compute in the
#: units of their GLSL, word by word.
MAY = ("glsim.core.units", "glsim.core.depth_frame", "glsim.noise")


@given(st.floats(0, 65, width=32), st.sampled_from([1.0, 2.5, 10.0]))
def test_depths_are_rounded_to_steps_and_nothing_else_becomes_nothing(
    depth_m: float, step_mm: float
) -> None:
    steps = to_steps(np.array([depth_m, 0], np.float32), step_mm)
    assert steps.dtype == np.uint16
    assert steps[1] == 0
    assert (steps[0] == 0) == (depth_m == 0)
    back = to_metres(from_steps(steps, step_mm))
    assert back.dtype == np.float32
    least = step_mm / 1000 if 0 < depth_m < step_mm / 2000 else depth_m
    # Half a step, and the rounding of float32 on the way there and back.
    assert abs(float(back[0]) - least) <= 0.5 * step_mm / 1000 + 1.5e-7 * depth_m + 1e-9
    np.testing.assert_array_equal(to_steps(back, step_mm), steps)


@pytest.mark.parametrize(("step_mm", "largest_m"), [(1.0, 65.535), (0.1, 6.5535)])
def test_what_does_not_fit_sixteen_bits_is_an_error(step_mm: float, largest_m: float) -> None:
    assert to_steps(np.array([largest_m], np.float32), step_mm)[0] == 65535
    beyond = np.array([largest_m + 0.001], np.float32)
    with pytest.raises(ConfigError, match=r"does not fit 16 bits in steps of .* larger output"):
        to_steps(beyond, step_mm)


def test_an_offset_is_added_where_there_is_depth() -> None:
    depth_mm = from_steps(np.array([0, 10], np.uint16), 0.1, 899.0)
    np.testing.assert_array_equal(depth_mm, np.float32([0, 900]))
    np.testing.assert_array_equal(to_mm(np.float32([0, 0.9])), np.float32([0, 900]))


def conversions(source: str) -> Iterator[str]:
    """The products and quotients of a source file with a literal 1000 or 0.001, but for times."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
            sides = [ast.unparse(side) for side in (node.left, node.right)]
            literal = [side.removeprefix("np.float32(").rstrip(")") for side in sides]
            text = ast.unparse(node)
            is_time = any(word in text for word in ("perf_counter", "seconds", "time_ms"))
            if {"1000", "1000.0", "0.001"} & {*literal} and not is_time:
                yield text


@pytest.mark.parametrize("text", ["d * 1000", "1e3 * d", "d / np.float32(1000)", "0.001 * d_mm"])
def test_a_conversion_by_a_literal_is_found(text: str) -> None:
    assert list(conversions(f"x = {text}"))
    assert not list(conversions("x = 1000 * (time.perf_counter() - start); y = range(1000)"))


@pytest.mark.parametrize("module", sorted(all_modules()))
def test_only_the_units_module_converts_depth_by_a_literal(module: str) -> None:
    file: Path = all_modules()[module]
    if not module.startswith(MAY):
        assert list(conversions(file.read_text(encoding="utf-8"))) == []
