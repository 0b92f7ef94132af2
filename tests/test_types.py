"""mypy sees every package of the project: a misspelt attribute is an error."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

#: Import path of a class of train -> code with a misspelt attribute, and mypy's message.
MISTAKES = {
    "by module": (
        "from glsim.train.recipe import Recipe\n\n\n"
        "def use(recipe: Recipe) -> None:\n    recipe.training.no_such_field\n",
        '"TrainingSettings" has no attribute "no_such_field"',
    ),
    "by public name": (
        'from glsim.train import load_recipe\n\nload_recipe("face").no_such_field\n',
        '"Recipe" has no attribute "no_such_field"',
    ),
}


@pytest.mark.parametrize("path", MISTAKES)
def test_a_misspelt_attribute_is_an_error(path: str, tmp_path: Path) -> None:
    """Takes seconds with the cache of ``make check``."""
    code, message = MISTAKES[path]
    file = tmp_path / "misspelt.py"
    file.write_text(code)
    done = subprocess.run(
        [ROOT / "scripts" / "check_types.sh", file],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert message in done.stdout, done.stdout + done.stderr
    assert "Found 1 error in 1 file" in done.stdout
