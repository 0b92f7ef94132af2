"""A page of headings, sentences and tables, written once and shown as Markdown or HTML."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Grid:
    """A table; cells may hold **bold** and `code`."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    def markdown(self) -> str:
        """Without a line break at the end."""
        lines = [self.head, ["---"] * len(self.head), *self.rows]
        return "\n".join(f"| {' | '.join(line)} |" for line in lines)

    def html(self) -> str:
        """In a frame that scrolls sideways."""
        head = "".join(f"<th>{_inline(cell)}</th>" for cell in self.head)
        lines = ["".join(f"<td>{_inline(cell)}</td>" for cell in row) for row in self.rows]
        inner = "".join(f"<tr>{line}</tr>" for line in lines)
        return f'<div class="wide"><table><tr>{head}</tr>{inner}</table></div>'


@dataclass(frozen=True)
class Heading:
    """Of a section."""

    text: str


@dataclass
class Page:
    """Parts in order: a str is a paragraph, a list of str an enumeration."""

    title: str
    parts: list[str | list[str] | Heading | Grid] = field(default_factory=list)

    def markdown(self) -> str:
        """The text of a file."""
        blocks = [f"# {self.title}"]
        for part in self.parts:
            if isinstance(part, Grid):
                blocks.append(part.markdown())
            elif isinstance(part, Heading):
                blocks.append(f"## {part.text}")
            else:
                blocks.append(part if isinstance(part, str) else "\n".join(f"- {x}" for x in part))
        return "\n\n".join(blocks) + "\n"

    def html(self) -> str:
        """A section of a report."""
        blocks = [f"<h2>{_inline(self.title)}</h2>"]
        for part in self.parts:
            if isinstance(part, Grid):
                blocks.append(part.html())
            elif isinstance(part, Heading):
                blocks.append(f"<h3>{_inline(part.text)}</h3>")
            elif isinstance(part, str):
                blocks.append(f"<p>{_inline(part)}</p>")
            else:
                blocks.append(f"<ul>{''.join(f'<li>{_inline(x)}</li>' for x in part)}</ul>")
        return "".join(blocks)


def _inline(text: str) -> str:
    safe = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", html.escape(text))
    return re.sub(r"`(.+?)`", r"<code>\1</code>", safe)
