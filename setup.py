"""Map the folders train, eval and shaders into the package glsim, and write its description.

pyproject.toml has the rest. There is no [project.urls], since the project has no public address.
"""

from __future__ import annotations

import re
from pathlib import Path

from setuptools import find_packages, setup

FOLDERS = ("train", "eval", "shaders")
"""Folders of the top level that install inside ``glsim``."""

ADDRESS: str | None = None
"""Public address of the checkout's files, ending in a slash; None: there is none yet."""

_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#)([^)\s]+)\)")


def description(readme: str, address: str | None) -> str:
    """Return README.md as an index of packages shows it, where no other file of the checkout is.

    With an address, pictures and links become absolute. Without, pictures and their captions (the
    paragraph in italics after them) go, and links become text with the name of the file.
    """
    if address is not None:
        return _LINK.sub(lambda m: f"{m[1]}[{m[2]}]({address}{m[3]})", readme)
    paragraphs = readme.split("\n\n")
    kept = [
        paragraph
        for before, paragraph in zip(["", *paragraphs], paragraphs, strict=False)
        if not paragraph.startswith("![")
        and not (before.startswith("![") and re.fullmatch(r"\*[^*].*\*\s*", paragraph, re.DOTALL))
    ]
    return _LINK.sub(lambda m: f"{m[2]} (`{m[3]}`)", "\n\n".join(kept))


if __name__ == "__main__":
    setup(
        packages=find_packages(include=["glsim*"])
        + [f"glsim.{name}" for name in find_packages(include=[f"{f}*" for f in FOLDERS])],
        package_dir={f"glsim.{folder}": folder for folder in FOLDERS},
        long_description=description(Path("README.md").read_text(encoding="utf-8"), ADDRESS),
        long_description_content_type="text/markdown",
    )
