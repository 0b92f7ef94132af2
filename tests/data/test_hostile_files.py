"""Files made to cost much: each reader reads them cheaply, or refuses them in one line."""

# ruff: noqa: E501  (tables: one attack a line)

import base64
import io
import json
import os
import sqlite3
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest
from rosbags.rosbag2.storage_mcap import zstd

from glsim.core.files.exr import encode_exr
from glsim.core.files.png import _chunk, encode_png
from glsim.data.map_files import DUMPS, READ_ONLY, SUFFIXES
from glsim.data.recordings.folders import _READERS as CAMERAS
from glsim.data.recordings.streams import STREAMS
from glsim.faces.meshes.obj import EXTENSIONS
from tests.data.test_damaged_files import YAML
from tests.support.bags import azure_calibration, write_mkv, write_topics

#: What reading may cost above an intact file of 1 kB: memory, MB, and MB for each MB of the file
#: that is no hole; CPU seconds, and seconds for each such MB.
MB, MB_EACH, SECONDS, SECONDS_EACH = 64, 8, 5, 2

#: Content of a file, or a function that makes the path.
Content = bytes | Callable[[Path], object]
POINTS = "".join(f"v {x} {y} {z}\n" for x, y, z in ((0, 0, 0), (90, 0, 0), (90, 90, 0), (0, 90, 9)))
PLY = "ply\nformat {} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
CORNERS = np.array([[0, 0, 0], [90, 0, 0], [90, 90, 0], [0, 90, 9]], "<f4").tobytes()
BINARY = "binary_little_endian"


def holes(head: bytes, size: int = 900_000_000) -> Callable[[Path], object]:
    """Make a file of zeros behind a head; it takes no space on the disk."""

    def make(path: Path) -> None:
        path.write_bytes(head)
        os.truncate(path, size)

    return make


def ply(rows: str, body: bytes, encoding: str = BINARY, lists: str = "uchar int") -> bytes:
    face = f"element face {rows}\nproperty list {lists} vertex_indices\nend_header\n"
    points = CORNERS if encoding == BINARY else POINTS.replace("v", "").encode()
    return (PLY.format(encoding) + face).encode() + points + body


def gltf(**changes: object) -> bytes:
    """Make a GLB of two triangles, with changed parts of its JSON."""
    data = CORNERS + struct.pack("<6H", 0, 1, 2, 0, 2, 3)
    tree: dict[str, object] = {
        "asset": {"version": "2.0"}, "nodes": [{"mesh": 0}], "buffers": [{"byteLength": 60}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "bufferViews": [{"buffer": 0, "byteLength": 48},
                        {"buffer": 0, "byteOffset": 48, "byteLength": 12}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
                      {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}],
    }  # fmt: skip
    text = json.dumps(tree | changes).encode()
    if "buffers" in changes:
        return text
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4s4I", b"glTF", 2, 28 + len(text) + 60, len(text), 0x4E4F534A)
    return head + text + struct.pack("<2I", 60, 0x004E4942) + data


OBJ = POINTS.encode()
FACES = b"f 1 2 3\nf 1 3 4\n"
FACET = (
    "facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex {} 0 0\nvertex 0 9 0\nendloop\nendfacet\n"
)
FAN = b"f " + b"1 2 3 " * 200_000 + b"\n"
STAR = b"".join(
    b"v %d %d 0\n" % tuple(p) for p in np.random.default_rng(0).integers(0, 9**5, (9**5, 2))
)
TREE = {"componentType": 5126, "count": 4_000_000, "type": "VEC3"}

#: Reader -> an intact file, and name of an attack -> its file.
TABLE: dict[str, tuple[Content, dict[str, Content]]] = {
    ".ply": (ply("2", struct.pack("<B3iB3i", 3, 0, 1, 2, 3, 0, 2, 3)), {
        "rows without properties": b"ply\nformat ascii 1.0\nelement a 2147483647\nend_header\n1\n",
        "binary without properties": f"ply\nformat {BINARY} 1.0\nelement vertex 2147483647\nelement"
        " face 2147483647\nend_header\n".encode(),
        "many rows": ply("2147483647", b"\3" * 9),
        "many rows in ASCII": ply("2147483647", b"3 0 1 2\n" * 9, "ascii"),
        "a long list": ply("1", struct.pack("<I3i", 2**31, 0, 1, 2), lists="uint int"),
        "lists of every length": ply("1400", b"".join(bytes([n // 256, n % 256]) + bytes(n)
                                     for n in range(1400)).replace(b"", b""), lists="uchar uchar"),
        "rows of one byte": ply("1000000", b"\1\0" + bytes(999_999), lists="uchar uchar"),
        "words in ASCII": ply("2", b"3 0 1 2\n3 0 2 3\n" + b"12 " * 300_000, "ascii"),
        "a header without end": holes(b"ply\nformat ascii 1.0\n"),
        "zeros behind": holes(ply("1", struct.pack("<B3i", 3, 0, 1, 2))),
        "many properties": b"ply\nformat ascii 1.0\nelement vertex 9\n" + b"property int x\n" * 60_000,
    }),
    ".off": (b"OFF\n4 2 0\n" + OBJ.replace(b"v ", b"") + b"3 0 1 2\n3 0 2 3\n", {
        "many points": b"OFF 2147483647 1 0\n0 0 0\n3 0 0 0\n",
        "many faces": b"OFF 1 2147483647 0\n0 0 0\n3 0 0 0\n",
        "zeros": holes(b""), "zeros behind": holes(b"OFF\n3 1 0\n"),
        "short lines": b"OFF\n160000 1 0\n" + b"0 0 0\n" * 160_000 + b"3 0 1 2\n",
        "one face": b"OFF\n4 1 0\n" + OBJ.replace(b"v ", b"") + b"400000 " + b"0 1 " * 200_000,
    }),
    ".obj": (OBJ + FACES, {
        "zeros": holes(b""), "zeros behind": holes(OBJ, 9_000_000),
        "one face": OBJ + b"v 30 20 0\n" + FAN.replace(b"1 2 3", b"1 5 3 "),
        "a random star": STAR + b"f " + b" ".join(b"%d" % n for n in range(1, 9**5)),
        "short faces": OBJ + b"f 1 2 3\n" * 120_000, "short points": OBJ + b"v 0 0 0\n" * 120_000,
        "several lengths": b"v 0 0 0\nv 0 1 0 1\n" * 60_000 + FACES,
        "empty lines": OBJ + b"\n" * 1_000_000 + FACES, "vn": OBJ + b"vn\n" * 330_000 + FACES,
        "hollow quads": b"v 0 0 0\nv 9 0 0\nv 1 1 0\nv 0 9 0\n" + b"f 1 2 3 4\n" * 100_000,
        "bent quads": b"v 0 0 0\nv 9 0 0\nv 1 1 9\nv 0 9 0\n" + b"f 1 2 3 4\n" * 100_000,
        "material files": b"mtllib " + b"a " * 500_000 + b"\n" + OBJ + FACES,
        "mtllib lines": b"".join(b"mtllib %d\n" % n for n in range(90_000)) + OBJ + FACES,
        "no numbers": OBJ + b"nan(" * 250_000 + FACES, "comments": OBJ + b"# f\\\n" * 200_000 + FACES,
    }),
    ".stl": (bytes(80) + struct.pack("<I12fH", 1, *[0.0] * 6, 9, 0, 0, 0, 9, 0, 0), {
        "many triangles": bytes(80) + struct.pack("<I12fH", 2**32 - 1, *[0.0] * 12, 0),
        "zeros": holes(b""), "zeros behind": holes(bytes(80) + struct.pack("<I12fH", 1, *[1.0] * 12, 0)),
        "text": f"solid a\n{''.join(FACET.format(n) for n in range(1, 9999))}endsolid".encode(),
        "solids": "".join(f"solid {n}\n{FACET.format(n)}endsolid\n" for n in range(1, 9999)).encode(),
        "words": b"solid a\nfacet normal" + b" 1" * 500_000,
    }),
    ".glb": (gltf(), {
        "instances": gltf(nodes=[{"mesh": 0}] * 90_000),
        "primitives": gltf(meshes=[{"primitives": [{"attributes": {"POSITION": 0}}] * 20_000}]),
        "empty parts": gltf(nodes=[{"mesh": 0}] * 9000, meshes=[{"primitives": [{"attributes": {"POSITION": 0}}] * 9000}], accessors=[{**TREE, "count": 0}]),
        "zeros without bytes": gltf(accessors=[TREE, {**TREE, "componentType": 5121, "type": "SCALAR"}]),
        "targets": gltf(meshes=[{"weights": [1] * 90_000, "primitives": [{"attributes": {"POSITION": 0}, "targets": [{"POSITION": 0}] * 90_000}]}]),
        "joints": gltf(nodes=[{"mesh": 0, "skin": 0}] * 900, skins=[{"joints": [0] * 90_000}], meshes=[{"primitives": [{"attributes": {"POSITION": 0, "JOINTS_0": 0, "WEIGHTS_0": 0}}]}]),
        "lists": gltf(extras=[[]] * 900_000), "objects": gltf(extras=[{}] * 900_000),
        "nodes": gltf(nodes=[{"scale": [1, 1, 1]}] * 40_000), "a deep list": b"{" + b'"a":[' * 400_000,
        "children": gltf(nodes=[{"children": [*range(1, 90_000)]}, *[{"mesh": 0}] * 90_000]),
        "zeros behind": holes(gltf()), "zeros": holes(b"glTF" + bytes(8)),
        "overlapping rows": gltf(bufferViews=[{"buffer": 0, "byteLength": 60, "byteStride": 1}] * 2),
    }),
    ".gltf": (gltf(buffers=[{"uri": "data:," + base64.b64encode(gltf()[-60:]).decode(), "byteLength": 60}]) , {
        "spaces": holes(b"{"), "a file of zeros": lambda path: (
            holes(b"")(path.with_suffix(".bin")),
            path.write_text(json.dumps({"buffers": [{"uri": "a.bin", "byteLength": 48}] * 999}))),
    }),
}  # fmt: skip


DEPTH = np.arange(24 * 32, dtype=np.uint16).reshape(24, 32) + np.uint16(600)


def bag(path: Path) -> None:
    write_topics(path, {"/depth/image": (DEPTH, "16UC1")}, {}, count=2)


def zeros(path: Path, at: float = 0.5) -> None:
    """Make a bag with a hole in it."""
    bag(path)
    data = path.read_bytes()
    cut = int(at * len(data))
    holes(data[:cut])(path)
    with path.open("ab") as file:
        file.write(data[cut:])


def database(*commands: str) -> Callable[[Path], object]:
    def make(path: Path) -> None:
        bag(path)
        with closing(sqlite3.connect(path)) as file:
            for command in commands:
                file.execute(command)
            file.commit()

    return make


def ros2(text: str) -> Callable[[Path], object]:
    """Make a folder of a ROS 2 bag with this metadata.yaml."""

    def make(path: Path) -> None:
        path.mkdir()
        os.mkfifo(path / "pipe.db3")
        (path / "metadata.yaml").write_text(text)

    return make


def tiny_records(path: Path) -> None:
    """Make four parts of records without content, 31 MB each, behind those of an intact file."""
    bag(path)
    data = path.read_bytes()
    packed = zstd.compress((b"\5" + struct.pack("<QHIQQ", 22, 9, 0, 0, 0)) * 1_000_000)
    body = struct.pack("<QQQII4sQ", 0, 0, 31_000_000, 0, 4, b"zstd", len(packed)) + packed
    footer = b"\2" + struct.pack("<QQQI", 20, 0, 0, 0) + data[-8:]  # without a summary
    data = data[: struct.unpack("<Q", data[-28:-20])[0]]
    path.write_bytes(data + (b"\6" + struct.pack("<Q", len(body)) + body) * 4 + footer)


def claim(size: int) -> Callable[[Path], object]:
    """Make a Matroska file whose only block says that it has this size; holes follow."""

    def make(path: Path) -> None:
        write_mkv(path, {"DEPTH": [DEPTH]}, azure_calibration())
        data, endless, length = path.read_bytes(), b"\1" + b"\xff" * 7, b"\1" + size.to_bytes(7)
        segment, cluster = data.index(b"\x18S\x80g"), data.index(b"\x1fC\xb6u")
        block = b"\x1fC\xb6u" + endless + b"\xe7\x81\0\xa3" + length + b"\x81\0\0\x80"
        head = data[: segment + 4] + endless + data[segment + 12 : cluster]
        holes(head + block)(path)

    return make


INFO = (
    "rosbag2_bagfile_information: {version: 5, storage_identifier: %s, duration: {nanoseconds: 1},"
    " starting_time: {nanoseconds_since_epoch: 1}, message_count: 1, relative_file_paths: [%s],"
    " topics_with_message_count: [%s]}"
)
ENDLESS = "WITH RECURSIVE a(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM a) SELECT n"
TABLE |= {
    ".bag": (bag, {
        "zeros": holes(b"", 3 << 30), "zeros behind": holes(b"#ROSBAG V2.0\n", 3 << 30),
        "a hole": zeros, "a hole in the index": lambda p: zeros(p, .9), "one line": b"#" * 1_000_000,
    }),
    ".mcap": (bag, {
        "zeros": holes(b""), "zeros behind": holes(b"\x89MCAP0\r\n"), "a hole": zeros,
        "a hole in the index": lambda path: zeros(path, 0.9), "tiny records": tiny_records,
    }),
    ".db3": (bag, {
        "zeros": holes(b""), "zeros behind": holes(b"SQLite format 3\0"),
        "an endless view": database("DROP TABLE message_definitions", f"CREATE VIEW message_definitions AS {ENDLESS} AS topic_type, 1 AS encoding, 1 AS encoded_message_definition, 1 AS type_description_hash, 1 AS id FROM a"),
        "a generated column": database("ALTER TABLE topics ADD COLUMN n GENERATED ALWAYS AS (hex(zeroblob(400000000)))"),
        "a generated blob": database("ALTER TABLE messages RENAME TO m", "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB GENERATED ALWAYS AS (zeroblob(900000000)))", "INSERT INTO messages SELECT id, topic_id, timestamp FROM m"),
        "a long message": database("UPDATE messages SET data = zeroblob(200000000)"),
        "a long name": database("UPDATE topics SET name = hex(zeroblob(9000000))"),
        "long settings": database("UPDATE topics SET offered_qos_profiles = '[' || replace(hex(zeroblob(450000)), '00', '[],') || ']'"),
        "many fields": database("UPDATE message_definitions SET encoded_message_definition = replace(hex(zeroblob(100000)), '00', 'int8 a' || char(10))"),
    }),
    "bag": (lambda path: (bag(path.with_suffix(".mcap")), path.mkdir(), path.with_suffix(".mcap").rename(path / "a.mcap"), (path / "metadata.yaml").write_text(INFO % ("mcap", "a.mcap", "{message_count: 2, topic_metadata: {name: /depth/image, type: sensor_msgs/msg/Image, serialization_format: cdr}}"))), {  # type: ignore[func-returns-value]
        "200 MB of text": ros2("[" + "[]," * 70_000_000), "a pipe": ros2(INFO % ("sqlite3", "pipe.db3", "")),
        "a pipe of records": ros2(INFO % ("mcap", "pipe.db3", "")),
        "anchors": ros2("a: &a []\nb: [" + "*a," * 80_000 + "]"), "lists": ros2("[" + "[]," * 80_000 + "]"),
    }),
    ".mkv": (lambda path: write_mkv(path, {"DEPTH": [DEPTH] * 2}, azure_calibration()), {
        "a block of 900 MB": claim(900_000_000), "a block of 250 MB": claim(250_000_000),
        "a calibration": lambda path: write_mkv(path, {"DEPTH": [np.ones((576, 640), np.uint16)]}, b"[" + b"[]," * 20_000_000),
        "zeros": holes(b""), "zeros behind": holes(b"\x1aE\xdf\xa3"), "a hole": lambda path: (write_mkv(path, {"DEPTH": [DEPTH] * 2}), os.truncate(path, 900_000_000)),  # type: ignore[func-returns-value]
    }),
}  # fmt: skip


PIXELS = struct.pack(">IIBBBBB", 32_000, 32_000, 16, 0, 0, 0, 0)


def png(head: bytes, rows: bytes, *more: bytes) -> bytes:
    parts = (_chunk(b"IHDR", head), *more, _chunk(b"IDAT", zlib.compress(rows, 9)))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts) + _chunk(b"IEND", b"")


def npy(shape: str, kind: str = "<u2") -> bytes:
    head = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    return b"\x93NUMPY\x02\0" + struct.pack("<I", len(head)) + head


def packed(member: bytes) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("depth.npy", member)
    return data.getvalue()


def saved(suffix: str) -> bytes:
    return bytes(cv2.imencode(suffix, DEPTH if suffix != ".pfm" else DEPTH / np.float32(1000))[1])


def beside(text: str) -> Callable[[Path], object]:
    """Make a file that states a camera, beside a map."""

    def make(path: Path) -> None:
        (path.parent / "depth_0.png").write_bytes(encode_png(WALL))
        path.parent.mkdir(exist_ok=True)
        path.write_text(text) if text else holes(b"")(path)

    return make


WALL = np.full((424, 512), 900, np.uint16)
HEAD = struct.pack(">IIBBBBB", 32, 24, 16, 0, 0, 0, 0)
TIFF = saved(".tiff")
EXR = encode_exr(DEPTH / np.float32(1000))
LISTS = "[" + "[]," * 330_000 + "[]]"
FOLDER: dict[str, Content] = {
    "zeros": beside(""),
    "lists": beside(f'{{"a": {LISTS}}}'),
    "one word": beside("9" * 1_000_000),
    "a deep list": beside('{"a":' + "[" * 900_000),
    "lines": beside("1 2 3\n" * 160_000),
    "tables": beside("".join(f"[a{n}]\n" for n in range(90_000))),
    "matrices": beside("a: !!opencv-matrix\n rows: 3\n" * 30_000),
    "a pipe": lambda p: (beside("1")(p), p.unlink(), os.mkfifo(p)),  # type: ignore[func-returns-value]
}
TABLE |= {
    ".png": (png(HEAD, bytes(24 * 65)), {
        "many pixels": png(PIXELS, bytes(1 << 20)), "many rows": png(HEAD, bytes(400_000_000)),
        "a long chunk": png(HEAD, b"")[:33] + b"\x7d\xff\xff\xffIDAT",
        "texts": png(HEAD, bytes(24 * 65), *[_chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(900_000)))] * 900),
        "a colour profile": png(HEAD, bytes(24 * 65), _chunk(b"iCCP", b"a\0\0" + zlib.compress(bytes(90_000_000)))),
        "zeros": holes(b""), "zeros behind": holes(png(HEAD, b"")[:33]), "small chunks": png(HEAD, b"", *[_chunk(b"IDAT", b"")] * 80_000),
    }),
    ".npy": (npy("(24, 32)") + bytes(1536), {
        "many values": npy("(4294967296, 4294967296)"), "many frames": holes(npy("(900000, 24, 32)") + DEPTH.tobytes(), 1_382_400_078),
        "a deep header": npy("(" * 9000), "a long header": npy("(" + "1," * 400_000 + ")"), "zeros": holes(b""),
        "zeros behind": holes(npy("(24, 32)")), "objects": npy("(9,)", "|O"), "many fields": npy("(9,)", "i1," * 90_000),
    }),
    ".npz": (packed(npy("(24, 32)") + DEPTH.tobytes()), {
        "zeros inside": packed(npy("(20000, 20000)") + bytes(800_000_000)), "many values": packed(npy("(4294967296, 9)")),
        "a said size": packed(npy("(24, 32)") + bytes(80_000_000)).replace(struct.pack("<I", 80_000_078 + 0), struct.pack("<I", 1614)),
        "zeros": holes(b"PK\3\4"), "a deep header": packed(npy("(" * 9000)),
    }),
    ".tiff": (TIFF, {
        "zeros": holes(b"II*\0"), "zeros behind": holes(TIFF),
        "many pixels": TIFF.replace(struct.pack("<HHIH", 256, 3, 1, 32), struct.pack("<HHIH", 256, 3, 1, 65535)),
        "many strips": b"II*\0\x08\0\0\0\xff\xff" + b"\x11\x01\x04\0\xff\xff\xff\x7f\0\0\0\0" * 65_535,
    }),
    ".exr": (EXR, {
        "zeros": holes(EXR[:4]), "zeros behind": holes(EXR[:200]),
        "many pixels": EXR.replace(struct.pack("<4i", 0, 0, 31, 23), struct.pack("<4i", 0, 0, 2**30, 2**30)),
        "a long name": EXR[:8] + b"a" * 1_000_000 + EXR[8:],
    }),
    ".pgm": (saved(".pgm"), {"zeros": holes(b"P5 "), "zeros behind": holes(saved(".pgm")),
        "many pixels": b"P5 99999 99999 65535\n", "comments": b"P5 " + b"#\n" * 500_000}),
    ".pfm": (saved(".pfm"), {"zeros": holes(b"Pf\n"), "many pixels": b"Pf 99999 99999 -1\n"}),
    ".depth": (np.full((424, 512), 900, "<f4").tobytes(), {"zeros": holes(b"")}),
    "camera.toml": (beside("unit_mm = 1"), FOLDER), "calib_ir.yaml": (beside(YAML), FOLDER),
    "depth.cal": (beside("365 0 16 0 365 12 0 0 1 0 0 0 0 1 0 0 0 1 0 0 0 1 0 0 0 512 424"), FOLDER),
    "scene_camera.json": (beside('{"0": {"cam_K": [365, 0, 16, 0, 365, 12, 0, 0, 1], "depth_scale": 1}}'), FOLDER),
    "intrinsic.json": (beside('{"width": 512, "height": 424, "intrinsic_matrix": [30, 0, 0, 0, 30, 0, 16, 12, 1]}'), FOLDER),
    "depth.txt": (beside("1.5 depth/1.png"), FOLDER),
}  # fmt: skip
#: Readers whose files are read in every run of the tests.
QUICK = {".ply", ".png", ".npy", ".bag"}
#: Readers that share the code of another.
SAME = {
    ".tif": ".tiff",
    **dict.fromkeys((".bin", ".raw", ".ir"), ".depth"),
    "cameras": "intrinsic.json",
    **dict.fromkeys(("associations.txt", "associated.txt"), "depth.txt"),
    "intrinsic/intrinsic_depth.txt": "depth.cal",
}


@pytest.mark.parametrize(
    "reader", [pytest.param(r, marks=() if r in QUICK else pytest.mark.long) for r in TABLE]
)
def test_hostile_files_are_cheap_or_one_line(tmp_path: Path, reader: str) -> None:
    intact, attacks = TABLE[reader]
    paths = []
    for number, content in enumerate([intact, *attacks.values()]):
        paths.append(tmp_path / str(number) / (f"a{reader}" if reader.startswith(".") else reader))
        paths[-1].parent.mkdir()
        paths[-1].write_bytes(content) if isinstance(content, bytes) else content(paths[-1])
    command = [sys.executable, "-m", "tests.support.hostile_reader", *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stderr) == (0, "")  # nothing by a library
    for name, path, row in zip(attacks, paths[1:], done.stdout.splitlines(), strict=True):
        spent = json.loads(row)
        size_mb = 512e-6 * sum(p.stat().st_blocks for p in path.parent.rglob("*"))
        assert spent["mb"] <= MB + MB_EACH * size_mb, (name, row)
        assert spent["s"] <= SECONDS + SECONDS_EACH * size_mb, (name, row)
        assert "\n" not in spent["line"], (name, row)


def test_every_reader_has_hostile_files() -> None:
    readers = {*EXTENSIONS, *SUFFIXES, *READ_ONLY, *DUMPS, *STREAMS, *CAMERAS, "intrinsic.json"}
    assert {SAME.get(reader, reader) for reader in readers} <= {*TABLE}
