"""The pages of docs/ and the README: links, imports, the reference, the first example."""

import ast
import importlib
import re
from pathlib import Path
from typing import Any

import pytest

from scripts.reference import DOCS, committed_pages
from tests.support.imports import ROOT
from tests.support.scenes import face_mesh, write_obj

PAGES = [
    *(ROOT / "README.md", ROOT / "CONTRIBUTING.md"),
    *sorted(p for p in DOCS.rglob("*.md") if not {"generated", "_build"} & {*p.parts}),
]
SCRIPTS = sorted([*(DOCS / "tutorials").glob("*.py"), *(DOCS / "gallery").glob("*.py")])
#: Where a user imports from; nothing deeper.
PUBLIC = ("glsim", "glsim.train", "glsim.noise.twins", "glsim.integrations.gymnasium")


def blocks(page: Path, language: str) -> list[str]:
    """The blocks of a language on a page."""
    text = page.read_text(encoding="utf-8")
    return list(re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE))


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub and MyST make them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    plain = (re.sub(r"\]\([^)]*\)|[^\w\- ]", "", heading.lower()) for heading in headings)
    return {heading.replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("page", PAGES + SCRIPTS, ids=lambda p: str(p.relative_to(ROOT)))
def test_code_imports_public_names(page: Path) -> None:
    code = "\n".join(blocks(page, "python")) if page.suffix == ".md" else page.read_text("utf-8")
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            assert not [a.name for a in node.names if a.name.startswith("glsim.")]
        elif isinstance(node, ast.ImportFrom) and str(node.module).startswith("glsim"):
            public = importlib.import_module(str(node.module)).__all__
            assert node.module in PUBLIC
            assert {a.name for a in node.names} <= {*public}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"^```(?!\{).*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    targets = re.findall(r"\]\((?!https?:|mailto:)([^)\s]+)", text)
    targets += re.findall(r"(?:\{image\}|:img-top:) (\S+)", text)
    for target in targets:
        path, _, anchor = target.partition("#")
        there = page.parent / path if path else page
        assert there.exists(), target
        assert not anchor or there.suffix != ".md" or anchor in anchors(there), target


def test_the_reference_is_that_of_the_code() -> None:
    """If it is not: ``python -m scripts.reference``."""
    for file, text in committed_pages().items():
        assert file.read_text(encoding="utf-8") == text.rstrip("\n") + "\n", file


def test_the_first_example_of_the_readme_runs(here: Path) -> None:
    write_obj(here / "face.obj", face_mesh())
    variables: dict[str, Any] = {}
    exec(compile(blocks(PAGES[0], "python")[0], "README.md", "exec"), variables)
    assert variables["frame"].noisy.any()
