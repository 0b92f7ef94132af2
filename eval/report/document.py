"""Documents of headings, paragraphs, tables and pictures: Markdown, or self-contained HTML."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from glsim.core.errors import GlsimError, pip_install
from glsim.core.files.markdown import markdown_table
from glsim.settings.toml_tables import read_toml

#: Matches a cell that starts with a number, bold or not: 1.2, -3 %, **0.85 ± 0.01**, 3 of 3.
_NUMBER: Final = re.compile(r"\W{0,3}\d")
#: Texts of cells without a value in columns of numbers.
_NO_VALUE: Final = frozenset(("", "-", "nan", "n/a", "not scored"))


#: Page -> name of a text -> the text.
TEXTS: Final[dict[str, dict[str, Any]]] = read_toml(Path(__file__).with_name("page_texts.toml"))


@dataclass(frozen=True)
class TextTable:
    """A table of text; cells may contain **bold** and `code`."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    def numeric_columns(self) -> list[bool]:
        """Return for each column whether at least half of its cells with a value are numbers.

        Columns of numbers are aligned right; the first column has names.
        """
        numeric = [False]
        for index in range(1, len(self.head)):
            filled = [row[index] for row in self.rows if row[index] not in _NO_VALUE]
            numbers = sum(1 for cell in filled if _NUMBER.match(cell))
            numeric.append(0 < numbers >= len(filled) / 2)
        return numeric

    def markdown(self) -> str:
        """Return the table as Markdown, without a final line break."""
        return "\n".join(markdown_table(self.head, self.rows))

    def latex(self) -> str:
        """Return the table as a LaTeX tabular (package booktabs)."""
        letters = str.maketrans(TEXTS["latex"])
        lines = []
        for row in (self.head, *self.rows):
            line = " & ".join(cell.translate(letters) for cell in row) + r" \\"
            line = re.sub(r"\*\*(.+?)\*\*", r"\\textbf{\1}", line)
            lines.append(re.sub(r"`(.+?)`", r"\\texttt{\1}", line))
        columns = "".join("lr"[numeric] for numeric in self.numeric_columns())
        begin, end = rf"\begin{{tabular}}{{{columns}}}", r"\end{tabular}"
        rules = [r"\toprule", lines[0], r"\midrule", *lines[1:], r"\bottomrule"]
        return "\n".join([begin, *rules, end])


@dataclass(frozen=True)
class Heading:
    """The heading of a section."""

    text: str


@dataclass(frozen=True)
class CaptionedPng:
    """A PNG picture with a caption, which reports also write as ``figures/NAME.png``."""

    name: str
    caption: str
    png: bytes


@dataclass
class Document:
    """A title and its parts in order; a str is a paragraph and a list of str is a bullet list."""

    title: str
    parts: list[str | list[str] | Heading | TextTable] = field(default_factory=list)

    def markdown(self, level: int = 1) -> str:
        """Return the document as Markdown; ``level`` is the heading level of the title."""
        blocks = [f"{'#' * level} {self.title}"]
        for part in self.parts:
            if isinstance(part, TextTable):
                blocks.append(part.markdown())
            elif isinstance(part, Heading):
                blocks.append(f"{'#' * (level + 1)} {part.text}")
            else:
                blocks.append(part if isinstance(part, str) else "\n".join(f"- {x}" for x in part))
        return "\n\n".join(blocks) + "\n"

    def latex(self) -> str:
        """Return the tables of the document as LaTeX, each after its heading as a comment."""
        blocks, title = [], self.title
        for part in self.parts:
            if isinstance(part, Heading):
                title = part.text
            elif isinstance(part, TextTable):
                blocks.append(f"% {title}\n{part.latex()}\n")
        return "\n".join(blocks)


if TYPE_CHECKING:
    from jinja2 import Template


def html_page(
    title: str,
    documents: Iterable[Document],
    pictures: Sequence[CaptionedPng] = (),
    notes: Iterable[Document] = (),
) -> str:
    """Return a complete HTML page. Raises GlsimError without Jinja2.

    All text is escaped; **bold** and `code` become HTML. Last intervals of cells are small.
    Pictures stand behind the documents, notes behind the pictures.
    """
    return _template().render(title=title, documents=documents, pictures=pictures, notes=notes)


@cache
def _template() -> Template:
    try:
        from jinja2 import Environment, PackageLoader, StrictUndefined
        from markupsafe import Markup, escape
    except ImportError:
        cure = f"{pip_install('eval')}, or give --no-figures"
        raise GlsimError(f"report.html needs Jinja2: {cure}") from None

    def inline(text: str) -> Markup:
        text = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", str(escape(text)))
        return Markup(re.sub(r"`(.+?)`", r"<code>\1</code>", text))

    def cell(text: str) -> Markup:
        return Markup(re.sub(r" (\[[-+\d., ]+\])$", r"<small>\1</small>", str(inline(text))))

    environment = Environment(
        loader=PackageLoader("glsim.eval.report", "."),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters |= {"inline": inline, "cell": cell}
    environment.filters["base64"] = lambda data: base64.b64encode(data).decode()
    return environment.get_template("page.html.jinja")
