"""What an installation brings: every file of the package, one version, the public names."""

import importlib.metadata
import re
import tomllib

import yaml

import glsim
from glsim.gl.context import INSTALL_HINT
from tests.support.imports import ROOT

PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_wheel_has_every_file_of_the_package() -> None:
    """Folders without __init__.py need a pattern: an editable install would not miss it."""
    patterns = PYPROJECT["tool"]["setuptools"]["package-data"]
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


def test_the_version_is_the_same_everywhere() -> None:
    version = PYPROJECT["project"]["version"]
    assert glsim.__version__ == importlib.metadata.version("glsim")
    assert f"\nversion: {version}\n" in text("CITATION.cff")
    recipe = yaml.safe_load(text("conda/recipe.yaml"))
    assert recipe["context"]["version"] == version
    needed = [*PYPROJECT["project"]["dependencies"], PYPROJECT["project"]["requires-python"]]
    run = (entry.partition(" ")[2] for entry in recipe["requirements"]["run"] if " " in entry)
    assert sorted(run) == sorted(
        re.sub(r"^[\w-]*", "", entry) for entry in needed if "win32" not in entry
    )


def test_public_names_exist_and_are_listed() -> None:
    assert set(dir(glsim)) == {*glsim.__all__, "__version__"}
    for name in glsim.__all__:
        assert getattr(glsim, name) is not None
