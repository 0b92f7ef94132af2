"""The frame of a reproduction that its figures show, and what each method makes of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from glsim.core.camera import SensorRig
from glsim.core.depth_frame import DepthFrame
from glsim.core.errors import DatasetError
from glsim.data.reader import Dataset
from glsim.denoise import load_denoiser
from glsim.denoise.interface import Depth
from glsim.eval.paper.runs import SeedGroup
from glsim.sensors.sensor import sensor_of
from glsim.settings.schema import Settings


@dataclass(frozen=True, eq=False)
class FigureFrame:
    """A frame of the data set: maps in mm, 0 = no depth, and the sensor that saw them.

    rig: the sensor's rig. window: the same with the camera of the delivered frame.
    """

    pair: DepthFrame
    clean: Depth
    noisy: Depth
    rig: SensorRig
    window: SensorRig


class Column(NamedTuple):
    """A method of a figure: its title, and the denoiser (``glsim.load_denoiser``) that draws it."""

    title: str
    spec: str


def choose_frame(dataset: Dataset, kind: str | None = None) -> FigureFrame:
    """Return the middle frame of the test split, of one kind of face source if it has any.

    Raises DatasetError for a data set without test frames or clean maps.
    """
    split = dataset.split("test")
    if not len(split):
        raise DatasetError(f"{dataset.path}: has no test frames to draw")
    numbers = [n for n, pair in enumerate(split) if pair.record["source"] == kind]
    chosen = numbers or range(len(split))
    pair = split[chosen[len(chosen) // 2]]
    rig = sensor_of(Settings.model_validate(dataset.header["settings"])).rig
    window = replace(rig, intrinsics=pair.intrinsics)
    return FigureFrame(pair, pair.clean_mm, pair.noisy_mm, rig, window)


def denoise(frame: FigureFrame, columns: Sequence[Column]) -> dict[str, Depth]:
    """Return title -> the depth map of each method, networks with the default composite.

    Raises DenoiserError as the methods do.
    """
    maps: dict[str, Depth] = {}
    for column in columns:
        denoised = load_denoiser(column.spec)(frame.noisy)
        maps[column.title] = denoised.depth_mm.astype(np.float32)
    return maps


def network_columns(groups: Sequence[SeedGroup], rows: Sequence[str]) -> list[Column]:
    """Return one column for each table row with a trained network: that of its largest network.

    It shows the first seed; its title says size and steps below the row.
    """
    columns = []
    for row in rows:
        of_row = sorted((g for g in groups if g.row == row), key=lambda g: g.size == "full")
        if of_row:
            run = of_row[-1].members[0]
            columns.append(Column(f"{row}\n{run.size}, {run.steps:,} steps", run.spec))
    return columns
