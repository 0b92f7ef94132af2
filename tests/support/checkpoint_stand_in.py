"""A replacement of ``glsim.denoise.inference`` in tests that have a checkpoint but no PyTorch.

A checkpoint is JSON: gain (depth moves towards 900 mm by this share of its distance), soft (the
validity is a probability), sigma_mm (the uncertainty of every pixel, if any), blind (predicts no
depth; a minimum probability above 0.75 has the same effect).
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from glsim.core.errors import DenoiserError
from glsim.networks.interface import DepthFunction


@dataclass
class Network(DepthFunction):
    gain: float
    soft: bool = False
    sigma_mm: float | None = None
    blind: bool = False

    def __post_init__(self) -> None:
        self.uncertain = self.sigma_mm is not None

    def configure(self, *options: object) -> None:
        pass

    def __call__(
        self, frames_mm: Any, measured: Any, now: int, infrared: Any = None
    ) -> tuple[Any, ...]:
        noisy_mm, valid = frames_mm[now], measured[now] & (not self.blind)
        depth = np.where(valid, noisy_mm + self.gain * (900 - noisy_mm), 0).astype(np.float32)
        kept = np.where(valid, 0.75, 0.25).astype(np.float32) if self.soft else valid
        sigma = () if self.sigma_mm is None else (np.full(depth.shape, self.sigma_mm, np.float32),)
        return depth, kept, *sigma


def load_network(path: Path, min_probability: float = 0.0) -> Network:
    try:
        network = Network(**json.loads(path.read_text()))
        network.blind |= min_probability > 0.75
        return network
    except (ValueError, TypeError) as error:
        raise DenoiserError(f"{path}: is no checkpoint: {error}") from None


def write_run(
    folder: Path, gain: float, *, row: str | None, title: str = "", size: str = "small",
    seed: int = 0, state: str = "finished", ended: str = "patience", **more: Any,
) -> None:  # fmt: skip
    """Write the files of a run of ``glsim train`` from which tables are made."""
    folder.mkdir(parents=True)
    (folder / "best.pt").write_text(json.dumps({"gain": gain} | more))
    recipe = {"title": title or row, "row": row, "size": size, "seed": seed}
    recipe["description"] = "narrower" if size == "small" else ""
    (folder / "recipe.json").write_text(json.dumps(recipe))
    run = {
        "state": state,
        "ended": ended,
        "seconds": 90.0,
        "steps": 10,
        "epochs": 1,
        "parameters": 185857,
    }
    (folder / "run.json").write_text(json.dumps(run))
