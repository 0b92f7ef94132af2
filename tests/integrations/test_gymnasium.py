"""The wrapper on a MuJoCo scene with a depth camera, rendered by OSMesa in a process of its own.

MuJoCo's EGL needs a newer PyOpenGL than pyrender pins; OSMesa works with both.
"""

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from tests.support.imports import ROOT

pytest.importorskip("torch")
gymnasium: Any = pytest.importorskip("gymnasium")

from glsim.core.errors import ConfigError  # noqa: E402
from glsim.integrations.gymnasium import NoisyDepth  # noqa: E402


class Wall(gymnasium.Env):  # type: ignore[misc]  # it has no types for us
    """Observes a wall at 1 m, in an image or in a dictionary."""

    def __init__(self, space: Any) -> None:
        self.observation_space, self.action_space = space, gymnasium.spaces.Discrete(1)

    def _seen(self):
        image = np.ones((48, 96, 1), np.float32)
        single = isinstance(self.observation_space, gymnasium.spaces.Box)
        return image if single else {"depth": image, "joints": np.zeros(2)}

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self._seen(), {}

    def step(self, action):
        return self._seen(), 0.0, False, False, {}


IMAGE = gymnasium.spaces.Box(0, 10, (48, 96, 1), np.float32)


def test_each_episode_has_a_device_and_seeds_repeat() -> None:
    """The mean of an episode's frames is its device's error: alike in one, unlike in another."""
    joints = gymnasium.spaces.Box(-1, 1, (2,), np.float64)
    env = NoisyDepth(Wall(gymnasium.spaces.Dict({"depth": IMAGE, "joints": joints})))

    def episode(seed: int | None) -> np.ndarray:
        frames = [env.reset(seed=seed)[0], *(env.step(0)[0] for _ in range(5))]
        assert all(frame in env.observation_space for frame in frames)
        return np.stack([frame["depth"][..., 0] for frame in frames])

    first, second, again = episode(3), episode(None), episode(3)
    assert first.tobytes() == again.tobytes()
    assert not (first[0] == first[1]).all()
    a, b, c = ((e.mean(0) - 1.0)[:, 36:].ravel() for e in (first[::2], first[1::2], second))
    assert np.corrcoef(a, b)[0, 1] > 0.5 > abs(np.corrcoef(a, c)[0, 1])
    alone = NoisyDepth(Wall(IMAGE))
    assert alone.reset(seed=3)[0].tobytes() == first[0].tobytes()


def test_observations_without_depth_are_named() -> None:
    counts = gymnasium.spaces.Box(0, 255, (48, 96, 1), np.uint8)
    with pytest.raises(ConfigError, match="'depth' is no image of float metres"):
        NoisyDepth(Wall(counts))
    with pytest.raises(ConfigError, match="'stereo_light' does not run on tensors"):
        NoisyDepth(Wall(IMAGE), "realsense-d435").reset()


SCENE = """
import mujoco, numpy as np, gymnasium
from glsim.integrations.gymnasium import NoisyDepth
# A floor 2 m below the camera, and a box of 0.4 m at the image's upper right (+x, +y).
XML = '''<mujoco><visual><map znear="0.01" zfar="10"/></visual><worldbody>
<geom type="plane" size="5 5 .1"/><geom type="box" size=".1 .1 .2" pos=".4 .3 .2"/>
<camera name="depth" pos="0 0 2" fovy="60"/></worldbody></mujoco>'''
model = mujoco.MjModel.from_xml_string(XML)
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
renderer = mujoco.Renderer(model, 96, 128)
renderer.enable_depth_rendering()

class Scene(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(0, np.inf, (96, 128), np.float32)
    action_space = gymnasium.spaces.Discrete(1)
    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        renderer.update_scene(data, "depth")
        return renderer.render(), {}

f = 48 / np.tan(np.radians(model.camera("depth").fovy[0]) / 2)
clean, _ = Scene().reset()
env = NoisyDepth(Scene(), camera={"fx": f, "fy": f, "cx": 64.0, "cy": 48.0})
noisy, _ = env.reset(seed=1)
again, _ = env.reset(seed=1)
other, _ = env.reset()
np.savez("made.npz", clean=clean, noisy=noisy, again=again, other=other, f=f)
renderer._gl_context = None  # PyOpenGL 3.1.0 cannot free it
"""


@pytest.mark.long
def test_a_mujoco_camera(tmp_path) -> None:
    pytest.importorskip("mujoco")
    (tmp_path / "scene.py").write_text(SCENE)
    environment = {**os.environ, "MUJOCO_GL": "osmesa", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "scene.py"], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[-2000:]
    made = np.load(tmp_path / "made.npz")
    clean, noisy = made["clean"], made["noisy"]
    # Scale, and depth along the axis: the floor is 2 m in the corners too, where rays are longer.
    corners = clean[[0, 0, -1, -1], [0, -1, 0, -1]]
    np.testing.assert_allclose(corners, 2.0, atol=0.002)
    # Orientation: the box's top, 1.6 m away, is where +x is right and +y is up.
    rows, columns = np.nonzero(clean < 1.7)
    x, y = (columns.mean() + 0.5 - 64) / made["f"] * 1.6, (48 - rows.mean() - 0.5) / made["f"] * 1.6
    np.testing.assert_allclose((x, y), (0.4, 0.3), atol=0.03)
    found = noisy > 0
    assert 0.6 < found.mean() < 1.0
    assert abs(np.median(noisy[found] - clean[found])) < 0.01
    # The second imager is on the right: it sees nothing of the first columns.
    assert (noisy[:, :9] == 0).all()
    assert (noisy[40:56, -9:] > 0).any()
    np.testing.assert_array_equal(noisy, made["again"])
    assert not (noisy == made["other"]).all()
