"""One HTML file that needs no network: its style, and figures within it."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from typing import Final

_STYLE: Final = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 75rem; margin: 2rem auto; padding: 0 1rem;
       color: #1a1a1a; }
table { border-collapse: collapse; font-size: 13px; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .6rem; text-align: right; border-bottom: 1px solid #ddd; }
th:first-child, td:first-child { text-align: left; }
td small { color: #777; display: block; white-space: nowrap; }
.wide { overflow-x: auto; }
figure { margin: 1.5rem 0; } figcaption { color: #555; font-size: 13px; }
img { max-width: 100%; }
"""


def html_figure(name: str, caption: str, png: bytes) -> str:
    """Return a figure with its caption; the picture is part of the text."""
    data, text = base64.b64encode(png).decode(), html.escape(caption)
    return (
        f'<figure id="{name}"><img alt="{text}" src="data:image/png;base64,{data}">'
        f"<figcaption>{text}</figcaption></figure>"
    )


def html_page(title: str, body: Sequence[str]) -> str:
    """Return a whole HTML page; the parts of the body are HTML already."""
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}'
        f"</title><style>{_STYLE}</style></head><body>{''.join(body)}</body></html>\n"
    )
