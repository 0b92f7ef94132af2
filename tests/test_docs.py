"""The pages of docs/ and the README: links, commands, imports and contents."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
import subprocess
from pathlib import Path
from typing import Any

import pytest

from scripts.check_site import find_broken_links
from scripts.reference import DOCS, committed_pages
from scripts.reference.commands import commands, options_of
from tests.support.imports import ROOT
from tests.support.scenes import face_mesh

PAGES = [
    ROOT / "README.md",
    *sorted(p for p in DOCS.rglob("*.md") if not {"generated", "_build"} & {*p.parts}),
]
SCRIPTS = sorted([*(DOCS / "tutorials").glob("*.py"), *(DOCS / "gallery").glob("*.py")])
#: Where a user imports from; nothing deeper.
PUBLIC = ("glsim", "glsim.train", "glsim.noise.twins", "glsim.integrations.gymnasium")


def blocks(page: Path, language: str) -> list[str]:
    """The blocks of a language on a page."""
    text = page.read_text(encoding="utf-8")
    found: list[str] = re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    return found


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


def wrong_option(line: str) -> str | None:
    """What a command line names that glsim does not have; None if nothing."""
    known = dict(commands())
    words = shlex.split(line, comments=True)[1:]
    if words[:1] and words[0].startswith("-"):
        return None  # options of glsim itself
    name = next((" ".join(words[:n]) for n in (2, 1) if " ".join(words[:n]) in known), None)
    if name is None:
        return f"no command {words[0]}"
    options = {word.split("=")[0] for word in words if re.match(r"--?[a-zA-Z]", word)}
    missing = options - options_of(known[name])
    return f"glsim {name} has no {', '.join(sorted(missing))}" if missing else None


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_a_page_names_what_there_is(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for code in blocks(page, "python"):
        assert private_imports(code) == []
    lines = [line for b in blocks(page, "sh") for line in b.replace("\\\n", " ").splitlines()]
    lines = [line for line in lines if line.startswith("glsim ")]
    assert [wrong for line in lines if (wrong := wrong_option(line))] == []
    targets = re.findall(r"\]\((?!https?:|mailto:|#)([^)\s#]+)", text)
    targets += re.findall(r"(?:\{image\}|:img-top:) (\S+)", text)
    for target in targets:
        assert (page.parent / target).exists(), target


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.name)
def test_scripts_import_public_names_only(script: Path) -> None:
    assert private_imports(script.read_text(encoding="utf-8")) == []


def test_wrong_imports_commands_and_links_are_found(tmp_path: Path) -> None:
    assert private_imports("from glsim.faces.meshes.load import load_mesh")
    assert private_imports("from glsim import no_such_name")
    assert wrong_option("glsim generat -o data") == "no command generat"
    assert wrong_option("glsim generate -o data --sujects 3") == "glsim generate has no --sujects"
    (tmp_path / "one.html").write_text('<a href="two.html#gone">wrong</a> <img src="none.png">')
    (tmp_path / "two.html").write_text('<h1 id="here">Title</h1>')
    assert find_broken_links(tmp_path) == [
        "one.html: none.png is not there",
        "one.html: two.html#gone has no such anchor",
    ]


def test_tables_of_contents_reach_every_page() -> None:
    named = set()
    for page in PAGES[1:]:
        for block in blocks(page, r"\{toctree\}"):
            for line in block.splitlines():
                if line.strip() and not line.startswith(":"):
                    found = re.search(r"<(.*)>", line)
                    target = found[1] if found else line.strip()
                    place = DOCS / target[1:] if target.startswith("/") else page.parent / target
                    named.add(place.resolve())
    assert {p.with_suffix("") for p in PAGES[1:]} - {DOCS / "index"} - named == set()


def test_the_reference_is_that_of_the_code() -> None:
    """If it is not: ``python -m scripts.reference``."""
    pages = committed_pages()
    there = {file for file in (DOCS / "reference").rglob("*.md") if file.name != "index.md"}
    assert there == set(pages)
    for file, text in pages.items():
        assert file.read_text(encoding="utf-8") == text.rstrip("\n") + "\n", file


def test_the_first_example_of_the_readme_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = face_mesh()
    lines = ["v {} {} {}".format(*vertex) for vertex in mesh.vertices_mm]
    lines += ["f {} {} {}".format(*(face + 1)) for face in mesh.faces]
    (tmp_path / "face.obj").write_text("\n".join(lines))
    monkeypatch.chdir(tmp_path)
    variables: dict[str, Any] = {}
    exec(compile(blocks(PAGES[0], "python")[0], "README.md", "exec"), variables)
    assert variables["frame"].noisy.shape == (128, 128)
    assert variables["frame"].noisy.any()


@pytest.mark.long
def test_the_example_of_the_readme_is_typed(tmp_path: Path) -> None:
    """As written, under ``mypy --strict``; a misspelt attribute is found."""
    (code,) = (block for block in blocks(PAGES[0], "python") if "frames(settings" in block)
    for name, text, status in (("right", code, 0), ("wrong", f"{code}\nframe.no_such\n", 1)):
        file = tmp_path / f"{name}.py"
        file.write_text(text)
        command = [ROOT / "scripts" / "check_types.sh", file]
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
        assert done.returncode == status, done.stdout + done.stderr
