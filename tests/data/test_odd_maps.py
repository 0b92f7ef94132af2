"""Depth maps of other programs: which channel, which unit, what is no surface, what is no map."""

import json
import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.cli import main
from glsim.core.camera import Intrinsics
from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.exr import depth_channel
from glsim.core.files.png import encode_png
from glsim.data.maps import open_maps
from glsim.data.recordings.files import read_map_mm
from glsim.data.recordings.folders import list_maps

METRES = np.full((32, 40), 0.8, np.float32)
METRES[8:20, 10:25] = 0.6
UNITS = np.rint(METRES * 1000).astype(np.uint16)
GREY = np.full_like(METRES, 0.5)
PICTURE = {"R": GREY, "G": GREY, "B": GREY, "A": GREY * 2}


def near(found_mm: NDArray[np.float32]) -> bool:
    """Whether a map is as written, but for corners that a median rounds."""
    return bool((np.abs(found_mm - UNITS) < 0.5).mean() > 0.98)


@pytest.mark.parametrize(
    "channels",
    [
        {**PICTURE, "ViewLayer.Depth.Z": METRES, "ViewLayer.Mist.Z": GREY},
        {**PICTURE, "dd.T": METRES},
        {"N.X": GREY, "N.Y": GREY, "N.Z": GREY, "DEPTH": METRES},
        {"Combined.A": GREY, "Depth.V": METRES},
        {"depth.R": METRES, "depth.G": METRES, "depth.B": METRES, "R": GREY},
        {"V": METRES, "A": GREY},
        {"Y": METRES},
        {"Z": METRES, "ZBack": GREY},
    ],
)
def test_the_channel_that_is_named_depth_is_taken(channels: dict[str, NDArray[Any]]) -> None:
    np.testing.assert_array_equal(depth_channel(channels), METRES)


@pytest.mark.parametrize(
    "channels",
    [
        PICTURE, {"A": GREY}, {"N.X": GREY, "N.Y": GREY, "N.Z": GREY}, {"U": GREY, "V": GREY},
        {"A.Depth.Z": METRES, "B.Depth.Z": GREY},
    ],
)  # fmt: skip
def test_no_channel_is_guessed(channels: dict[str, NDArray[Any]]) -> None:
    with pytest.raises(
        ValueError, match=f"surely depth: choose one of {', '.join(channels)} with --channel"
    ):
        depth_channel(channels)
    name = next(iter(channels))
    np.testing.assert_array_equal(depth_channel(channels, name.lower()), channels[name])


def test_parts_and_halfs_of_openexr_are_read_and_the_channel_may_be_chosen(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    openexr = pytest.importorskip("OpenEXR")
    kind = {"type": openexr.scanlineimage}
    layers = {"rgba": PICTURE, "Depth": {"V": METRES.astype(np.float16)}}
    parts = [openexr.Part({**kind, "name": name}, images) for name, images in layers.items()]
    openexr.File(parts).write("parts.exr")
    assert near(read_map_mm(Path("parts.exr"), 1.0))
    openexr.File(kind, {**PICTURE, "depth.left": METRES, "depth.right": GREY}).write("two.exr")
    for command in (["denoise", "-d", "median"], ["corrupt", "-s", "ideal", "--backend", "numpy"]):
        arguments = [command[0], "two.exr", "-o", "out.npy", *command[1:]]
        assert main(arguments) == 1
        assert "A, B, G, R, depth.left, depth.right" in capsys.readouterr().err
        assert main([*arguments, "--channel", "depth.LEFT"]) == 0
        assert near(np.load("out.npy") * 1000)


@pytest.mark.parametrize(
    ("values", "kept"),
    [
        (np.where(METRES < 0.7, METRES, 1e10), UNITS < 700),
        (np.where(METRES < 0.7, METRES, np.inf), UNITS < 700),
        (np.where(METRES < 0.7, METRES, 100), UNITS < 700),
        (np.where(METRES < 0.7, METRES * 1000, np.float16(65504)), UNITS < 700),
        (np.where(METRES < 0.7, UNITS, 65535).astype(np.uint16), UNITS < 700),
        (METRES * 1000, UNITS > 0),
        (METRES[None].astype(np.float16), UNITS > 0),
        (METRES[..., None], UNITS > 0),
        (np.dstack([METRES] * 3), UNITS > 0),
        (UNITS.astype(">u2"), UNITS > 0),
    ],
)
def test_units_far_planes_and_axes_of_one(
    tmp_path: Path, values: NDArray[Any], kept: NDArray[np.bool_]
) -> None:
    np.save(tmp_path / "a.npy", values)
    found = read_map_mm(tmp_path / "a.npy", 1.0)
    np.testing.assert_allclose(found, np.where(kept, UNITS, 0), atol=0.5)


def tiff(bits: int, form: int, data: bytes, big: bool, pages: int = 1) -> bytes:
    """A grey little-endian TIFF or BigTIFF of one strip, 32 x 40 pixels."""
    head, word, at = (16, "Q", 8) if big else (8, "I", 4)
    tags = {256: 40, 257: 32, 258: bits, 259: 1, 262: 1, 273: head, 277: 1, 278: 32}
    tags |= {279: len(data), 339: form}
    entries = b"".join(
        struct.pack(f"<HH2{word}", t, 16 if big else 4, 1, v) for t, v in tags.items()
    )
    count = struct.pack("<Q" if big else "<H", len(tags))
    start = (
        struct.pack("<2sHHHQ", b"II", 43, at, 0, head + len(data))
        if big
        else struct.pack("<2sHI", b"II", 42, head + len(data))
    )
    return start + data + count + entries + struct.pack(f"<{word}", pages - 1)


@pytest.mark.parametrize("big", [True, False])
def test_bigtiff_and_halfs_in_tiff_are_read(tmp_path: Path, big: bool) -> None:
    file, half = tmp_path / "a.tif", METRES.astype("<f2")
    for form, data in ((1, UNITS.tobytes()), (3, half.tobytes())):
        whole = tiff(16, form, data, big)
        file.write_bytes(whole)
        assert near(read_map_mm(file, 1.0))
        file.write_bytes(whole[:-300])
        with pytest.raises(DatasetError, match=r"a\.tif: is no readable image"):
            read_map_mm(file, 1.0)
    file.write_bytes(tiff(16, 1, UNITS.tobytes(), big, pages=2))
    with pytest.raises(DatasetError, match="several images"):
        read_map_mm(file, 1.0)


def test_significant_bits_are_heeded_and_shifted_values_refused(tmp_path: Path) -> None:
    ramp = np.linspace(500, 1500, 1280).reshape(32, 40).astype(np.uint16)
    shifted = encode_png(ramp << 4)
    chunk = b"sBIT\x0c"
    stated = shifted[:33] + struct.pack(">I", 1) + chunk + struct.pack(">I", zlib.crc32(chunk))
    (tmp_path / "stated.png").write_bytes(stated + shifted[33:])
    np.testing.assert_array_equal(read_map_mm(tmp_path / "stated.png", 1.0), ramp)
    file = tmp_path / "raw.png"
    for bits in (3, 4):
        file.write_bytes(encode_png(ramp << bits))
        with pytest.raises(DatasetError, match=f"multiples of {1 << bits}: state the unit"):
            open_maps(file)
        shifted_back = open_maps(file, unit_mm=1 / (1 << bits)).frames[0].noisy_mm
        np.testing.assert_array_equal(shifted_back, ramp)


def test_a_folder_has_one_unit_in_every_command(tmp_path: Path) -> None:
    """One map of a far plane alone would pass for millimetres."""
    for number in range(3):
        np.save(tmp_path / f"{number}.npy", METRES)
    np.save(tmp_path / "3.npy", np.full_like(METRES, 500.0))
    recording = open_maps(tmp_path)
    assert near(recording.frames[0].noisy_mm)
    assert not recording.frames[3].noisy_mm.any()


@pytest.mark.parametrize("listing", ["depth.txt", "associations.txt"])
def test_folders_of_tum_have_steps_of_a_fifth_of_a_millimetre(tmp_path: Path, listing: str) -> None:
    (tmp_path / "depth").mkdir()
    (tmp_path / "rgb").mkdir()
    file = tmp_path / "depth" / "1.5.png"
    file.write_bytes(encode_png(UNITS * 5))
    cv2.imwrite(str(tmp_path / "rgb" / "1.5.png"), np.zeros((32, 40, 3), np.uint8))
    (tmp_path / listing).write_text("# depth maps\n1.5 depth/1.5.png\n")
    assert near(open_maps(tmp_path).frames[0].noisy_mm)
    assert near(open_maps(tmp_path / "depth").frames[0].noisy_mm)
    files, others = list_maps(tmp_path, "noisy")
    assert (files, dict(others)) == ([file], {"rgb/*.png": 1})
    (tmp_path / listing).write_text("other words\n")
    assert "nothing states a unit" in open_maps(tmp_path).notes[0]


def test_scannet_states_its_camera(tmp_path: Path) -> None:
    for name in ("depth", "intrinsic"):
        (tmp_path / name).mkdir()
    (tmp_path / "depth" / "0.png").write_bytes(encode_png(UNITS))
    np.savetxt(tmp_path / "intrinsic" / "intrinsic_depth.txt", np.diag([50.0, 51, 1, 1]))
    recording = open_maps(tmp_path)
    assert (recording.camera.width, recording.camera.fy, recording.camera.cx) == (40, 51, 0.5)
    assert not recording.notes


def test_polycam_states_its_camera_at_the_size_of_its_colour_images(tmp_path: Path) -> None:
    for name in ("depth", "cameras", "confidence"):
        (tmp_path / name).mkdir()
    for number in range(3):
        (tmp_path / "depth" / f"{number}.png").write_bytes(encode_png(UNITS))
        (tmp_path / "confidence" / f"{number}.png").write_bytes(encode_png(UNITS))
        own = {"width": 160, "height": 128, "fx": 200 + number, "fy": 202, "cx": 81, "cy": 63}
        (tmp_path / "cameras" / f"{number}.json").write_text(json.dumps(own))
    for place in (tmp_path, tmp_path / "depth"):
        recording = open_maps(place)
        assert recording.camera == Intrinsics(40, 32, 201 / 4, 202 / 4, 81 / 4, 63 / 4)
        assert (len(recording.frames), recording.notes) == (3, ())
    for file in (tmp_path / "cameras").iterdir():
        file.write_text(json.dumps({**own, "fx": 1e400}))
    with pytest.raises(DatasetError, match="fits no depth maps"):
        open_maps(tmp_path)


def test_names_sort_by_their_numbers_and_hidden_files_are_none(tmp_path: Path) -> None:
    for number in range(12):
        (tmp_path / f"{number}.png").write_bytes(encode_png(UNITS + number))
        (tmp_path / f"._{number}.png").write_bytes(b"resource fork")
    numbers = [str(number) for number in range(12)]
    assert [path.stem for path in list_maps(tmp_path, "noisy")[0]] == numbers
    recording = open_maps(tmp_path)
    assert [recording.frames[k].name for k in range(len(recording.frames))] == numbers
    given = sorted(map(str, tmp_path.glob("[0-9]*.png")))
    (tmp_path / ".cache").symlink_to(tmp_path)
    for inputs in (given, [str(tmp_path / "*.png")], [str(tmp_path / ".cache" / "*.png")]):
        assert [path.stem for path in open_maps(inputs).sources] == numbers


def test_a_batch_goes_on_behind_what_is_no_map(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("in").mkdir()
    cv2.imwrite("in/a.tif", np.dstack([UNITS, UNITS + 1, UNITS]))
    np.save("in/b.npy", np.stack([UNITS] * 5))
    np.save("in/c.npy", METRES.ravel())
    np.save("in/d.npy", METRES)
    for command in (["denoise", "-d", "median"], ["corrupt", "-s", "ideal", "--backend", "numpy"]):
        assert main([command[0], "in", "-o", command[0], *command[1:]]) == 1
        error = capsys.readouterr().err
        assert all(f"in/{name}: is " in error for name in ("a.tif", "c.npy"))
        assert "2 of 8 maps could not be read" in error
        for name in ("b_00000", "b_00004", "d"):  # each map of a stack is one
            assert near(np.load(f"{command[0]}/{name}.npy") * 1000)


def test_the_same_map_has_the_same_noise_in_any_format_and_place(here: Path) -> None:
    slanted = np.linspace(700, 1100, 1280).reshape(32, 40).astype(np.uint16)
    Path("in").mkdir()
    cv2.imwrite("in/a.tiff", slanted)
    np.save("in/b.npy", (slanted / 1000).astype(np.float32))
    Path("one.png").write_bytes(encode_png(slanted))
    noise = ["-s", "kinect-v2", "--backend", "numpy", "-q"]
    assert main(["corrupt", "one.png", "-o", "x.png", *noise]) == 0
    assert main(["corrupt", "in/b.npy", "-o", "y.npy", *noise]) == 0
    assert main(["corrupt", "in", "-o", "out", *noise]) == 0
    first = cv2.imread("x.png", cv2.IMREAD_UNCHANGED)
    assert (first != slanted).mean() > 0.5
    np.testing.assert_array_equal(cv2.imread("out/a.tiff", cv2.IMREAD_UNCHANGED), first)
    np.testing.assert_array_equal(np.rint(np.load("y.npy") * 1000), first)
    copy = np.rint(np.load("out/b.npy") * 1000)
    assert (copy != first).mean() > 0.5  # the second of two copies


def test_words_of_names_decide_with_any_separator_before_the_format(tmp_path: Path) -> None:
    """What renderers and label tools write beside the depth; the depth may be the TIFF files."""
    picture = np.zeros((32, 40, 3), np.uint8)
    for number in range(2):
        names = f"{number:05d}-color {number}.normal instance_{number} {number}_seg"
        for name in names.split():
            cv2.imwrite(str(tmp_path / f"{name}.png"), picture)
        cv2.imwrite(str(tmp_path / f"depth_{number}.tiff"), UNITS)
        np.save(tmp_path / f"{number}_infrared_right.npy", UNITS)
    recording = open_maps(tmp_path)
    assert [path.name for path in recording.sources] == ["depth_0.tiff", "depth_1.tiff"]
    assert sum(recording.left_out.values()) == 10
    assert "left out 2 *_color.png, 2 *_normal.png" in recording.sentence()


def test_a_recording_with_a_mesh_beside_it_is_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "depth").mkdir()
    (tmp_path / "depth" / "0.png").write_bytes(encode_png(UNITS))
    (tmp_path / "scan.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert main(["inspect", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "images, 1 frame of 40 x 32 px" in printed
    assert f"1 mesh beside it: glsim inspect {tmp_path / 'scan.obj'}" in printed


def test_crops_of_several_sizes_are_denoised(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("in").mkdir()
    for number, size in enumerate([(40, 30), (30, 40), (64, 48)]):
        Path(f"in/{number}.png").write_bytes(encode_png(np.full(size, 900, np.uint16)))
    assert main(["denoise", "in", "-o", "out"]) == 0
    assert "2 of 3 sampled maps have another size than the first: 1, 2" in capsys.readouterr().err
    assert len(list(Path("out").iterdir())) == 3


LONG = np.arange(32 * 40, dtype=np.uint16).reshape(32, 40)


@pytest.mark.parametrize(
    ("values", "problem"),
    [
        ((LONG % 256).astype(np.uint16) * 257, "multiples of 257"),
        ((65535 - LONG * 51).astype(np.uint16), "% of its values are above 20000"),
        (-METRES, "most of its depths are negative"),
        (np.moveaxis(np.stack([METRES] * 16) + np.arange(16)[:, None, None] * 1e-4, 0, 2),
         r"is \(32, 40, 16\), whose last axis is time"),
        (UNITS.astype(np.int32) - 700, "whole numbers from -100 to 100"),
    ],
)  # fmt: skip
def test_what_is_no_depth_says_so(tmp_path: Path, values: NDArray[Any], problem: str) -> None:
    np.save(tmp_path / "a.npy", values)
    with pytest.raises(DatasetError, match=problem):
        open_maps(tmp_path / "a.npy")


def test_the_axis_of_time_is_told_by_a_moving_scene_too(tmp_path: Path) -> None:
    moving = np.stack([np.roll(METRES, 9 * k, 1) + 0.1 * k for k in range(30)])
    np.save(tmp_path / "a.npy", moving)
    assert open_maps(tmp_path / "a.npy").frames[0].noisy_mm.shape == METRES.shape
    np.save(tmp_path / "a.npy", np.moveaxis(moving, 0, 2))
    with pytest.raises(DatasetError, match="whose last axis is time"):
        open_maps(tmp_path / "a.npy")


def test_long_whole_numbers_and_depth_buffers(tmp_path: Path) -> None:
    for number, kind in enumerate((np.int16, np.int32, np.int64, np.uint32)):
        np.save(tmp_path / f"{number}.npy", UNITS.astype(kind))
        assert near(open_maps(tmp_path / f"{number}.npy").frames[0].noisy_mm)
    np.save(tmp_path / "z.npy", np.where(METRES < 0.7, METRES, np.float32(1)))
    assert "taken for metres; convert" in open_maps(tmp_path / "z.npy").sentence()


def test_formats_that_libraries_here_read(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.pgm"), UNITS)
    cv2.imwrite(str(tmp_path / "a.pfm"), METRES)
    np.savez(tmp_path / "a.npz", depth=METRES, color=GREY)
    for name in ("a.pgm", "a.pfm", "a.npz"):
        assert near(open_maps(tmp_path / name).frames[0].noisy_mm), name
    np.savez(tmp_path / "b.npz", a=METRES, b=METRES)
    (tmp_path / "c.pfm").write_bytes((tmp_path / "a.pfm").read_bytes()[:-9])
    (tmp_path / "d.hdf5").write_bytes(b"\x89HDF")
    for name, problem in (("b.npz", "holds a, b"), ("c.pfm", "c.pfm"), ("d.hdf5", "glsim reads")):
        with pytest.raises(DatasetError, match=problem):
            open_maps(tmp_path / name)


def test_openexr_keeps_its_display_window_and_says_distances_along_rays(tmp_path: Path) -> None:
    openexr = pytest.importorskip("OpenEXR")
    header = {
        "type": openexr.scanlineimage,
        "displayWindow": (np.array([0, 0], np.int32), np.array([63, 47], np.int32)),
        "dataWindow": (np.array([16, 8], np.int32), np.array([55, 39], np.int32)),
    }
    openexr.File(header, {"dd.T": METRES}).write(str(tmp_path / "a.exr"))
    recording = open_maps(tmp_path)
    whole = recording.frames[0].noisy_mm
    assert whole.shape == (48, 64)
    assert near(whole[8:40, 16:56])
    assert np.count_nonzero(whole) == METRES.size
    assert "dd.t is the distance along the ray" in recording.sentence()
    text = "width = 64\nheight = 48\nfocal_px = [32, 32]\nalong_ray = true\n"
    (tmp_path / "camera.toml").write_text(text)
    seen = whole > 0
    x, y = (np.arange(64) + 0.5 - 32) / 32, (np.arange(48) + 0.5 - 24) / 32
    length = np.sqrt(1 + x**2 + (y**2)[:, None])
    read = open_maps(tmp_path)
    np.testing.assert_allclose(read.frames[0].noisy_mm[seen], (whole / length)[seen], rtol=1e-5)
    assert not read.notes
    (tmp_path / "camera.toml").write_text("along_ray = true\n")
    with pytest.raises(ConfigError, match="distances along rays need intrinsics"):
        open_maps(tmp_path)


def test_cameras_of_bop_and_open3d_are_read_and_others_named(tmp_path: Path) -> None:
    (tmp_path / "depth").mkdir()
    (tmp_path / "depth" / "0.png").write_bytes(encode_png(UNITS * 10))
    k = [60.0, 0, 19.5, 0, 61.0, 15.5, 0, 0, 1]
    bop = tmp_path / "scene_camera.json"
    bop.write_text(json.dumps({"0": {"cam_K": k, "depth_scale": 0.1}}))
    recording = open_maps(tmp_path)
    assert near(recording.frames[0].noisy_mm)
    assert recording.camera == Intrinsics(40, 32, 60.0, 61.0, 20.0, 16.0)
    mine = bop.rename(tmp_path / "my_camera.json")
    by_columns = [60.0, 0, 0, 0, 61.0, 0, 19.5, 15.5, 1]
    columns = {"width": 40, "height": 32, "intrinsic_matrix": by_columns}
    (tmp_path / "intrinsic.json").write_text(json.dumps(columns))
    assert open_maps(tmp_path).camera == recording.camera
    (tmp_path / "intrinsic.json").unlink()
    keys = {"width": 40, "height": 32, "fx": 60.0, "fy": 61.0, "ppx": 19.5, "ppy": 15.5}
    for colour in ({**keys, "width": 80}, {**keys, "fx": 90}):  # of another size, or also named
        mine.write_text(json.dumps({"color": colour, "depth": keys}))
        assert open_maps(tmp_path).camera == recording.camera
    mine.write_text(json.dumps({"left": keys, "right": {**keys, "fx": 90}}))
    assert "my_camera.json: not read; a camera.toml states the camera" in open_maps(tmp_path).notes


def test_corrupt_takes_the_camera_that_is_stated(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("in").mkdir()
    Path("in/a.png").write_bytes(encode_png(UNITS))
    command = ["corrupt", "in", "-s", "kinect-v2", "--backend", "numpy", "-q", "-o"]
    Path("in/camera.toml").write_text("width = 40\nheight = 32\nfocal_px = [60.0, 30.0]\n")
    assert main([*command, "stated"]) == 0
    Path("in/camera.toml").unlink()
    given = ["given", "--focal-px", "60,30", "--centre-px", "20,16"]
    assert main([*command, *given]) == 0
    assert Path("stated/a.png").read_bytes() == Path("given/a.png").read_bytes()
    assert main([*command, "other", "--focal-px", "30"]) == 0
    assert Path("other/a.png").read_bytes() != Path("given/a.png").read_bytes()
    Path("in/b.png").write_bytes(encode_png(UNITS[:3, :3]))
    capsys.readouterr()
    assert main(["corrupt", "in", "-s", "realsense-d435", "-o", "small"]) == 1
    assert "in/b.png: a map of 3 x 3 pixels is smaller than the window" in capsys.readouterr().err
    assert Path("small/a.png").is_file()
