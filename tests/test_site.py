"""The site: the reference names everything that there is, and the tables of contents every page."""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path

import pytest

import glsim
import glsim.train
import glsim.transforms
from glsim.exports import FORMATS
from glsim.noise.registry import shipped_stages
from glsim.reason import Reason
from glsim.sensors.sensor import sensor_names
from glsim.settings.presets import preset_names
from glsim.settings.schema import Settings
from glsim.train.recipe import Recipe
from scripts.check_site import find_broken_links
from scripts.reference import CHAPTERS
from scripts.reference.commands import commands, options_of
from scripts.reference.settings import setting_names
from scripts.reference.stages import header_text
from tests.support.imports import ROOT

DOCS = ROOT / "docs"
WRITTEN = sorted(file for file in DOCS.rglob("*.md") if not {"generated", "_build"} & {*file.parts})
_TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```", re.DOTALL | re.MULTILINE)
_SHELL = re.compile(r"^```sh\n(.*?)^```", re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def generated() -> dict[str, str]:
    """Page name -> Markdown of the whole reference; nothing is written to disk."""
    pages: dict[str, str] = {}
    for chapter in CHAPTERS.values():
        pages |= chapter()
    return pages


def entries(page: str, text: str) -> set[str]:
    """The pages that the tables of contents of a page name, from docs/, without ending."""
    found = set()
    for block in _TOCTREE.findall(text):
        for line in block.splitlines():
            if not line.strip() or line.startswith(":"):
                continue
            match = re.search(r"<(.*)>", line)
            target = match[1] if match else line.strip()
            here = target.removeprefix("/") if target.startswith("/") else ""
            full = here or str(Path(page).parent / target)
            if "*" in full:
                found |= {str(f.relative_to(DOCS).with_suffix("")) for f in DOCS.glob(f"{full}.md")}
            else:
                found.add(full)
    return found


def test_tables_of_contents_reach_every_page(generated: dict[str, str]) -> None:
    texts = {
        str(file.relative_to(DOCS).with_suffix("")): file.read_text(encoding="utf-8")
        for file in WRITTEN
    }
    texts |= {f"generated/reference/{name}": text for name, text in generated.items()}
    named = {target for page, text in texts.items() for target in entries(page, text)}
    galleries = {"generated/tutorials/index", "generated/gallery/index"}
    wanted = {*texts, *galleries} - {"index"}
    assert wanted - named == set(), "name these pages in a table of contents (docs/*/index.md)"
    assert named - wanted == set(), "a table of contents names pages that do not exist"


def test_the_reference_names_all_that_there_is(generated: dict[str, str]) -> None:
    for name, spec in shipped_stages().items():
        page = generated[f"stages/{name}"]
        for parameter in spec.parameters.values():
            assert f"| `{parameter.name}` | {parameter.type} | {parameter.default:g} |" in page
    for name in sensor_names():
        assert f"# `{name}`" in generated[f"sensors/{name}"]
    for model, page in ((Settings, "settings"), (Recipe, "recipes")):
        for key in setting_names(model):
            table, _, name = key.rpartition(".")
            head = f"## `[{table}]`" if table else "## Top level"
            section = generated[page].split(head)[1].split("\n## ")[0]
            row = next(line for line in section.splitlines() if line.startswith(f"| `{name}` |"))
            assert row.rstrip(" |").count(" | ") == 4, f"{key}: has no description"
    for name in preset_names():
        assert f"### `{name}`" in generated["settings"]
    for name, command in commands():
        assert f"## `glsim {name}`" in generated["commands"]
        for option in options_of(command) - {"-h", "--help"}:
            assert f"`{option}`" in generated["commands"]
    for module in (glsim, glsim.train, glsim.transforms):
        page = generated[f"python_{module.__name__.replace('.', '_')}"]
        for name in module.__all__:
            assert f":: {module.__name__}.{name}\n" in page
    for reason in Reason:
        assert f"| {reason.value} | `{reason.name}` |" in generated["data_sets"]


def test_ranges_and_sources_come_from_the_code(generated: dict[str, str]) -> None:
    assert "| `motion` | number or distribution | `1` | 0 to 5 |" in generated["settings"]
    assert (
        "| `behind_mm` | number or distribution | `uniform [1000.0, 3000.0]` | 400 to 8000 |"
        in (generated["settings"])
    )
    assert "libfreenect2 and Microsoft's reliable range" in generated["sensors/kinect-v2"]
    assert "```text\nsigma_mm = 1.5" in generated["stages/axial"]


def test_the_header_of_a_stage_is_split_into_text_and_formulas() -> None:
    source = (
        "#version 330 core\n// wave: adds a * b.\n//   d = a * b\n// Source: none.\n//@ sparse\nx"
    )
    assert (
        header_text(source) == "wave: adds a \\* b.\n\n```text\nd = a * b\n```\n\nSource: none.\n\n"
    )


def shell_lines(text: str) -> list[str]:
    """The commands of glsim in the shell blocks of a page, one line each."""
    lines = [
        line for block in _SHELL.findall(text) for line in block.replace("\\\n", " ").splitlines()
    ]
    return [line for line in lines if line.startswith("glsim ")]


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


@pytest.mark.parametrize("page", [ROOT / "README.md", *WRITTEN], ids=lambda p: p.name)
def test_commands_of_a_page_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert [wrong for line in shell_lines(text) if (wrong := wrong_option(line))] == []


def test_a_wrong_command_is_found() -> None:
    assert wrong_option("glsim generat -o data") == "no command generat"
    assert wrong_option("glsim generate -o data --sujects 3") == "glsim generate has no --sujects"
    assert wrong_option("glsim import biwi hpdb -o real --every 10  # all") is None


@pytest.mark.parametrize("page", [ROOT / "README.md", *WRITTEN], ids=lambda p: p.name)
def test_external_links_have_the_form_of_links(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]*)\)", page.read_text(encoding="utf-8")):
        if ":" in target:
            assert re.fullmatch(r"https://[\w.-]+\.\w+(/[\w./~#%?=&+-]*)?", target), target


def test_links_of_the_readme_work_in_a_checkout() -> None:
    """They are relative: no page of the site has an address of its own yet."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    links = re.findall(r"\[[^\]]*\]\(([^)]+)\)", text)
    assert len(links) >= 20
    missing = [link for link in links if not (ROOT / link).exists()]
    assert missing == []


def test_no_page_names_an_address_that_is_reserved_for_examples() -> None:
    files = [ROOT / "README.md", ROOT / "pyproject.toml", *WRITTEN, *(DOCS / "tutorials").glob("*")]
    found = [
        f.name for f in files if re.search(r"https?://[\w.-]*\.example\b", f.read_text("utf-8"))
    ]
    assert found == []


def test_every_extra_is_explained() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = {*project["optional-dependencies"]} - {
        "test",
        "test-all",
        "bench",
    }  # for work on glsim itself
    text = (DOCS / "howto" / "install.md").read_text(encoding="utf-8")
    assert {name for name in extras if f"| `{name}` |" not in text} == set()


def test_one_example_of_each_command_is_on_its_page() -> None:
    lines = shell_lines((DOCS / "howto" / "commands.md").read_text(encoding="utf-8"))
    shown = {line.split()[1] for line in lines}
    assert {name.split()[0] for name, _ in commands()} - shown == set()


def test_every_format_of_an_export_is_described() -> None:
    text = (DOCS / "export.md").read_text(encoding="utf-8")
    rows = [row.split("|")[1] for row in text.splitlines() if row.startswith("| `")]
    assert set(re.findall(r"`(\w+)`", " ".join(rows))) == set(FORMATS)


def test_figures_of_pages_exist() -> None:
    """Also those in directives, which tests/test_docs.py does not read."""
    for page in WRITTEN:
        text = page.read_text(encoding="utf-8")
        named = re.findall(r"\]\(([\w./-]+\.png)\)|\{image\} (\S+)|:img-top: (\S+)", text)
        for name in filter(None, (part for match in named for part in match)):
            assert (page.parent / name).exists(), f"{page.name} shows {name}"


def test_broken_links_of_a_built_site_are_found(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "one.html").write_text(
        '<a href="../two.html#here">fine</a> <a href="#top" id="top">fine</a>'
        '<img src="../my%20figure.png"><a href="https://example.org/none">elsewhere</a>'
        '<a href="../two.html#gone">wrong</a> <img src="none.png">'
        '<a href="../three.html">wrong</a>'
    )
    (tmp_path / "two.html").write_text('<h1 id="here">Title</h1>')
    (tmp_path / "my figure.png").write_bytes(b"")
    assert find_broken_links(tmp_path) == [
        "a/one.html: ../three.html is not there",
        "a/one.html: ../two.html#gone has no such anchor",
        "a/one.html: none.png is not there",
    ]
