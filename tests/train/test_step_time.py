"""The measured time of a step: it grows with the network, and leaves nothing behind."""

from __future__ import annotations

from pathlib import Path

import pytest

from glsim.train.recipe import load_recipe
from glsim.train.step_time import seconds_per_step

SMALL = ("model.backbone.width=4", "data.crop=32", "training.batch=1")


@pytest.mark.long
def test_a_deeper_network_takes_longer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """60 layers take more than 3 do, by much more than the noise of a busy machine."""
    monkeypatch.chdir(tmp_path)
    shallow, deep = (
        seconds_per_step(load_recipe("paper-d7", (*SMALL, f"model.backbone.depth={depth}"), {}))
        for depth in (3, 60)
    )
    assert 0 < shallow < deep
    assert not list(tmp_path.iterdir())
