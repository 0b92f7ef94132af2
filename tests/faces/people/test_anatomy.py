"""People: sizes as of people, and action units that move what they should."""

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.core.errors import ConfigError
from glsim.faces.action_units import SHAPES, shape_weights, shapes_of
from glsim.faces.people.identity import sample_identity
from glsim.faces.people.load import load_model
from glsim.faces.people.model import REGIONS, BodyModel
from glsim.faces.people.subject import BodySubject
from glsim.faces.performance import CODES
from tests.support.people import needs_anny

HEAD = ("skin", "brow", "scalp", "lips", "ear", "nose", "lids")


@pytest.fixture(scope="module")
def model() -> BodyModel:
    return load_model()


def inside(model: BodyModel, *names: str) -> NDArray[np.bool_]:
    return np.isin(model.regions, [REGIONS.index(name) for name in names])


def shown(model: BodyModel, name: str, expression: Mapping[str, float]) -> NDArray[np.float32]:
    """Return the vertices of a subject with an expression; the head keeps its place."""
    return BodySubject(model, 0, name).frame("s00_12", "face", 0.0, expression)


def test_action_units_are_those_of_all_performances() -> None:
    assert shapes_of("AU12") == {"mouthSmileLeft": 1.0, "mouthSmileRight": 1.0}
    assert shapes_of("AU12_L") == {"mouthSmileLeft": 1.0}
    assert shapes_of("AU27") == shapes_of("AU27_R") == {"jawOpen": 1.0}
    assert shapes_of("AU30_L") == {"jawLeft": 1.0}
    for code in CODES:
        for word in code.split("+"):
            side = f"_{word[-1]}" if word[-1] in "LR" else ""
            assert shapes_of(f"AU{word.rstrip('LR')}{side}")
    for wrong in ("AU99", "AU12_X", "AU30", "12", "smile"):
        with pytest.raises(ConfigError, match=f"{wrong}: no blend shape shows this action unit"):
            shapes_of(wrong)


def test_an_action_takes_the_largest_weight_and_lips_are_pushed_out_once() -> None:
    weights = shape_weights({"AU26": 1.0, "AU25": 1.0, "AU18": 1.0, "AU22": 1.0})
    assert weights["jawOpen"] == 0.5
    assert weights["mouthPucker"] + weights["mouthFunnel"] == pytest.approx(1.0)
    assert list(weights) == [action for action in SHAPES if action in weights]
    assert set(shape_weights({"AU1_L": 0.5})) == {"browInnerUpLeft"}


@needs_anny
def test_grown_people_have_the_sizes_of_people(model: BodyModel) -> None:
    heights, pupils, breadths = [], [], []
    eyes, head = inside(model, "sclera", "iris", "pupil"), inside(model, "skin", "scalp")
    for number in range(40):
        person = sample_identity(1, f"a{number:04d}")
        if person.age_years < 18:
            continue
        body, _ = model.body(person.weights)
        eye = body[eyes]
        pupils.append(eye[eye[:, 0] > 0, 0].mean() - eye[eye[:, 0] < 0, 0].mean())
        heights.append(np.ptp(body[:, 1]))
        breadths.append(np.ptp(body[head, 0]))
    assert 50.0 < min(pupils) < max(pupils) < 75.0
    assert np.mean(pupils) == pytest.approx(62.0, abs=2.0)  # Dodgson 2004: 63
    assert 1350.0 < min(heights) < max(heights) < 2050.0
    assert np.mean(heights) == pytest.approx(1680.0, abs=60.0)  # NCD-RisC 2016: 1.65 m
    assert np.mean(breadths) == pytest.approx(150.0, abs=8.0)  # ANSUR: 154 men, 147 women


@needs_anny
def test_the_head_is_fine_and_its_surface_closed(model: BodyModel) -> None:
    on_head = inside(model, *HEAD)[model.triangles].all(axis=1)
    for name in ("a0000", "a0001", "a0002", "a0003"):
        body, _ = model.body(sample_identity(0, name).weights)
        corners = body[model.triangles[on_head]]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        assert edges.mean() <= 3.5
    # Skin has no hole: edges with one triangle lie within eyes, mouth, nostrils and teeth only.
    sides = np.concatenate([model.triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    _, first, count = np.unique(
        np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True
    )
    assert count.max() == 2
    open_at = sides[first[count == 1]]
    assert not inside(model, "scalp", "brow", "torso", "arm", "hand", "leg", "foot", "ear")[
        open_at
    ].any()


@needs_anny
def test_action_units_move_what_they_should(model: BodyModel) -> None:
    lips = np.flatnonzero(inside(model, "lips"))
    for name in ("a0000", "a0005", "a0012"):
        neutral = shown(model, name, {})
        corner = {"L": lips[neutral[lips, 0].argmax()], "R": lips[neutral[lips, 0].argmin()]}
        smile = shown(model, name, {"AU12": 1.0}) - neutral
        assert all(smile[v, 1] > 4.0 for v in corner.values())
        one = shown(model, name, {"AU12_L": 1.0}) - neutral
        assert one[corner["L"], 1] > 4.0 > 1.0 > abs(one[corner["R"], 1])
        frown = shown(model, name, {"AU15": 1.0}) - neutral
        assert all(frown[v, 1] < -2.0 for v in corner.values())
        jaw = shown(model, name, {"AU26": 1.0}) - neutral
        assert jaw[model.chin, 1] < -8.0
        wide = shown(model, name, {"AU27": 1.0}) - neutral
        assert wide[model.chin, 1] < -18.0
        brow = inside(model, "brow")
        assert (shown(model, name, {"AU1": 1.0, "AU2": 1.0}) - neutral)[brow, 1].mean() > 2.0
        assert (shown(model, name, {"AU4": 1.0}) - neutral)[brow, 1].mean() < -0.5


@needs_anny
@pytest.mark.parametrize("further", [{}, {"AU7": 1.0}, {"AU45": 1.0}])
def test_closed_lids_meet_and_do_not_cross(model: BodyModel, further: dict[str, float]) -> None:
    """The upper edge ends a quarter of a millimetre below the lower one; AU7 raises the lower."""
    landmarks = model.landmarks
    for name in ("a0000", "a0002", "a0004", "a0006", "a0012"):
        closed = shown(model, name, {"AU43": 1.0, **further})[landmarks]
        gap_mm = closed[[37, 38, 43, 44], 1] - closed[[41, 40, 47, 46], 1]
        np.testing.assert_allclose(gap_mm, -0.25, atol=0.05)
