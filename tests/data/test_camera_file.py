"""camera.toml beside frames: what it says holds, and mistakes get one clear line."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.atomic import write_atomic
from glsim.core.files.png import encode_png
from glsim.data.maps import open_maps
from glsim.data.reader import open_dataset
from glsim.data.recordings.camera_file import _CameraTable

DEPTH = np.full((48, 64), 9000, np.uint16)
CAMERA = "width = 64\nheight = 48\nfocal_px = [50.5, 51.5]\n"


def _folder(root: Path, text: str, frames: int = 2, place: str = "") -> Path:
    (root / place).mkdir(parents=True, exist_ok=True)
    for number in range(frames):
        cv2.imwrite(str(root / place / f"depth_{number:03d}.png"), DEPTH + number)
    (root / "camera.toml").write_text(text)
    return root


@pytest.mark.parametrize("place", ["", "depth"])
def test_unit_and_intrinsics_of_the_file_hold(tmp_path: Path, place: str) -> None:
    text = f"unit_mm = 0.1\n{CAMERA}centre_px = [30, 20]\nbaseline_m = 0.05\n"
    text += "[distortion]\nk1 = 0.1\np2 = 0.01\n"
    recording = open_maps(_folder(tmp_path, text, place=place))
    frame = recording.read()[0]
    np.testing.assert_allclose(frame.measured_mm, 900.0, rtol=1e-6)
    assert frame.step_mm == 0.1
    assert (frame.intrinsics.fx, frame.intrinsics.fy) == (50.5, 51.5)
    assert (frame.intrinsics.cx, frame.intrinsics.cy) == (30, 20)
    assert recording.distortion == (0.1, 0, 0, 0.01, 0)
    assert recording.stated.baseline_m == 0.05


def test_png_files_state_their_step_and_a_camera_file_wins(tmp_path: Path) -> None:
    """What glsim denoise writes is read in the steps that it states."""
    depth = np.full((40, 60), 9000, np.uint16)
    write_atomic(encode_png(depth, depth_unit_mm=0.1), tmp_path / "0000_depth.png")
    assert open_maps(tmp_path).read()[0].measured_mm[0, 0] == pytest.approx(900)
    with pytest.raises(ConfigError, match=r"--depth-unit-mm 0\.5: .* states steps of 0\.1 mm"):
        open_maps(tmp_path, unit_mm=0.5)
    (tmp_path / "camera.toml").write_text("unit_mm = 0.2\n")
    assert open_maps(tmp_path).read()[0].measured_mm[0, 0] == pytest.approx(1800)


def test_options_win_over_the_file(tmp_path: Path) -> None:
    root = _folder(tmp_path, f"unit_mm = 0.1\n{CAMERA}")
    frames = open_maps(root, unit_mm=0.1).read(focal_px=70.0)
    assert frames[0].measured_mm[0, 0] == pytest.approx(900)
    assert (frames.intrinsics.fx, frames.intrinsics.cx) == (70.0, 32.0)


def test_a_sensor_of_glsim_gives_what_the_file_leaves_open(tmp_path: Path) -> None:
    root = tmp_path / "r"
    root.mkdir()
    cv2.imwrite(str(root / "a.png"), np.full((720, 1280), 3000, np.uint16))
    (root / "camera.toml").write_text('sensor = "realsense-d405"\nunit_mm = 0.2\n')
    recording = open_maps(root)
    assert recording.camera.fx == 648.0
    assert recording.stated.unit_mm == 0.2
    assert recording.stated.baseline_m == pytest.approx(0.018)
    (root / "camera.toml").write_text('sensor = "realsense-d405"\n')
    assert open_maps(root).frames[0].noisy_mm[0, 0] == pytest.approx(300.0)


def test_an_import_keeps_unit_and_camera(tmp_path: Path) -> None:
    root = _folder(tmp_path / "r", f"unit_mm = 0.1\n{CAMERA}")
    assert main(["import", "kinect2", str(root), "-o", str(tmp_path / "d"), "-q"]) == 0
    dataset = open_dataset(tmp_path / "d")
    assert dataset.depth_unit_mm == 0.1
    assert dataset.frames()[0].intrinsics.fx == 50.5
    assert dataset.frames()[0].record["notes"]["camera"] == "camera.toml"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("focal = 3", "no such setting 'focal' (did you mean 'focal_px'?)"),
        ("unit_mm = 0", "unit_mm: must be greater than 0"),
        (CAMERA.replace("50.5", "0"), "focal_px.0: must be greater than or equal to 1 (got 0)"),
        (CAMERA.replace("50.5", "nan"), "focal_px.0: must be a finite number"),
        ("width = 64", "height and focal_px missing"),
        ("centre_px = [3, 4]", "centre_px and distortion need width, height and focal_px"),
        ('sensor = "realsense-d345"', "or 'realsense-d435'"),
        (CAMERA.replace("64", "80"), "says 80x48, but the frames are 64x48"),
        ("width = ", "camera.toml: "),
    ],
)
def test_mistakes_get_one_line(
    tmp_path: Path, text: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    root = _folder(tmp_path / "r", text)
    assert main(["import", "kinect2", str(root), "-o", str(tmp_path / "d"), "-q"]) in (1, 2)
    error = capsys.readouterr().err.strip()
    assert message in error
    assert "camera.toml" in error
    assert "\n" not in error
    if "but the frames are" in message:
        assert main(["denoise", str(root), "-o", str(tmp_path / "n"), "-d", "median"]) == 0
        assert "camera.toml says 80x48, but the maps are 64x48" in capsys.readouterr().err


@pytest.mark.parametrize("most", [1, 2, 3, 5, 9])
def test_a_recording_is_thinned_to_any_number(tmp_path: Path, most: int) -> None:
    for count in (1, 3, 5, 11):
        recording = open_maps(_folder(tmp_path / f"{count}", "", count))
        read = recording.read(most)
        assert 0 < len(read) <= most
        assert len(read) == count or len(read) >= min(most, 4) - (most % 4 if most > 4 else 0)


@pytest.mark.parametrize("field", [*_CameraTable.model_fields, "use"])
@pytest.mark.parametrize(
    "command",
    ["inspect {0}", "import kinect2 {0} -o {1}/d", "fit {0} -o {1}/f.toml", "compare {0} {0}",
     "compare {0} --replay kinect-v2", "eval-real {0} -o {1}/s", "denoise {0} -o {1}/n",
     "corrupt {0} -o {1}/c", "preview {0} -o {1}/p"],
)  # fmt: skip
def test_no_command_runs_code_that_a_recording_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    command: str, field: str,
) -> None:  # fmt: skip
    ran = tmp_path / "ran"
    for name in {"sensor": ("s.toml", "st.py:f", "st:f")}.get(field, ("st.py:f", "st:f")):
        root = _folder(tmp_path / "r", f"{field} = {name!r}\n")
        code = f"open({str(ran)!r}, 'w')\ndef f(view, layers, p): return {{}}\n"
        (root / "st.py").write_text(code)
        chain = 'extends = "ideal"\ntitle = "x"\n[[stage]]\nuse = "st.py:f"\n'
        (root / "s.toml").write_text(chain)
        monkeypatch.chdir(root)
        monkeypatch.syspath_prepend(root)
        assert main(command.format(root, tmp_path).split()) in (0, 1, 2)
        error = capsys.readouterr().err.strip().splitlines()[-1:]
        if field == "sensor":
            assert f"camera.toml: sensor: {name!r} is no sensor that glsim ships" in error[0]
        assert not ran.exists()


def test_the_file_chooses_a_channel_of_openexr(tmp_path: Path) -> None:
    openexr = pytest.importorskip("OpenEXR")
    near = np.full((48, 64), 0.9, np.float32)
    kind = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}
    openexr.File(dict(kind), {"left.Z": near, "right.Z": 2 * near}).write(str(tmp_path / "a.exr"))
    with pytest.raises(DatasetError, match=r"or with channel = NAME in a camera\.toml"):
        open_maps(tmp_path)
    (tmp_path / "camera.toml").write_text('channel = "right.Z"\n')
    assert open_maps(tmp_path).frames[0].noisy_mm[0, 0] == pytest.approx(1800)
    many = {f"c{number}": np.zeros((2000, 2000), np.float32) for number in range(20)}
    openexr.File(dict(kind), many | {"Z": many["c0"]}).write(str(tmp_path / "a.exr"))
    with pytest.raises(DatasetError, match="too many channels"):
        open_maps(tmp_path)


def test_what_is_assumed_or_left_out_is_said_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = _folder(tmp_path / "r", "unit_mm = 0.1\n", 3)
    for number in (0, 2):
        cv2.imwrite(str(root / f"ir_{number:03d}.png"), DEPTH)
    assert main(["import", "kinect2", str(root), "-o", str(tmp_path / "d")]) == 0
    said = capsys.readouterr().err
    assert "depth_001 has no infrared image: that of the other frames is left out" in said
    assert said.count("states no intrinsics: those of kinect-v2 (f 365 px") == 1
