"""Damaged files in each face set's formats, and the outcome of reading them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from glsim.errors import MeshError
from glsim.faces.base import BadFace, Face, FaceSource
from glsim.faces.scans.biwi_files import read_calibration, read_depth_bin
from glsim.faces.sources.biwi import Biwi
from glsim.faces.sources.d3dfacs import D3dfacs
from glsim.faces.sources.facewarehouse import FaceWarehouse
from tests.support.face_sets import (
    COLUMNS,
    FACE,
    TRIANGLES,
    obj_bytes,
    ply_bytes,
    put,
    shape_bytes,
    write_recording,
    write_tester,
)

_INTEGERS = (-1, 0, 1, 3, 45, 46, 47, 255, 65_536, 10**9, 2**31 - 1, -(2**31))
_FLOATS = (float("nan"), float("inf"), -1e38, 1e38, 1e-40, 0.0)
_WORDS = (
    b"nan", b"inf", b"-1", b"0", b"999999999", b"99999999999999999999", b"1e308", b"", b"x", b"1//",
    b"-2147483648", b"\xff", b"\n", b"f", b"v", b"element", b"list", b"end_header",
)  # fmt: skip


def mutate(data: bytes, rng: np.random.Generator) -> bytes:
    """Apply one to three kinds of damage: cut, flip, overwrite, remove, repeat, insert, word."""
    for _ in range(rng.integers(1, 4)):
        if not data:
            return data
        head = rng.random() < 0.4
        at = int(rng.integers(0, min(len(data), 300) if head else len(data)))
        length = int(rng.integers(1, 64))
        damage = rng.integers(0, 8)
        if damage == 0:
            data = data[:at]
        elif damage == 1:
            flipped = bytearray(data)
            for _ in range(rng.integers(1, 9)):
                flipped[min(at + int(rng.integers(0, 16)), len(data) - 1)] ^= 1 << int(
                    rng.integers(0, 8)
                )
            data = bytes(flipped)
        elif damage == 2:
            word = np.array(rng.choice(_INTEGERS), "<i4").tobytes()
            at -= at % 4 if rng.random() < 0.7 else 0
            data = data[:at] + word + data[at + 4 :]
        elif damage == 3:
            data = data[:at] + np.array(rng.choice(_FLOATS), "<f4").tobytes() + data[at + 4 :]
        elif damage == 4:
            data = data[:at] + data[at + length :]
        elif damage == 5:
            data = data[:at] + data[at : at + length] * int(rng.integers(2, 5)) + data[at:]
        elif damage == 6:
            data = data[:at] + rng.bytes(length) + data[at:]
        else:
            words = data.split(b" ")
            words[int(rng.integers(0, min(len(words), 12) if head else len(words)))] = _WORDS[
                int(rng.integers(0, len(_WORDS)))
            ]
            data = b" ".join(words)
    return data


@dataclass(frozen=True)
class Format:
    """A tree with one file to damage, and a function that reads it.

    read: takes ``afresh`` and returns the reason for a skip, or None. afresh: whether to detect
    unit, axes and scale again (0.1 s) instead of reusing them.
    """

    target: Path
    data: bytes
    read: Callable[[bool], str | None]

    def outcome(self, data: bytes, afresh: bool = True) -> str | None:
        """Return the reason why the damaged file is skipped; None if it is usable."""
        self.target.write_bytes(data)
        return self.read(afresh)


def _source_reader(
    open_source: Callable[[], FaceSource], path: str, always: bool = False
) -> Callable[[bool], str | None]:
    """Return a reader of the frames whose file is ``path``, or of all frames without one.

    always: open the source afresh for every file.
    """
    kept = open_source()
    subject = kept.subjects(1)[0]
    list(kept.load(kept.frames(subject, None)[:1]))

    def read(afresh: bool) -> str | None:
        source = open_source() if afresh or always else kept
        keys = list(source.frames(subject, None))
        chosen = [key for key in keys if key.path == path] or keys
        results = list(source.load(chosen[:1] + chosen[-1:]))
        for result in results:
            if isinstance(result, BadFace):
                return str(result.error)
            assert isinstance(result, Face)
            assert np.isfinite(result.mesh.vertices_mm).all()
            assert np.ptp(result.mesh.vertices_mm, axis=0).max() <= 600.1
            assert result.mesh.faces.min() >= 0
            assert result.mesh.faces.max() < len(result.mesh.vertices_mm)
        return None

    return read


def _file_reader(reader: Callable[[Path], object], path: Path) -> Callable[[bool], str | None]:
    def read(afresh: bool) -> str | None:
        try:
            reader(path)
        except MeshError as error:
            return str(error)
        return None

    return read


def _small() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return every other vertex of the analytic face (V, 3), quads (Q, 4) and triangles (F, 3)."""
    points = FACE.reshape(-1, COLUMNS, 3)[::2, ::2]
    rows, columns = points.shape[:2]
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    quads = np.stack([first, first + 1, first + columns + 1, first + columns], axis=1)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return points.reshape(-1, 3), quads, triangles


def _ascii_ply(points: np.ndarray, triangles: np.ndarray) -> bytes:
    head = ply_bytes(points[:0], triangles[:0]).decode().replace("binary_little_endian", "ascii")
    head = head.replace("vertex 0", f"vertex {len(points)}").replace(
        "face 0", f"face {len(triangles)}"
    )
    lines = [" ".join(f"{value:.6g}" for value in point) for point in points]
    lines += [f"3 {a} {b} {c}" for a, b, c in triangles]
    return (head + "\n".join(lines) + "\n").encode()


def formats(root: Path) -> dict[str, Format]:
    """Write a tree for each format below ``root``; the first frame of a sequence stays valid."""
    points, quads, triangles = _small()
    found = {}
    for name, data in (
        ("d3dfacs.ply", ply_bytes(points / 1000, triangles)),
        ("d3dfacs-ascii.ply", _ascii_ply(points / 1000, triangles)),
        ("d3dfacs.obj", obj_bytes(points, triangles, "/1")),
    ):
        suffix = name[-4:]
        whole = (
            ply_bytes(FACE / 1000, TRIANGLES) if suffix == ".ply" else obj_bytes(FACE, TRIANGLES)
        )
        put(root / name / f"Joe/1+2/1+2_1{suffix}", whole)
        target = put(root / name / f"Joe/1+2/1+2_2{suffix}", data)
        tree = root / name
        path = f"Joe/1+2/1+2_2{suffix}"
        found[name] = Format(target, data, _source_reader(partial(D3dfacs, tree), path))

    shapes = np.stack([points * (1 + k / 1000) for k in range(47)]) / 110
    for name, file in (
        ("shape.bs", "Blendshape/shape.bs"),
        ("shape_0.obj", "Blendshape/shape_0.obj"),
        ("pose_1.obj", "TrainingPose/pose_1.obj"),
    ):
        folder = write_tester(root / name, 1, poses=0)
        put(folder / "Blendshape/shape.bs", shape_bytes(shapes))
        obj = obj_bytes(shapes[0], quads, "/1/1")
        put(folder / "Blendshape/shape_0.obj", obj)
        if name == "pose_1.obj":
            put(folder / "TrainingPose/pose_1.obj", obj)
        tree = root / name
        always = name == "shape_0.obj"
        reader = _source_reader(partial(FaceWarehouse, tree), f"Tester_1/{file}", always)
        found[name] = Format(folder / file, (folder / file).read_bytes(), reader)

    for name, file in (("biwi.obj", "01.obj"), ("pose.txt", "01/frame_00004_pose.txt")):
        tree = write_recording(root / name, 1, frames=2)
        put(tree / "01.obj", obj_bytes((points - [3, 12, 0]) * [1, -1, -1], triangles, "//1"))
        data = (tree / file).read_bytes()
        found[name] = Format(
            tree / file, data, _source_reader(partial(Biwi, tree), file, file == "01.obj")
        )
    tree = write_recording(root / "files", 1, frames=1)
    for name, file, reader_of in (
        ("depth.bin", "01/frame_00003_depth.bin", read_depth_bin),
        ("depth.cal", "01/depth.cal", read_calibration),
    ):
        target = tree / file
        found[name] = Format(target, target.read_bytes(), _file_reader(reader_of, target))
    return found
