"""Kinect V2 packets: encoded for libfreenect2, decoded here independently from the bytes."""

from __future__ import annotations

from pathlib import Path

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.cli import main
from glsim.faces.one_mesh import OneMesh
from glsim.frame import Frame
from glsim.noise.numpy_twins import TWINS
from glsim.noise.numpy_twins.tof_taps import taps_of
from glsim.pipeline import simulate
from glsim.sensors import kinect_packet
from glsim.sensors.sensor import load_sensor
from tests.support.scenes import face_mesh, settings_for
from tests.support.tof_harness import Camera, quad

LUT_STEPS = np.repeat([1, 1, 2, 4, 8, 16, 32, 64], 128)
POSITIVE = np.concatenate([[0], np.cumsum(LUT_STEPS)[:-1]])
LUT = np.concatenate([POSITIVE, -POSITIVE])
LUT[1024] = 32767


def read_tap(data: bytes, sub_image: int, x: int, y: int) -> int:
    """Decode one tap, bit by bit; y as libfreenect2 counts rows."""
    row = y + 212 if y < 212 else 423 - y
    words = np.frombuffer(data, "<u2")[sub_image * 149248 + 352 * row :]
    bit = 11 * ((x >> 2) + ((x & 3) << 7))
    value = int(words[bit >> 4]) >> (bit & 15)
    if (bit & 15) > 5:
        value |= int(words[(bit >> 4) + 1]) << (16 - (bit & 15))
    return int(LUT[value & 2047])


def read_all(data: bytes) -> NDArray[np.int64]:
    """Decode a packet to (9, 424, 512) taps, row 0 on top."""
    bits = np.unpackbits(np.frombuffer(data, np.uint8), bitorder="little")
    codes = bits.reshape(10, 424, 512, 11) @ (1 << np.arange(11))
    taps = np.empty((10, 424, 512), np.int64)
    for start in range(4):
        taps[:, :, start::4] = LUT[codes[:, :, start * 128 : start * 128 + 128]]
    rows = np.array([y + 212 if y < 212 else 423 - y for y in range(424)])
    return taps[:9, rows][:, ::-1]


def decode(taps: NDArray[np.int64], rays: NDArray[np.floating]) -> NDArray[np.float64]:
    """Taps to (424, 512) float64 mm, by the decoder's published steps without its filters."""
    m = taps.reshape(3, 3, 424, 512)
    phase_of = np.array([0, 2.094395, 4.18879])
    a = (m * np.cos(phase_of)[None, :, None, None]).sum(axis=1)
    b = (m * np.sin(-phase_of)[None, :, None, None]).sum(axis=1)
    cycles = np.mod(np.arctan2(b, a), 2 * np.pi) / (2 * np.pi)
    n80, n16, n120 = cycles * np.array([3, 15, 2])[:, None, None]
    fast = n80 + 3 * np.round((n16 - n80) / 3)
    first = np.abs((fast - n120) / 2 - np.round((fast - n120) / 2))
    second = np.abs((fast + 15 - n120) / 2 - np.round((fast + 15 - n120) / 2))
    turn = 15 * (second < first)
    fast, slow = fast + turn, n16 + turn
    third = n120 + 2 * np.round((fast - n120) / 2)
    distance = 2083.333 * (fast / 3 + slow / 15 + third / 2) / 3
    stretch = np.sqrt((rays**2).sum(axis=-1) + 1)
    path = 2 * distance
    return (path**2 - 45.0**2) / (2 * (path * stretch - 45.0 * rays[..., 0]))


def test_codes_are_those_of_the_table() -> None:
    codes = kinect_packet.tap_codes(LUT[LUT != 32767].astype(np.float32))
    expected = np.flatnonzero(LUT != 32767)
    np.testing.assert_array_equal(LUT[codes], LUT[expected])
    np.testing.assert_array_equal(codes[1:1024], expected[1:1024])


def test_packed_codes_are_read_back_one_by_one() -> None:
    rng = np.random.default_rng(0)
    codes = rng.integers(0, 2048, (10, 424, 512)).astype(np.uint16)
    data = kinect_packet.pack_codes(codes)
    assert len(data) == kinect_packet.PACKET_BYTES == 2_984_960
    for _ in range(300):
        sub, x, y = int(rng.integers(10)), int(rng.integers(1, 511)), int(rng.integers(424))
        assert read_tap(data, sub, x, y) == LUT[codes[sub, 423 - y, x]]
    np.testing.assert_array_equal(read_all(data), LUT[codes[:9]])


@pytest.mark.parametrize("z_mm", [500.5, 900.0, 1800.0, 3000.0, 4500.0])
def test_without_noise_the_distance_comes_back(context: moderngl.Context, z_mm: float) -> None:
    """The light of a white wall at 0.2 m at all distances: with less, 11 bits limit the result."""
    cam = Camera.open(context)
    clean, frame = cam.clean([quad(z_mm)])
    values = cam.values({
        "tof_light": {"gain": 9000.0 * (z_mm / 1000) ** 2, "harmonic_2": 0.0, "harmonic_5": 0.0,
                      "tail": 1.0},
        "tof_taps": {"read_variance": 0.0, "shot_variance": 0.0, "saturation_lsb": 16320.0},
    })  # fmt: skip
    layers = {**clean, "lit": np.ones_like(clean["clean"])}
    layers |= TWINS["tof_light"](frame.view("tof_light"), layers, values["tof_light"])
    p = {name: np.float32(value) for name, value in values["tof_taps"].items()}
    taps, _, saturated = taps_of(frame.view("tof_taps"), layers, p)
    assert not saturated.any()
    codes = np.zeros((10, 424, 512), np.uint16)
    codes[:9] = np.moveaxis(kinect_packet.tap_codes(taps.reshape(424, 512, 9)), -1, 0)
    depth = decode(read_all(kinect_packet.pack_codes(codes)), cam.sensor.rig.rays())
    error = (depth - z_mm)[100:324, 150:360]
    assert abs(error.mean()) < 0.1
    assert error.std() < 0.2


#: The decoder without its filters and without the stages after it.
PLAIN = {
    name: {"enabled": False}
    for name in ("tof_bilateral", "tof_edge", "tof_floor", "fixed_pattern", "millimetre_quantise")
}


def test_a_packet_decodes_to_the_depth_of_its_frame(context: moderngl.Context) -> None:
    settings = settings_for("kinect-v2", stage=PLAIN, output={"depth_unit_mm": 0.1})
    source = settings.source[0].model_copy(update={"frames_per_subject": 1})
    single = settings.model_copy(update={"source": (source,)})
    (frame,) = simulate(
        single,
        sources=[OneMesh(face_mesh())],
        context=context,
        extra_layers=kinect_packet.REQUIRED_LAYERS,
    )
    assert isinstance(frame, Frame)
    data = kinect_packet.encode_packet(load_sensor("kinect-v2"), frame)
    depth = decode(read_all(data), load_sensor("kinect-v2").rig.rays())
    valid = frame.noisy > 0
    assert valid.sum() > 2000
    assert np.mean(np.abs(depth - 0.1 * frame.noisy)[valid] < 1.0) > 0.999


def test_the_command_writes_packet_and_tables(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "wall.obj").write_text(
        "v -80 -90 0\nv 80 -90 0\nv 80 90 0\nv -80 90 0\nf 1 2 3\nf 1 3 4\n"
    )
    command = ["render", str(tmp_path / "wall.obj"), "-o", str(tmp_path), "--unit", "mm"]
    command += ["--axes", "+x+y+z", "-q", "--raw"]
    assert main(command) == 0
    assert (tmp_path / "wall_raw.bin").stat().st_size == kinect_packet.PACKET_BYTES
    tables = (tmp_path / "wall_p0.bin").read_bytes()
    assert len(tables) == 32 + 3 * (512 * 424 * 2 + 4)
    assert main([*command, "--sensor", "kinect-v1"]) == 2
    assert "sensor 'kinect-v1' has no Kinect V2 packet" in capsys.readouterr().err
    assert main([*command, "--crop", "128"]) == 2
    assert "a Kinect V2 packet has 512x424 pixels, not 128x128" in capsys.readouterr().err
    assert main([*command, "--set", "tof_taps.companding=false"]) == 2
    assert "companding must be on" in capsys.readouterr().err
