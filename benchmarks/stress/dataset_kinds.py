"""Files of a data set: its manifest, header and chunk records, damaged or with other values."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.stress.damage import Kind, change_value
from glsim.files.atomic import file_checksum
from tests.support import mutations
from tests.support.dataset_fakes import make, make_settings, make_tasks, sign


def read_dataset(root: Path) -> None:
    """Verify a data set, then read all its frames as the commands do.

    Raises AssertionError if verify raises or a problem takes more than a line.
    """
    from glsim.dataset import open_dataset, verify
    from glsim.measures.depth_errors import measure_errors
    from glsim.preview import PreviewFrame
    from glsim.train.data.checks import checked_split, fingerprint

    for problem in verify(root, deep=True):
        assert "\n" not in problem, problem
    dataset = open_dataset(root)
    pairs = list(dataset)
    for pair in pairs:
        PreviewFrame.of_pair(pair)
    measure_errors(pairs)
    fingerprint(root)
    checked_split(dataset, "train", None, "no")


def _dataset(folder: Path, file: str, format: str = "png", *, signed: bool) -> Kind:
    """A data set with one damaged file.

    Args:
        signed: with checksums that fit, as an attacker's.
    """
    root = folder / "data"
    layers = ["clean", "noisy", "infrared", "reason"]
    make(root, make_settings(format=format, layers=layers), make_tasks(4, 2))
    whole = {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}

    def change(rng: np.random.Generator) -> None:
        for path, data in whole.items():
            path.write_bytes(data)
        target = root / file
        text = target.read_text()
        if signed:
            lines = text.splitlines()
            chosen = int(rng.integers(len(lines))) if file.endswith("jsonl") else 0
            record = json.loads(lines[chosen] if file.endswith("jsonl") else text)
            for _ in range(rng.integers(1, 3)):
                change_value(record, rng)
            lines[chosen] = json.dumps(record)
            changed = "\n".join(lines) + "\n" if file.endswith("jsonl") else json.dumps(record)
            target.write_text(changed)
            _sign(root, header=file == "dataset.json")
        else:
            target.write_bytes(mutations.mutate(text.encode(), rng))

    return Kind(change, partial(read_dataset, root))


def _sign(root: Path, *, header: bool) -> None:
    if not header:
        sign(root)
        return
    index = root / ".glsim" / "chunks.jsonl"
    lines = [*index.read_text().splitlines()[:-1], json.dumps(file_checksum(root / "dataset.json"))]
    index.write_text("\n".join(lines) + "\n")


def _chunk(folder: Path) -> Kind:
    """Chunk records: damaged bytes, and changed values under a CRC32 that fits."""
    from glsim.dataset.records import ChunkRecord, ChunkSummary, parse_chunk_record

    path = folder / "chunk"
    root = folder / "data"
    make(root, make_settings(), make_tasks(2, 2))
    frames = (root / "manifest.jsonl").read_text().splitlines(keepends=True)
    data = ChunkRecord(ChunkSummary(0, len(frames), 0, 5000), frames, []).to_bytes()
    path.write_bytes(data)

    def change(rng: np.random.Generator) -> None:
        if rng.random() < 0.5:
            path.write_bytes(mutations.mutate(data, rng))
            return
        summary = json.loads(data.split(b"\n")[0][9:])
        change_value(summary, rng)
        text = json.dumps(summary, separators=(",", ":"))
        body = "".join([text, *frames])
        crc32 = zlib.crc32(body.encode())
        path.write_text("".join([f"{crc32:08x} {text}\n", *frames]))

    def read() -> None:
        parse_chunk_record(path.read_bytes())

    return Kind(change, read)


#: Name -> a function that prepares the kind in a folder.
DATASET_KINDS: dict[str, Callable[[Path], Kind]] = {
    "manifest": partial(_dataset, file="manifest.jsonl", signed=False),
    "header": partial(_dataset, file="dataset.json", signed=False),
    "manifest-values": partial(_dataset, file="manifest.jsonl", signed=True),
    "header-values": partial(_dataset, file="dataset.json", signed=True),
    "shard-values": partial(_dataset, file="manifest.jsonl", format="webdataset", signed=True),
    "chunk-record": _chunk,
}
