"""One input of every kind that glsim reads, small and sound, and the code that reads it whole."""

from __future__ import annotations

import json
import re
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchmarks.stress import networks
from benchmarks.stress.damage import change_value, change_words
from benchmarks.stress.meshes import write_mesh
from glsim.files.atomic import file_checksum
from tests.support import mutations
from tests.support.dataset_fakes import make, make_settings, make_tasks, sign

_SENSOR = """
title = "mine"
[rig]
width = 64
height = 48
focal_px = [60.0, 60.0]
centre_px = [32.0, 24.0]
supersample = 3
[rig.distortion]
k1 = 0.05
[[rig.emitter]]
position_m = [0.045, 0, 0]
[[stage]]
use = "shadow"
[[stage]]
use = "axial"
base_sigma_mm = { uniform = [1, 3], per = "sequence" }
[[stage]]
use = "despeckle"
min_area_px = 20
"""
_CONFIG = """
sensor = "kinect-v2-paper"
seed = 7
split = [0.7, 0.12, 0.18]
[[source]]
kind = "procedural"
subjects = 10
weight = 2
[pose]
yaw_deg = { uniform = [-30, 30] }
distance_mm = { normal = [900, 50] }
[scene]
wall_mm = 1500
[stage.axial]
base_sigma_mm = 2.0
[output]
crop = 128
layers = ["clean", "noisy"]
depth_unit_mm = 0.5
"""
_RECIPE = """
extends = "paper"
title = "mine"
[model]
kind = "mask_aware"
uncertainty = true
backbone = { kind = "small_unet", width = 8, scales = 3, blocks = 2, growth = 0.5 }
[loss]
kind = "masked"
depth = "gaussian"
[optimiser]
lr = 1e-3
[training]
batch = 4
max_steps = 10
[data]
crop = 64
flip = true
"""
_GLSL = """#version 330 core
// mine: adds some noise
#include "reason.glsl"
uniform sampler2D u_depth;
uniform float sigma_mm = 1.5; //@ [0, 20] mm standard deviation
uniform int steps = 3; //@ [1, 8] 1 how many
uniform bool on = true; //@ 1 whether
uniform uvec2 u_seed;
out float depth; //@ 1/3 of the frame
void main() { depth = texelFetch(u_depth, ivec2(gl_FragCoord.xy), 0).r + sigma_mm; }
"""


@dataclass(frozen=True)
class Kind:
    """A kind of input. change: makes a damaged copy; read: reads it; None if there was no error.

    read raises GlsimErrors for what it refuses, or returns the reason.
    """

    change: Callable[[np.random.Generator], None]
    read: Callable[[], str | None]


def _bytes(path: Path, read: Callable[[Path], object]) -> Kind:
    """A file whose bytes are damaged."""
    data = path.read_bytes()

    def change(rng: np.random.Generator) -> None:
        path.write_bytes(mutations.mutate(data, rng))

    def whole() -> None:
        read(path)

    return Kind(change, whole)


def _mesh(folder: Path, suffix: str) -> Kind:
    from glsim.meshio.load import load_mesh

    path = folder / f"face.{suffix.removesuffix('-ascii')}"
    write_mesh(path, ascii=suffix.endswith("-ascii"))
    bytes_kind = _bytes(path, load_mesh)
    if suffix not in ("glb", "gltf"):
        return bytes_kind
    data = path.read_bytes()
    head = b"" if suffix == "gltf" else data[:12]
    length = len(data) if suffix == "gltf" else struct.unpack_from("<I", data, 12)[0]
    start = 0 if suffix == "gltf" else 20

    def change(rng: np.random.Generator) -> None:
        """Damage the bytes, or change a value of the tree."""
        if rng.random() < 0.4:
            bytes_kind.change(rng)
            return
        tree = json.loads(data[start : start + length])
        change_value(tree, rng)
        text = json.dumps(tree).encode()
        text += b" " * (-len(text) % 4)
        chunk = struct.pack("<I4s", len(text), b"JSON") if head else b""
        path.write_bytes(head + chunk + text + data[start + length :])

    return Kind(change, bytes_kind.read)


def _face_set(folder: Path, name: str) -> Kind:
    """A file of FaceWarehouse's or Biwi's layout, read through its source."""
    format_ = mutations.formats(folder)[name]
    outcome: list[str | None] = [None]

    def change(rng: np.random.Generator) -> None:
        format_.target.write_bytes(mutations.mutate(format_.data, rng))

    def read() -> str | None:
        outcome[0] = format_.read(False)
        return outcome[0]

    return Kind(change, read)


def _text(folder: Path, name: str, content: str, read: Callable[[Path], object]) -> Kind:
    path = folder / name
    path.write_text(content)

    def change(rng: np.random.Generator) -> None:
        data = content.encode()
        path.write_bytes(
            change_words(content, rng) if rng.random() < 0.7 else mutations.mutate(data, rng)
        )

    def whole() -> None:
        read(path)

    return Kind(change, whole)


def _image(folder: Path) -> Kind:
    from glsim.files.png import encode_png, read_depth_png

    path = folder / "map.png"
    image = np.arange(48 * 64, dtype=np.uint16).reshape(48, 64)
    path.write_bytes(encode_png(image))
    data = path.read_bytes()

    def change(rng: np.random.Generator) -> None:
        """Damage it; in half of the cases make the CRC32 of its header right again."""
        changed = mutations.mutate(data, rng)
        if rng.random() < 0.5 and len(changed) > 33:
            changed = changed[:29] + struct.pack(">I", zlib.crc32(changed[12:29])) + changed[33:]
        path.write_bytes(changed)

    def read() -> None:
        read_depth_png(path)

    return Kind(change, read)


def _sensor(path: Path) -> None:
    from glsim.sensors.sensor import load_sensor

    load_sensor(str(path)).describe()


def _config(path: Path) -> None:
    from glsim.settings.schema import load_settings

    load_settings(path)


def _recipe(path: Path) -> None:
    from glsim.train.losses.registry import build_loss
    from glsim.train.models.registry import weight_shapes
    from glsim.train.recipe import load_recipe

    recipe = load_recipe(str(path))
    build_loss(recipe.loss)
    weight_shapes(recipe.model)


def _glsl(path: Path) -> None:
    from glsim.noise.registry import find_stage

    find_stage(str(path))


def _checkpoint(folder: Path) -> Kind:
    """A checkpoint whose bytes are damaged, or whose recipe's values are changed."""
    from glsim.denoise import checkpoint
    from glsim.denoise.inference import load_network
    from glsim.train.models.registry import build_model

    path = folder / "best.pt"
    model = {"kind": "mask_aware", "backbone": {"kind": "dncnn", "depth": 3, "width": 4}}
    content: dict[str, Any] = {
        "recipe": {"model": model},
        "model": build_model(model).state_dict(),
        "data": {},
        "progress": {},
        "validation": {},
    }
    checkpoint.save(path, content)
    data = path.read_bytes()

    def change(rng: np.random.Generator) -> None:
        if rng.random() < 0.5:
            path.write_bytes(mutations.mutate(data, rng))
        else:
            recipe = json.loads(json.dumps(content["recipe"]))
            change_value(recipe, rng)
            checkpoint.save(path, content | {"recipe": recipe})

    def read() -> None:
        load_network(path)

    return Kind(change, read)


def _onnx(folder: Path, runtime: Literal["onnxruntime", "opencv"]) -> Kind:
    """A network for an ONNX runtime, in a process of its own, as a runtime may crash."""
    data = networks.onnx_bytes(folder)
    path = folder / "net.onnx"

    def change(rng: np.random.Generator) -> None:
        path.write_bytes(mutations.mutate(data, rng))

    return Kind(change, partial(networks.in_child, partial(networks.run_onnx, path, runtime)))


def _drawn(folder: Path) -> Kind:
    """A shader that the driver compiles and draws with, in a process of its own."""
    import glsim.corrupt  # noqa: F401 (so that each process need not)

    path = folder / "mine.glsl"
    path.write_text(networks.SHADER)

    def change(rng: np.random.Generator) -> None:
        """Change words, or put one of the shader's own in the place of another."""
        text = networks.SHADER
        if rng.random() < 0.4:
            path.write_bytes(change_words(text, rng))
            return
        words = list(re.finditer(r"[\w.]+|[-+*/=<>&|!]+", text))
        old, new = (words[int(n)] for n in rng.integers(12, len(words), 2))
        path.write_text(text[: old.start()] + new[0] + text[old.end() :])

    return Kind(change, partial(networks.in_child, partial(networks.draw, path)))


def read_dataset(root: Path) -> None:
    """Read a data set by its reader, frame by frame, and verify it; verify must not raise."""
    from glsim.dataset import open_dataset, verify
    from glsim.dataset.noise_statistics import measure_noise
    from glsim.preview import PreviewFrame
    from glsim.train.data.checks import checked_split, fingerprint

    for problem in verify(root, deep=True):
        assert "\n" not in problem, problem
    dataset = open_dataset(root)
    pairs = list(dataset)
    for pair in pairs:
        PreviewFrame.of_pair(pair)
    measure_noise(pairs)
    fingerprint(root)
    checked_split(dataset, "train", None, "no")


def _dataset(folder: Path, file: str, format: str = "png", *, signed: bool) -> Kind:
    """A data set with one damaged file. signed: with checksums that fit, as an attacker's."""
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
KINDS: dict[str, Callable[[Path], Kind]] = {
    "obj": partial(_mesh, suffix="obj"),
    "ply": partial(_mesh, suffix="ply"),
    "ply-ascii": partial(_mesh, suffix="ply-ascii"),
    "stl": partial(_mesh, suffix="stl"),
    "glb": partial(_mesh, suffix="glb"),
    "gltf": partial(_mesh, suffix="gltf"),
    "off": partial(_mesh, suffix="off"),
    "shape.bs": partial(_face_set, name="shape.bs"),
    "biwi-depth": partial(_face_set, name="depth.bin"),
    "biwi-pose": partial(_face_set, name="pose.txt"),
    "png": _image,
    "sensor": partial(_text, name="mine.toml", content=_SENSOR, read=_sensor),
    "config": partial(_text, name="mine.toml", content=_CONFIG, read=_config),
    "recipe": partial(_text, name="mine.toml", content=_RECIPE, read=_recipe),
    "glsl": partial(_text, name="mine.glsl", content=_GLSL, read=_glsl),
    "manifest": partial(_dataset, file="manifest.jsonl", signed=False),
    "header": partial(_dataset, file="dataset.json", signed=False),
    "manifest-values": partial(_dataset, file="manifest.jsonl", signed=True),
    "header-values": partial(_dataset, file="dataset.json", signed=True),
    "shard-values": partial(_dataset, file="manifest.jsonl", format="webdataset", signed=True),
    "chunk-record": _chunk,
    "checkpoint": _checkpoint,
    "glsl-drawn": _drawn,
    "onnx": partial(_onnx, runtime="onnxruntime"),
    "onnx-opencv": partial(_onnx, runtime="opencv"),
}
