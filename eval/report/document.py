"""A document of headings, paragraphs, tables and pictures: Markdown here, HTML in ``page``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from glsim.files.markdown import markdown_table


@dataclass(frozen=True)
class TextTable:
    """A table of text; cells may contain **bold** and `code`."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    def markdown(self) -> str:
        """Return Markdown without a final line break."""
        return "\n".join(markdown_table(self.head, self.rows))


@dataclass(frozen=True)
class Heading:
    """The heading of a section."""

    text: str


@dataclass(frozen=True)
class CaptionedPng:
    """A PNG picture with a caption; reports also write it as ``figures/NAME.png``."""

    name: str
    caption: str
    png: bytes


@dataclass
class Document:
    """A title and parts in order: a str is a paragraph, a list of str is a bullet list."""

    title: str
    parts: list[str | list[str] | Heading | TextTable] = field(default_factory=list)

    def markdown(self, level: int = 1) -> str:
        """Return Markdown; ``level`` is that of the title."""
        blocks = [f"{'#' * level} {self.title}"]
        for part in self.parts:
            if isinstance(part, TextTable):
                blocks.append(part.markdown())
            elif isinstance(part, Heading):
                blocks.append(f"{'#' * (level + 1)} {part.text}")
            else:
                blocks.append(part if isinstance(part, str) else "\n".join(f"- {x}" for x in part))
        return "\n\n".join(blocks) + "\n"
