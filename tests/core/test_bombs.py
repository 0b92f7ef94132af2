"""Images that are small on the disk and huge in memory, and files that never end."""

import os
import resource
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.core.errors import DatasetError
from glsim.core.files.png import (
    _chunk,
    decode_png,
    encode_png,
    image_size,
    read_image,
    size_problem,
)
from glsim.core.files.regular import open_regular, read_regular
from glsim.data.layer_images import decode_layer


def bomb(width: int, height: int, bits: int = 16, colour: int = 0) -> bytes:
    """A PNG of zeros that says this size; only some rows are there."""
    rows = zlib.compress(bytes(1 << 20), 9)
    head = struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0)
    parts = (_chunk(b"IHDR", head), _chunk(b"IDAT", rows), _chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000


def test_a_bomb_is_refused_by_its_header_everywhere(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """2 MB of 32,000 x 32,000 pixels took 5.9 GB in denoise and 8 GB in corrupt."""
    data = bomb(32_000, 32_000)
    file = tmp_path / "bomb.png"
    file.write_bytes(data)
    before = peak_mb()
    problem = "is 32000 x 32000 pixels, more than the"
    assert decode_png(data) is None
    with pytest.raises(DatasetError, match=problem):
        read_image(file)
    with pytest.raises(DatasetError, match=problem):
        decode_layer(data, "noisy", "x")
    for command in (["denoise", "-d", "median"], ["corrupt", "--backend", "numpy"]):
        assert main([command[0], str(file), "-o", str(tmp_path / "o.png"), *command[1:]]) == 1
        assert problem in capsys.readouterr().err
    assert peak_mb() - before < 300


@pytest.mark.parametrize("size", [(8193, 1), (1, 2**31 - 1), (2**32 - 1, 2**32 - 1), (4096, 1025)])
def test_maps_have_at_most_four_million_pixels(tmp_path: Path, size: tuple[int, int]) -> None:
    (tmp_path / "wide.png").write_bytes(bomb(*size))
    with pytest.raises(DatasetError, match="more than the"):
        read_image(tmp_path / "wide.png")


@pytest.mark.parametrize("suffix", ["png", "tiff"])
def test_sizes_are_read_as_opencv_reads_them(suffix: str) -> None:
    for image in (np.zeros((7, 300), np.uint16), np.zeros((70_000, 3), np.uint8)):
        data = cv2.imencode(f".{suffix}", image)[1].tobytes()
        assert image_size(data) == (image.shape[1], image.shape[0])
        too_large = image.shape[0] > 8192
        assert (size_problem(data) is not None) == too_large
        assert (decode_png(data) is None) == too_large


def test_other_kinds_of_images_are_not_decoded() -> None:
    """OpenCV knows twenty formats by their first bytes, whatever the name of the file."""
    picture = np.zeros((20, 20, 3), np.uint8)
    for suffix in ("jpg", "bmp", "webp", "ppm"):
        assert decode_png(cv2.imencode(f".{suffix}", picture)[1].tobytes()) is None
    for data in (b"", b"\x89PNG\r\n\x1a\n", b"II*\0", b"II*\0\xff\xff\xff\xff", b"MM\0*\0\0\0\x08"):
        assert decode_png(data) is None


def test_only_regular_files_are_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "good").write_bytes(encode_png(np.ones((2, 2), np.uint8)))
    for path, problem in (
        (tmp_path / "pipe", "is a pipe"),
        (Path("/dev/zero"), "a device"),
        (tmp_path, "Is a directory"),
        (tmp_path / "a\0b", "NUL byte"),
        (tmp_path / "none", "No such file"),
        (tmp_path / ("x" * 300), "File name too long"),
    ):
        with pytest.raises(OSError, match=problem) as error:
            open_regular(path)
        assert error.value.strerror
        with pytest.raises(OSError, match=problem):
            read_regular(path, 10)
    with pytest.raises(OSError, match="are more than"):
        read_regular(tmp_path / "good", 10)
    with pytest.raises(OSError, match="are more than"):
        read_regular(Path("/proc/self/maps"), 10)  # its size is said to be 0
    assert read_regular(tmp_path / "good", 1000)[1:4] == b"PNG"


def test_files_inside_a_folder(tmp_path: Path) -> None:
    root = tmp_path / "root"
    (root / "a").mkdir(parents=True)
    (root / "a" / "out").symlink_to(tmp_path)
    (tmp_path / "x").write_text("no")
    (root / "a" / "x").write_text("yes")
    linked = tmp_path / "link"
    linked.symlink_to(root)
    for folder in (root, linked):
        assert read_regular(folder / "a" / "x", 10, inside=folder) == b"yes"
    for name in ("../x", "/etc/passwd", "a/out/x", "a/../../x"):
        with pytest.raises(OSError, match="leads out of"):
            open_regular(root / name, inside=root)


def test_an_animation_and_a_png_without_end_are_refused() -> None:
    whole = encode_png(np.arange(3072, dtype=np.uint16).reshape(48, 64))
    animation = _chunk(b"acTL", struct.pack(">II", 100, 0))
    for data in (whole[:-12], whole[:33] + animation + whole[33:]):
        assert decode_png(data) is None
