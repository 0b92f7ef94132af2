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

SOURCE = ProceduralFaces(seed=3)
#: Each point's mirror image, from the drawing of Multi-PIE.
MIRROR = np.concatenate(
    [
        *(range(16, -1, -1), range(26, 16, -1), range(27, 31), range(35, 30, -1)),
        *((45, 44, 43, 42, 47, 46), (39, 38, 37, 36, 41, 40)),
        *(range(54, 47, -1), range(59, 54, -1), range(64, 59, -1), (67, 66, 65)),
    ]
)


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
    assert (MIRROR[MIRROR] == np.arange(LANDMARKS)).all()
    on_midline = np.flatnonzero(np.arange(LANDMARKS) == MIRROR)
    assert on_midline.tolist() == [8, 27, 28, 29, 30, 33, 51, 57, 62, 66]


@pytest.mark.parametrize("subject", ["p0000", "p0001", "p0007"])
def test_the_parts_follow_each_other_as_in_multi_pie(subject: str) -> None:
    """Each part begins at the subject's right, and lies where the part lies."""
    points = points_of(subject)
    x, y, z = points.T
    for part in (range(4, 13), range(17, 22), range(22, 27), range(31, 36), range(48, 55)):
        assert (np.diff(x[list(part)]) > 0).all(), part
    assert (np.diff(y[:9]) < 0).all()  # from the ear down to the chin, and up to the other ear
    assert (np.diff(y[8:17]) > 0).all()
    assert x[:8].max() < 0 < x[9:17].min()
    assert (np.diff(x[54:60]) < 0).all()  # back along the lower lip
    assert (np.diff(x[[60, 61, 62, 63, 64]]) > 0).all()
    assert (np.diff(x[[64, 65, 66, 67, 60]]) < 0).all()
    assert (np.diff(y[27:31]) < 0).all()  # down the bridge of the nose
    assert z[30] == z.max()  # its tip is the foremost point
    assert y[8] == y.min()  # the chin is the lowest
    for eye in (np.arange(36, 42), np.arange(42, 48)):
        assert x[eye[0]] == x[eye].min()
        assert x[eye[3]] == x[eye].max()
        assert (y[eye[[1, 2]]] > y[eye[[0, 3]]].max() - 1.5).all()
        assert y[eye[[1, 2]]].min() > y[eye[[4, 5]]].max()
        assert x[eye[1]] < x[eye[2]]
        assert x[eye[5]] < x[eye[4]]
    assert y[17:27].min() > y[36:48].max()
    assert y[48:68].max() < y[31:36].min()
    assert (y[49:54] > y[55:60][::-1]).all()
    assert y[48:68].min() > y[8]


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
