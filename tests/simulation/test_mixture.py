"""Test mixed sources, the paper's split, and the options of each kind of source."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import settings as quick
from hypothesis import strategies as st

from glsim.core.errors import ConfigError
from glsim.settings.schema import load_settings
from glsim.settings.source_settings import SourceSettings, parse_source
from glsim.simulation.pipeline import open_sources
from glsim.simulation.plan.split import PAPER_IMAGES, split_as_paper
from glsim.simulation.plan.tasks import Thinning, image_counts, make_tasks
from tests.support.face_sets import FACE, TRIANGLES, ply_bytes, put, write_tester


def _sources(*options: dict[str, float]) -> list[SourceSettings]:
    return [parse_source(option) for option in options]


def test_counts_and_weights() -> None:
    assert image_counts(_sources({}, {}), [7, 9]) == [7, 9]
    assert image_counts(_sources({"count": 3}, {}), [7, 9]) == [3, 9]
    assert image_counts(_sources({"weight": 2}, {"weight": 1}), [100, 10]) == [20, 10]
    three = _sources({"weight": 2}, {"weight": 1}, {"count": 4})
    assert image_counts(three, [10, 10, 9]) == [10, 5, 4]
    with pytest.raises(ConfigError, match=r"source 1 \(procedural\): count = 5, but it has 4"):
        image_counts(_sources({}, {"count": 5}), [9, 4])
    with pytest.raises(ConfigError, match=r"source 1 .* give it a weight or a count, as other"):
        image_counts(_sources({"weight": 1}, {}), [9, 4])
    with pytest.raises(ConfigError, match="a weight or a count, not both"):
        load_settings(overrides={"source": [{"weight": 1, "count": 2}]})


@quick(max_examples=100)
@given(st.lists(st.integers(0, 20), min_size=1, max_size=8).filter(any), st.data())
def test_thinning_is_even_and_exact(people: list[int], data: st.DataObject) -> None:
    total = sum(people)
    count = data.draw(st.integers(1, total))
    thinning = Thinning(total, count)
    positions = [thinning.position(number) for number in range(count)]
    assert positions == sorted(set(positions))
    assert 0 <= positions[0] <= positions[-1] < total
    assert [thinning.below(p) for p in positions] == list(range(count))
    first = 0
    for have in people:
        kept = thinning.below(first + have) - thinning.below(first)
        assert kept == sum(first <= p < first + have for p in positions)
        assert abs(kept - have * count / total) <= 1
        first += have
    every = Thinning(total, total)
    assert [every.position(number) for number in range(total)] == list(range(total))


def test_the_papers_split_is_met_where_the_people_allow_it() -> None:
    people = {f"d{n}": 4300 + 37 * n for n in range(10)} | {f"w{n}": 20 for n in range(150)}
    split = split_as_paper(people, 0)
    total = sum(people.values())
    for name, images in zip(("train", "val", "test"), PAPER_IMAGES, strict=True):
        have = sum(count for person, count in people.items() if split[person] == name)
        assert abs(have - images / sum(PAPER_IMAGES) * total) <= 20
    assert split_as_paper(dict(reversed(people.items())), 0) == split


@quick(max_examples=50)
@given(st.lists(st.integers(0, 500), min_size=1, max_size=30), st.integers(0, 2**63 - 1))
def test_every_person_is_in_one_of_the_papers_splits(counts: list[int], seed: int) -> None:
    people = {f"p{n}": count for n, count in enumerate(counts)}
    split = split_as_paper(people, seed)
    assert set(split) == set(people)
    if len(counts) >= 3 and min(counts) > 0:
        assert set(split.values()) == {"train", "val", "test"}


def _three_sets(root: Path) -> list[dict[str, object]]:
    for subject in ("Ann", "Bob", "Cy"):
        for frame in range(6):
            data = ply_bytes(FACE / 1000, TRIANGLES)
            put(root / f"d3/{subject}/1+2/1+2_{frame}.ply", data)
    for number in (1, 2):
        write_tester(root / "fw", number)
    return [
        {"kind": "d3dfacs", "root": root / "d3", "every": 2, "weight": 3},
        {"kind": "facewarehouse", "root": root / "fw", "steps": 2, "poses": False, "weight": 1},
        {"kind": "procedural", "subjects": 2, "frames_per_subject": 4, "count": 5},
    ]


def test_several_sources_make_one_plan(tmp_path: Path) -> None:
    settings = load_settings(
        overrides={"source": _three_sets(tmp_path), "split": "paper", "seed": 3}
    )
    tasks = make_tasks(settings, open_sources(settings))
    by_source = [sum(task.source == number for task in tasks) for number in range(3)]
    assert by_source == [9, 3, 5]
    assert {task.subject[:2] for task in tasks} == {"0-", "1-", "2-"}
    assert {task.split for task in tasks} == {"train", "val", "test"}
    assert load_settings(overrides={"split": "0.5,0.25,0.25"}).split == (0.5, 0.25, 0.25)
