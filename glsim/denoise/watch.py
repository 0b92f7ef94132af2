"""Denoise the depth maps of a folder as they appear there."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from glsim.denoise.depth_files import MapFrames, infrared_files
from glsim.denoise.map_denoiser import MapDenoiser
from glsim.depth_protocol import DepthProtocol
from glsim.errors import ConfigError, DatasetError
from glsim.files.arrivals import FolderArrivals
from glsim.files.atomic import write_atomic
from glsim.map_files import encode_map, format_of, is_map
from glsim.recordings.names import other_kind


class Watched(NamedTuple):
    """The result for one file.

    Attributes:
        source: the file.
        problem: why it could not be read; "" if it was denoised.
        latency_s: from its appearance to the written map; None for a file that was there before.
        seconds: time of reading, denoising and writing.

    """

    source: Path
    problem: str
    latency_s: float | None
    seconds: float


def watch_folder(
    folder: Path,
    out: Path,
    denoiser: MapDenoiser,
    depth_unit_mm: float,
    out_unit_mm: float | None = None,
    protocol: DepthProtocol = "depth",
) -> Iterator[Watched]:
    """Denoise the depth maps of a folder, and those that appear there, for ever.

    They are one sequence in the order of their names, in which numbers count by value. A map with a
    denoised map that is not older is left out, so that an interrupted watch can start again.

    Args:
        folder: to watch.
        out: folder of the denoised maps, which keep their names and formats.
        denoiser: of the maps.
        depth_unit_mm: step of the files.
        out_unit_mm: step of the denoised files, which state it; default: that of the files.
        protocol: see ``MapFrames``.

    Raises:
        ConfigError: a folder cannot be watched.
        DatasetError: a folder is removed.

    """
    if not folder.is_dir():
        raise ConfigError(f"--watch {folder}: no such folder")
    if out.exists() and not out.is_dir():
        raise ConfigError(f"-o {out}: is a file; with --watch give a folder")
    if out.resolve() == folder.resolve():
        raise ConfigError(f"-o {out}: is the folder that is watched: give another one")
    if protocol == "paper" and denoiser.method.before:
        raise ConfigError(
            "--watch: moves each map by itself under the protocol paper: choose a denoiser of "
            "single frames, or --protocol depth"
        )
    step_mm = out_unit_mm or depth_unit_mm
    stream = denoiser.stream()
    arrivals = FolderArrivals(
        folder, lambda name: is_map(Path(name)) and not other_kind(name, "noisy")
    )
    for path, appeared_s, complete in arrivals:
        target = out / path.name
        if appeared_s is None and complete and _is_current(target, path):
            continue
        start_s = time.monotonic()
        problem = ""
        try:
            images = infrared_files([path], None) if denoiser.method.infrared else ()
            frames = MapFrames([path], depth_unit_mm, infrared=images, protocol=protocol)
            counts = frames.infrared(0) if images else None
            sample = frames.load(0)
            depth_mm = stream.push(sample.noisy_mm, counts).depth_mm
            depth_m = frames.as_stored(0, depth_mm, sample.offset_mm) * np.float32(0.001)
        except DatasetError as error:
            problem = str(error)
        else:
            data = encode_map(depth_m, format_of(target), step_mm, "--out-unit-mm", state_unit=True)
            write_atomic(data, target, sync=False)
        end_s = time.monotonic()
        latency_s = None if appeared_s is None or problem else end_s - appeared_s
        yield Watched(path, problem, latency_s, end_s - start_s)


def _is_current(target: Path, source: Path) -> bool:
    """Return whether a denoised map is not older than its source."""
    try:
        return target.stat().st_mtime_ns >= source.stat().st_mtime_ns
    except OSError:
        return False
