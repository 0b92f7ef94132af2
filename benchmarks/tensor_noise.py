"""Time noise on batches of depth maps: python -m benchmarks.tensor_noise [--device cuda] [...].

Maps a second of each sensor: "torch" in batches on the device, "OpenGL" map by map. "lean" is noise
as people write it in PyTorch: Gaussian with a sigma that grows with the distance, lateral shifts,
and losses at edges. On a CPU seconds are those of the process on all cores (user and system time),
so that other processes count little; the best of some rounds, in which the ways take turns.
"""

import argparse
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import torch

from glsim import DepthNoise

_SENSORS = (
    "realsense-d4xx-fast", "kinect-v2-fast", "kinect-v2", "any-depth-camera", "azure-kinect"
)  # fmt: skip


def domes(batch: int, height: int, width: int) -> Any:
    """Make (batch, height, width) maps of a dome before a slanted wall, m."""
    y, x = np.mgrid[:height, :width] / np.array([height, width]).reshape(2, 1, 1) - 0.5
    dome = 1 - (x / 0.31) ** 2 - (y / 0.4) ** 2
    depth = np.where(dome > 0, 0.9 - 0.08 * np.sqrt(np.maximum(dome, 0)), 1.7 + 0.4 * x)
    scales = 1 + 0.1 * np.arange(batch).reshape(-1, 1, 1) / batch
    return torch.from_numpy((depth * scales).astype(np.float32))


def lean(depth_m: Any) -> Any:
    """Add Gaussian noise, shifts of up to a pixel, and losses beside edges of 5 cm."""
    batch, height, width = depth_m.shape
    rows, columns = (
        torch.arange(side, device=depth_m.device).view(shape)
        + torch.randn_like(depth_m).mul(0.6).round().long()
        for side, shape in ((height, (1, -1, 1)), (width, (1, 1, -1)))
    )
    at = rows.clamp(0, height - 1) * width + columns.clamp(0, width - 1)
    noisy = depth_m.flatten(1).gather(1, at.flatten(1)).view(batch, height, width)
    noisy = noisy + torch.randn_like(depth_m) * (0.0012 + 0.0019 * (noisy - 0.4) ** 2)
    edges = torch.nn.functional.max_pool2d(depth_m, 3, 1, 1) - depth_m > 0.05
    return torch.where(edges & (torch.rand_like(depth_m) < 0.8), 0.0, noisy)


def seconds(call: Callable[[], object], device: str) -> float:
    """Return the seconds of a call: of the process on a CPU, else until the device is done."""
    if device == "cpu":
        start = time.process_time()
        call()
        return time.process_time() - start
    torch.cuda.synchronize()
    start = time.perf_counter()
    call()
    torch.cuda.synchronize()
    return time.perf_counter() - start


def main(arguments: Sequence[str] | None = None) -> None:
    """Print maps a second of each sensor, size and batch."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.tensor_noise", description=__doc__)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--sensor", action="append", choices=_SENSORS)
    parser.add_argument("--size", nargs=2, type=int, default=(128, 128), help="width height")
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args(arguments)
    maps = domes(options.batch, options.size[1], options.size[0]).to(options.device)
    some, seeds = maps[:8].cpu(), torch.arange(options.batch, device=options.device)
    print(f"{options.size[0]}x{options.size[1]}, batches of {options.batch}, {options.device}")
    for sensor in options.sensor or _SENSORS:
        drawn, made = DepthNoise(sensor), DepthNoise(sensor, device=options.device)
        ways: dict[str, tuple[int, Callable[[], object]]] = {
            "OpenGL": (len(some), partial(drawn, some, frame=0)),
            "torch": (len(maps), partial(made, maps, seeds=seeds)),
            "lean": (len(maps), lambda: lean(maps)),
        }
        for _, call in ways.values():
            call()
        best = dict.fromkeys(ways, np.inf)
        for _ in range(options.rounds):
            for name, (count, call) in ways.items():
                best[name] = min(best[name], seconds(call, options.device) / count)
        cells = "".join(f"{name:>10} {1 / best[name]:7.0f}" for name in ways)
        print(
            f"{sensor:18}{cells}  torch / OpenGL {best['OpenGL'] / best['torch']:.1f}", flush=True
        )


if __name__ == "__main__":
    main()
