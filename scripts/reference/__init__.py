"""Pages of the documentation that are written from the code: ``python -m scripts.reference``.

Settings, recipes, noise stages, sensors, the format of data sets and the command line go to
docs/reference and are committed; tests/test_docs.py compares them with the code. The public names
of Python go to docs/generated/reference, which git ignores: Sphinx fills them from docstrings.
"""

from __future__ import annotations

from pathlib import Path

from scripts.reference import (
    commands,
    data_sets,
    python_names,
    sensors,
    settings,
    shader_library,
    stages,
)

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"

#: Page of the reference -> what writes it.
CHAPTERS = {
    "settings": settings.pages,
    "stages": stages.pages,
    "shader_library": shader_library.pages,
    "sensors": sensors.pages,
    "data_sets": data_sets.pages,
    "commands": commands.pages,
}


def committed_pages() -> dict[Path, str]:
    """Return file of docs/reference -> Markdown, for all pages that are committed."""
    folder = DOCS / "reference"
    chapters = [pages() for pages in CHAPTERS.values()]
    return {folder / f"{name}.md": text for pages in chapters for name, text in pages.items()}


def write_pages() -> list[Path]:
    """Write all pages; return the files."""
    written = committed_pages()
    for name, text in python_names.pages().items():
        written[DOCS / "generated" / "reference" / f"{name}.md"] = text
    for file, text in written.items():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text.rstrip("\n") + "\n", encoding="utf-8")
    return [*written]
