"""Test the PNG encoder against OpenCV and Pillow."""

import io
import zlib
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from glsim.core.files.png import decode_png, encode_png


def decoded(data: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)


def make_image(
    dtype: type, height: int, width: int, top: int, bottom: int, seed: int
) -> NDArray[Any]:
    rng = np.random.default_rng(seed)
    image: NDArray[Any] = np.zeros((height, width), dtype)
    rows = image[top : height - bottom]
    rows[...] = rng.integers(0, np.iinfo(dtype).max, rows.shape, dtype, endpoint=True)
    rows[rng.random(rows.shape) < 0.3] = 0
    return image


@settings(max_examples=60)
@given(
    st.sampled_from([np.uint8, np.uint16]),
    st.integers(1, 40),
    st.integers(1, 300),
    st.integers(0, 41),
    st.integers(0, 41),
    st.integers(0, 9),
)
def test_any_image_survives(dtype, height, width, top, bottom, seed) -> None:
    image = make_image(dtype, height, width, top, bottom, seed)[::-1]  # with strides
    data = encode_png(image)
    read = decoded(data)
    assert read.dtype == dtype
    np.testing.assert_array_equal(read, image)
    with Image.open(io.BytesIO(data)) as checked:
        checked.verify()  # every checksum
    with Image.open(io.BytesIO(data)) as other:
        np.testing.assert_array_equal(np.asarray(other), image)


def test_same_image_same_bytes_wherever_the_stack_lies() -> None:
    """Each first pair of pixels has another hash; ISA-L's level 1 fails for about 50 of them."""
    pixels = np.zeros((20_000, 3, 64), np.uint16)
    pixels[:, ::2] = np.random.default_rng(4).integers(1, 60_000, (20_000, 1, 64), np.uint16)
    with ThreadPoolExecutor(1) as other_stack:
        elsewhere = other_stack.submit(lambda: [encode_png(image) for image in pixels]).result()
    assert [encode_png(image) for image in pixels] == elsewhere


def test_empty_rows_cost_little() -> None:
    image = make_image(np.uint16, 124, 512, 0, 0, 3)
    padded = np.vstack([np.zeros((150, 512), np.uint16), image, np.zeros((150, 512), np.uint16)])
    empty_rows = 300 * (1 + 2 * 512)
    assert len(encode_png(padded)) < len(encode_png(image)) + empty_rows // 50


@pytest.mark.parametrize("encode", [encode_png, lambda image: cv2.imencode(".png", image)[1]])
def test_one_wrong_bit_is_refused_and_nothing_is_printed(
    encode: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    """The checksums of chunks are made right again: only that of the unpacked image is wrong."""
    random = np.random.default_rng(1)
    image = (600 + random.integers(-3, 4, (48, 64)).cumsum(axis=1)).astype(np.uint16)
    whole = bytes(encode(image))
    start = whole.index(b"IDAT")
    end = start + 4 + int.from_bytes(whole[start - 4 : start], "big")
    for place in random.integers(start + 4, end, 300):
        data = bytearray(whole)
        data[place] ^= 1 << int(random.integers(8))
        data[end : end + 4] = zlib.crc32(data[start:end]).to_bytes(4, "big")
        decoded = decode_png(bytes(data))
        assert decoded is None or np.array_equal(decoded, image)
    assert capfd.readouterr() == ("", "")
