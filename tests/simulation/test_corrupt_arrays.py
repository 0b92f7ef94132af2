"""Noise on float depth of other simulators: NumPy and PyTorch, batches, any camera, recipes."""

import multiprocessing
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim import DepthNoise, GlsimError, load_settings
from glsim.core.errors import ConfigError
from glsim.simulation.corrupt import depth_batch
from tests.support.scenes import Plane, face_mesh

CAMERA: dict[str, Any] = {"width": 96, "height": 72, "fx": 90.0, "fy": 91.0, "cx": 48.0, "cy": 36.0}


def corrupter(
    sensor: str = "kinect-v2-fankhauser",
    backend: str | None = "numpy",
    camera: Mapping[str, Any] = CAMERA,
) -> DepthNoise:
    return DepthNoise.for_camera(sensor, **camera, first_pixel=0.5, backend=backend)


def maps(count: int = 3) -> NDArray[np.float32]:
    """Tilted walls of different distances with an empty corner."""
    with corrupter() as one:
        rays = one.rig().rays()
    depth = np.stack([Plane(0.9 + 0.1 * n, 10 * n, 40).depth(rays) for n in range(count)])
    depth[:, :10, :10] = 0
    return depth.astype(np.float32)


@pytest.mark.parametrize("backend", [None, "numpy"])
def test_a_map_has_the_same_noise_alone_and_in_a_batch(backend: str | None) -> None:
    clean = maps()
    with corrupter(backend=backend) as corrupt:
        together = corrupt(clean, frame=5)
        alone = [corrupt(clean[n], frame=5 + n) for n in range(3)]
        other = corrupt(clean, frame=6)
        elsewhere = corrupt(clean, frame=5, sequence="b")
    assert together.shape == clean.shape
    assert together.dtype == np.float32
    np.testing.assert_array_equal(together, np.stack(alone))
    assert (other != together).mean() > 0.3
    assert (elsewhere != together).mean() > 0.3
    seen = (together > 0) & (clean > 0)
    assert seen.mean() > 0.8
    assert 0.3 < np.abs(1000 * (together - clean))[seen].mean() < 10  # mm, Fankhauser's sigma
    assert not together[:, :8, :8].any()


def test_the_types_and_shapes_of_simulators_come_back() -> None:
    clean = maps(2)
    with corrupter() as corrupt:
        expected = corrupt(clean, frame=0)
        for given in (clean[..., None], clean[:, None], clean[None, :, :, :, None]):
            found = corrupt(given, frame=0)
            assert found.shape == given.shape
            np.testing.assert_array_equal(found.reshape(clean.shape), expected)
        doubles = corrupt(clean.astype(np.float64), frame=0)
        assert doubles.dtype == np.float64
        np.testing.assert_array_equal(doubles, expected)
        turned = np.ascontiguousarray(clean[:, ::-1])[:, ::-1]  # rows from below, as GL gives them
        np.testing.assert_array_equal(corrupt(turned, frame=0), expected)
        halves = corrupt(clean.astype(np.float16))
        assert halves.dtype == np.float16


def test_tensors_are_not_copied_and_not_changed() -> None:
    torch = pytest.importorskip("torch")
    clean = maps(2)
    tensor = torch.from_numpy(clean.copy()).requires_grad_()
    given, results, answer = depth_batch(tensor, (72, 96))
    assert given.ctypes.data == tensor.data_ptr()
    assert results.ctypes.data == answer().data_ptr()
    with corrupter() as corrupt:
        noisy = corrupt(tensor, frame=0)
        np.testing.assert_array_equal(noisy.numpy(), corrupt(clean, frame=0))
    assert isinstance(noisy, torch.Tensor)
    assert noisy.dtype == torch.float32
    assert not noisy.requires_grad
    np.testing.assert_array_equal(tensor.detach().numpy(), clean)
    assert np.shares_memory(depth_batch(clean, (72, 96))[0], clean)


@pytest.mark.parametrize("empty", [np.nan, np.inf, -np.inf, 1e10, -1.0, 65.535, 0.0])
def test_what_simulators_call_background_is_no_surface(empty: float) -> None:
    clean = maps(1)[0]
    given = np.where(clean > 0, clean, np.float32(empty))
    with corrupter("kinect-v2-paper") as corrupt:
        np.testing.assert_array_equal(corrupt(given, frame=0), corrupt(clean, frame=0))


def test_principal_points_of_both_conventions_are_one_camera() -> None:
    with corrupter() as ours:
        centred = {**CAMERA, "cx": 47.5, "cy": 35.5}
        with DepthNoise.for_camera(
            "kinect-v2-fankhauser", **centred, first_pixel=0, backend="numpy"
        ) as theirs:
            assert ours.rig() == theirs.rig()
            np.testing.assert_array_equal(ours(maps(), frame=0), theirs(maps(), frame=0))


def test_draws_per_sequence_are_held_within_it() -> None:
    stage = {"axial": {"base_sigma_mm": {"uniform": [0.5, 2.0], "per": "sequence"}}}
    settings = load_settings(overrides={"sensor": "kinect-v2-fankhauser", "stage": stage})
    with DepthNoise.for_camera(settings, **CAMERA, first_pixel=0.5, backend="numpy") as corrupt:
        (clean,) = maps(1)
        frames = [corrupt.corrupt_depth(clean, frame=n, sequence=s) for s in "ab" for n in (0, 1)]
    drawn = [frame.parameters["axial.base_sigma_mm"] for frame in frames]
    assert drawn[0] == drawn[1] != drawn[2] == drawn[3]


@pytest.mark.parametrize(
    ("depth", "message"),
    [
        (np.zeros((72, 96), np.uint16), r"float metres .* not uint16"),
        ([[1.0]], r"an array or a tensor of float metres .* not list"),
        (np.zeros((96, 72), np.float32), r"shape \(96, 72\): the camera has 96x72 pixels"),
        (np.zeros((72, 96, 3), np.float32), r"shape \(72, 96, 3\)"),
    ],
)
def test_what_is_no_depth_is_named(depth: Any, message: str) -> None:
    with corrupter() as corrupt, pytest.raises(ConfigError, match=message):
        corrupt(depth, frame=0)


@pytest.mark.parametrize(("key", "px"), [("first_pixel", 1), ("fy", -9), ("width", 0), ("fx", 3)])
def test_what_is_no_camera_is_named(key: str, px: float) -> None:
    camera: dict[str, Any] = {**CAMERA, "first_pixel": 0.5, key: px}
    with pytest.raises(GlsimError, match=f"{px:g}"):
        DepthNoise.for_camera("ideal", **camera, backend="numpy")


@pytest.mark.long
def test_depth_that_open3d_made_comes_back_with_noise() -> None:
    """Open3D's rays pass through pixel centres at 0.5 too, unlike its point clouds."""
    o3d = pytest.importorskip("open3d")
    mesh, portrait = face_mesh(60), {**CAMERA, "fx": 200.0, "fy": 202.0}  # fills a sixth
    points = mesh.vertices_mm * np.array([0.001, -0.001, -0.001]) + np.array([0, 0, 0.9])
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(points.astype(np.float32), np.asarray(mesh.faces).astype(np.uint32))
    k = [[200.0, 0, 48.0], [0, 202.0, 36.0], [0, 0, 1]]
    rays = scene.create_rays_pinhole(
        o3d.core.Tensor(k), o3d.core.Tensor(np.eye(4)), width_px=96, height_px=72
    )
    depth = scene.cast_rays(rays)["t_hit"].numpy()  # inf where nothing was hit
    seen = np.isfinite(depth)
    assert 0.1 < seen.mean() < 1
    assert abs(depth[seen].min() - 0.853) < 0.003  # the tip of the nose, 47 mm before 0.9 m
    with corrupter(backend=None, camera=portrait) as corrupt:
        noisy = corrupt(depth, frame=0)
    both = seen & (noisy > 0)
    assert both.sum() > 0.8 * seen.sum()
    error_mm = 1000 * (noisy[both] - depth[both])
    assert abs(np.median(error_mm)) < 1.0
    assert 0.3 < np.median(np.abs(error_mm)) < 6.0


#: Forks before the sensor's shaders were ever compiled; argument: the sensor that the parent uses.
_FORKS = """
import multiprocessing, sys, numpy
from glsim import DepthNoise
depth_m = numpy.full((40, 48), 0.9, numpy.float32)
def noisy(corrupter):
    return corrupter(depth_m, frame=3).tobytes()
for sensor in sys.argv[1:]:
    with DepthNoise(sensor) as other:
        noisy(other)
with DepthNoise() as corrupter:
    with multiprocessing.get_context("fork").Pool(2) as pool:
        one, two = pool.map(noisy, [corrupter] * 2)
    assert one == two == noisy(corrupter)
"""


@pytest.mark.parametrize("before", [[], ["kinect-v1"]], ids=["unused", "another sensor"])
@pytest.mark.long
def test_a_forked_process_compiles_shaders(before: list[str], tmp_path: Path) -> None:
    """A forked process compiles its first shaders without hanging and draws its parent's noise."""
    done = subprocess.run(
        [sys.executable, "-c", _FORKS, *before],
        env=os.environ | {"MESA_SHADER_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr


_PARENTS: list[DepthNoise] = []


def _noisy_bytes(depth_m: NDArray[np.float32]) -> bytes:
    return _PARENTS[0](depth_m, frame=3).tobytes()


def test_a_forked_process_opens_a_context_of_its_own() -> None:
    """It is inherited, not pickled, and was used before."""
    depth_m = np.full((40, 48), 0.9, np.float32)
    with DepthNoise() as corrupter:
        _PARENTS[:] = [corrupter]
        here = _noisy_bytes(depth_m)
        with multiprocessing.get_context("fork").Pool(1) as pool:
            assert pool.map(_noisy_bytes, [depth_m]) == [here]
        assert _noisy_bytes(depth_m) == here


def test_float_millimetres_are_refused_and_empty_maps_are_not() -> None:
    """They were beyond the far plane, and gave zeros without a word."""
    with corrupter() as corrupt:
        for given in (maps(2) * 1000, (maps(2)[1] * 1000).astype(np.float64)):
            with pytest.raises(ConfigError, match=r"this is millimetres, .* give depth / 1000"):
                corrupt(given, frame=0)
        far = np.full((72, 96), 1000.0, np.float32)  # a simulator's far plane, 1 km
        with pytest.warns(UserWarning, match="all depth is 1000 m, .* give depth / 1000"):
            assert not corrupt(far, frame=0).any()
        with pytest.warns(UserWarning, match=r"all depth is 0.001 m, .*: give metres"):
            assert not corrupt(far / np.float32(1e6), frame=0).any()
        half = far.copy()
        half[:20] = 0.9
        assert corrupt(half, frame=0)[:20].any()
        nothing = np.full((72, 96), np.inf, np.float32)
        assert not corrupt(nothing, frame=0).any()
        hills = np.linspace(40, 90, 72 * 96, dtype=np.float32).reshape(72, 96)
        # Metres: 40 mm would be nearer than any sensor sees.
        with pytest.warns(UserWarning, match="all depth is 40 to 90 m, the sensor sees"):
            assert not corrupt(hills, frame=0).any()
