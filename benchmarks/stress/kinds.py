"""One input of every kind that glsim reads, small and sound, and the code that reads it whole."""

from __future__ import annotations

import json
import re
import struct
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchmarks.stress import networks
from benchmarks.stress.array_kinds import ARRAY_KINDS
from benchmarks.stress.damage import Kind, bytes_kind, change_value, change_words
from benchmarks.stress.dataset_kinds import DATASET_KINDS
from benchmarks.stress.meshes import write_mesh
from benchmarks.stress.text_kinds import TEXT_KINDS
from tests.support import mutations


def _mesh(folder: Path, suffix: str) -> Kind:
    from glsim.meshio.load import load_mesh

    path = folder / f"face.{suffix.removesuffix('-ascii')}"
    write_mesh(path, ascii=suffix.endswith("-ascii"))
    damaged_bytes = bytes_kind(path, load_mesh)
    if suffix not in ("glb", "gltf"):
        return damaged_bytes
    data = path.read_bytes()
    head = b"" if suffix == "gltf" else data[:12]
    length = len(data) if suffix == "gltf" else struct.unpack_from("<I", data, 12)[0]
    start = 0 if suffix == "gltf" else 20

    def change(rng: np.random.Generator) -> None:
        """Change some bytes of the file, or one value of its JSON tree."""
        if rng.random() < 0.4:
            damaged_bytes.change(rng)
            return
        tree = json.loads(data[start : start + length])
        change_value(tree, rng)
        text = json.dumps(tree).encode()
        text += b" " * (-len(text) % 4)
        chunk = struct.pack("<I4s", len(text), b"JSON") if head else b""
        path.write_bytes(head + chunk + text + data[start + length :])

    return Kind(change, damaged_bytes.read)


#: Files of the published face sets, by their names in ``tests.support.mutations.formats``.
_FACE_SET_FILES = (
    "d3dfacs.ply", "d3dfacs-ascii.ply", "d3dfacs.obj", "shape.bs", "shape_0.obj", "pose_1.obj",
    "biwi.obj", "pose.txt", "depth.bin", "depth.cal",
)  # fmt: skip


def _face_set(folder: Path, name: str) -> Kind:
    """Read a damaged file of a face set by its source, at random by a newly opened one."""
    format_ = mutations.formats(folder)[name]
    afresh = False

    def change(rng: np.random.Generator) -> None:
        nonlocal afresh
        format_.target.write_bytes(mutations.mutate(format_.data, rng))
        afresh = bool(rng.random() < 0.1)

    return Kind(change, lambda: format_.read(afresh))


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
    """An ONNX file, run by a runtime in a child process, because a damaged one may crash it."""
    data = networks.onnx_bytes(folder)
    path = folder / "net.onnx"

    def change(rng: np.random.Generator) -> None:
        path.write_bytes(mutations.mutate(data, rng))

    return Kind(change, partial(networks.in_child, partial(networks.run_onnx, path, runtime)))


def _drawn(folder: Path) -> Kind:
    """A shader, compiled and drawn with by the driver in a child process."""
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


#: Name -> a function that prepares the kind in a folder.
KINDS: dict[str, Callable[[Path], Kind]] = {
    "obj": partial(_mesh, suffix="obj"),
    "ply": partial(_mesh, suffix="ply"),
    "ply-ascii": partial(_mesh, suffix="ply-ascii"),
    "stl": partial(_mesh, suffix="stl"),
    "glb": partial(_mesh, suffix="glb"),
    "gltf": partial(_mesh, suffix="gltf"),
    "off": partial(_mesh, suffix="off"),
    **{name: partial(_face_set, name=name) for name in _FACE_SET_FILES},
    "png": _image,
    **TEXT_KINDS,
    **DATASET_KINDS,
    **ARRAY_KINDS,
    "checkpoint": _checkpoint,
    "glsl-drawn": _drawn,
    "onnx": partial(_onnx, runtime="onnxruntime"),
    "onnx-opencv": partial(_onnx, runtime="opencv"),
}
