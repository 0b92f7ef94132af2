"""A document of headings, paragraphs and tables that is written as Markdown or HTML."""

from __future__ import annotations

import html
import re
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

    def html(self) -> str:
        """Return HTML; a wide table scrolls sideways."""
        head = "".join(f"<th>{_inline(cell)}</th>" for cell in self.head)
        lines = ["".join(f"<td>{_inline(cell)}</td>" for cell in row) for row in self.rows]
        inner = "".join(f"<tr>{line}</tr>" for line in lines)
        return f'<div class="wide"><table><tr>{head}</tr>{inner}</table></div>'


@dataclass(frozen=True)
class Heading:
    """The heading of a section."""

    text: str


@dataclass
class Document:
    """A title and parts in order: a str is a paragraph, a list of str is a bullet list."""

    title: str
    parts: list[str | list[str] | Heading | TextTable] = field(default_factory=list)

    def markdown(self) -> str:
        """Return the text of a Markdown file."""
        blocks = [f"# {self.title}"]
        for part in self.parts:
            if isinstance(part, TextTable):
                blocks.append(part.markdown())
            elif isinstance(part, Heading):
                blocks.append(f"## {part.text}")
            else:
                blocks.append(part if isinstance(part, str) else "\n".join(f"- {x}" for x in part))
        return "\n\n".join(blocks) + "\n"

    def html(self) -> str:
        """Return a section of an HTML report."""
        blocks = [f"<h2>{_inline(self.title)}</h2>"]
        for part in self.parts:
            if isinstance(part, TextTable):
                blocks.append(part.html())
            elif isinstance(part, Heading):
                blocks.append(f"<h3>{_inline(part.text)}</h3>")
            elif isinstance(part, str):
                blocks.append(f"<p>{_inline(part)}</p>")
            else:
                blocks.append(f"<ul>{''.join(f'<li>{_inline(x)}</li>' for x in part)}</ul>")
        return "".join(blocks)


def _inline(text: str) -> str:
    """Convert **bold** and `code` to HTML, and escape the rest."""
    safe = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", html.escape(text))
    return re.sub(r"`(.+?)`", r"<code>\1</code>", safe)
