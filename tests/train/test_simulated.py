"""Pairs rendered while training: one sequence for any number of workers, resumable, endless."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from glsim.core.errors import ConfigError, MeshError
from glsim.core.reason import Reason
from glsim.data.driver import generate
from glsim.data.reader import open_dataset
from glsim.faces.face_source import BadFace, Face, FaceKey, FaceSource
from glsim.sensors.sensor import sensor_of
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.frame import Skipped
from glsim.simulation.pipeline import open_sources, simulate
from glsim.train import SimulatedPairs, StoredPairs, randomised
from glsim.train.data.stream import BATCHES_PER_BLOCK, LANES, BatchStream, split_people
from tests.support.scenes import face_mesh

Batches = list[tuple[Tensor, Tensor]]


def small(**changes: Any) -> Settings:
    tree: dict[str, Any] = {
        "sensor": "kinect-v2-fast",
        "split": [0.5, 0.5, 0.0],
        "source": {"subjects": 12, "frames_per_subject": 6},
        "pose": {"distance_mm": {"uniform": [1000, 1400]}},
        "output": {"crop": 32, "depth_unit_mm": 0.1},
    }
    return load_settings(overrides=tree | changes)


def stream(settings: Settings, split: str = "train", reuse: int = 1, seed: int = 0) -> BatchStream:
    sources = open_sources(settings)
    return BatchStream(
        settings, sources, split_people(settings, sources, split), split, 2, reuse, seed
    )


def equal(one: Batches, other: Batches) -> bool:
    return len(one) == len(other) and all(
        torch.equal(a[0], b[0]) and torch.equal(a[1], b[1]) for a, b in zip(one, other, strict=True)
    )


@pytest.mark.long
def test_the_sequence_is_one_for_any_number_of_workers_and_start() -> None:
    """14 batches are more than one round through the lanes."""
    pairs = SimulatedPairs(small(), batch=1, reuse=2, length=LANES + 2)
    alone = list(pairs.loader(0))
    noisy_mm, clean_mm = alone[0]
    assert noisy_mm.shape == clean_mm.shape == (1, 1, 32, 32)
    assert noisy_mm.dtype == torch.float32
    assert equal(alone, list(pairs.loader(2)))
    later = SimulatedPairs(small(), batch=1, reuse=2, start=5, length=LANES + 2 - 5)
    assert equal(alone[5:], list(later.loader(0)))
    assert len(later.loader(0)) == LANES - 3
    another = SimulatedPairs(small(), batch=1, reuse=2, seed=1, length=1)
    assert not equal(alone[:1], list(another.loader(0)))


def test_a_start_in_a_later_block(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lanes before and after the first batch are then at different blocks."""
    monkeypatch.setattr("glsim.train.data.stream.LANES", 2)
    monkeypatch.setattr("glsim.train.data.simulated.LANES", 2)
    first = 2 * BATCHES_PER_BLOCK + 1
    pairs = SimulatedPairs(small(), batch=1, length=first + 3)
    later = SimulatedPairs(small(), batch=1, start=first, length=3)
    assert equal(list(pairs.loader(0))[first:], list(later.loader(0)))


def test_pairs_are_those_of_a_data_set(tmp_path: Path) -> None:
    """The same task through a file and through the stream gives the same numbers."""
    settings = small(split=[1.0, 0.0, 0.0], source={"subjects": 2, "frames_per_subject": 2})
    generate(settings, tmp_path / "d", workers=1)
    stored = StoredPairs(tmp_path / "d", "train")
    frames = [frame for frame in simulate(settings) if not isinstance(frame, Skipped)]
    assert len(open_dataset(tmp_path / "d")) == len(frames) == 4
    for number, frame in enumerate(frames):
        measured = frame.measured()
        given = np.stack([measured.noisy_mm, measured.clean_mm])
        np.testing.assert_array_equal(torch.cat(stored[number]).numpy(), given)


def test_the_target_may_be_the_expected_depth() -> None:
    """Same noisy frames; the target differs by the wiggling, and by nothing random."""
    clean, expected = (
        next(iter(SimulatedPairs(small(), batch=2, length=1, target=target)))
        for target in ("clean", "expected")
    )
    assert torch.equal(clean[0], expected[0])
    assert torch.equal(clean[1] > 0, expected[1] > 0)
    error_mm = (expected[1] - clean[1])[clean[1] > 0]
    assert 0.05 < error_mm.abs().mean() < 5


def test_each_pair_is_given_as_often_as_it_is_to_be_reused() -> None:
    plan = stream(small(), reuse=3)
    period = LANES * BATCHES_PER_BLOCK * 3
    uses: dict[tuple[int, int, int], int] = {}
    for number in range(2 * period):
        place = plan.place(number)
        assert place.lane == number % LANES
        assert len(set(place.pairs)) == plan.batch
        for pair in place.pairs:
            uses[place.lane, place.block, pair] = uses.get((place.lane, place.block, pair), 0) + 1
    assert set(uses.values()) == {3}
    assert len(uses) == 2 * LANES * plan.block_pairs


def test_noise_and_poses_never_come_again_and_people_stay_in_their_split() -> None:
    settings = small()
    train, val = stream(settings), stream(settings, "val")
    tasks = [
        task for lane in range(LANES) for block in range(3) for task in train.tasks(lane, block)
    ]
    assert len({task.seeds.frame for task in tasks}) == len(tasks) == 3 * LANES * train.block_pairs
    held_out = {task.subject for lane in range(LANES) for task in val.tasks(lane, 0)}
    assert len(held_out) == 6
    assert not held_out & {task.subject for task in tasks}
    of_data_set = open_sources(settings)
    assert {p for names in split_people(settings, of_data_set, "val") for p in names} == held_out
    assert len({task.device for task in stream(small(devices=50)).tasks(0, 0)}) > 2
    assert [t.seeds for t in stream(settings, seed=1).tasks(0, 0)] != [t.seeds for t in tasks[:8]]


class Broken(FaceSource):
    """A source whose every second face, or every face, cannot be used."""

    name = "broken"

    def __init__(self, every: int) -> None:
        self.every = every

    def subjects(self, count: int | None) -> list[str]:
        return [f"b{number}" for number in range(4)]

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        return [FaceKey(subject, "s", number) for number in range(4)]

    def load(self, keys: Any) -> Any:
        for key in keys:
            bad = key.frame % self.every == 0
            yield BadFace(key, MeshError("torn")) if bad else Face(key, face_mesh())


def test_bad_faces_are_replaced_by_the_same_others(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("glsim.train.data.simulated.open_sources", lambda _: [Broken(2)])
    first, second = (list(SimulatedPairs(small(), batch=1, length=2)) for _ in range(2))
    assert equal(first, second)
    assert all(clean.any() for _, clean in first)
    assert "torn" in caplog.text
    monkeypatch.setattr("glsim.train.data.simulated.open_sources", lambda _: [Broken(1)])
    with pytest.raises(MeshError, match=r"none of 4 faces can be rendered.*torn"):
        next(iter(SimulatedPairs(small(), batch=1)))


def test_wrong_use() -> None:
    with pytest.raises(
        ConfigError, match="5 workers cannot share 12 lanes: take one of 0, 1, 2, 3"
    ):
        SimulatedPairs(small()).loader(5)
    with pytest.raises(ConfigError, match="reuse is 0: give 1 or more"):
        SimulatedPairs(small(), reuse=0)
    with pytest.raises(ConfigError, match="nobody is in the split 'test'"):
        SimulatedPairs(small(), split="test")
    with pytest.raises(ConfigError, match=r"no such split 'trian'.*'train'"):
        SimulatedPairs(small(), split="trian")
    with pytest.raises(ConfigError, match="split = 'paper'"):
        SimulatedPairs(small(split="paper"))
    with pytest.raises(ConfigError, match=r"no.*tof_light"):
        SimulatedPairs(randomised(overrides={"sensor": "ideal"}))
    with pytest.raises(TypeError, match="never ends"):
        len(SimulatedPairs(small()))


def test_the_fingerprint_is_of_what_is_rendered() -> None:
    prints = [
        SimulatedPairs(*given, **options).fingerprint()
        for given, options in (
            ((small(),), {}),
            ((small(),), {"start": 5}),
            ((small(seed=1),), {}),
            ((small(),), {"reuse": 2}),
            ((small(),), {"target": "expected"}),
            ((small(),), {"protocol": "paper"}),
        )
    ]
    assert prints[0] == prints[1]
    assert len({str(p) for p in prints}) == 5


MEASURED = [reason for reason in Reason if reason.has_depth]
FOLDER = Path(__file__).parents[2] / "train" / "data"
FILES = ["any_camera.toml", "any_camera_320.toml", "any_camera_640.toml", "any_camera_1024.toml"]


def any_camera(name: str) -> Settings:
    few = ["source.subjects=1", "source.frames_per_subject=2", "devices=2"]
    return load_settings(FOLDER / name, few)


def test_one_camera_at_four_sizes() -> None:
    loaded = [any_camera(name) for name in FILES]
    rigs = [sensor_of(s).rig for s in loaded]
    assert [rig.intrinsics.width for rig in rigs] == [512, 320, 640, 1024]
    assert all(0 < rig.baseline_m <= 0.075 for rig in rigs)
    parts = [own.model_dump(exclude={"rig", "pose", "scene"}) for own in loaded]
    assert parts == [parts[0]] * 4


@pytest.mark.parametrize("name", FILES)
def test_frames_hold_a_face(name: str) -> None:
    layers = ("clean", "expected", "noisy", "infrared", "reason")
    first = list(simulate(any_camera(name), layers=layers))
    for frame in first:
        assert frame.noisy.shape == (128, 128)
        assert (frame.noisy > 0).mean() > 0.3
        assert ((frame.noisy > 0) == np.isin(frame.reason, MEASURED)).all()
        assert (frame.expected != frame.clean).any()
    assert first[0].parameters != first[1].parameters
