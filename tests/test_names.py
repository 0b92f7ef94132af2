"""Every module, name and path that a docstring, a comment or a page gives exists."""

from __future__ import annotations

import ast
import re
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from glsim.plugins import GROUPS
from tests.support.imports import ROOT, all_modules

MODULES = all_modules()
TOP = "benchmarks|design|docs|eval|glsim|scripts|shaders|tests|train"
_PATH = re.compile(rf"(?<![\w./~-])(?:{TOP})/[\w./*-]*[\w*]")
_DOTTED = re.compile(r"(?<![\w./-])(?:glsim|benchmarks|scripts)(?:\.[A-Za-z_]\w*)+")
#: Folders that commands make, and words that are no modules.
_MADE = ("docs/_build", "docs/generated")
_NO_MODULES = {"NAME", "__file__", "def", "sif", "toml", *GROUPS}  # glsim.stages: entry points


def sources() -> list[Path]:
    """The files of the repository that people write."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.split("\0")  # fmt: skip
    kinds = {".py", ".glsl", ".frag", ".vert", ".toml", ".md", ".js", ".sh", ".yml"}
    names = [name for name in listed if Path(name).suffix in kinds or name == "Makefile"]
    return [ROOT / name for name in names if name != "CHANGELOG.md" and (ROOT / name).is_file()]


def remarks(file: Path) -> str:
    """The docstrings and comments of a file; all of a page."""
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".py":
        tree = ast.parse(text)
        strings = [
            node.value.value
            for node in ast.walk(tree)
            if isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ]
        return "\n".join([*strings, *re.findall(r"(?:^|\s)#.*", text)])
    if file.suffix in (".glsl", ".frag", ".vert", ".js"):
        return "\n".join(re.findall(r"//.*|/\*.*?\*/", text, re.DOTALL))
    return text


@cache
def defined(module: str) -> frozenset[str]:
    """Names that a module defines or imports at its top level."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
        elif isinstance(node, ast.ImportFrom | ast.Import):
            found |= {(alias.asname or alias.name).partition(".")[0] for alias in node.names}
    if module == "glsim":
        found |= set(re.findall(r'"(\w+)"', MODULES[module].read_text(encoding="utf-8")))
    return frozenset(found)


def missing(text: str) -> Iterator[str]:
    """Yield the modules, names and paths in a text that do not exist."""
    for name in _DOTTED.findall(text):
        parts = name.split(".")
        if (ROOT / Path(*parts)).is_dir() or (ROOT / Path(*parts)).with_suffix(".py").is_file():
            continue
        if name in MODULES or parts[-1] in _NO_MODULES:
            continue
        for length in range(len(parts) - 1, 0, -1):
            module = ".".join(parts[:length])
            if module in MODULES:
                if parts[length] not in defined(module):
                    yield name
                break
        else:
            yield name
    for path in _PATH.findall(text):
        if not path.startswith(_MADE) and not any(ROOT.glob(path)):
            yield path


def test_what_a_text_names_exists() -> None:
    found = {str(file.relative_to(ROOT)): sorted(set(missing(remarks(file)))) for file in sources()}
    assert {file: names for file, names in found.items() if names} == {}


@pytest.mark.parametrize(
    "text",
    ["see design/reality.md", "glsim.fit.no_such_module", "glsim.pipeline.nothing", "eval/no.py"],
)
def test_what_does_not_exist_is_found(text: str) -> None:
    assert list(missing(text))
    assert not list(missing("glsim.pipeline.simulate, glsim.errors, eval/metrics, tests/**/*.py"))
