"""The procedural head's action units: where they act, and how far."""

from __future__ import annotations

import numpy as np
import pytest

from glsim.faces.procedural import sample_identity
from glsim.faces.procedural.actions import ACTION_UNITS
from glsim.faces.procedural.parameters import mean_identity
from glsim.faces.procedural.subject import (
    HeadSubject,
    head_model,
    make_subject,
    neutral_head,
    subject_of,
)
from glsim.faces.procedural.template import PART_EYEBALL
from glsim.faces.procedural.topology import EYE_COLUMNS, MOUTH_COLUMN, SLIT_EYE, SLIT_MOUTH
from tests.support.head_points import slit_vertex, triangle_areas


@pytest.fixture(scope="module")
def mean() -> HeadSubject:
    neutral = neutral_head(mean_identity())  # without a person's asymmetry
    return subject_of(neutral, np.full(len(neutral), 0.6, np.float32))


UPPER_FACE = {"AU1", "AU2", "AU4", "AU5", "AU43", "AU45"}
LOWER_FACE = {"AU14", "AU15", "AU16", "AU17", "AU18", "AU20", "AU22", "AU23", "AU24", "AU25",
              "AU26", "AU27", "AU28"}  # fmt: skip


def test_there_are_enough_units() -> None:
    assert len({unit.name for unit in ACTION_UNITS}) >= 20


@pytest.mark.parametrize("unit", [unit.name for unit in ACTION_UNITS])
def test_units_act_where_they_should(unit: str, mean: HeadSubject) -> None:
    rest, acted, left = mean.frames([{}, {unit: 1.0}, {f"{unit}_L": 1.0}])
    moved = np.linalg.norm(acted - rest, axis=1)
    assert 1.5 <= moved.max() <= 46.0
    y, z = head_model().template.points[:, 1], head_model().template.points[:, 2]
    assert moved[z < -120].max() < 0.5  # never the back of the head
    if unit in UPPER_FACE:
        assert moved[y < -30].max() < 0.5
    if unit in LOWER_FACE:
        assert moved[y > 25].max() < 0.5
    if unit not in ("AU26", "AU27", "AU28"):
        right_side = head_model().template.points[:, 0] < -14
        assert np.abs(left - rest)[right_side].max() < 0.05


@pytest.mark.parametrize("unit", [unit.name for unit in ACTION_UNITS])
def test_units_are_symmetric_and_keep_triangles(unit: str, mean: HeadSubject) -> None:
    (acted,) = mean.frames([{unit: 1.0}])
    head = head_model().template
    assert triangle_areas(acted).min() > 1e-5
    keys = list(zip(head.row, head.column, head.ring, head.low, strict=True))
    place = {key: i for i, key in enumerate(keys) if key[1]}
    pairs = [
        (i, place[r, -c, g, low])
        for (r, c, g, low), i in place.items()
        if c > 0 and (r, -c, g, low) in place
    ]
    on_left, other = (list(column) for column in zip(*pairs, strict=True))
    difference = acted[on_left] - acted[other] * np.array([-1, 1, 1], dtype=np.float32)
    assert np.abs(difference).max() < 1e-3


def test_jaw_drop_opens_the_mouth(mean: HeadSubject) -> None:
    top, bottom = slit_vertex(SLIT_MOUTH, 1, False), slit_vertex(SLIT_MOUTH, 1, True)
    rest, drop, stretch = mean.frames([{}, {"AU26": 1.0}, {"AU27": 1.0}])
    gap = [float(f[top, 1] - f[bottom, 1]) for f in (rest, drop, stretch)]
    assert abs(gap[0]) < 0.5
    assert 10 < gap[1] < 25
    assert 25 < gap[2] < 50


@pytest.mark.parametrize("subject", ["p0000", "p0001", "p0002", "p0003"])
def test_lids_close_over_the_globe(subject: str) -> None:
    person = make_subject(sample_identity(0, subject), 0, subject)
    rest, shut = person.frames([{}, {"AU43": 1.0}])
    for side in (1, -1):
        for column in range(EYE_COLUMNS[0] + 3, EYE_COLUMNS[1] - 2):
            top = slit_vertex(SLIT_EYE, side * column, False)
            bottom = slit_vertex(SLIT_EYE, side * column, True)
            assert rest[top, 1] - rest[bottom, 1] > 2.0
            assert shut[top, 1] - shut[bottom, 1] < 0.1
    ball = head_model().template.part == PART_EYEBALL
    assert np.array_equal(rest[ball], shut[ball])


def test_smile_lifts_and_widens(mean: HeadSubject) -> None:
    corner = slit_vertex(SLIT_MOUTH, MOUTH_COLUMN, False)
    rest, smile = mean.frames([{}, {"AU12": 1.0}])
    assert smile[corner, 0] - rest[corner, 0] > 3.0
    assert smile[corner, 1] - rest[corner, 1] > 3.0
