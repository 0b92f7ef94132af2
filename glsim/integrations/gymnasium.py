"""A sensor's noise on the depth images of a Gymnasium environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict

from glsim.core.errors import ConfigError
from glsim.settings.schema import Settings
from glsim.simulation.depth_noise import DepthNoise

__all__ = ["NoisyDepth"]


class NoisyDepth(gymnasium.ObservationWrapper):  # type: ignore[misc]  # it has no types for us
    """A wrapper that adds sensor noise to an environment's depth images, by episode another device.

    The noise is a function of the last seed of ``reset`` (before: the sensor's seed), the number of
    episodes since then, and the step. The environment's random numbers do not change.

    Args:
        env: environment whose observation is a depth image, or a dictionary with one: (H, W) or (H,
            W, 1) float metres along the axis, 0 or infinity = no depth.
        sensor: see DepthNoise; its stages must accept tensors.
        camera: fx, fy, cx, cy of the image, pixels, with the first pixel's centre at 0.5.
        options: further options of DepthNoise.

    Raises ConfigError: observations have no such image; also the errors of DepthNoise.
    """

    def __init__(
        self,
        env: Any,
        sensor: str | Settings = "realsense-d4xx-fast",
        *,
        key: str = "depth",
        camera: dict[str, Any] | None = None,
        **options: Any,
    ) -> None:
        super().__init__(env)
        self._noise = DepthNoise(sensor, backend="torch", **options)
        self._camera, space = camera or {}, env.observation_space
        self._key = key if isinstance(space, Dict) else None
        image = space.spaces.get(key) if isinstance(space, Dict) else space
        if not isinstance(image, Box) or not np.issubdtype(image.dtype, np.floating):
            raise ConfigError(
                f"the observation {key!r} is no image of float metres (a Box): {image}: name "
                "another by key=, or let the environment observe one"
            )
        noisy = Box(0.0, np.inf, image.shape, image.dtype.type)
        alone = self._key is None
        self.observation_space = noisy if alone else Dict({**space.spaces, key: noisy})
        self._devices = np.random.default_rng(self._noise.settings.seed)
        self._device, self._frame = 0, 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode with another device; a seed makes this and later episodes repeatable."""
        if seed is not None:
            self._devices = np.random.default_rng(seed)
        self._device, self._frame = int(self._devices.integers(2**31)), 0
        begun: tuple[Any, dict[str, Any]] = super().reset(seed=seed, options=options)
        return begun

    def observation(self, observation: Any) -> Any:
        """Return the observation with noisy depth of the next frame, 0 = no return."""
        clean = observation if self._key is None else observation[self._key]
        noisy = self._noise(clean, seeds=self._device, frame=self._frame, **self._camera)
        self._frame += 1
        return noisy if self._key is None else {**observation, self._key: noisy}
