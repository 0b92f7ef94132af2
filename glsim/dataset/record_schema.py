"""The schema of what a data set says of itself: dataset.json, manifest lines, chunk records.

A record is JSON that anybody may have changed. It is parsed and checked in one step by pydantic's
compiled validators (types, ranges, finite numbers, known names, nesting up to 200 levels), and
nothing of it is used before. Keys that are not listed here are kept as they are: a later version
may add some. What a record may name is a file inside the data set, see ``RELATIVE_NAME``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired, get_args

from pydantic import ConfigDict, Field, StringConstraints, TypeAdapter, ValidationError
from typing_extensions import TypedDict  # what pydantic needs before Python 3.12

from glsim.errors import DatasetError
from glsim.files.atomic import wrap_read_errors
from glsim.files.png import MAX_IMAGE_BYTES, MAX_SIDE_PX
from glsim.files.regular import read_regular
from glsim.settings.schema import DEPTH_UNIT_MM, LayerName

#: Largest dataset.json, bytes: twice the names of 100,000 subjects and the checksums of as many
#: shards. 17 MB of short keys take 400 MB and a second to parse.
MAX_HEADER_BYTES = 1 << 24
#: Largest line of a manifest, bytes; the longest that is written (52 expressions, notes) has 6,000.
MAX_LINE_BYTES = 1 << 17
#: Most frames of one data set: file names number them with eight digits.
MAX_FRAMES = 10**8

#: One part of a path: no slash, no control characters, not "." and not "..".
_ANY, _NO_DOT = r"[^/\x00-\x1f\x7f]", r"[^/.\x00-\x1f\x7f]"
_WORD = rf"(?:{_NO_DOT}{_ANY}*|\.{_NO_DOT}{_ANY}*|\.\.{_ANY}+)"
#: The name of a file inside the data set: words with slashes between them.
RELATIVE_NAME = rf"^{_WORD}(?:/{_WORD}){{0,7}}$"

Word = Annotated[str, StringConstraints(pattern=rf"^{_WORD}$", max_length=255)]
FileName = Annotated[str, StringConstraints(pattern=RELATIVE_NAME, max_length=1024)]
Text = Annotated[str, StringConstraints(max_length=100_000)]
Count = Annotated[int, Field(strict=True, ge=0, le=MAX_FRAMES)]
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e9, le=1e9)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=1e9)]
Side = Annotated[int, Field(strict=True, ge=1, le=MAX_SIDE_PX)]
Pixel = Annotated[int, Field(strict=True, ge=-MAX_SIDE_PX, le=MAX_SIDE_PX)]
Code = Annotated[int, Field(strict=True, ge=0, le=255)]
Bytes = Annotated[int, Field(strict=True, ge=0, le=2**53)]
Crc32 = Annotated[int, Field(strict=True, ge=0, lt=2**32)]
Split = Literal["train", "val", "test"]
Unit = Annotated[
    float,
    Field(strict=True, allow_inf_nan=False, ge=DEPTH_UNIT_MM[0], le=DEPTH_UNIT_MM[1]),
]
#: Largest offset of stored depths, mm: that of the largest depth in the largest steps.
Offset = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-655_350, le=655_350)]


_Couple = Annotated[list[Number], Field(min_length=2, max_length=2)]
_Triple = Annotated[list[Number], Field(min_length=3, max_length=3)]
_Row = Annotated[list[Number], Field(min_length=4, max_length=4)]


class FileRecord(TypedDict):
    """Size and CRC32 of a listed file."""

    __pydantic_config__ = ConfigDict(extra="allow")  # type: ignore[misc]
    size: Bytes
    crc32: Crc32


class ImageRecord(TypedDict):
    """An image file, or a member of a shard at an offset, bytes."""

    __pydantic_config__ = ConfigDict(extra="allow")  # type: ignore[misc]
    name: FileName
    size: Annotated[int, Field(strict=True, ge=0, le=MAX_IMAGE_BYTES)]
    crc32: Crc32
    member: NotRequired[Word]
    offset: NotRequired[Bytes]


class IntrinsicsRecord(TypedDict):
    """The fields of ``glsim.geometry.camera.Intrinsics``."""

    __pydantic_config__ = ConfigDict(extra="forbid")  # type: ignore[misc]
    width: Side
    height: Side
    fx: Positive
    fy: Positive
    cx: Number
    cy: Number


class LandmarksRecord(TypedDict):
    """The fields of ``glsim.frame.Landmarks``."""

    __pydantic_config__ = ConfigDict(extra="forbid")  # type: ignore[misc]
    points_m: Annotated[list[_Triple], Field(min_length=68, max_length=68)]
    pixels: Annotated[list[_Couple], Field(min_length=68, max_length=68)]
    visible: Annotated[list[bool], Field(min_length=68, max_length=68)]


class FrameRecord(TypedDict):
    """A line of the manifest, see ``glsim.dataset.records.frame_record``."""

    __pydantic_config__ = ConfigDict(extra="allow")  # type: ignore[misc]
    index: Count
    split: Split
    subject: Word
    sequence: Word
    frame: Count
    intrinsics: IntrinsicsRecord
    depth_offset_mm: Offset
    files: dict[LayerName, ImageRecord]
    time_s: NotRequired[Finite]
    source: NotRequired[Text]
    path: NotRequired[Text]
    device: NotRequired[Count]
    seeds: NotRequired[dict[str, Text]]
    pose: NotRequired[dict[str, Number]]
    expression: NotRequired[dict[str, Number]]
    parameters: NotRequired[dict[str, Finite]]
    window: NotRequired[Annotated[list[Pixel], Field(min_length=4, max_length=4)]]
    notes: NotRequired[dict[str, Any]]
    head_to_camera: NotRequired[Annotated[list[_Row], Field(min_length=4, max_length=4)]]
    landmarks: NotRequired[LandmarksRecord]
    regions: NotRequired[dict[str, Code]]


class ShardRecord(TypedDict):
    """A shard and its checksum."""

    __pydantic_config__ = ConfigDict(extra="allow")  # type: ignore[misc]
    name: FileName
    size: Bytes
    crc32: Crc32


class SummaryRecord(TypedDict):
    """The first line of a chunk record, see ``glsim.dataset.records.ChunkSummary``."""

    __pydantic_config__ = ConfigDict(extra="forbid")  # type: ignore[misc]
    chunk: Count
    frames: Count
    skipped: Count
    bytes: Bytes
    shard: ShardRecord | None


class _OutputTable(TypedDict):
    __pydantic_config__ = ConfigDict(extra="allow")  # type: ignore[misc]
    layers: Annotated[list[LayerName], Field(min_length=1, max_length=len(get_args(LayerName)))]
    format: Literal["png", "webdataset"]


class _SourceTable(TypedDict):
    __pydantic_config__ = ConfigDict(extra="allow")  # type: ignore[misc]
    kind: Text


class _SettingsTable(TypedDict):
    __pydantic_config__ = ConfigDict(extra="allow")  # type: ignore[misc]
    output: _OutputTable
    sensor: NotRequired[Text]
    seed: NotRequired[Annotated[int, Field(strict=True, ge=0, lt=2**63)]]
    source: NotRequired[list[_SourceTable]]


class _SensorTable(TypedDict):
    __pydantic_config__ = ConfigDict(extra="allow")  # type: ignore[misc]
    name: NotRequired[Text]
    title: NotRequired[Text]


class _Frames(TypedDict):
    __pydantic_config__ = ConfigDict(extra="forbid")  # type: ignore[misc]
    train: Count
    val: Count
    test: Count


class HeaderRecord(TypedDict):
    """dataset.json, as far as a reader uses it."""

    __pydantic_config__ = ConfigDict(extra="allow")  # type: ignore[misc]
    format: Literal["glsim"]
    frames: _Frames
    depth_unit_mm: Unit
    settings: _SettingsTable
    files: dict[FileName, FileRecord]
    format_version: NotRequired[Annotated[int, Field(strict=True, ge=0)]]
    sensor: NotRequired[_SensorTable]
    subjects: NotRequired[dict[Split, list[Word]]]
    skipped: NotRequired[Count]
    planned_frames: NotRequired[Count]
    regions: NotRequired[dict[str, Code]]


_FILE_NAME = re.compile(rf"{RELATIVE_NAME[:-1]}\Z")  # Python's $ also matches before a newline
_FRAME: TypeAdapter[FrameRecord] = TypeAdapter(FrameRecord)
_HEADER: TypeAdapter[HeaderRecord] = TypeAdapter(HeaderRecord)
_SUMMARY: TypeAdapter[SummaryRecord] = TypeAdapter(SummaryRecord)
_FILE: TypeAdapter[FileRecord] = TypeAdapter(FileRecord)
_OBJECT: TypeAdapter[dict[str, Any]] = TypeAdapter(dict[str, Any])


def is_file_name(name: str) -> bool:
    """Return whether a name is that of a file inside the data set."""
    return _FILE_NAME.match(name) is not None and len(name) <= 1024


def parse_frame(line: bytes | str, where: str) -> dict[str, Any]:
    """Parse and check a line of a manifest. Raises DatasetError: ``where`` and the field."""
    return _parse(_FRAME, line, where)


def parse_summary(line: bytes | str, where: str) -> dict[str, Any]:
    """Parse and check the first line of a chunk record. Raises DatasetError."""
    return _parse(_SUMMARY, line, where)


def parse_checksum(line: bytes | str, where: str) -> dict[str, Any]:
    """Parse and check a recorded size and CRC32. Raises DatasetError."""
    return _parse(_FILE, line, where)


def parse_header(data: bytes, where: str) -> dict[str, Any]:
    """Parse and check the bytes of dataset.json. Raises DatasetError."""
    return _parse(_HEADER, data, where)


def read_object(path: Path) -> tuple[dict[str, Any], bytes]:
    """Read a header as any JSON object, not checked yet, and its bytes. Raises DatasetError."""
    with wrap_read_errors(path):
        data = read_regular(path, MAX_HEADER_BYTES, inside=path.parent)
    return parse_object(data, f"{path}:"), data


def parse_object(data: bytes, where: str) -> dict[str, Any]:
    """Parse bytes as any JSON object. Raises DatasetError."""
    return _parse(_OBJECT, data, where)


def _parse(adapter: TypeAdapter[Any], data: bytes | str, where: str) -> dict[str, Any]:
    try:
        value: dict[str, Any] = adapter.validate_json(data)
    except ValidationError as error:
        raise DatasetError(f"{where} is damaged: {_problem(error)}") from None
    return value


def _problem(error: ValidationError) -> str:
    """Describe the first problem in one line: the field and what is wrong with it."""
    problem: Mapping[str, Any] = error.errors(include_url=False)[0]
    if problem["type"] == "json_invalid":
        return str(problem["msg"]).removeprefix("Invalid JSON: ")
    field = ".".join(ascii(part).strip("'")[:60] for part in problem["loc"]) or "it"
    if problem["type"] == "missing":
        return f"it lacks {field}"
    if problem["type"] == "string_pattern_mismatch":
        return f"{field}: {_short(problem['input'])} does not name a file inside the data set"
    given = problem["input"]
    tail = f" (got {_short(given)})" if isinstance(given, str | int | float | None) else ""
    return f"{field}: {problem['msg']}{tail}"


def _short(value: object) -> str:
    text = ascii(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
