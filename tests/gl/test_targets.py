"""Render targets: reused, zero outside their window, given back when a scope is left."""

import contextlib

import numpy as np
import pytest
from moderngl import Context

from glsim.core.rect import Rect
from glsim.gl.declarations import Layer
from glsim.gl.targets import Readback, TargetPool

WHOLE = Rect(0, 0, 8, 6)
DEPTH, PAIR = Layer("depth", "float"), Layer("pair", "vec2")


@pytest.fixture
def pool(context: Context) -> TargetPool:
    return TargetPool(context, WHOLE.width, WHOLE.height)


def test_a_scope_gives_back_what_it_holds_also_after_an_error(pool: TargetPool) -> None:
    with pool.scope() as held:
        held += [pool.take(DEPTH, WHOLE), pool.take(DEPTH, WHOLE), pool.take(PAIR, WHOLE)]
        first = list(held)
        assert pool.take(DEPTH, WHOLE) not in first
    with contextlib.suppress(ValueError), pool.scope() as held:
        held += [pool.take(DEPTH, WHOLE), pool.take(DEPTH, WHOLE), pool.take(PAIR, WHOLE)]
        assert held == first  # the same targets in the same order
        raise ValueError
    assert pool.take(DEPTH, WHOLE) is first[0]


def test_a_target_holds_nothing_of_an_earlier_window(context: Context, pool: TargetPool) -> None:
    target = pool.upload(DEPTH, np.ones((WHOLE.height, WHOLE.width), np.float32))
    pool.give_back(target)
    small = Rect(2, 1, 3, 2)
    again = pool.take(DEPTH, small)
    assert again is target
    readback = Readback(context)
    readback.request(pool, {"depth": again}, WHOLE)
    assert not readback.arrays()["depth"].any()
    assert again.drawn == small
