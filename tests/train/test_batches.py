"""Sources of batches: stored pairs by index, simulated pairs by position in their stream."""

from collections.abc import Iterator
from typing import Any

import pytest
import torch
from torch import Tensor

from glsim import Settings
from glsim.train import batches
from glsim.train.batches import BatchSource, SimulatedBatches
from glsim.train.recipe import Recipe, TrainingSettings
from glsim.train.run_setup import make_fabric
from tests.support.train_fakes import batch_source, recipe


class Numbers:
    """A stream whose batches hold their numbers; ``opened`` counts its iterators."""

    opened = 0

    def __init__(self, settings: Settings, batch: int, **options: Any) -> None:
        self.batch, self.start = batch, options.get("start", 0)
        self.length = options.get("length")
        self.seed = options.get("seed", 0)

    def fingerprint(self) -> dict[str, Any]:
        return {"seed": self.seed}

    def loader(self, workers: int) -> torch.utils.data.DataLoader[Any]:
        return torch.utils.data.DataLoader(Iterable(self), batch_size=None)

    def __iter__(self) -> Iterator[tuple[Tensor, Tensor]]:
        type(self).opened += 1
        number = self.start
        while self.length is None or number < self.start + self.length:
            image = torch.full((self.batch, 1, 8, 8), 1.0 + number)
            yield image, image
            number += 1


class Iterable(torch.utils.data.IterableDataset[Any]):
    def __init__(self, numbers: Numbers) -> None:
        self.numbers = numbers

    def __iter__(self) -> Iterator[tuple[Tensor, Tensor]]:
        return iter(self.numbers)


def numbers(source: BatchSource, epoch: int, skip: int = 0) -> list[float]:
    return [float(noisy.mean()) - 1 for noisy, _ in source.batches(epoch, skip)]


@pytest.fixture
def stream(monkeypatch: pytest.MonkeyPatch) -> Recipe:
    monkeypatch.setattr(batches, "SimulatedPairs", Numbers)
    monkeypatch.setattr(Numbers, "opened", 0)
    return recipe(data={"epoch_steps": 3, "validation_frames": 12})


def test_a_stream_goes_on_from_epoch_to_epoch(stream: Recipe) -> None:
    source = SimulatedBatches(Settings(), stream)
    assert len(source.validation) == 12  # type: ignore[arg-type]
    before = Numbers.opened
    assert source.prepare(make_fabric(TrainingSettings())) == 3
    assert [numbers(source, epoch) for epoch in (0, 1)] == [[0, 1, 2], [3, 4, 5]]
    assert Numbers.opened == before + 1, "its workers stay alive"


def test_a_stream_resumes_in_the_middle_of_an_epoch(stream: Recipe) -> None:
    source = SimulatedBatches(Settings(), stream)
    source.prepare(make_fabric(TrainingSettings()))
    assert numbers(source, 1, skip=1) == [4, 5]
    assert numbers(source, 2) == [6, 7, 8]
    assert numbers(source, 0) == [0, 1, 2], "or anywhere else"


def test_stored_pairs_resume_in_the_middle_of_an_epoch() -> None:
    source = batch_source(recipe(training={"batch": 2}))
    assert source.prepare(make_fabric(TrainingSettings())) == 5
    whole = [noisy for noisy, _ in source.batches(1, 0)]
    rest = [noisy for noisy, _ in source.batches(1, 3)]
    assert torch.equal(torch.stack(whole[3:]), torch.stack(rest))
    assert not torch.equal(next(source.batches(0, 0))[0], whole[0])
