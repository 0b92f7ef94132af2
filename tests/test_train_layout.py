"""The training stands above the simulator and beside the evaluation: what it imports."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_layout import imports, loaded_after

FOLDER = Path(__file__).parent.parent / "train"
MODULES = sorted(FOLDER.rglob("*.py"))


@pytest.mark.parametrize("file", MODULES, ids=lambda f: str(f.relative_to(FOLDER)))
def test_imports(file: Path) -> None:
    for name in imports(file):
        assert not name.startswith(("glsim.eval", "eval", "train")), name
        if name in ("typer", "rich"):
            assert file.parent.name == "commands", name
    assert len(file.read_text().splitlines()) < 310


def test_recipes_and_commands_need_no_pytorch() -> None:
    loaded = loaded_after("import glsim.cli, glsim.train.recipe")
    assert not loaded & {"torch", "lightning_fabric", "cv2", "moderngl"}
