"""Experiments with other surfaces and other noise that the paper's text talks about.

Each is scored like table 1, under all four cases: FOLDER/experiments/NAME holds filters/MASK/SEED/
data and, per protocol, the scores, as the folder of a reproduction does (``glsim.eval.paper.
cases``). The first one has the noise of the tables.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from glsim.eval.paper.cases import FILTERS_FOLDER

#: Folder of the experiments in that of a reproduction.
EXPERIMENTS_FOLDER: Final = "experiments"
_FACES: Final = ("--source", "procedural")
_NO_PERLIN: Final = ("--set", "perlin.enabled=false")
#: Boards at more than one distance, mm: at a single one, rounding to 1/8 px of disparity (8.2 mm at
#: 900 mm) would be the same error everywhere. Chosen around the paper's distance.
_BOARDS: Final = ("--source", "board", "--set", "pose.distance_mm={ uniform = [850, 950] }")


@dataclass(frozen=True)
class Experiment:
    """Table 1 on other frames.

    Attributes:
        title: what is changed, in tables.
        options: of ``glsim generate``, beside those of the plan.
        factor: 0, or by how much the clean maps of FACES are reduced and enlarged again to be the
            noisy ones (``glsim.eval.paper.resampled``).
    """

    title: str
    options: tuple[str, ...] = _FACES
    factor: int = 0


#: The experiment that the others are compared with: its name is that of its noise.
FACES: Final = "perlin"
EXPERIMENTS: Final = {
    FACES: Experiment("faces, Perlin noise"),
    "gaussian": Experiment(
        "faces, Gaussian noise", (*_FACES, *_NO_PERLIN, "--set", "gaussian.enabled=true")
    ),
    "simplex": Experiment(
        "faces, simplex noise", (*_FACES, *_NO_PERLIN, "--set", "simplex.enabled=true")
    ),
    "blensor": Experiment(
        "faces, Perlin noise of BlenSor's kinect.py",
        (
            *(*_FACES, "--set", "perlin.amplitude_px=0.25", "--set", "perlin.octaves=1"),
            *("--set", "perlin.lattice_x_px=48", "--set", "perlin.lattice_y_px=48"),
        ),
    ),
    "lateral": Experiment(
        "faces, Perlin and lateral noise of 0.5 px", (*_FACES, "--set", "lateral.enabled=true")
    ),
    "board": Experiment("a board of a face's size, Perlin noise", _BOARDS),
    "wall": Experiment(
        "a board that fills the crop, Perlin noise",
        (*_BOARDS, "--set", "source.width_mm=800", "--set", "source.height_mm=800"),
    ),
    "resampled-2": Experiment("faces, half the resolution and back", factor=2),
    "resampled-4": Experiment("faces, a quarter of the resolution and back", factor=4),
}


def experiment_folder(reproduction: Path, name: str) -> Path:
    """Return the folder of an experiment within the folder of a reproduction."""
    return reproduction / EXPERIMENTS_FOLDER / name


def data_folder(reproduction: Path, name: str, mask: str, seed: int) -> Path:
    """Return the folder of an experiment's depth maps, made with one clean mask and one seed."""
    return experiment_folder(reproduction, name) / FILTERS_FOLDER / mask / str(seed) / "data"
