"""One HTML file that needs no network: documents and pictures, through ``page.html.jinja``."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Sequence
from functools import cache
from typing import TYPE_CHECKING

from glsim.core.errors import GlsimError
from glsim.eval.report.document import CaptionedPng, Document

if TYPE_CHECKING:
    from jinja2 import Template


def html_page(
    title: str,
    documents: Iterable[Document],
    pictures: Sequence[CaptionedPng] = (),
    notes: Iterable[Document] = (),
) -> str:
    """Return a whole HTML page: documents, pictures with their captions, and notes after them.

    All text is escaped; **bold** and `code` become HTML. Brackets at the end of a cell of a table,
    which hold an interval, are small. Raises GlsimError without Jinja2.
    """
    return _template().render(title=title, documents=documents, pictures=pictures, notes=notes)


@cache
def _template() -> Template:
    try:
        from jinja2 import Environment, PackageLoader, StrictUndefined
        from markupsafe import Markup, escape
    except ImportError:
        raise GlsimError(
            "report.html needs Jinja2: pip install 'glsim[eval]', or give --no-figures"
        ) from None

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
