"""D3DFACS: registrations and raw sequences, their action units, frames, peaks and patches."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from glsim.faces.face_source import Face
from glsim.faces.meshes.alignment import rotation
from glsim.faces.sources.d3dfacs import D3dfacs, action_units, deformation
from tests.support.face_models import analytic_face
from tests.support.face_sets import FACE, TRIANGLES, all_keys, obj_bytes, ply_bytes, put


def _registrations(root: Path, frames: int = 5) -> Path:
    """Write a jaw that opens and closes on a drifting head; frame 12 is missing."""
    for number in range(frames):
        opening = 20.0 * np.sin(np.pi * number / (frames - 1))
        points = analytic_face(rows=31, columns=25, open_mm=opening)[0] + [0, 3.0 * number, 0]
        name = f"Joe/1+2L/1+2L_{10 + number + (number > 1)}.ply"
        put(root / "d3dfacs_alignments" / name, ply_bytes(points / 1000, TRIANGLES))
    return root


def test_registrations(tmp_path: Path) -> None:
    source = D3dfacs(_registrations(tmp_path))
    keys = all_keys(source)
    assert [(key.subject, key.sequence, key.frame) for key in keys] == [
        ("Joe", "1+2L", frame) for frame in (10, 11, 13, 14, 15)
    ]
    assert [key.time_s for key in keys] == [pytest.approx(n / 60) for n in (0, 1, 3, 4, 5)]
    faces = list(pickle.loads(pickle.dumps(source)).load(keys))
    assert all(isinstance(face, Face) for face in faces)
    good = [face for face in faces if isinstance(face, Face)]
    assert good[0].notes["action_units"] == ["1", "2L"]
    assert good[0].notes["unit"] == "m"
    assert good[0].notes["axes"] == "+x+y+z"
    assert good[0].mesh.faces is good[4].mesh.faces
    moved = good[4].mesh.vertices_mm - good[0].mesh.vertices_mm
    np.testing.assert_allclose(moved, np.tile([0, 12, 0], (len(FACE), 1)), atol=1e-3)


def test_every_and_the_peak(tmp_path: Path) -> None:
    _registrations(tmp_path)
    assert [key.frame for key in all_keys(D3dfacs(tmp_path, every=2))] == [10, 13, 15]
    peak = D3dfacs(tmp_path, peak_only=True)
    assert [key.frame for key in all_keys(peak)] == [13]
    (face,) = peak.load(all_keys(peak))
    assert face.notes["peak"] == "measured"
    put(tmp_path / "d3dfacs_alignments/Joe/1+2L/1+2L_13.ply", b"ply\n")
    assert [key.frame for key in all_keys(D3dfacs(tmp_path, peak_only=True))] in ([11], [14])


def test_deformation_leaves_rigid_motion_out() -> None:
    turned = FACE @ rotation("+z+x+y").T + [1, 2, 3]
    assert deformation(FACE, turned) < 1e-9
    assert deformation(FACE, analytic_face(rows=31, columns=25, open_mm=20)[0]) > 1


def _halves(shift: int) -> tuple[bytes, bytes]:
    """Return two overlapping half faces, numbered separately; ``shift`` changes their topology."""
    corners = FACE[TRIANGLES][:, :, 0].mean(axis=1)
    parts = []
    for side in (corners < 8 + shift, corners >= -2 - shift):
        used, inverse = np.unique(TRIANGLES[side], return_inverse=True)
        parts.append(obj_bytes(FACE[used], inverse.reshape(-1, 3), "/1"))
    return parts[0], parts[1]


def test_raw_sequences_of_two_patches(tmp_path: Path) -> None:
    for number in range(3):
        left, right = _halves(3 * number)
        put(tmp_path / f"Ann/AU 4+7R take/left_{number:03d}.obj", left)
        put(tmp_path / f"Ann/AU 4+7R take/right_{number:03d}.obj", right)
    count = left.count(b"\nv ") + 1
    grouped = b"o left\n" + left + b"o right\n" + b"".join(
        line if not line.startswith(b"f") else
        b"f " + b" ".join(b"%d" % (int(w.split(b"/")[0]) + count) for w in line.split()[1:]) + b"\n"
        for line in right.splitlines(keepends=True)
    )  # fmt: skip
    put(tmp_path / "Bob/12/f_7.obj", grouped)
    source = D3dfacs(tmp_path)
    keys = all_keys(source)
    assert [(k.subject, k.sequence, k.frame) for k in keys] == [
        ("Ann", "AU_4+7R_take", 0), ("Ann", "AU_4+7R_take", 1), ("Ann", "AU_4+7R_take", 2),
        ("Bob", "12", 7),
    ]  # fmt: skip
    faces = list(pickle.loads(pickle.dumps(source)).load(keys))
    good = [face for face in faces if isinstance(face, Face)]
    assert len(good) == 4
    assert good[0].notes["unit"] == "mm"
    assert good[0].notes["action_units"] == ["4", "7R"]
    assert len(good[0].mesh.faces) < len(good[2].mesh.faces)
    assert all(abs(np.ptp(face.mesh.vertices_mm[:, 0]) - np.ptp(FACE[:, 0])) < 1 for face in good)
    assert [key.frame for key in all_keys(D3dfacs(tmp_path, peak_only=True))] == [1, 7]


@pytest.mark.parametrize(
    ("name", "units"),
    [("1+2", ["1", "2"]), ("AU_12L", ["12L"]), ("day2-4+5R", ["4", "5R"]), ("neutral", [])],
)
def test_action_units(name: str, units: list[str]) -> None:
    assert action_units(name) == units


@pytest.mark.parametrize(
    ("turn", "scale", "why"),
    [
        ("-x+y-z", 0.001, "looks away or stands on its head"),
        ("-x-y+z", 0.001, "looks away or stands on its head"),
        ("+x+y+z", 0.01, "the face is .* times as large as a mean one"),
    ],
)
def test_a_face_that_is_wrong_is_refused(tmp_path: Path, turn: str, scale: float, why: str) -> None:
    put(tmp_path / "Joe/1/1_1.ply", ply_bytes(FACE @ rotation(turn) * scale, TRIANGLES))
    source = D3dfacs(tmp_path)
    (bad,) = source.load(all_keys(source))
    with pytest.raises(type(bad.error), match=why):
        raise bad.error
    if scale == 0.001:
        right = D3dfacs(tmp_path, axes=turn)
        assert all(isinstance(face, Face) for face in right.load(all_keys(right)))
