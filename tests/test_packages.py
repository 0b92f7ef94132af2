"""Recipes for packages say the same: version, Debian packages, extras, the two commands."""

from __future__ import annotations

import re
import tomllib

import pytest
import yaml

from glsim.gl.context import INSTALL_HINT
from tests.support.imports import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EGL = {word for word in INSTALL_HINT["egl"].split() if word.startswith("lib")}
INSTALL_PAGE = ROOT / "docs" / "howto" / "install.md"


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_citation_has_the_version_and_the_licence_of_the_package() -> None:
    found = dict(re.findall(r"^(version|license|title): (.+)$", text("CITATION.cff"), re.MULTILINE))
    assert found == {key: PROJECT[key] for key in ("version", "license")} | {"title": "glsim"}


@pytest.mark.parametrize(
    "name",
    [
        *("Dockerfile", "glsim.def", "scripts/check_wheel.sh", ".github/workflows/checks.yml"),
        *("docs/howto/install.md", "docs/start.md", "README.md", "scripts/setup.sh"),
    ],
)
def test_every_recipe_installs_the_debian_packages_of_the_hint(name: str) -> None:
    assert "libgl1" in EGL
    words = set(re.findall(r"[a-z0-9.-]+", text(name)))
    assert EGL - words == set(), f"{name} lacks {EGL - words}"


def test_the_apptainer_file_copies_all_that_the_package_is_built_from() -> None:
    copied = set(re.findall(r"^    (\S+) /source/\S+$", text("glsim.def"), re.MULTILINE))
    folders = set(re.findall(r'"(\w+)"', text("setup.py"))) & {"train", "eval", "shaders"}
    assert folders == {"train", "eval", "shaders"}
    assert {"glsim", "setup.py", "pyproject.toml", "constraints.txt", *folders} <= copied


def test_the_page_has_a_row_for_every_extra() -> None:
    rows = re.findall(r"^\| (`.*?) \|", INSTALL_PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`([a-z0-9-]+)`", row)}
    assert set(PROJECT["optional-dependencies"]) <= named


def test_the_workflow_runs_what_the_readme_promises() -> None:
    promised = re.findall(r"^(make \w+)", text("README.md"), re.MULTILINE)
    assert promised[:2] == ["make demo", "make test"]
    workflow = text(".github/workflows/checks.yml")
    for command in (*promised[:2], "make docs", "scripts/check_wheel.sh"):
        assert f"- run: {command}\n" in workflow


@pytest.mark.parametrize("name", ["README.md", "docs/start.md", "docs/howto/install.md"])
def test_the_installation_as_written_works_on_a_bare_debian(name: str) -> None:
    """Debian has neither pip nor make, and refuses pip outside of a venv."""
    lines = re.findall(r"```sh\n(.*?)```", text(name), re.DOTALL)[0].splitlines()
    words = [line.split("#")[0].split() for line in lines]
    assert words[0][:3] == ["sudo", "apt-get", "install"]
    assert {"python3-venv", *EGL} <= {*words[0]}
    assert words[1] == ["python3", "-m", "venv", ".venv"]
    assert words[2] == [".venv/bin/pip", "install", "."]
    assert words[3] == [".", ".venv/bin/activate"]


def test_no_page_names_the_package_as_pip_would_look_for_it_on_an_index() -> None:
    """Nothing is there before a release: an extra is that of the checkout, '.[people]'."""
    pages = [
        page
        for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md"))
        if not {"_build", "generated"} & {*page.parts}  # of the built site
    ]
    wrong = [
        f"{page.name}: {line}"
        for page in pages
        for line in page.read_text(encoding="utf-8").splitlines()
        if re.search(r"pip install .?glsim\b", line) and page != INSTALL_PAGE
    ]
    assert wrong == []


def test_the_demo_needs_no_make() -> None:
    """``make demo`` is the script, and the scripts call neither make nor what it brings."""
    assert "demo:\n\t@scripts/demo.sh\n" in text("Makefile")
    for name in ("scripts/demo.sh", "scripts/setup.sh"):
        commands = [line for line in text(name).splitlines() if not line.lstrip().startswith("#")]
        assert not any(re.search(r"\bmake\b", line.split(" # ")[0]) for line in commands), name


#: Name on PyPI -> name on conda-forge, where they differ.
CONDA_NAMES = {"isal": "python-isal", "opencv-contrib-python-headless": "py-opencv"}


def test_the_conda_recipe_says_what_the_project_says() -> None:
    recipe = yaml.safe_load(text("conda/recipe.yaml"))
    assert recipe["context"]["version"] == PROJECT["version"]
    assert recipe["about"]["summary"] == PROJECT["description"]
    assert recipe["about"]["license"] == PROJECT["license"]
    assert (ROOT / recipe["about"]["license_file"]).is_file()
    run = dict(entry.partition(" ")[::2] for entry in recipe["requirements"]["run"])
    wanted = dict(re.findall(r"^([\w-]+)(.*)$", "\n".join(PROJECT["dependencies"]), re.MULTILINE))
    expected = {CONDA_NAMES.get(name, name): version for name, version in wanted.items()}
    expected["python"] = PROJECT["requires-python"]
    assert {name: version for name, version in run.items() if name != "libegl"} == expected
    (setuptools,) = tomllib.loads(text("pyproject.toml"))["build-system"]["requires"]
    host = {entry.replace(" ", "") for entry in recipe["requirements"]["host"]}
    assert {setuptools, f"python{PROJECT['requires-python']}", "pip"} == host
    assert recipe["build"]["python"]["entry_points"] == [
        f"{name} = {place}" for name, place in PROJECT["scripts"].items()
    ]
