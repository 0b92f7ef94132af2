"""JSON records of frames and chunks."""

from __future__ import annotations

import io
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from isal import isal_zlib

from glsim.core.errors import DatasetError, with_mesh_option
from glsim.core.files.atomic import to_json
from glsim.data.record_schema import parse_summary
from glsim.simulation.frame import Frame, Skipped
from glsim.simulation.plan.tasks import Task

Record = dict[str, Any]
#: Largest chunk record, bytes: 512 frames whose lines are twenty times longer than usual.
_MAX_BYTES = 1 << 26


def _task_fields(task: Task, source: str) -> Record:
    return {
        "index": task.index,
        "split": task.split,
        "subject": task.subject,
        "sequence": task.sequence,
        "frame": task.key.frame,
        "time_s": float(task.key.time_s),
        "source": source,
        "path": task.key.path,
    }


#: Seeds of a record; the device's seed follows from its number.
_SEEDS = ("frame", "sequence", "subject")


def frame_record(task: Task, frame: Frame, files: Mapping[str, Mapping[str, object]]) -> Record:
    """Return the manifest record of a frame.

    Seeds are 16 hexadecimal digits: JSON readers in other languages round integers above 2**53.
    ``files``: layer -> name, size, crc32, and member and offset within a shard.
    """
    record = _task_fields(task, frame.source) | {
        "device": task.device,
        "seeds": {name: f"{getattr(task.seeds, name):016x}" for name in _SEEDS},
        "pose": dict(frame.pose),
        "expression": dict(frame.expression),
        "parameters": dict(frame.parameters),
        "intrinsics": asdict(frame.intrinsics),
        "window": list(frame.window),
        "depth_offset_mm": float(frame.depth_offset_mm),
        "notes": dict(frame.notes),
        "files": dict(files),
    }
    if frame.head_to_camera is not None:
        record["head_to_camera"] = np.round(frame.head_to_camera, 9).tolist()
    if frame.landmarks is not None:  # to 0.001 mm and 0.001 px
        record["landmarks"] = {
            "points_m": np.round(frame.landmarks.points_m, 6).tolist(),
            "pixels": np.round(frame.landmarks.pixels, 3).tolist(),
            "visible": frame.landmarks.visible.tolist(),
        }
    return record | {"regions": frame.seen_regions} if "regions" in files else record


def skipped_record(task: Task, skipped: Skipped) -> Record:
    """Return the record of a frame that could not be made, with the reason."""
    why = with_mesh_option(skipped.why, "--set source.")
    return _task_fields(task, skipped.source) | {"why": why}


def metadata_row(record: Record) -> Record:
    """Convert a record to a row for the image-folder loader of Hugging Face ``datasets``.

    The loader turns each ``<layer>_file_name`` (relative to the split's folder) into an image
    column, and needs equal columns and types in every row and split. Therefore a row holds only
    common values of all frames, and no nested tables.
    """
    split = record["split"] + "/"
    row = {
        f"{layer}_file_name": file["name"].removeprefix(split)
        for layer, file in record["files"].items()
    }
    names = ("index", "subject", "sequence", "frame", "time_s", "source", "device")
    row |= {name: record[name] for name in names}
    row |= {name: float(value) for name, value in record["pose"].items()}
    row |= {name: float(record["intrinsics"][name]) for name in ("fx", "fy", "cx", "cy")}
    return row | {"depth_offset_mm": record["depth_offset_mm"]}


@dataclass(frozen=True)
class ChunkSummary:
    """The counts of a chunk's frames and image bytes, and its shard: keys of the record on disk."""

    chunk: int
    frames: int
    skipped: int
    bytes: int
    shard: dict[str, Any] | None = None

    @property
    def total(self) -> int:
        """Number of frames, made and skipped."""
        return self.frames + self.skipped


@dataclass(frozen=True)
class ChunkRecord:
    """The record of a complete chunk: its summary, manifest lines and skipped lines."""

    summary: ChunkSummary
    frames: list[str]
    skipped: list[str]

    def to_bytes(self) -> bytes:
        """Encode the record as a file: its text, which the manifest repeats, compressed."""
        return isal_zlib.compress(self._text(), 1)  # a fifth of the size

    def _text(self) -> bytes:
        """Return a CRC32 of all lines, the summary, and the lines."""
        summary = to_json(asdict(self.summary), f"chunk {self.summary.chunk}")
        lines = "".join([*self.frames, *self.skipped])
        crc32 = zlib.crc32(f"{summary}{lines}".encode())
        return f"{crc32:08x} {summary}\n{lines}".encode()


def parse_chunk_record(data: bytes) -> ChunkRecord:
    """Decode the bytes of ``ChunkRecord.to_bytes``. Raises DatasetError if damaged."""
    try:
        if data[:1] == b"\x78":  # zlib (RFC 1950); glsim 0.3 wrote text, which begins with a CRC32
            data = zlib.decompressobj().decompress(data, _MAX_BYTES + 1)
        if len(data) > _MAX_BYTES:
            raise DatasetError(f"a chunk record is damaged: it has more than {_MAX_BYTES} bytes")
        first, *lines = io.StringIO(data.decode(), newline="\n").readlines()
    except (ValueError, zlib.error):
        raise DatasetError("a chunk record is damaged") from None
    summary = ChunkSummary(**parse_summary(first[9:], "a chunk record"))
    record = ChunkRecord(summary, lines[: summary.frames], lines[summary.frames :])
    if record._text() != data:  # includes the CRC32
        raise DatasetError(f"the record of chunk {summary.chunk} is damaged")
    return record
