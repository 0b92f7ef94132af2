"""Rate of a training loop on rendered pairs, against the same loop on pairs in PNG files.

``python -m benchmarks.training_data --reuse 1 4``: for three sensors and two precisions (bfloat16
as in our recipes, float32 as in the paper's), DnCNN with 7 layers on batches of 4. Run it on an
idle machine: both loops use all cores.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader

from glsim import Settings, generate, load_settings
from glsim.train import SimulatedPairs, StoredPairs, randomised
from glsim.train.models.base import channels_last

BATCH = 4
LAYERS, WIDTH = 7, 64
POSES = {"yaw_deg": {"uniform": [-60, 60]}, "distance_mm": {"uniform": [520, 1450]}}


def settings_of(sensor: str) -> Settings:
    """Settings of ``--simulate``, or its poses with another sensor."""
    if sensor == "kinect-v2":
        return randomised(["split=[1,0,0]", "source.subjects=40", "source.frames_per_subject=4"])
    output = {"crop": 128, "depth_unit_mm": 0.1}
    people = {"subjects": 40, "frames_per_subject": 4}
    return load_settings(
        overrides={"sensor": sensor, "split": [1, 0, 0], "source": people, "pose": POSES}
        | {"output": output}
    )


class TimedLoop:
    """A training loop: a network and its optimiser."""

    def __init__(self, precision: str) -> None:
        widths = [1, *[WIDTH] * (LAYERS - 1)]
        layers = [nn.Sequential(nn.Conv2d(a, WIDTH, 3, padding=1), nn.ReLU()) for a in widths[:-1]]
        self.fast = precision == "bf16"
        self.network = nn.Sequential(*layers, nn.Conv2d(WIDTH, 1, 3, padding=1))
        if self.fast:
            self.network = channels_last(self.network)
        self.optimiser = torch.optim.Adam(self.network.parameters(), 1e-4)

    def step(self, noisy_mm: Tensor, clean_mm: Tensor) -> None:
        with torch.autocast("cpu", torch.bfloat16, enabled=self.fast):
            loss = (self.network(noisy_mm / 1000) - clean_mm / 1000).square().mean()
        self.optimiser.zero_grad()
        loss.backward()
        self.optimiser.step()

    def rate(self, batches: Iterator[Iterable[Tensor]], warm: int, steps: int) -> float:
        """Batches per second, after ``warm`` batches that start workers and fill their blocks."""
        for batch in islice(batches, warm):
            self.step(*batch)
        start = time.perf_counter()
        for batch in islice(batches, steps):
            self.step(*batch)
        return steps / (time.perf_counter() - start)


def endless(loader: Iterable[list[Tensor]]) -> Iterator[list[Tensor]]:
    """Repeat the epochs of a loader; each epoch reads the files."""
    while True:
        yield from loader


def main(steps: int, warm: int, reuses: list[int], workers: int) -> None:
    torch.manual_seed(0)
    threads = torch.get_num_threads()
    print(f"{os.cpu_count()} cores, {threads} PyTorch threads, load {os.getloadavg()[0]:.1f}")
    for sensor in ("kinect-v2", "kinect-v2-fast", "kinect-v2-paper"):
        settings = settings_of(sensor)
        with tempfile.TemporaryDirectory() as folder:
            generate(settings, Path(folder, "d"))
            for precision in ("bf16", "fp32"):
                stored = DataLoader(StoredPairs(Path(folder, "d"), "train", cache_mb=0), BATCH)
                png = TimedLoop(precision).rate(endless(stored), 2, steps)
                line = f"{sensor} {precision}: PNG {png:.2f} batches/s"
                for reuse in reuses:
                    pairs = SimulatedPairs(settings, batch=BATCH, reuse=reuse)
                    batches = iter(pairs.loader(workers))
                    rate = TimedLoop(precision).rate(batches, warm, steps)
                    line += f"; reuse {reuse} {rate:.2f} ({rate / png:.0%})"
                    del batches
                print(line, flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=100, help="timed batches")
    parser.add_argument("--warm", type=int, default=40, help="batches before the clock starts")
    parser.add_argument("--reuse", type=int, nargs="+", default=[1, 4], help="uses of each pair")
    parser.add_argument("--workers", type=int, default=1, help="processes that render")
    given = parser.parse_args()
    main(given.steps, given.warm, given.reuse, given.workers)
