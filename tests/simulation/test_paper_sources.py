"""The paper's face sets in their proportions, and embedded heads where a set is not there."""

from pathlib import Path

import pytest

from glsim.settings.schema import load_settings
from glsim.simulation.pipeline import open_sources
from glsim.simulation.plan.paper_sources import (
    PAPER_SOURCES,
    missing_counts,
    paper_counts,
    paper_mixture,
)
from glsim.simulation.plan.split import PAPER_IMAGES
from glsim.simulation.plan.tasks import make_tasks
from tests.support.face_sets import write_tree

FOLDERS = {"d3dfacs": "d3dfacs_alignments", "facewarehouse": "FaceWarehouse", "biwi": "hpdb"}


@pytest.mark.parametrize("images", [3, 60, 600, sum(PAPER_IMAGES)])
def test_counts_add_up_in_the_papers_order(images: int) -> None:
    counts = paper_counts(images)
    assert sum(counts.values()) == images
    assert counts["d3dfacs"] >= counts["biwi"] >= counts["facewarehouse"] >= 1
    if images == sum(PAPER_IMAGES):
        assert counts == {kind: source.images for kind, source in PAPER_SOURCES.items()}
        assert counts["facewarehouse"] == 150 * 19


def test_what_is_missing_of_the_papers_sets() -> None:
    assert missing_counts({"procedural": 600}) == paper_counts(600)
    assert missing_counts(paper_counts(600)) == {}
    held = paper_counts(600)
    moved = held | {"biwi": held["biwi"] - 50, "procedural": 50}
    assert missing_counts(moved) == {"biwi": 50}


def test_sets_that_are_there_are_used_and_filled_up(tmp_path: Path) -> None:
    """All the images, as many people as in the paper, and a plan that can be made."""
    roots = {kind: write_tree(name, tmp_path) for kind, name in FOLDERS.items() if kind != "biwi"}
    tables = paper_mixture(roots, 600)
    counts = paper_counts(600)
    assert sum(table["count"] for table in tables) == 600
    assert [table["kind"] for table in tables] == [
        "d3dfacs", "procedural", "facewarehouse", "procedural", "procedural",
    ]  # fmt: skip
    assert tables[0]["count"] == 2
    assert tables[1]["subjects"] == PAPER_SOURCES["d3dfacs"].people - 1
    assert tables[1]["count"] == counts["d3dfacs"] - 2
    assert (tables[2]["count"], tables[2]["expressions"]) == (2, True)  # one pose of two people
    assert tables[4]["subjects"] == PAPER_SOURCES["biwi"].people
    settings = load_settings(overrides={"split": "paper", "source": tables})
    tasks = make_tasks(settings, open_sources(settings))
    assert len(tasks) == 600
    assert [sum(task.source == n for task in tasks) for n in range(5)] == [
        table["count"] for table in tables
    ]
