"""Inputs of ``mutate`` that hold arrays or a state of the tuner: stacks, maps, matrices, links."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.stress.damage import Kind, bytes_kind, change_value, change_words
from tests.support import mutations


def _stack(folder: Path) -> Kind:
    """A recording of three frames in one .npy file."""
    from glsim.recordings.recording import open_recording

    path = folder / "depth.npy"
    np.save(path, np.full((3, 24, 32), 900, np.uint16))
    return bytes_kind(path, lambda file: open_recording(file).read(3))


def _pattern_map(folder: Path) -> Kind:
    from glsim.sensors.pattern_map import read_pattern_map

    path = folder / "map.npy"
    np.save(path, np.zeros((24, 32), np.float32))
    return bytes_kind(path, lambda file: read_pattern_map(file, (24, 32)))


def _projector_image(folder: Path) -> Kind:
    from glsim.files.png import encode_png
    from glsim.sensors.projector_image import read_projector_image

    path = folder / "dots.png"
    dots = np.random.default_rng(0).random((24, 32)) < 0.1
    path.write_bytes(encode_png(255 * dots.astype(np.uint8)))
    return bytes_kind(path, lambda file: read_projector_image(file, (90, 60), (400, 400)))


def _matrices(folder: Path) -> Kind:
    """Matrices in OpenCV's YAML; half of the time a word is changed."""
    from glsim.recordings.opencv_yaml import read_matrices

    path = folder / "calib_ir.yaml"
    text = (
        "%YAML:1.0\n---\ncameraMatrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
        "   data: [ 365.4, 0., 254.8, 0., 365.4, 205.4, 0., 0., 1. ]\n"
    )
    path.write_text(text)

    def change(rng: np.random.Generator) -> None:
        words = rng.random() < 0.5
        path.write_bytes(change_words(text, rng) if words else mutations.mutate(text.encode(), rng))

    def read() -> None:
        read_matrices(path)

    return Kind(change, read)


def _link(folder: Path) -> Kind:
    """A link of the tuner, whose text or whose values are changed."""
    from glsim.tune.state import StageCode, Tuning, python_code, set_options, tuning_of_link
    from glsim.tune.trust import check_link

    code = {"axial": StageCode("void main() {}")}
    tuning = Tuning("kinect-v1", {"axial.sigma_mm": {"uniform": [1, 2]}, "seed": 3}, code, 2)
    sound = tuning.link()
    tree = json.loads(zlib.decompress(base64.urlsafe_b64decode(sound + "==")))
    text = sound

    def change(rng: np.random.Generator) -> None:
        nonlocal text
        if rng.random() < 0.3:
            text = mutations.mutate(sound.encode(), rng).decode("latin-1")
            return
        changed = json.loads(json.dumps(tree))
        change_value(changed, rng)
        packed = zlib.compress(json.dumps(changed).encode())
        text = base64.urlsafe_b64encode(packed).decode().rstrip("=")

    def read() -> None:
        opened = tuning_of_link(text)
        check_link(opened, "kinect-v1", folder)
        python_code(opened)
        set_options(opened)

    return Kind(change, read)


ARRAY_KINDS: dict[str, Callable[[Path], Kind]] = {
    "npy-stack": _stack,
    "npy-map": _pattern_map,
    "png-pattern": _projector_image,
    "opencv-yaml": _matrices,
    "tuner-link": _link,
}
