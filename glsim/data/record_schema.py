"""The schema of a data set's JSON: dataset.json, manifest lines and chunk records.

Anybody may have changed a record, so pydantic parses and checks it before use. Unknown keys stay.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, Literal, NotRequired

from pydantic import AfterValidator, ConfigDict, Field, TypeAdapter, ValidationError
from typing_extensions import TypedDict  # for pydantic before Python 3.12

from glsim.core.errors import DatasetError
from glsim.core.files.png import MAX_IMAGE_BYTES, MAX_SIDE_PX
from glsim.data.disk_format import FORMAT_VERSION
from glsim.settings.schema import DEPTH_UNIT_MM, LayerName

#: Largest dataset.json, bytes: twice the size with the names of 100,000 subjects and the checksums
#: of as many shards. Parsing 17 MB of short keys takes 400 MB and a second.
MAX_HEADER_BYTES = 1 << 24
#: Largest line of a manifest, bytes; the longest written line (52 expressions, notes) has 6,000.
MAX_LINE_BYTES = 1 << 17
_CONTROL = re.compile(r"[\x00-\x1f\x7f]")


def is_file_name(name: str) -> bool:
    """Return whether a name is a relative path that stays inside the data set."""
    words = name.split("/")
    return len(name) <= 1024 and not _CONTROL.search(name) and not {"", ".", ".."} & set(words)


def _inside(name: str) -> str:
    if not is_file_name(name):
        raise ValueError(f"{ascii(name)[:60]} does not name a file inside the data set")
    return name


FileName = Annotated[str, AfterValidator(_inside)]
#: Without any slash: an empty word between two is refused.
Word = Annotated[str, AfterValidator(lambda name: _inside(name.replace("/", "//")))]
Count = Annotated[int, Field(strict=True, ge=0, le=2**53)]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e9, le=1e9)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=1e9)]
Side = Annotated[int, Field(strict=True, ge=1, le=MAX_SIDE_PX)]
Crc32 = Annotated[int, Field(strict=True, ge=0, lt=2**32)]
Split = Literal["train", "val", "test"]
Unit = Annotated[float, Field(strict=True, ge=DEPTH_UNIT_MM[0], le=DEPTH_UNIT_MM[1])]
Row = Annotated[list[Number], Field(min_length=4, max_length=4)]


class _Open(TypedDict):
    """The base of entries whose further keys are kept as they are."""

    __pydantic_config__ = ConfigDict(extra="allow")  # type: ignore[misc]


class _Closed(TypedDict):
    """The base of entries without further keys."""

    __pydantic_config__ = ConfigDict(extra="forbid")  # type: ignore[misc]


class _File(_Open):
    size: Count
    crc32: Crc32


class _Shard(_Open):
    """The entry of a shard; the order of its keys is part of a chunk record's checksum."""

    name: FileName
    size: Count
    crc32: Crc32


class _Image(_Open):
    """The entry of an image, either a file or a shard's member at an offset in bytes."""

    name: FileName
    size: Annotated[int, Field(strict=True, ge=0, le=MAX_IMAGE_BYTES)]
    crc32: Crc32
    member: NotRequired[Word]
    offset: NotRequired[Count]


class _Intrinsics(_Closed):
    width: Side
    height: Side
    fx: Positive
    fy: Positive
    cx: Number
    cy: Number


class _Landmarks(_Closed):
    points_m: Annotated[list[tuple[Number, Number, Number]], Field(min_length=68, max_length=68)]
    pixels: Annotated[list[tuple[Number, Number]], Field(min_length=68, max_length=68)]
    visible: Annotated[list[bool], Field(min_length=68, max_length=68)]


class FrameRecord(_Open):
    """The schema of a manifest line, see ``glsim.data.records.frame_record``."""

    index: Count
    split: Split
    subject: Word
    sequence: Word
    frame: Count
    intrinsics: _Intrinsics
    depth_offset_mm: Number
    files: dict[LayerName, _Image]
    time_s: NotRequired[Number]
    pose: NotRequired[dict[str, Number]]
    head_to_camera: NotRequired[Annotated[list[Row], Field(min_length=4, max_length=4)]]
    landmarks: NotRequired[_Landmarks]
    regions: NotRequired[dict[str, Count]]


class _Summary(_Closed):
    """The schema of a chunk record's first line, see ``glsim.data.records.ChunkSummary``."""

    chunk: Count
    frames: Count
    skipped: Count
    bytes: Count
    shard: _Shard | None


class _Output(_Open):
    layers: Annotated[list[LayerName], Field(min_length=1)]
    format: Literal["png", "webdataset"]


class _Source(_Open):
    kind: str


class _Settings(_Open):
    output: _Output
    source: NotRequired[list[_Source]]


class HeaderRecord(_Open):
    """The schema of the entries of dataset.json that readers use."""

    format: Literal["glsim"]
    frames: dict[Split, Count]
    depth_unit_mm: Unit
    settings: _Settings
    files: dict[FileName, _File]
    sensor: NotRequired[dict[str, Any]]
    subjects: NotRequired[dict[Split, list[Word]]]
    regions: NotRequired[dict[str, Count]]


def _parse(adapter: TypeAdapter[Any], data: bytes | str, where: str) -> dict[str, Any]:
    try:
        value: dict[str, Any] = adapter.validate_json(data)
    except ValidationError as error:
        raise DatasetError(f"{where} is damaged: {_problem(error)}") from None
    return value


def _problem(error: ValidationError) -> str:
    """Describe the first validation error in one line: its field and its message."""
    problem: Mapping[str, Any] = error.errors(include_url=False)[0]
    field = ".".join(ascii(part).strip("'")[:60] for part in problem["loc"])
    message = str(problem["msg"]).removeprefix("Invalid JSON: ").removeprefix("Value error, ")
    return f"{field}: {message}" if field else message


#: Parse and check a manifest line, the first line of a chunk record, and a recorded size and CRC32.
#: Arguments: JSON, and its origin, which a DatasetError names with the field.
parse_frame = partial(_parse, TypeAdapter(FrameRecord))
parse_summary = partial(_parse, TypeAdapter(_Summary))
parse_checksum = partial(_parse, TypeAdapter(_File))
_parse_header = partial(_parse, TypeAdapter(HeaderRecord))


def checksum_of(entry: Mapping[str, Any]) -> dict[str, int]:
    """Return the recorded size and CRC32 of a file's entry."""
    return {"size": entry["size"], "crc32": entry["crc32"]}


def parse_header(data: bytes, where: str) -> dict[str, Any]:
    """Parse and check the bytes of dataset.json. Raises DatasetError."""
    header = _parse_header(data, where)
    if len(header["frames"]) != 3:
        raise DatasetError(f"{where} is damaged: frames: it lacks a split")
    return header


def refuse_newer(header: Mapping[str, Any], where: str) -> None:
    """Raise DatasetError if a newer glsim wrote the header or plan of a data set."""
    version = header.get("format_version", 0)
    if isinstance(version, int) and version > FORMAT_VERSION:
        raise DatasetError(
            f"{where}: format version {version} is newer than {FORMAT_VERSION}, which this glsim "
            "reads and writes: update glsim"
        )
