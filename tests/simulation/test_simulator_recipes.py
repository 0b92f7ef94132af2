"""The recipes of docs/howto/other_simulators.md, with stand-ins for the simulators."""

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.imports import ROOT

WIDTH, HEIGHT = 64, 48
PAGE = (ROOT / "docs/howto/other_simulators.md").read_text(encoding="utf-8")


def recipe(title: str) -> dict[str, Any]:
    """The names that the code below a heading of the page defines."""
    section = PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]
    names: dict[str, Any] = {}
    for code in re.findall(r"```python\n(.*?)```", section, re.DOTALL):
        exec(compile(code, title, "exec"), names)
    return names


def wall(empty: float) -> NDArray[np.float32]:
    """A wall at 1.1 to 1.3 m, at a slant, and nothing in a corner."""
    depth = np.tile(np.linspace(1.1, 1.3, WIDTH, dtype=np.float32), (HEIGHT, 1))
    depth[:12, :16] = empty
    return depth


def check(noisy: NDArray[np.float32], clean: NDArray[np.float32]) -> None:
    """The middle of the wall has noise of millimetres; what was empty stays empty."""
    middle = noisy[20:40, 24:56]
    error_mm = 1000 * (middle - clean[20:40, 24:56])[middle > 0]
    assert error_mm.size > 500
    assert 0.5 < error_mm.std() < 25
    assert not noisy[:9, :13].any()


def test_the_first_example_of_the_page_runs() -> None:
    code = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)
    names: dict[str, Any] = {}
    exec(compile(code[1].replace("640", "64").replace("480", "48"), "page", "exec"), names)
    assert names["noisy_m"].shape == (48, 64)
    assert names["batch_m"].shape == (2, 48, 64)
    assert (names["batch_m"][0] != names["noisy_m"]).any()


def test_a_ros_node_waits_for_the_camera_and_counts_frames() -> None:
    published: list[tuple[NDArray[np.float32], str]] = []
    node = recipe("Gazebo and ROS")["AddNoise"](
        lambda depth, header: published.append((depth, header))
    )
    clean = wall(np.inf)
    node.on_depth(clean, "too early")
    assert published == []
    k = [60.0, 0, 31.5, 0, 60.0, 23.5, 0, 0, 1]
    info = SimpleNamespace(width=WIDTH, height=HEIGHT, k=k)
    node.on_camera_info(info)
    node.on_camera_info(info)
    node.on_depth(clean, "a")
    node.on_depth(clean, "b")
    assert [header for _, header in published] == ["a", "b"]
    for noisy, _ in published:
        check(noisy, clean)
    assert (published[0][0] != published[1][0]).any()


def test_an_observation_of_habitat_keeps_its_other_sensors() -> None:
    names = recipe("Habitat")
    clean = wall(0)
    with names["corrupter_of"](WIDTH, HEIGHT, 56.1) as corrupt:
        image = corrupt.rig().intrinsics
        assert (image.cx, image.cy) == (WIDTH / 2, HEIGHT / 2)
        assert image.fx == pytest.approx(60, rel=0.01)
        given = {"rgb": "untouched", "depth_sensor": clean}
        found = names["noisy_observation"](given, corrupt, 3, "episode 7")
        again = names["noisy_observation"](given, corrupt, 3, "episode 7")
    assert found["rgb"] == "untouched"
    assert given["depth_sensor"] is clean
    check(found["depth_sensor"], clean)
    np.testing.assert_array_equal(found["depth_sensor"], again["depth_sensor"])


def test_frames_of_blenderproc_get_noise() -> None:
    k = np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]])
    data = {"depth": [wall(1e10), wall(1e10)]}
    found = recipe("BlenderProc")["add_noise"](data, k, WIDTH, HEIGHT)["noisy_depth"]
    assert found.shape == (2, HEIGHT, WIDTH)
    for noisy in found:
        check(noisy, wall(1e10))


def test_a_batch_of_isaac_comes_back_as_a_tensor() -> None:
    torch = pytest.importorskip("torch")
    names = recipe("Isaac Sim and Isaac Lab")
    clean = torch.from_numpy(np.stack([wall(np.inf)] * 2)[..., None])
    k = torch.tensor([[[60.0, 0, 32.0], [0, 60.0, 24.0], [0, 0, 1]]] * 2)
    camera = SimpleNamespace(
        data=SimpleNamespace(
            image_shape=(HEIGHT, WIDTH),
            intrinsic_matrices=k,
            output={"distance_to_image_plane": clean},
        )
    )
    with names["corrupter_of"](camera) as corrupt:
        assert (corrupt.rig().intrinsics.cx, corrupt.rig().intrinsics.cy) == (32.0, 24.0)
        noisy = names["noisy_depth"](camera, corrupt, 1)
    assert noisy.shape == clean.shape
    assert noisy.device == clean.device
    for one in noisy.numpy()[..., 0]:
        check(one, wall(np.inf))
