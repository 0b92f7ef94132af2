"""Depth packets of the Kinect V2, in the USB format that libfreenect2 decodes.

A packet has ten sub-images of 512 x 424 codes of 11 bits: three phases (0, 120, 240 degrees) at 80,
16 and 120 MHz each, and one that the decoder ignores. Sources: libfreenect2's
CpuDepthPacketProcessor (decodePixelMeasurement) for the layout, its Registration of parameters for
the lookup table, its P0TablesResponse for the p0 tables.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError
from glsim.frame import Frame
from glsim.geometry.rect import Rect
from glsim.noise.frame_context import FrameContext
from glsim.noise.numpy_twins.tof_taps import taps_of
from glsim.noise.stage import Stage
from glsim.sensors.sensor import Sensor

WIDTH, HEIGHT = 512, 424
SUB_IMAGES = 10
_BITS = 11
_ROW_BYTES = WIDTH * _BITS // 8
PACKET_BYTES: Final = SUB_IMAGES * HEIGHT * _ROW_BYTES

#: Extra layers of a frame that ``encode_packet`` needs (``Simulator``'s extra_layers).
REQUIRED_LAYERS = ("light_a", "light_b", "clean")

#: The code of a saturated tap: minus zero.
SATURATED_CODE = 1024


def tap_codes(taps: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Encode integer taps of the 11-bit table, -16320 to 16320; the sign is the highest bit."""
    magnitude = np.rint(np.abs(taps)).astype(np.int64)
    exponent = np.maximum(np.frexp(magnitude.astype(np.float64))[1] - 1, 7)
    # 128 codes per octave from 128 on; below 128 the code is the value.
    above = 128 * (exponent - 6) + ((magnitude - (1 << exponent)) >> (exponent - 7))
    codes = np.where(magnitude < 128, magnitude, above)
    signed: NDArray[np.uint16] = codes + np.where((taps < 0) & (codes > 0), 1024, 0)
    return signed.astype(np.uint16)


def pack_codes(codes: NDArray[np.uint16]) -> bytes:
    """Pack (n, 424, 512) codes, row 0 on top, into n sub-images.

    A row is a stream of 11-bit numbers, lowest bit first: columns 0, 4, 8, ..., then 1, 5, ... Rows
    are counted upwards, and each half of the image is read out from the middle outwards.
    """
    upwards = codes[:, ::-1]
    rows = np.concatenate([upwards[:, : HEIGHT // 2 - 1 : -1], upwards[:, : HEIGHT // 2]], axis=1)
    columns = np.concatenate([np.arange(start, WIDTH, 4) for start in range(4)])
    ordered = rows[:, :, columns]
    bits = (ordered[..., None] >> np.arange(_BITS, dtype=np.uint16)) & 1
    stream = bits.astype(np.uint8).reshape(len(codes), HEIGHT, WIDTH * _BITS)
    return np.packbits(stream, axis=-1, bitorder="little").tobytes()


def encode_packet(sensor: Sensor, frame: Frame) -> bytes:
    """Encode the packet that decodes to the frame's depth.

    The twin of tof_taps computes the taps again, from the frame's light and seed. Pixels that see
    nothing hold read noise, as a device's do; libfreenect2 makes NaN of taps of exactly 0.

    Args:
        frame: with REQUIRED_LAYERS.

    Raises:
        ConfigError: a sensor without taps, a frame of another size, or a crop.
    """
    stage = taps_stage(sensor)
    image = frame.intrinsics
    if (image.width, image.height) != (WIDTH, HEIGHT):
        raise ConfigError(
            f"a Kinect V2 packet has {WIDTH}x{HEIGHT} pixels, not {image.width}x{image.height}: "
            "use no crop, and a rig of that size"
        )
    context = FrameContext.for_frame(
        rig=sensor.rig,
        window=Rect(0, 0, WIDTH, HEIGHT),
        seed=frame.seed,
        sequence_seed=0,
        device_seed=0,
    )
    values = _values(stage, frame.parameters)
    layers = {name: _whole(frame.extra[name], frame.window) for name in REQUIRED_LAYERS}
    taps, _, saturated = taps_of(context.view(stage.name), layers, values)
    codes = tap_codes(taps.reshape(HEIGHT, WIDTH, 9))
    codes[saturated] = SATURATED_CODE
    if values["dead_border"] > 0:
        codes[:, [0, -1]] = 0
    full = np.zeros((SUB_IMAGES, HEIGHT, WIDTH), np.uint16)
    full[:9] = np.moveaxis(codes, -1, 0)
    return pack_codes(full)


def _whole(layer: NDArray[np.float32], window: Rect) -> NDArray[np.float32]:
    """A layer of the whole frame, (424, 512, ...), with 0 outside its window."""
    whole = np.zeros((HEIGHT, WIDTH, *layer.shape[2:]), np.float32)
    whole[window.slices] = layer
    return whole


def p0_tables() -> bytes:
    """Encode libfreenect2's P0TablesResponse. All entries are 0: no pixel has a phase offset."""
    table = WIDTH * HEIGHT * 2
    header = struct.pack("<8I", 32, 0, 0, table, 0, 0, 0, 0)
    return header + 3 * (2 + table + 2) * b"\0"


def taps_stage(sensor: Sensor) -> Stage:
    """The tof_taps stage. Raises ConfigError if there is none, or if its companding is off."""
    stages = [stage for stage in sensor.stages if stage.spec.name == "tof_taps"]
    if not stages:
        raise ConfigError(
            f"sensor {sensor.name!r} has no Kinect V2 packet: it needs the stage "
            "tof_taps (kinect-v2)"
        )
    if stages[0].settings["companding"].bounds()[0] == 0:
        raise ConfigError(f"{stages[0].name}.companding must be on: a packet has 11-bit codes")
    return stages[0]


def _values(stage: Stage, drawn: Mapping[str, float]) -> dict[str, np.float32]:
    values = {}
    for name, setting in stage.settings.items():
        value = setting.constant if setting.is_constant else drawn[f"{stage.name}.{name}"]
        assert value is not None
        values[name] = np.float32(value)
    return values
