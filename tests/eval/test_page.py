"""report.html: all text is escaped, and everything is within the one file."""

import base64
from html.parser import HTMLParser

import pytest

from glsim.eval.report.document import CaptionedPng, Document, Heading, TextTable, html_page

PNG = b"\x89PNG\r\n\x1a\n and the rest"


class Elements(HTMLParser):
    """Collects elements with their text, and checks that each one ends."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.found: list[tuple[str, str]] = []
        self.attributes: dict[str, str | None] = {}
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes.update(attrs)
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if data.strip() and "style" not in self.open:
            self.found.append((self.open[-1], data.strip()))


def test_every_part_of_a_document_becomes_its_element() -> None:
    table = TextTable(["method", "mean"], [["`face`", "**1.2** [1.1, 1.3]"], ["median", "2"]])
    page = Document("Scores", ["A **bold** text.", ["one", "two"], Heading("RMSE"), table])
    notes = [Document("Remarks", ["the end"])]
    picture = CaptionedPng("boxes", "A figure.", PNG)
    elements = Elements(html_page("Title", [page], [picture], notes))
    assert elements.found == [
        *(("title", "Title"), ("h1", "Title"), ("h2", "Scores")),
        *(("p", "A"), ("b", "bold"), ("p", "text."), ("li", "one"), ("li", "two")),
        *(("h3", "RMSE"), ("th", "method"), ("th", "mean"), ("code", "face")),
        *(("b", "1.2"), ("small", "[1.1, 1.3]"), ("td", "median"), ("td", "2")),
        *(("h2", "Figures"), ("figcaption", "A figure."), ("h2", "Remarks"), ("p", "the end")),
    ]
    assert elements.attributes["id"] == "boxes"
    source = elements.attributes["src"]
    kind, _, data = source.partition(",")
    assert kind == "data:image/png;base64"
    assert base64.b64decode(data) == PNG


def test_columns_of_numbers_are_aligned_on_the_right_and_text_on_the_left() -> None:
    """Numbers may be bold, have a sign, a spread or a unit; a column may lack some."""
    rows = [
        ["2 filters", "**1.2** [1.1, 1.3]", "-", "-53 %", "**same**", "-"],
        ["median", "nan", "0.85 ± 0.01", "not scored", "2 of 3 seeds differ", "-"],
        ["nlm", "-", "(0.9)", "+4", "refuted", "-"],
    ]
    table = TextTable(["row", "mean", "spread", "gain", "verdict", "printed"], rows)
    assert table.numeric_columns() == [False, True, True, True, False, False]
    page = html_page("Title", [Document("Scores", [table])])
    assert '<td class="number">-53 %</td>' in page
    assert "<td><b>same</b></td>" in page


@pytest.mark.parametrize("text", ["<script>alert(1)</script>", 'a" onload="x', "{{ title }}", "&"])
def test_text_is_no_html_and_no_template(text: str) -> None:
    page = Document(text, [text, [text], Heading(text), TextTable([text], [[f"**{text}**"]])])
    elements = Elements(html_page(text, [page], [CaptionedPng("x", text, PNG)]))
    assert [found for _, found in elements.found if found != "Figures"] == [text] * 9
    assert elements.attributes["alt"] == text
    assert "onload" not in elements.attributes
