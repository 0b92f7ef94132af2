"""Raw frames of the Kinect V2, as its USB packets carry them and libfreenect2 decodes them.

Ten sub-images of 512 x 424 codes of 11 bits: three phases (0, 120, 240 degrees) at 80, at 16 and at
120 MHz, and one that the decoder ignores. Layout after libfreenect2's CpuDepthPacketProcessor
(decodePixelMeasurement), lookup table after its Registration of parameters, p0 tables after its
P0TablesResponse.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError
from glsim.frame import Frame, Rect
from glsim.noise.stage import Stage
from glsim.noise.twins.tof_taps import taps_of
from glsim.noise.view import FrameContext
from glsim.sensor import Sensor

WIDTH, HEIGHT = 512, 424
SUB_IMAGES = 10
_BITS = 11
_ROW_BYTES = WIDTH * _BITS // 8
PACKET_BYTES: Final = SUB_IMAGES * HEIGHT * _ROW_BYTES

#: What a frame must carry for ``packet`` (``Simulator``'s extra_layers).
LAYERS = ("light_a", "light_b", "clean")

#: The code that stands for a saturated tap: minus nought.
SATURATED_CODE = 1024


def tap_codes(taps: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Whole taps of the 11-bit table, -16320 to 16320, to their codes; sign in the highest bit."""
    size = np.rint(np.abs(taps)).astype(np.int64)
    exponent = np.maximum(np.frexp(size.astype(np.float64))[1] - 1, 7)
    # 128 codes in each doubling from 128 on; below, a code is a value.
    above = 128 * (exponent - 6) + ((size - (1 << exponent)) >> (exponent - 7))
    codes = np.where(size < 128, size, above)
    signed: NDArray[np.uint16] = codes + np.where((taps < 0) & (codes > 0), 1024, 0)
    return signed.astype(np.uint16)


def pack(codes: NDArray[np.uint16]) -> bytes:
    """(n, 424, 512) codes in the image's orientation to n packed sub-images.

    A row is a stream of 11-bit numbers, lowest bit first: the columns 0, 4, 8, ..., then 1, 5, ...;
    the decoder's rows run upwards, and its two halves are read out away from the middle.
    """
    upwards = codes[:, ::-1]
    rows = np.concatenate([upwards[:, : HEIGHT // 2 - 1 : -1], upwards[:, : HEIGHT // 2]], axis=1)
    columns = np.concatenate([np.arange(start, WIDTH, 4) for start in range(4)])
    ordered = rows[:, :, columns]
    bits = (ordered[..., None] >> np.arange(_BITS, dtype=np.uint16)) & 1
    stream = bits.astype(np.uint8).reshape(len(codes), HEIGHT, WIDTH * _BITS)
    return np.packbits(stream, axis=-1, bitorder="little").tobytes()


def packet(sensor: Sensor, frame: Frame) -> bytes:
    """The packet whose decoding is the frame's depth.

    The taps are computed again, from the frame's light and its seed, by the twin of tof_taps.
    Raises ConfigError for a sensor without taps, of another size, or for a crop.
    """
    stage = taps_stage(sensor)
    image = frame.intrinsics
    if (image.width, image.height) != (WIDTH, HEIGHT):
        raise ConfigError(
            f"raw frames are {WIDTH}x{HEIGHT}, not {image.width}x{image.height}: "
            "leave out the crop and take a rig of that size"
        )
    window: Rect = frame.window
    context = FrameContext(window, WIDTH, HEIGHT, frame.seed, 0, 0, 0.0, 0.0)
    values = _values(stage, frame.parameters)
    taps, read, saturated = taps_of(context.view(stage.name), frame.extra, values)
    codes = tap_codes(taps.reshape(*read.shape, 9))
    codes[saturated] = SATURATED_CODE
    codes[~read] = 0
    full = np.zeros((SUB_IMAGES, HEIGHT, WIDTH), np.uint16)
    full[:9, window.slices[0], window.slices[1]] = np.moveaxis(codes, -1, 0)
    return pack(full)


def p0_tables() -> bytes:
    """libfreenect2's P0TablesResponse: the phases of all pixels count from nought, so all are 0."""
    table = WIDTH * HEIGHT * 2
    header = struct.pack("<8I", 32, 0, 0, table, 0, 0, 0, 0)
    return header + 3 * (2 + table + 2) * b"\0"


def taps_stage(sensor: Sensor) -> Stage:
    """The stage that measures taps. Raises ConfigError if there is none, or one without codes."""
    stages = [stage for stage in sensor.stages if stage.spec.name == "tof_taps"]
    if not stages:
        raise ConfigError(
            f"sensor {sensor.name!r} has no raw frames: they need the stage tof_taps (kinect-v2)"
        )
    if stages[0].settings["companding"].bounds()[0] == 0:
        raise ConfigError(f"{stages[0].name}.companding must be on: raw frames have 11 bits")
    return stages[0]


def _values(stage: Stage, drawn: Mapping[str, float]) -> dict[str, np.float32]:
    values = {}
    for name, setting in stage.settings.items():
        value = setting.constant if setting.is_constant else drawn[f"{stage.name}.{name}"]
        assert value is not None
        values[name] = np.float32(value)
    return values
