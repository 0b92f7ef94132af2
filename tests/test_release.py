"""The package that is built: its recipes agree, and the wheel works for a stranger."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

from glsim.gl.context import INSTALL_HINT
from tests.support.imports import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
#: Name on PyPI -> name on conda-forge, where they differ.
CONDA_NAMES = {"isal": "python-isal", "mapbox-earcut": "mapbox_earcut",
               "opencv-contrib-python-headless": "py-opencv"}  # fmt: skip


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.mark.long
def test_the_wheel_works_for_a_stranger(tmp_path: Path) -> None:
    """Needs a package index; CI runs the script as well."""
    pip = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "packaging"]
    if subprocess.run(pip, cwd=tmp_path, capture_output=True, check=False).returncode:
        pytest.skip("no package index can be reached")
    command = ["bash", str(ROOT / "scripts" / "check_wheel.sh")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]


def test_the_wheel_has_every_file_of_the_package() -> None:
    """Folders without __init__.py need a pattern: an editable install would not miss it."""
    patterns = tomllib.loads(text("pyproject.toml"))["tool"]["setuptools"]["package-data"]
    for folder in ("glsim", "eval", "train", "shaders"):
        for file in (ROOT / folder).rglob("*"):
            if file.is_dir() or file.suffix in (".py", ".pyc"):
                continue
            package = next(home for home in file.parents if (home / "__init__.py").exists())
            dotted = ".".join(package.relative_to(ROOT).parts)
            own = [*patterns["*"], *patterns.get(dotted, [])]
            assert any(file in package.glob(pattern.replace("**", "**/*")) for pattern in own), file


def test_every_recipe_installs_the_debian_packages_of_the_hint() -> None:
    packages = {word for word in INSTALL_HINT["egl"].split() if word.startswith("lib")}
    for name in ("Dockerfile", "glsim.def", "scripts/setup.sh", "docs/howto/install.md"):
        assert packages <= set(re.findall(r"[a-z0-9.-]+", text(name))), name


def test_the_conda_recipe_and_the_citation_say_what_the_project_says() -> None:
    cited = dict(re.findall(r"^(version|license): (.+)$", text("CITATION.cff"), re.MULTILINE))
    assert cited == {key: PROJECT[key] for key in ("version", "license")}
    recipe = yaml.safe_load(text("conda/recipe.yaml"))
    assert recipe["context"]["version"] == PROJECT["version"]
    run = dict(entry.partition(" ")[::2] for entry in recipe["requirements"]["run"])
    wanted = dict(re.findall(r"^([\w-]+)(.*)$", "\n".join(PROJECT["dependencies"]), re.MULTILINE))
    expected = {CONDA_NAMES.get(name, name): version for name, version in wanted.items()}
    expected["python"] = PROJECT["requires-python"]
    assert {name: version for name, version in run.items() if name != "libegl"} == expected


def test_the_description_has_links_that_work_on_an_index() -> None:
    description = runpy.run_path(str(ROOT / "setup.py"), run_name="setup")["description"]
    page = "# a\n\n![A face](docs/face.png)\n\n*What it\nshows.*\n\n*Not* a [page](docs/x.md).\n"
    assert description(page, None) == "# a\n\n*Not* a page (`docs/x.md`).\n"
    assert "](https://h.example/docs/x.md)" in description(page, "https://h.example/")
