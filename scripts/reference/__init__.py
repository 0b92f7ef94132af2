"""Pages of the documentation that are written from the code: ``python -m scripts.reference``.

They go to docs/generated/reference, which git ignores: settings, noise stages, sensors, the format
of data sets, the command line and the public names of Python. ``docs/conf.py`` writes them before
each build.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from scripts.reference import commands, data_sets, python_names, sensors, settings, stages

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "generated" / "reference"

#: Page of the reference -> what writes it.
CHAPTERS = {
    "settings": settings.pages,
    "stages": stages.pages,
    "sensors": sensors.pages,
    "data_sets": data_sets.pages,
    "commands": commands.pages,
    "python": python_names.pages,
}


def write_pages(folder: Path = FOLDER) -> list[Path]:
    """Write all pages into an emptied folder; returns their files."""
    shutil.rmtree(folder, ignore_errors=True)
    files = []
    for pages in CHAPTERS.values():
        for name, text in pages().items():
            file = folder / f"{name}.md"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
            files.append(file)
    return files
