"""The 68 landmarks of embedded heads: on the skin, mirrored, in the order of Multi-PIE."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.faces.landmarks import LANDMARKS, landmark_vertices
from glsim.faces.procedural.regions import REGIONS
from glsim.faces.procedural.source import ProceduralFaces
from glsim.faces.procedural.subject import head_model
from glsim.faces.procedural.template import PART_SKIN
from tests.support.landmark_order import MIDLINE, MIRROR, assert_order

SOURCE = ProceduralFaces(seed=3)


def points_of(subject: str) -> NDArray[np.float64]:
    """The landmarks of a neutral head, (68, 3) mm: x to its left, y up, z to the front."""
    return SOURCE.neutral(subject)[0][landmark_vertices(SOURCE)].astype(np.float64)


def test_they_are_68_different_vertices_of_the_skin() -> None:
    vertices = landmark_vertices(SOURCE)
    assert vertices.shape == (LANDMARKS,)
    assert len(set(vertices.tolist())) == LANDMARKS
    template = head_model().template
    assert (template.part[vertices] == PART_SKIN).all()
    assert (template.ring[vertices] == 0).all()
    used = np.unique(template.faces)
    assert np.isin(vertices, used).all()


def test_left_is_the_mirror_of_right_on_the_template() -> None:
    points = head_model().template.points[landmark_vertices(SOURCE)]
    np.testing.assert_allclose(points[MIRROR] * [-1, 1, 1], points, atol=1e-6)
    assert np.flatnonzero(np.arange(LANDMARKS) == MIRROR).tolist() == MIDLINE


@pytest.mark.parametrize("subject", ["p0000", "p0001", "p0007"])
def test_the_parts_follow_each_other_as_in_multi_pie(subject: str) -> None:
    assert_order(points_of(subject))


def test_brows_and_lips_lie_on_their_regions() -> None:
    """The regions are painted by another rule: the weights of brows, lips and nose."""
    regions = SOURCE.regions[landmark_vertices(SOURCE)]
    brow, lips, nose = (REGIONS.index(name) for name in ("brow", "lips", "nose"))
    assert (regions[17:27] == brow).all()
    assert (regions[28:31] == nose).all()
    assert (regions[60:68] == lips).all()
    assert np.isin(regions[36:48], [REGIONS.index("lids"), REGIONS.index("skin")]).all()


def test_an_open_mouth_parts_the_inner_lips() -> None:
    """They are fixed vertices: the lower inner lip follows the jaw, the bridge does not."""
    subject = SOURCE.subjects(1)[0]
    vertices = landmark_vertices(SOURCE)
    gaps = []
    for face in SOURCE.load(SOURCE.frames(subject, 240)[::4]):
        points = face.mesh.vertices_mm[vertices]  # type: ignore[union-attr]
        gaps.append(float(points[62, 1] - points[66, 1]))
    assert max(gaps) > min(gaps) + 1.0
