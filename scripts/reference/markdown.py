"""Markdown text of the generated pages."""

from __future__ import annotations

from collections.abc import Sequence

from glsim.core.files.markdown import markdown_table

#: Characters of plain text that Markdown would take for markup.
_MARKUP = str.maketrans({c: f"\\{c}" for c in "|*_<>[]`^$~#"})


def plain(text: str) -> str:
    """Return text of the code as Markdown, on one line; what stands in `` becomes inline code."""
    parts = " ".join(text.split()).split("``")
    return "".join(f"`{p}`" if n % 2 else p.translate(_MARKUP) for n, p in enumerate(parts))


def code(text: object) -> str:
    """Return a value as inline code; "" for an empty value."""
    shown = str(text).replace("|", "\\|")
    return f"`{shown}`" if shown else ""


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table with an empty line after it."""
    return "\n".join(markdown_table(head, rows)) + "\n\n"


def block(text: str, language: str = "text") -> str:
    """Return a block of code."""
    return f"```{language}\n{text.strip(chr(10))}\n```\n\n"
