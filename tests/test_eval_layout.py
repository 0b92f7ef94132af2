"""The evaluation stands above the simulator: what it imports, and what it does not."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_layout import imports, loaded_after

FOLDER = Path(__file__).parent.parent / "eval"
MODULES = sorted(FOLDER.rglob("*.py"))

#: Reached by name where they are needed, and never by an import statement.
BY_NAME_ONLY = ("torch", "matplotlib", "skimage", "scipy", "pandas", "glsim.train", "train", "eval")


@pytest.mark.parametrize("file", MODULES, ids=lambda f: str(f.relative_to(FOLDER)))
def test_imports(file: Path) -> None:
    for name in imports(file):
        assert not any(name == bad or name.startswith(f"{bad}.") for bad in BY_NAME_ONLY), name
        assert not name.startswith("glsim.eval"), f"{name}: neighbours are relative"
        if name in ("typer", "rich") or name.startswith("glsim.cli"):
            assert file.parent.name == "commands", name
    assert len(file.read_text().splitlines()) < 300


def test_scoring_needs_no_figures_and_no_networks() -> None:
    loaded = loaded_after("import glsim.eval.run, glsim.eval.tables, glsim.eval.study")
    assert not loaded & {"torch", "matplotlib", "skimage", "scipy"}


def test_the_command_line_stays_light() -> None:
    loaded = loaded_after("import glsim.cli")
    assert not loaded & {"torch", "matplotlib", "cv2", "moderngl", "glsim.eval.metrics"}
