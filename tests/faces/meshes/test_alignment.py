"""Unit, axes, winding and centre of a mesh are detected, checked and logged."""

import json
import math
from collections.abc import Callable
from itertools import permutations, product

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from glsim.core.errors import ConfigError, MeshError
from glsim.faces.meshes.alignment import UNITS_MM, check_unit, estimate_alignment, rotation
from glsim.faces.meshes.face_fit import ORIGIN_BEHIND_NOSE_MM
from tests.support.face_models import analytic_face

FACE, TRIANGLES = analytic_face()
#: Every way to name the axes of a file that does not mirror it.
TURNS = [
    "".join(sign + axis for sign, axis in zip(signs, axes, strict=True))
    for axes in permutations("xyz")
    for signs in product("+-", repeat=3)
    if (signs.count("-") % 2 == 0) == ("".join(axes) in "xyzxy")
]


def _tilt(first: int, second: int, degrees: float) -> NDArray[np.float64]:
    """Rotation in the plane of two axes."""
    turn = np.eye(3)
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turn[first, [first, second]] = cosine, -sine
    turn[second, [first, second]] = sine, cosine
    return turn


@pytest.mark.parametrize(
    "axes",
    [t if n % 6 == 0 else pytest.param(t, marks=pytest.mark.long) for n, t in enumerate(TURNS)],
)
def test_every_turn_is_undone(axes: str) -> None:
    in_file = FACE @ rotation(axes)
    alignment = estimate_alignment(in_file, TRIANGLES)
    assert alignment.axes == axes
    assert not alignment.flip_winding
    plain = estimate_alignment(FACE, TRIANGLES, axes="+x+y+z")
    np.testing.assert_allclose(alignment.apply(in_file), plain.apply(FACE), atol=0.5)


@pytest.mark.parametrize("unit", ["m", "dm", "cm", "mm"])
def test_unit_is_found_from_the_size(unit: str) -> None:
    alignment = estimate_alignment(FACE / UNITS_MM[unit], TRIANGLES)
    assert (alignment.unit, alignment.mm_per_unit) == (unit, UNITS_MM[unit])
    assert alignment.detected == ("unit", "axes")
    extent = np.ptp(alignment.apply(FACE / UNITS_MM[unit]), axis=0)
    np.testing.assert_allclose(extent, np.ptp(FACE, axis=0), rtol=1e-5)


def test_units_can_be_given() -> None:
    assert estimate_alignment(FACE / 25.4, TRIANGLES, unit="inch").mm_per_unit == 25.4
    alignment = estimate_alignment(FACE / 125, TRIANGLES, unit="125", axes="+x+y+z")
    assert (alignment.unit, alignment.mm_per_unit, alignment.detected) == ("125 mm", 125.0, ())


def test_origin_lies_behind_the_tip_of_the_nose() -> None:
    alignment = estimate_alignment(FACE, TRIANGLES)
    points = alignment.apply(FACE)
    tip = points[np.argmax(points[:, 2])]
    assert tip[2] == pytest.approx(ORIGIN_BEHIND_NOSE_MM, abs=0.3)  # of 40,000 samples
    assert np.abs(tip[:2]).max() < 4  # within the ball of the tip
    assert estimate_alignment(FACE, TRIANGLES, recentre=False).origin_mm == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("axes", ["+x+y+z", "+z+x+y"])
def test_the_pose_does_not_depend_on_the_triangles(axes: str) -> None:
    points, faces = FACE @ rotation(axes), TRIANGLES
    alignment = estimate_alignment(points, faces)
    rng = np.random.default_rng(0)
    for order in (slice(None), slice(None, None, -1), rng.permutation(16 * len(TRIANGLES))):
        finer = trimesh.remesh.subdivide(*trimesh.remesh.subdivide(points, faces))
        other = estimate_alignment(finer[0], finer[1][order])
        assert other.axes == axes
        np.testing.assert_allclose(other.origin_mm, alignment.origin_mm, atol=0.1)
        assert other.nose_match == pytest.approx(alignment.nose_match, abs=0.01)


@pytest.mark.parametrize("wrong", ["-x-y+z", "-x+y-z", "+x+z-y"])
def test_given_axes_that_turn_the_face_away_are_doubted(wrong: str) -> None:
    alignment = estimate_alignment(FACE, TRIANGLES, axes=wrong)
    assert alignment.axes == wrong
    assert any("look away or stand on its head" in doubt for doubt in alignment.doubts)
    assert estimate_alignment(FACE, TRIANGLES, axes="+x+y+z").doubts == ()


@pytest.mark.parametrize(
    "change",
    [
        lambda face: face * [0.8, 0.8, 0.8],
        lambda face: face * [1.2, 1.2, 1.2],
        lambda face: face @ _tilt(0, 1, 12).T,
        lambda face: face @ _tilt(1, 2, 15).T,
        lambda face: face @ _tilt(0, 2, -15).T,
        lambda face: face + np.random.default_rng(0).normal(size=face.shape),
    ],
)
def test_small_faces_tilts_and_noise_do_not_disturb(
    change: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> None:
    assert estimate_alignment(change(FACE) @ rotation("+z+x+y"), TRIANGLES).axes == "+z+x+y"


def test_an_open_mouth_does_not_disturb() -> None:
    face, triangles = analytic_face(open_mm=40)
    assert estimate_alignment(face, triangles).axes == "+x+y+z"


@pytest.mark.long
def test_no_nose_is_an_error_or_with_given_axes_a_doubt() -> None:
    flat = FACE.copy()
    flat[:, 2] = 40 - flat[:, 0] ** 2 / 160 - flat[:, 1] ** 2 / 440
    with pytest.raises(MeshError, match="no face is found: give the axes"):
        estimate_alignment(flat, TRIANGLES)
    alignment = estimate_alignment(flat, TRIANGLES, axes="+x+y+z")
    assert alignment.doubts == ("no nose is found: centred on the bounding box",)
    points = alignment.apply(flat)
    assert points[:, 2].max() == pytest.approx(ORIGIN_BEHIND_NOSE_MM, abs=0.5)


@pytest.mark.parametrize("factor", [1e-6, 1e5, 1e30])
def test_sizes_no_unit_explains_are_refused(factor: float) -> None:
    with pytest.raises(MeshError, match=r"it is of unknown scale, .* gives its face the mean size"):
        estimate_alignment(FACE * factor, TRIANGLES)


@pytest.mark.parametrize(("unit", "size"), [("m", "215,"), ("0.1", "22 mm")])
def test_a_given_unit_must_make_a_head(unit: str, size: str) -> None:
    with pytest.raises(MeshError, match=f"it is {size}.*should be 80 to 2600 mm"):
        estimate_alignment(FACE, TRIANGLES, unit=unit)


@pytest.mark.parametrize("unit", ["metre", "", "-5", "nan", "inf", "0"])
def test_nonsense_units_are_config_errors(unit: str) -> None:
    with pytest.raises(ConfigError, match="no such unit"):
        check_unit(unit)


def test_nonsense_axes_are_config_errors() -> None:
    with pytest.raises(ConfigError, match="mirrors the face"):
        estimate_alignment(FACE, TRIANGLES, axes="-x+y+z")
    for axes in ("xyz", "+x+x+z", "+x+y", "up", ""):
        with pytest.raises(ConfigError, match="write which axis of the file"):
            estimate_alignment(FACE, TRIANGLES, axes=axes)


def test_notes_are_json_and_the_line_names_everything() -> None:
    alignment = estimate_alignment(FACE[:, [1, 2, 0]] / 10, TRIANGLES[:, ::-1])
    notes = json.loads(json.dumps(alignment.notes()))
    assert notes["unit"] == "cm"
    assert notes["axes"] == "+z+x+y"
    assert notes["winding_flipped"] is True
    assert notes["found_by_rule"] == ["unit", "axes"]
    line = "unit cm, axes +z+x+y, 215 mm across (unit and axes found by rule)"
    assert str(alignment).startswith(line)
