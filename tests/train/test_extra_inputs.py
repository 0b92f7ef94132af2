"""Neighbours in time: their stack, features, data, and the start from `face`."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.utils.data import Subset

from glsim.core.depth_frame import FrameKey
from glsim.core.errors import ConfigError, DatasetError
from glsim.data.reader import open_dataset
from glsim.networks import checkpoint
from glsim.networks.inputs import NetworkInputs, stack_inputs
from glsim.settings.schema import load_settings
from glsim.train import Augmentation, SimulatedPairs, StoredPairs, fit
from glsim.train.data.extra_inputs import Neighbours, vary_inputs
from glsim.train.models.base import DepthModel
from glsim.train.models.extra_features import mean_over_time, neighbour_features
from glsim.train.models.registry import build_model, inputs_of
from glsim.train.state import copy_weights
from tests.support.dataset_fakes import make, make_settings, make_tasks
from tests.support.networks import BACKBONES, build, frames
from tests.support.train_fakes import Domes, batch_source, recipe

FACE = {"kind": "mask_aware", "uncertainty": True, "surfaces": True}
ALL: dict[str, Any] = {"before": 2, "after": 1}


def network(**inputs: Any) -> DepthModel:
    return build_model(FACE | inputs | {"backbone": BACKBONES["small_unet"]})


def test_the_stack_has_the_nearest_neighbours_first_and_zeros_for_what_is_missing() -> None:
    inputs = NetworkInputs(before=2, after=1)
    images = [np.full((3, 4), value, np.float32) for value in (900, 899, 898, 897)]
    stack = stack_inputs(inputs, images[0], images[1:])
    assert stack[:, 0, 0].tolist() == [900, 899, 898, 0]
    named = inputs.named(stack)
    assert {name: len(part) for name, part in named.items()} == inputs.names
    assert named["before_mm"][:, 0, 0].tolist() == [899, 898]
    assert stack_inputs(NetworkInputs(), images[0], images[1:], images[1:]).shape == (1, 3, 4)
    assert inputs_of(FACE | ALL | {"backbone": BACKBONES["dncnn"]}) == inputs
    with pytest.raises(ConfigError, match=r"model.before = 5"):
        network(before=5)


def features(neighbours_mm: Tensor, depth_mm: Tensor) -> Tensor:
    mean = mean_over_time(neighbours_mm, depth_mm)
    return neighbour_features(neighbours_mm, depth_mm + mean.offset_mm, mean)


def test_a_neighbour_on_another_surface_adds_what_a_missing_one_adds() -> None:
    fill_mm = frames(1).clamp_min(800)
    near = fill_mm + 2.0
    missing = torch.zeros_like(near)
    expected = features(torch.cat([near, missing], 1), fill_mm)
    for far in (fill_mm + 60, fill_mm - 60, torch.full_like(near, torch.nan), -near):
        found = features(torch.cat([near, far], 1), fill_mm)
        torch.testing.assert_close(found, expected, rtol=0, atol=0)
    closeness, weight = expected[:, 2:4], expected[:, -1:]
    assert float(closeness[:, 0].min()) > 0.99
    assert not closeness[:, 1].any()
    assert float(weight.max()) <= 0.5


def test_before_training_a_network_with_further_inputs_equals_the_one_it_starts_from() -> None:
    torch.manual_seed(2)
    face = build("surfaces", "small_unet").eval()
    for inputs in ({"before": 4}, ALL):
        started = network(**inputs).eval()
        copy_weights(face.state_dict(), started, "best.pt")
        depth_mm = frames()
        count = started.inputs.channels - 1
        others = torch.cat([depth_mm + 1, depth_mm - 2, depth_mm + 3] * 2, 1)
        stack = torch.cat([depth_mm, others[:, :count]], 1)
        mean_mm = depth_mm + mean_over_time(stack[:, 1:], depth_mm).offset_mm
        assert not torch.equal(mean_mm, depth_mm)
        for part, wanted in zip(started(stack), face(mean_mm), strict=True):
            torch.testing.assert_close(part, wanted, rtol=0, atol=0)
    narrow = build_model(FACE | {"backbone": BACKBONES["small_unet"] | {"width": 4}})
    with pytest.raises(ConfigError, match=r"best.pt: backbone.* is \(.*this network needs"):
        copy_weights(face.state_dict(), narrow, "best.pt")
    with pytest.raises(ConfigError, match="is another architecture"):
        copy_weights(build("surfaces", "dncnn").state_dict(), narrow, "best.pt")


def test_neighbours_are_of_the_same_sequence_and_not_too_far_in_time() -> None:
    words = [("a", "s")] * 4 + [("a", "t")] * 2 + [("b", "t")]
    numbers = [0, 1, 2, 6, 7, 8, 9]
    keys = [FrameKey(*w, n) for w, n in zip(words, numbers, strict=True)]
    neighbours = Neighbours(keys, NetworkInputs(before=3, after=1))
    assert neighbours.of(0) == ([], [1])
    assert neighbours.of(2) == ([1, 0], [])
    assert neighbours.of(3) == ([], [])  # four frames were lost
    assert neighbours.of(5) == ([4], [])
    assert neighbours.of(6) == ([], [])


def test_training_sees_every_number_of_neighbours() -> None:
    inputs = NetworkInputs(before=4)
    stack = stack_inputs(inputs, np.ones((2, 2)), [np.full((2, 2), 9.0 - n) for n in range(4)])
    drawn = [vary_inputs(stack, inputs, np.random.default_rng(n)) for n in range(300)]
    counts = np.bincount([np.count_nonzero(one[1:, 0, 0]) for one in drawn])
    assert len(counts) == 5
    assert counts.min() > 30
    for one in drawn:
        order = one[1:, 0, 0][one[1:, 0, 0] > 0]
        assert (np.diff(order) < 0).all()  # the nearest first
        assert not one[1 + len(order) :].any()
    assert {one[0, 0, 0] for one in drawn} == {1.0}


@pytest.fixture(scope="module")
def videos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out: Path = tmp_path_factory.mktemp("data") / "videos"
    make(out, make_settings(layers=("clean", "noisy")), make_tasks(4, 6))
    return out


@pytest.mark.parametrize("cache_mb", [0, 1000])
def test_stored_pairs_have_their_neighbours(videos: Path, cache_mb: float) -> None:
    inputs = NetworkInputs(before=2, after=1)
    pairs = StoredPairs(videos, "train", inputs=inputs, cache_mb=cache_mb)
    stored = open_dataset(videos).split("train")
    for number, earlier, later in ((0, [], [1]), (4, [3, 2], [5]), (6, [], [7]), (11, [10, 9], [])):
        noisy, clean_mm = (part.numpy() for part in pairs[number])
        expected = [stored[number].noisy_mm]
        for side, length in ((earlier, 2), (later, 1)):
            expected += [stored[n].noisy_mm for n in side]
            expected += [0 * stored[number].noisy_mm] * (length - len(side))
        np.testing.assert_array_equal(noisy, np.stack(expected))
        np.testing.assert_array_equal(clean_mm[0], stored[number].clean_mm)


def test_frames_of_new_poses_are_no_neighbours_in_time(tmp_path: Path) -> None:
    turned = load_settings(
        overrides={"source": {"kind": "procedural"}, "pose": {"yaw_deg": {"uniform": [-9, 9]}}}
    )
    make(tmp_path / "set", turned, make_tasks(1, 2))
    with pytest.raises(DatasetError, match=r"pose\.yaw_deg .* --set redraw=sequence"):
        StoredPairs(tmp_path / "set", "train", inputs=NetworkInputs(before=1))


def test_augmentation_applies_to_all_inputs_alike(videos: Path) -> None:
    inputs = NetworkInputs(before=2)
    plain = StoredPairs(videos, "train", inputs=inputs)
    bumpy = StoredPairs(
        videos, "train", inputs=inputs, augmentation=Augmentation(True, 5.0), seed=1
    )
    mirrored = raised = 0
    for number in range(2, 12):
        (stack, clean_mm), (changed, raised_mm) = plain[number], bumpy[number]
        if not torch.equal(changed[0] > 0, stack[0] > 0):
            mirrored += 1
            stack, clean_mm = stack.flip(-1), clean_mm.flip(-1)
        bumps_mm = raised_mm - clean_mm
        raised += bool(bumps_mm.any())
        for image, original in zip(changed, stack, strict=True):
            both = (original > 0) & (clean_mm[0] > 0)
            torch.testing.assert_close(
                (image - original)[both], bumps_mm[0][both], atol=1e-3, rtol=0
            )
            assert torch.equal(image > 0, original > 0)
    assert 0 < mirrored < 10
    assert raised


class Videos(Domes):
    """Domes whose neighbours are other noise on the same surface."""

    def __getitem__(self, index: int) -> tuple[Tensor, Tensor]:
        noisy_mm, clean_mm = super().__getitem__(index)
        others = [self.noisy[(index + step) % len(self)] for step in (1, 2)]
        return torch.cat([noisy_mm, *others]), clean_mm


def test_a_training_starts_from_a_network_of_single_frames_and_records_it(tmp_path: Path) -> None:
    face = recipe(training={"max_epochs": 1})
    fit(face, batch_source(face), tmp_path / "face")
    start = str(tmp_path / "face" / checkpoint.BEST)
    video = recipe(model={"before": 2}, training={"max_epochs": 1, "start": start})
    source = batch_source(video)
    source._train, source.validation = Videos(10), Subset(Videos(3, first=100), range(3))
    report = fit(video, source, tmp_path / "video")
    assert report["start"]["file"] == start
    assert len(report["start"]["crc32"]) == 8
    saved = checkpoint.load(tmp_path / "video" / checkpoint.BEST)
    assert saved["start"] == report["start"]
    Path(start).unlink()  # a resumed training does not need it
    more = recipe(model={"before": 2}, training={"max_epochs": 2, "start": start})
    assert fit(more, source, tmp_path / "video", resume=True)["start"] == report["start"]


def test_simulated_pairs_have_neighbours_of_their_run() -> None:
    settings = load_settings(
        overrides={
            "sensor": "kinect-v2-fast",
            "split": [1.0, 0.0, 0.0],
            "redraw": "sequence",
            "source": {"subjects": 2, "frames_per_subject": 16, "frames_per_sequence": 8,
                       "frames_per_second": 30},
            "pose": {"distance_mm": {"uniform": [900, 1400]}},
            "output": {"crop": 32, "depth_unit_mm": 0.1},
        }
    )  # fmt: skip
    inputs = NetworkInputs(before=4)
    batches = list(SimulatedPairs(settings, batch=4, inputs=inputs, length=4))
    stacks = torch.cat([noisy for noisy, _ in batches])
    assert stacks.shape[1:] == (5, 32, 32)
    counts = (stacks[:, 1:].flatten(2) > 0).any(-1).sum(1)
    assert len(counts.unique()) > 2
    for stack, count in zip(stacks, counts, strict=True):
        for neighbour in stack[1 : 1 + int(count)]:
            both = (stack[0] > 0) & (neighbour > 0)
            difference_mm = (stack[0] - neighbour)[both]
            assert 0 < float(difference_mm.abs().median()) < 12  # another frame of the same face
