"""People: identities, performances, framings and movements of the source."""

import itertools
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.core.errors import ConfigError
from glsim.faces import open_source
from glsim.faces.face_source import Face, FaceKey
from glsim.faces.people.model import REGIONS
from glsim.faces.sources.people import People
from glsim.settings.source_settings import parse_source
from tests.support.face_sets import assert_keys_decide
from tests.support.people import needs_anny

pytestmark = needs_anny


@pytest.fixture(scope="module")
def people() -> People:
    return People(seed=3)


def faces(source: People, keys: Sequence[FaceKey]) -> list[Face]:
    return [face for face in source.load(keys) if isinstance(face, Face)]


def part(face: Face, *names: str) -> NDArray[np.float32]:
    """Return the vertices of regions."""
    numbers = [REGIONS.index(name) for name in names]
    return face.mesh.vertices_mm[np.isin(People(3).topology.regions, numbers)]


def test_a_frame_depends_on_its_key_alone(people: People) -> None:
    assert_keys_decide(people, [*people.frames("a0001", 33)[28:], *people.frames("a0000", 2)])


def test_people_without_an_end_or_of_another_source_are_refused(people: People) -> None:
    with pytest.raises(ConfigError, match="people faces never end"):
        people.subjects(None)
    with pytest.raises(ConfigError, match="no subject 'p0000' of people"):
        list(people.load([FaceKey("p0000", "s00_12", 0)]))


def test_all_frames_share_one_topology_with_regions(people: People) -> None:
    one, two = (faces(people, people.frames(name, 1))[0] for name in people.subjects(2))
    assert one.mesh.faces is two.mesh.faces
    topology = people.topology
    assert topology.triangles is one.mesh.faces
    assert topology.region_names == REGIONS
    assert topology.regions.shape == (len(one.mesh.vertices_mm),)
    assert set(np.unique(topology.regions)) == set(range(len(REGIONS)))
    assert len(np.unique(one.mesh.albedo)) > 10
    assert one.mesh.vertices_mm.dtype == np.float32


def test_the_face_looks_at_the_camera_whatever_the_body_does(people: People) -> None:
    for key in (*people.frames("a0002", 31)[29:], people.frames("a0003", 1)[0]):
        (face,) = faces(people, [key])
        nose = part(face, "nose")
        tip = nose[nose[:, 2].argmax()]
        np.testing.assert_allclose(tip, (0.0, 0.0, 45.0), atol=12.0)
        eyes = part(face, "sclera", "iris", "pupil")
        left, right = eyes[eyes[:, 0] > 0].mean(axis=0), eyes[eyes[:, 0] < 0].mean(axis=0)
        across = (left - right) / np.linalg.norm(left - right)
        assert across[0] > 0.99
        assert part(face, "foot")[:, 1].max() < -300


def test_a_framing_moves_its_part_to_the_origin(people: People) -> None:
    for subject in ("a0000", "a0004"):
        key = people.frames(subject, 1)[0]
        bust, body = (faces(People(3, framing=f), [key])[0] for f in ("bust", "body"))
        collar = part(bust, "neck").mean(axis=0)
        assert np.abs(collar).max() < 80.0
        low, high = body.mesh.vertices_mm.min(axis=0), body.mesh.vertices_mm.max(axis=0)
        assert abs(low[1] + high[1]) < 30.0
        assert high[1] < 1100.0
        soles = part(body, "foot")
        assert np.ptp(soles[soles[:, 1] < low[1] + 15.0][:, 2]) > 80.0  # flat on a floor


def test_no_two_frames_of_a_sequence_are_alike_and_motion_is_smooth(people: People) -> None:
    keys = people.frames("a0001", 30)
    for framing, most_mm in (("face", 25.0), ("body", 60.0)):
        bodies = [face.mesh.vertices_mm for face in faces(People(3, framing=framing), keys)]
        steps = [np.abs(b - a).max() for a, b in itertools.pairwise(bodies)]
        assert min(steps) > 0.01
        assert max(steps) < most_mm
    at_rest = [part(face, "scalp") for face in faces(people, [keys[0], keys[-1]])]
    assert np.median(np.abs(at_rest[0] - at_rest[1])) == 0.0  # the pipeline moves the head


def test_postures_vary_and_no_hand_hides_the_face(people: People) -> None:
    found, chin = set(), 0
    for subject in people.subjects(20):
        key = people.frames(subject, 1)[0]
        (face,) = faces(people, [key])
        arms = face.notes["arms"]
        assert isinstance(arms, list)
        found |= {(face.notes["sitting"], arm) for arm in arms}
        chin += "chin" in arms
        x, y, z = part(face, "hand").T
        assert not ((np.abs(x) < 70.0) & (y > -62.0) & (y < 120.0) & (z > 0.0)).any()
    assert len(found) >= 6
    assert chin >= 1


def test_settings_open_people_with_a_framing() -> None:
    source = open_source(parse_source({"kind": "people", "framing": "bust"}), seed=5)
    assert isinstance(source, People)
    assert (source.seed, source.framing) == (5, "bust")
    with pytest.raises(ValueError, match="framing: procedural has no such option"):
        parse_source({"kind": "procedural", "framing": "bust"})
