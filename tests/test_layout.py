"""How the parts hang together: imports in one direction, packages that are all listed."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import moderngl
import pytest

import glsim
from glsim.gl.source import SHADER_ROOT, load_source
from glsim.noise.stage import shipped
from glsim.noise.twins import TWINS
from glsim.sensor import SENSOR_FOLDER, load_sensor

ROOT = Path(__file__).parent.parent
MODULES = sorted((ROOT / "glsim").rglob("*.py"))

#: Who may import what is heavy or has one home: module -> files and folders below glsim/.
HOMES = {
    "moderngl": (
        "gl",
        "render.py",
        "regionpass.py",
        "samples.py",
        "pipeline.py",
        "noise/chain.py",
        "visibility.py",
        "validate",
        "cli",
    ),
    "trimesh": ("scenefile.py", "meshio.py"),
    "typer": ("cli",),
    "rich": ("cli",),
    "torch": (),
    "skimage": (),
    "pyrender": (),
    "open3d": (),
    "scipy": (),
    "hypothesis": (),
    "pytest": (),
}

#: The ground floor: these import each other's errors and nothing else of glsim.
LOW = {"camera.py", "mesh.py", "errors.py", "reason.py", "pose.py", "distribution.py"}

LOADED_LAZILY = ("torch", "cv2", "skimage", "moderngl", "trimesh", "typer", "rich", "numpy")


def imports(file: Path) -> set[str]:
    """The modules that a file names in import statements, anywhere in it."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = "." * node.level + (node.module or "")
            found |= {base} | {f"{base}.{alias.name}" for alias in node.names}
    return found


@pytest.mark.parametrize("file", MODULES, ids=lambda f: str(f.relative_to(ROOT)))
def test_imports_go_one_way(file: Path) -> None:
    place = file.relative_to(ROOT / "glsim")
    for name in imports(file):
        assert not name.startswith("."), f"{name}: relative import"
        assert not name.startswith(("glsim.train", "glsim.eval", "train", "eval", "tests")), name
        package = name.split(".")[0]
        if package in HOMES:
            homes = [Path(home) for home in HOMES[package]]
            assert any(place == home or place.is_relative_to(home) for home in homes), name
        if not place.is_relative_to("cli") and place.name != "__main__.py":
            assert not name.startswith("glsim.cli"), name
    if str(place) in LOW:
        ours = {name for name in imports(file) if name.startswith("glsim.")}
        assert all(name.startswith("glsim.errors") for name in ours)
    if place.parts[0] in ("faces", "noise", "gl"):
        upward = ("glsim.pipeline", "glsim.dataset", "glsim.corrupt", "glsim.sensor")
        assert not [name for name in imports(file) if name.startswith(upward)]


def loaded_after(code: str) -> set[str]:
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(' '.join(sys.modules))"],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    return set(done.stdout.split())


def test_importing_glsim_loads_nothing_heavy() -> None:
    assert not loaded_after("import glsim") & set(LOADED_LAZILY)


def test_planning_needs_no_opengl() -> None:
    """Settings, sensors and their stages are text."""
    code = "import glsim; glsim.load_settings(); glsim.sensor_names()"
    assert not loaded_after(code) & {"torch", "cv2", "skimage", "trimesh"}


def test_public_names_exist() -> None:
    assert set(glsim.__all__) == set(glsim._HOME)
    for name in glsim.__all__:
        assert getattr(glsim, name) is not None
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = glsim.nothing


def test_packages_are_the_folders_on_disk() -> None:
    """An unlisted folder works in a checkout and is missing in the wheel."""
    setup = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    homes = setup["package-dir"]

    def folder(package: str) -> Path:
        near = max((h for h in homes if f"{package}.".startswith(f"{h}.")), key=len)
        return ROOT / homes[near] / Path(*package.removeprefix(near).strip(".").split("."))

    listed = [folder(package) for package in setup["packages"]]
    on_disk = [
        path.parent
        for home in set(homes.values())
        for path in sorted((ROOT / home).rglob("__init__.py"))
    ]
    assert sorted(listed) == sorted(on_disk)
    data = tuple(pattern.lstrip("*") for pattern in setup["package-data"]["*"])
    for home in set(homes.values()):
        for path in (ROOT / home).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                assert path.name.endswith((".py", *data)), f"{path} would not be installed"
                assert path.parent in listed, f"{path.parent} is no package"


SHADERS = [p for p in sorted(SHADER_ROOT.rglob("*")) if p.suffix in (".glsl", ".vert", ".frag")]


@pytest.mark.parametrize("file", SHADERS, ids=lambda f: str(f.relative_to(SHADER_ROOT)))
def test_every_shader_starts_with_its_name_and_purpose(file: Path) -> None:
    lines = file.read_text().splitlines()
    assert lines[0] == "#version 330 core" or file.parent.name == "lib"
    title = lines[0 if file.parent.name == "lib" else 1]
    assert title.startswith(f"// {file.stem}: ")
    assert load_source(file).text


def test_every_shader_stage_has_a_twin() -> None:
    assert set(TWINS) == {name for name, spec in shipped().items() if spec.source is not None}


@pytest.mark.parametrize("file", sorted(SENSOR_FOLDER.glob("*.toml")), ids=lambda f: f.stem)
def test_every_sensor_loads_by_name_and_by_path(file: Path) -> None:
    sensor = load_sensor(file.stem)
    assert sensor.title
    assert sensor.describe() == load_sensor(str(file)).describe()


def test_the_renderer_is_the_expected_one(context: moderngl.Context) -> None:
    """CI says which with GLSIM_EXPECT_RENDERER, so that a changed image is noticed."""
    expected = os.environ.get("GLSIM_EXPECT_RENDERER", "")
    assert expected.lower() in str(context.info["GL_RENDERER"]).lower()
    assert context.version_code >= 330
