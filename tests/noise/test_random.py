"""Random numbers and fields: twin against GLSL, statistics, continuity, change with time."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from glsim.core.rect import Rect
from glsim.gl.declarations import Layer
from glsim.gl.program import link
from glsim.gl.shader_source import load_source
from glsim.gl.targets import TargetPool
from glsim.noise.twins import values as fields
from glsim.noise.twins.layers import normal_pair, random_bits, uniform01
from tests.support.stage_harness import Z_MAX, Image, z_correlation, z_mean, z_rate, z_sd

SHADER = """#version 330 core
// bits: the words of random_bits, in halves that a float holds, and the numbers made of them.
#include "lib/random.glsl"
uniform ivec2 u_offset;
uniform uint u_seed;
uniform uint u_draw;
uniform bool u_ramp;
out vec4 high;
out vec4 low;
out vec4 numbers;
void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    uvec4 bits = random_bits(pixel + u_offset, u_seed, u_draw);
    if (u_ramp) { // the smallest numbers in row 0, the largest in row 1
        uint first = uint(pixel.x) << 9u;
        bits.xy = uvec2(pixel.y == 0 ? first : 0xffffffffu - first, bits.y);
    }
    high = vec4(bits >> 16u);
    low = vec4(bits & 0xffffu);
    numbers = vec4(uniform01(bits.x), uniform01(bits.y), normal_pair(bits.xy));
}
"""
Draw = Callable[..., tuple[NDArray[np.uint32], NDArray[np.float32]]]

SIZE = Rect(0, 0, 512, 32)
X, Y = np.arange(512)[None, :], np.arange(424)[:, None]
SEED = 0xC0FFEE


@pytest.fixture
def draw(context: moderngl.Context, tmp_path_factory: pytest.TempPathFactory) -> Draw:
    file: Path = tmp_path_factory.mktemp("hash") / "bits.glsl"
    file.write_text(SHADER)
    program = link(context, load_source(file))
    array = context.vertex_array(program, [])
    pool = TargetPool(context, SIZE.width, SIZE.height)
    targets = [pool.take(Layer(name, "vec4"), SIZE) for name in ("high", "low", "numbers")]

    def run(**uniforms: Any) -> tuple[NDArray[np.uint32], NDArray[np.float32]]:
        for name, value in {"u_ramp": False, **uniforms}.items():
            program[name] = value
        context.enable_only(moderngl.NOTHING)
        buffer = pool.framebuffer(targets)
        buffer.use()
        buffer.viewport = SIZE
        array.render(moderngl.TRIANGLES, vertices=3)
        high, low, numbers = (
            np.frombuffer(target.texture.read(), np.float32).reshape(SIZE.height, SIZE.width, 4)
            for target in targets
        )
        bits: NDArray[np.uint32] = high.astype(np.uint32) * np.uint32(65536) + low.astype(np.uint32)
        return bits, numbers

    return run


@pytest.mark.parametrize("offset", [(0, 0), (-300, -20), (2**31 - 600, -(2**31)), (65500, 3)])
@pytest.mark.parametrize(("seed", "number"), [(0, 0), (1, 1), (2**32 - 1, 2), (SEED, 0xF1E1D)])
def test_twin_gives_the_bits_of_the_shader(
    draw: Draw, offset: tuple[int, int], seed: int, number: int
) -> None:
    bits, numbers = draw(u_offset=offset, u_seed=seed, u_draw=number)
    x, y = offset[0] + X, offset[1] + Y[: SIZE.height]
    twin = random_bits(x, y, seed, number)
    np.testing.assert_array_equal(bits, np.stack(twin, axis=-1))
    np.testing.assert_array_equal(numbers[..., 0], uniform01(twin[0]))
    np.testing.assert_array_equal(numbers[..., 1], uniform01(twin[1]))
    # A driver's log is less exact near 1, that is, for normal numbers near 0.
    off = np.abs(numbers[..., 2:] - np.stack(normal_pair(twin[0], twin[1]), axis=-1))
    assert off.max() < 1e-3
    assert np.quantile(off, 0.999) < 1e-5


def test_uniform() -> None:
    for word in random_bits(X, Y, SEED, 0):
        for shift in (0, 8, 16, 24):
            counts = np.bincount(((word >> shift) & 255).ravel(), minlength=256)
            chi = ((counts - word.size / 256) ** 2).sum() / (word.size / 256)
            assert abs(chi - 255) / np.sqrt(2 * 255) < Z_MAX
        for bit in range(32):
            assert abs(z_rate((word >> bit) & 1 == 1, 0.5)) < Z_MAX


@pytest.mark.parametrize("lag", [(0, 1), (1, 0), (1, 1), (1, -1), (0, 64), (64, 0)])
def test_neighbours_are_independent(lag: tuple[int, int]) -> None:
    for word in random_bits(X, Y, SEED, 0):
        u = uniform01(word)
        shifted = np.roll(u, lag, axis=(0, 1))
        assert abs(z_correlation(u, shifted)) < Z_MAX
        assert abs(z_correlation((u - 0.5) ** 2, (shifted - 0.5) ** 2)) < Z_MAX


def test_seeds_draws_and_words_are_independent() -> None:
    first = [uniform01(word) for word in random_bits(X, Y, SEED, 0)]
    for other in ((SEED, 0), (SEED + 1, 0), (SEED ^ 2**28, 0), (SEED, 1), (SEED + 1, 1)):
        second = [uniform01(word) for word in random_bits(X, Y, *other)]
        for i, j in np.ndindex(4, 4):
            if i != j or other != (SEED, 0):
                assert abs(z_correlation(first[i], second[j])) < Z_MAX


def test_normal_pair() -> None:
    first, second, _, _ = random_bits(X, Y, SEED, 0)
    a, b = (part.astype(np.float64) for part in normal_pair(first, second))
    n = a.size
    for part in (a, b):
        assert abs(z_mean(part)) < Z_MAX
        assert abs(z_sd(part, 1.0)) < Z_MAX
        assert abs(stats.skew(part, axis=None)) / np.sqrt(6 / n) < Z_MAX
        assert abs(stats.kurtosis(part, axis=None)) / np.sqrt(24 / n) < Z_MAX
        assert stats.kstest(part.ravel(), "norm").pvalue > 1e-5
        for limit in (2.0, 3.0, 4.0):
            assert abs(z_rate(np.abs(part) > limit, 2 * stats.norm.sf(limit))) < Z_MAX
    assert abs(z_correlation(a, b)) < Z_MAX
    assert abs(z_correlation(a**2, b**2)) < Z_MAX


Field = Callable[[fields.Vector, int], Image]

FIELDS = {"perlin": fields.perlin_at, "simplex": fields.simplex_at}


@pytest.fixture(params=FIELDS, name="field")
def _field(request: pytest.FixtureRequest) -> Field:
    return FIELDS[str(request.param)]


def points() -> fields.Vector:
    """Random points, so far apart that hardly two share a cell."""
    x, y, z = np.random.default_rng(0).uniform(-300, 300, (3, 200_000)).astype(np.float32)
    return x, y, z


def moved(at: fields.Vector, by: NDArray[np.floating] | list[float]) -> fields.Vector:
    x, y, z = (part + np.float32(step) for part, step in zip(at, by, strict=True))
    return x, y, z


def test_range_and_mean(field: Field) -> None:
    values = field(points(), 1)
    assert 0.8 < np.abs(values).max() <= 1.0
    assert abs(z_mean(values)) < Z_MAX
    assert abs(z_mean(values**3)) < Z_MAX  # symmetric about 0


@pytest.mark.parametrize("other", [0, 2, 3, 1 + 2**16])
def test_seeds_are_independent(field: Field, other: int) -> None:
    """Octaves take consecutive seeds, so these matter most."""
    assert abs(z_correlation(field(points(), 1), field(points(), other))) < Z_MAX


def test_continuous(field: Field) -> None:
    """No steps along any axis: the change is bounded by slope times distance."""
    at, step = points(), 1e-3
    for axis in np.eye(3):
        change = np.abs(field(moved(at, step * axis), 1) - field(at, 1))
        assert change.max() < 8.0 * step + 1e-4  # float32 coordinates are 3e-5 apart here
