"""Test the plan: splits, seeds, file names."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import settings as quick
from hypothesis import strategies as st

from glsim.errors import ConfigError, DatasetError
from glsim.faces.base import FaceKey
from glsim.faces.one_mesh import OneMesh
from glsim.plan.split import split_subjects
from glsim.plan.tasks import Task, check_plan, make_tasks
from glsim.settings.schema import Settings, load_settings
from glsim.settings.seeds import stable_seed
from tests.support.scenes import plate

SHARES = (0.70, 0.12, 0.18)


class People(OneMesh):
    """The requested numbers of subjects and of frames, in two sequences."""

    def __init__(self, name: str = "people") -> None:
        super().__init__(plate())
        self.name = name

    def subjects(self, count: int | None) -> list[str]:
        return [f"p{number}" for number in range(count or 0)]

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        return [FaceKey(subject, "ab"[n % 2], n // 2, n / 30) for n in range(count or 0)]


def settings(subjects: int = 10, frames: int = 4, **overrides: object) -> Settings:
    source = {"subjects": subjects, "frames_per_subject": frames}
    return load_settings(overrides={"source": source} | overrides)


def plan(subjects: int = 10, frames: int = 4, **overrides: object) -> list[Task]:
    return make_tasks(settings(subjects, frames, **overrides), [People()])


@pytest.mark.parametrize(
    ("subjects", "counts"),
    [(1, (1, 0, 0)), (2, (2, 0, 0)), (3, (1, 1, 1)), (10, (7, 1, 2)), (100, (70, 12, 18))],
)
def test_counts_are_those_of_the_largest_remainder(
    subjects: int, counts: tuple[int, int, int]
) -> None:
    names = [f"s{n}" for n in range(subjects)]
    for seed in range(5):
        split = split_subjects(names, SHARES, seed)
        assert set(split) == set(names)
        assert tuple(list(split.values()).count(s) for s in ("train", "val", "test")) == counts


@quick(deadline=None, max_examples=200)
@given(
    st.integers(1, 200),
    st.lists(st.integers(0, 100), min_size=3, max_size=3).filter(any),
    st.integers(0, 2**63 - 1),
)
def test_every_subject_is_in_one_split_and_no_wanted_split_is_empty(
    subjects: int, weights: list[int], seed: int
) -> None:
    shares = [weight / sum(weights) for weight in weights]
    split = split_subjects(
        [f"s{n}" for n in range(subjects)], (shares[0], shares[1], shares[2]), seed
    )
    assert len(split) == subjects
    wanted = [share for share in shares if share > 0]
    for name, share in zip(("train", "val", "test"), shares, strict=True):
        count = list(split.values()).count(name)
        assert share > 0 or count == 0
        if subjects >= len(wanted):
            assert share == 0 or count > 0
            assert abs(count - share * subjects) < 2


def test_the_split_depends_on_seed_and_names_not_on_their_order() -> None:
    names = [f"s{n}" for n in range(50)]
    split = split_subjects(names, SHARES, 3)
    assert split_subjects(names[::-1], SHARES, 3) == split
    assert split_subjects(names, SHARES, 4) != split


def test_seeds_are_pinned() -> None:
    """The seeds of a data set never change."""
    assert stable_seed("frame", 0, "procedural", "p0000", "smile", 3) == 6056506485744913244
    assert stable_seed("a", "b") != stable_seed("ab")
    assert stable_seed("a", 1) == stable_seed("a", "1")
    assert 0 <= stable_seed("x") < 2**64


def test_tasks_are_in_order_with_names_and_seeds_of_their_own() -> None:
    tasks = plan(5, 6, devices=2)
    assert [task.index for task in tasks] == list(range(30))
    assert [task.subject for task in tasks[::6]] == ["p0", "p1", "p2", "p3", "p4"]
    assert [task.device for task in tasks[::6]] == [0, 1, 0, 1, 0]
    assert tasks[3].stem == f"{tasks[3].split}/p0/b_00001"
    assert len({task.stem for task in tasks}) == 30
    assert len({task.seeds.frame for task in tasks}) == 30
    assert len({task.seeds.sequence for task in tasks}) == 10
    assert len({task.seeds.subject for task in tasks}) == 5
    assert len({seed for task in tasks for seed in task.seeds}) == 45


def test_the_plan_is_a_function_of_the_settings() -> None:
    assert plan() == plan()
    other = plan(seed=1)
    assert not {task.seeds for task in plan()} & {task.seeds for task in other}


def test_more_frames_leave_the_others_as_they_were() -> None:
    few = {task.stem: task.seeds for task in plan(10, 4)}
    many = {task.stem: task.seeds for task in plan(10, 8)}
    assert few.items() <= many.items()


def test_noise_settings_leave_the_plan_as_it_was() -> None:
    assert plan(sensor="kinect-v1", stage={"axial": {"angle_mm": 0}}) == plan()


def test_several_sources_are_kept_apart() -> None:
    two = settings(3, 2, source=[{"subjects": 3, "frames_per_subject": 2}] * 2)
    tasks = make_tasks(two, [People("one"), People("one")])
    assert [task.subject for task in tasks[::2]] == ["0-p0", "0-p1", "0-p2", "1-p0", "1-p1", "1-p2"]
    assert [task.source for task in tasks] == [0] * 6 + [1] * 6
    assert len({task.seeds.frame for task in tasks}) == 12


def test_an_empty_plan_is_an_error() -> None:
    with pytest.raises(ConfigError, match="the plan has no frames: the source has no subjects or"):
        make_tasks(settings(5, 5), [_Nobody()])


class _Nobody(People):
    def subjects(self, count: int | None) -> list[str]:
        return []


def test_a_plan_that_would_leak_or_overwrite_is_an_error() -> None:
    tasks = plan(2, 2, split=[0.5, 0.5, 0.0])
    moved = replace(tasks[1], split="test")
    with pytest.raises(DatasetError, match=r"subject p0 is in test and in (train|val)"):
        check_plan([tasks[0], moved])
    with pytest.raises(DatasetError, match=r"2 frames would be written to .*/p0/a_00000: sequence"):
        check_plan([tasks[0], tasks[0]])
