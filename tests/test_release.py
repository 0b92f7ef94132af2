"""A release without an upload: wheel and sdist are built and checked as an index would."""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email import message_from_bytes
from pathlib import Path
from types import ModuleType

import pytest

from tests.support.imports import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
README = (ROOT / "README.md").read_text(encoding="utf-8")
#: What the package is built from, as CONTRIBUTING.md says.
SOURCES = ("glsim", "train", "eval", "shaders")
ALONE = ("setup.py", "pyproject.toml", "MANIFEST.in", "README.md", "LICENSE", "CHANGELOG.md")
#: Largest files, bytes: what networks and heads (11 MB, hardly compressible) and code need, no
#: data set beside them.
LARGEST = 14_000_000


def built_module() -> ModuleType:
    spec = importlib.util.spec_from_file_location("glsim_setup", ROOT / "setup.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


SETUP = built_module()


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both files, built from a copy: building leaves folders beside the sources."""
    for package in ("build", "twine"):
        pytest.importorskip(package, reason=f"needs {package}: pip install '.[test-all]'")
    folder = tmp_path_factory.mktemp("release")
    copy, out = folder / "source", folder / "dist"
    listed = subprocess.run(
        ["git", "ls-files", *SOURCES, *ALONE, "CITATION.cff"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    for name in listed.stdout.splitlines():
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, copy / name)
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), str(copy)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return out


def one(dist: Path, pattern: str) -> Path:
    (found,) = dist.glob(pattern)
    return found


def wheel_names(dist: Path) -> set[str]:
    with zipfile.ZipFile(one(dist, "*.whl")) as wheel:
        return set(wheel.namelist())


@pytest.mark.long
def test_twine_accepts_both_files(dist: Path) -> None:
    files = [str(file) for file in sorted(dist.iterdir())]
    assert len(files) == 2
    command = [sys.executable, "-m", "twine", "check", "--strict", *files]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert done.stdout.count("PASSED") == 2


@pytest.mark.long
def test_the_wheel_holds_the_package_and_nothing_else(dist: Path) -> None:
    names = wheel_names(dist)
    assert {name.split("/")[0] for name in names} == {
        "glsim", f"glsim-{PROJECT['version']}.dist-info",
    }  # fmt: skip
    data = (".png", ".tar", ".ply", ".obj", ".pt", ".safetensors", ".jsonl", ".csv")
    assert [name for name in names if name.endswith(data) or "/test" in name] == []
    sources = {
        Path(name)
        for pattern in (
            "*.py",
            "*.toml",
            "*.glsl",
            "*.frag",
            "*.vert",
            "*.onnx",
            "*.jinja",
            "heads.npz",
        )
        for source in SOURCES
        for path in (ROOT / source).rglob(pattern)
        if "__pycache__" not in (name := path.relative_to(ROOT)).parts
    }
    expected = {
        (name if name.parts[0] == "glsim" else "glsim" / name).as_posix() for name in sources
    }
    assert expected - names == set()
    assert "glsim/settings/presets/office.toml" in names
    assert "glsim/sensors/kinect-v2.toml" in names
    assert "glsim/shaders/tof/tof_light.glsl" in names
    assert "glsim/tune/assets/tune.js" in names
    assert one(dist, "*.whl").stat().st_size < LARGEST


@pytest.mark.long
def test_the_sdist_holds_what_it_is_built_from(dist: Path) -> None:
    with tarfile.open(one(dist, "*.tar.gz")) as sdist:
        names = {name.partition("/")[2] for name in sdist.getnames()} - {""}
    made = {"PKG-INFO", "setup.cfg", "glsim.egg-info"}
    assert {name.split("/")[0] for name in names} == {*SOURCES, *ALONE, "CITATION.cff", *made}
    assert one(dist, "*.tar.gz").stat().st_size < LARGEST


@pytest.mark.long
def test_the_metadata_are_those_of_the_project(dist: Path) -> None:
    with zipfile.ZipFile(one(dist, "*.whl")) as wheel:
        data = wheel.read(f"glsim-{PROJECT['version']}.dist-info/METADATA")
        entries = wheel.read(f"glsim-{PROJECT['version']}.dist-info/entry_points.txt").decode()
    found = message_from_bytes(data)
    assert found["Name"] == "glsim"
    assert found["Version"] == PROJECT["version"]
    assert found["License-Expression"] == PROJECT["license"]
    assert found["Requires-Python"] == PROJECT["requires-python"]
    assert set(found.get_all("Provides-Extra")) == set(PROJECT["optional-dependencies"])
    assert found["Description-Content-Type"] == "text/markdown"
    assert "glsim = glsim.__main__:main" in entries
    # No public address: a link that leads nowhere is worse than none.
    assert found.get_all("Project-URL") is None
    assert SETUP.ADDRESS is None


@pytest.mark.long
def test_the_description_is_rendered_as_on_an_index(dist: Path) -> None:
    from readme_renderer.markdown import render

    with zipfile.ZipFile(one(dist, "*.whl")) as wheel:
        data = wheel.read(f"glsim-{PROJECT['version']}.dist-info/METADATA")
    html = render(message_from_bytes(data).get_payload(decode=True).decode("utf-8"))
    assert html is not None
    assert re.search("<h1[^>]*>glsim<", html)
    assert "<pre" in html
    assert "<table>" in html
    sources = re.findall(r'(?:src|href)="([^"]*)"', html)
    assert [source for source in sources if not source.startswith(("https://", "#"))] == []


def test_the_version_is_that_of_the_newest_changes() -> None:
    newest = re.findall(
        r"^## \[([^\]]+)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE
    )[0]
    assert newest in ("Unreleased", PROJECT["version"])


def test_a_description_without_an_address_names_files_and_shows_no_picture() -> None:
    text = "# a\n\n![A face](docs/face.png)\n\n*What it\nshows.*\n\n*Not* a [page](docs/x.md).\n"
    assert SETUP.description(text, None) == "# a\n\n*Not* a page (`docs/x.md`).\n"
    assert "](docs" not in SETUP.description(README, None)
    assert "![" not in SETUP.description(README, None)


def test_a_description_with_an_address_has_absolute_links_and_pictures() -> None:
    text = "![A face](docs/face.png) [page](docs/x.md) [out](https://a.example/b) [in](#tour)"
    assert SETUP.description(text, "https://h.example/") == (
        "![A face](https://h.example/docs/face.png) [page](https://h.example/docs/x.md) "
        "[out](https://a.example/b) [in](#tour)"
    )
    assert not re.search(r"\]\((?!https?:|#)", SETUP.description(README, "https://h.example/"))
