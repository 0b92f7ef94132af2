"""mypy sees every package of the project: a misspelt attribute is an error."""

from __future__ import annotations

import re
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


EXAMPLES = [ROOT / "README.md", ROOT / "docs" / "howto" / "python.md"]


@pytest.mark.parametrize("page", EXAMPLES, ids=lambda page: page.stem)
def test_the_examples_of_a_page_are_typed(page: Path, tmp_path: Path) -> None:
    """As written, under ``mypy --strict``: what a user of a checker copies."""
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    (lines,) = (block for block in blocks if "frames(settings" in block)
    lines += (
        "\nimport numpy as np\nfrom typing import assert_type\nfrom numpy.typing import NDArray\n"
        "from glsim import Corrupter\n"
        'corrupt = Corrupter(load_settings(), (4, 4), "numpy")\n'
        "depth_m: NDArray[np.float32] = np.ones((4, 4), np.float32)\n"
        "assert_type(corrupt(depth_m), NDArray[np.float32])\n"
    )
    file = tmp_path / "example.py"
    file.write_text(lines)
    done = subprocess.run(
        [ROOT / "scripts" / "check_types.sh", file],
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
