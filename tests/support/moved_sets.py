"""Two data sets of the same frames: as measured, and with the nearest point at 1 mm."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from glsim.core.depth_protocol import DepthProtocol, offset_to_nearest
from glsim.core.rect import Rect
from glsim.core.units import subtract_offset
from glsim.data.dataset_run import write_dataset
from glsim.settings.schema import Settings
from glsim.simulation.frame import Frame
from glsim.simulation.plan.tasks import Task
from tests.support.dataset_fakes import SENSOR, fake_frame, make_settings, make_tasks
from tests.support.eval_scenes import CAMERA, SIZE, dome, noisy


def dome_frames(settings: Settings, tasks: Iterable[Task]) -> Iterator[Frame]:
    """Yield noisy domes at 900 mm or more, in whole millimetres, moved as the settings say.

    No noise is nearer than the tip of the dome, so that files at 1 mm lose nothing.
    """
    nearest_to_mm = settings.output.nearest_to_mm
    for task in tasks:
        clean = dome()
        clean = np.where(clean > 0, clean + np.float32(10 * task.index), 0).astype(np.float32)
        seen = noisy(clean, task.index)
        seen = np.where(seen > 0, np.maximum(seen, 900 + 10 * task.index), 0).astype(np.float32)
        offset_mm = 0.0
        if nearest_to_mm is not None:
            offset_mm = offset_to_nearest(clean, nearest_to_mm)
            clean, seen = (subtract_offset(depth, offset_mm) for depth in (clean, seen))
        metres = [(depth / 1000).astype(np.float32) for depth in (clean, seen)]
        zeros = np.zeros(SIZE, np.float32)
        yield replace(
            fake_frame(task, offset_mm=offset_mm),
            intrinsics=CAMERA,
            window=Rect(0, 0, SIZE[1], SIZE[0]),
            clean_m=metres[0],
            noisy_m=metres[1],
            infrared_counts=zeros,
            reason_codes=zeros.astype(np.uint8),
            expected_m=None,
        )


def write_both_protocols(root: Path) -> dict[str, Path]:
    """Write the same domes as measured and at 1 mm; return protocol -> folder."""
    protocols: tuple[DepthProtocol, ...] = ("depth", "paper")
    return {protocol: write_domes(root / protocol, protocol) for protocol in protocols}


def write_domes(out: Path, protocol: DepthProtocol, subjects: int = 4, frames: int = 2) -> Path:
    """Write a data set of domes under a protocol; return its folder."""
    nearest_to_mm = 1.0 if protocol == "paper" else None
    write_dataset(
        make_settings(nearest_to_mm=nearest_to_mm),
        make_tasks(subjects, frames),
        out,
        dome_frames,
        sensor=SENSOR,
        renderer="fake renderer",
        workers=1,
    )
    return out
