"""Test the plan: splits, seeds, file names."""

import hashlib
import re
import tracemalloc
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import settings as quick
from hypothesis import strategies as st

from glsim.core.errors import ConfigError, DatasetError
from glsim.data.chunks import ChunkPlan
from glsim.faces.face_source import FaceKey
from glsim.faces.one_mesh import OneMesh
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.pipeline import open_sources
from glsim.simulation.plan.split import split_subjects
from glsim.simulation.plan.tasks import Plan, make_tasks
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


def plan(subjects: int = 10, frames: int = 4, **overrides: object) -> Plan:
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


@quick(max_examples=200)
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
    assert len({seed for task in tasks for seed in task.seeds[:3]}) == 45
    assert {task.seeds.device for task in tasks if task.device == 0} == {None}
    assert len({task.seeds.device for task in tasks if task.device == 1}) == 1
    other = plan(5, 6, seed=1)
    assert not {task.seeds.frame for task in tasks} & {task.seeds.frame for task in other}


def test_more_frames_leave_the_others_as_they_were() -> None:
    few = {task.stem: task.seeds for task in plan(10, 4)}
    many = {task.stem: task.seeds for task in plan(10, 8)}
    assert few.items() <= many.items()


class _Scans(People):
    """Two meshes of each person, which a plan uses again."""

    repeats = True

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        return super().frames(subject, 2)[:count]


def test_meshes_are_used_again_as_sequences_with_draws_of_their_own() -> None:
    tasks = make_tasks(settings(2, 5), [_Scans()])
    first = [task for task in tasks if task.subject == "p0"]
    assert [task.stem.rpartition("/")[2] for task in first] == [
        "a_00000", "b_00000", "a_r001_00000", "b_r001_00000", "a_r002_00000",
    ]  # fmt: skip
    assert [task.key for task in first] == [first[0].key, first[1].key] * 2 + [first[0].key]
    assert len({task.seeds.frame for task in tasks}) == 10
    assert len({task.seeds.sequence for task in tasks}) == 10
    few = make_tasks(settings(2, 2), [_Scans()])
    assert {t.stem: t.seeds for t in few}.items() <= {t.stem: t.seeds for t in tasks}.items()
    assert len(make_tasks(settings(2, 1), [_Scans()])) == 2


def test_an_empty_plan_is_an_error() -> None:
    with pytest.raises(ConfigError, match="the plan has no frames: the source has no subjects or"):
        make_tasks(settings(5, 5), [_Nobody()])


class _Nobody(People):
    def subjects(self, count: int | None) -> list[str]:
        return []


class _Alike(People):
    """People of the same name, or frames of the same name."""

    def __init__(self, subject: str) -> None:
        super().__init__()
        self._subject_name = subject

    def subjects(self, count: int | None) -> list[str]:
        return [self._subject_name.format(n) for n in range(count or 0)]

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        return [FaceKey(subject, "a", n // 2) for n in range(count or 0)]


def test_a_plan_that_would_leak_or_overwrite_is_an_error() -> None:
    with pytest.raises(DatasetError, match="a source names two of its people alike: rename one"):
        make_tasks(settings(3, 2), [_Alike("same")])
    with pytest.raises(DatasetError, match=r"2 frames would be written to .*/p0/a_00000: sequence"):
        ChunkPlan(make_tasks(settings(3, 4), [_Alike("p{}")]), 32)
    with pytest.raises(DatasetError, match=r"'train/\.\./a_00000' does not name a file inside"):
        ChunkPlan(make_tasks(settings(1, 1), [_Alike("..")]), 32)


def test_a_plan_is_a_sequence_that_is_computed() -> None:
    computed = plan(5, 6, devices=2)
    whole = list(computed)
    assert [computed[index] for index in range(30)] == whole
    assert computed[7:23:5] == whole[7:23:5]
    assert computed[-1] == whole[-1]
    assert computed[10:9] == []
    with pytest.raises(IndexError, match="the plan has 30 frames, not one at 30"):
        computed[30]


MIXED = {"source": [{"kind": "procedural", "subjects": 4, "frames_per_subject": 20, "weight": 2},
                    {"kind": "procedural", "subjects": 3, "frames_per_subject": 50, "weight": 1},
                    {"kind": "procedural", "subjects": 2, "frames_per_subject": 9, "count": 5}],
         "split": "paper"}  # fmt: skip
PINNED = [
    ({"source": {"subjects": 7, "frames_per_subject": 65}, "seed": 3, "devices": 3},
     "6f2649e69743b3ed"),
    ({"source": {"subjects": 5, "frames_per_subject": 33, "frames_per_sequence": 8,
                 "frames_per_second": 30}, "seed": 1}, "0dc80896b88f286d"),
    (MIXED, "7ab789cf92b83b66"),
    ({"source": {"subjects": 40, "frames_per_subject": 3}, "split": "paper", "seed": 5},
     "d83f95b2d02506d6"),
]  # fmt: skip


@pytest.mark.parametrize(("tree", "expected"), PINNED)
def test_tasks_are_those_of_the_plans_that_were_lists(
    tree: dict[str, object], expected: str
) -> None:
    """Data sets of the same settings are the same for ever. Hashes: of the plan as a list, 0.2."""
    given = load_settings(overrides=tree)
    text = "\n".join(map(repr, make_tasks(given, open_sources(given))))
    text = re.sub(r", device=(None|\d+)\), device=", "), device=", text)  # a key that came later
    text = text.replace(", repeat=0)", ")").replace("ScopeSeeds(", "DrawKeys(")  # as in 0.2
    assert hashlib.blake2b(text.encode(), digest_size=8).hexdigest() == expected


@quick(max_examples=60)
@given(st.lists(st.integers(0, 7), min_size=1, max_size=12).filter(any), st.integers(1, 9))
def test_chunks_hold_every_frame_once_by_split_and_index(each: list[int], size: int) -> None:
    class Uneven(People):
        def frames(self, subject: str, count: int | None) -> list[FaceKey]:
            return super().frames(subject, each[int(subject[1:])])

    tasks = make_tasks(settings(len(each), 1), [Uneven()])
    for planned in (tasks, list(tasks)):
        chunks = ChunkPlan(planned, size)
        made = [task for chunk in chunks for task in chunk.tasks]
        assert made == [t for split in ("train", "val", "test") for t in tasks if t.split == split]
        assert all({t.split for t in chunk.tasks} == {chunk.split} for chunk in chunks)
        assert [chunks.frames_in(c.number) for c in chunks] == [len(c.tasks) for c in chunks]
        assert {chunks.split_of(c.number) == c.split for c in chunks} == {True}
        assert len({chunk.shard for chunk in chunks}) == len(chunks)


def test_a_fingerprint_changes_with_the_plan() -> None:
    def fingerprint(source: People | None = None, **overrides: object) -> str:
        given = settings(5, 4, **overrides)
        return ChunkPlan(make_tasks(given, [source or People()]), 32).fingerprint()

    first = fingerprint()
    assert first == fingerprint()
    others = [fingerprint(seed=1), fingerprint(devices=2), fingerprint(split=[1, 0, 0])]
    others += [fingerprint(People("other")), fingerprint(_Renamed())]
    assert len({first, *others}) == 6


class _Renamed(People):
    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        return [replace(key, path="another.obj") for key in super().frames(subject, count)]


def test_ten_million_frames_are_planned_in_the_memory_of_their_people() -> None:
    given = load_settings(overrides={"source": {"subjects": 500, "frames_per_subject": 20_000}})
    tracemalloc.start()
    tasks = make_tasks(given, open_sources(given))
    chunks = ChunkPlan(tasks, 512)
    chunks.fingerprint()
    last = chunks[len(chunks) - 1].tasks[-1]
    used = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(tasks) == 10_000_000
    assert tasks[last.index] == last
    assert used < 3e6
    many = load_settings(overrides={"source": {"subjects": 600_000}})
    with pytest.raises(ConfigError, match="at most 50000000 of 500000 people: make several, with"):
        make_tasks(many, open_sources(given))
