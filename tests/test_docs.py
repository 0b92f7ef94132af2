"""The Python of the README and of docs/: what it imports is public, and the first example runs.

``make docs`` checks links within the site; tests/test_site.py checks commands and contents.
"""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path
from typing import Any

import pytest

from tests.support.imports import ROOT
from tests.support.scenes import face_mesh

DOCS = ROOT / "docs"
PAGES = [
    ROOT / "README.md",
    *sorted(p for p in DOCS.rglob("*.md") if not {"generated", "_build"} & {*p.parts}),
]
SCRIPTS = sorted([*(DOCS / "tutorials").glob("*.py"), *(DOCS / "gallery").glob("*.py")])
#: Where a user imports from; nothing deeper.
PUBLIC = ("glsim", "glsim.train", "glsim.transforms")
_BLOCK = re.compile(r"```python\n(.*?)```", re.DOTALL)


def snippets(page: Path) -> list[str]:
    """The Python blocks of a page."""
    return _BLOCK.findall(page.read_text(encoding="utf-8"))


def private_imports(code: str) -> list[str]:
    """Names of glsim that a piece of code imports and that are no public API."""
    private = []
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            private += [a.name for a in node.names if a.name.startswith("glsim.")]
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("glsim"):
            module = node.module or ""
            public = importlib.import_module(module).__all__ if module in PUBLIC else ()
            private += [f"{module}.{a.name}" for a in node.names if a.name not in public]
    return private


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_pages_import_public_names_only(page: Path) -> None:
    for code in snippets(page):
        assert private_imports(code) == []


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.name)
def test_scripts_import_public_names_only(script: Path) -> None:
    assert private_imports(script.read_text(encoding="utf-8")) == []


def test_deeper_imports_are_found() -> None:
    assert private_imports("from glsim.meshio.load import load_mesh")
    assert private_imports("from glsim import no_such_name")
    assert private_imports("import glsim.pipeline")
    assert not private_imports("import glsim\nfrom glsim import simulate")
    assert sum(len(snippets(page)) for page in PAGES) >= 5


def test_every_file_that_a_page_names_exists() -> None:
    """Paths such as ``glsim/settings/schema.py`` in the text, and links between pages."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        named = re.findall(
            r"`((?:glsim|train|eval|shaders|tests|scripts|benchmarks)/[\w./-]+)`", text
        )
        linked = re.findall(r"\]\(([\w./-]+\.(?:md|png))(?:#[\w-]+)?\)", text)
        for path in named:
            assert (ROOT / path).exists(), f"{page.name} names {path}"
        for path in linked:  # a link that starts with / starts from docs/
            if "generated/" not in path:
                place = DOCS / path[1:] if path.startswith("/") else page.parent / path
                assert place.exists(), f"{page.name} links to {path}"


def test_the_first_example_of_the_readme_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = face_mesh()
    lines = ["v {} {} {}".format(*vertex) for vertex in mesh.vertices_mm]
    lines += ["f {} {} {}".format(*(face + 1)) for face in mesh.faces]
    (tmp_path / "face.obj").write_text("\n".join(lines))
    monkeypatch.chdir(tmp_path)
    variables: dict[str, Any] = {}
    exec(compile(snippets(PAGES[0])[0], "README.md", "exec"), variables)
    frame = variables["frame"]
    assert frame.noisy.shape == (128, 128)
    assert frame.noisy.any()
