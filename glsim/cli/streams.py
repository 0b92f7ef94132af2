"""Standard streams that may be closed, and text for a terminal."""

from __future__ import annotations

import codecs
import os
import sys
import unicodedata

#: Characters of help texts and messages that have no likeness in ASCII by Unicode's own tables.
_IN_ASCII = {
    "\u2026": ".",
    "\u2212": "-",
    "\xb1": "+-",
    "\xd7": "x",
    "\xb0": " deg",
    "\u2192": "->",
}


def open_closed_streams() -> None:
    """Give a process without standard streams (``>&-``) some that lead nowhere.

    Otherwise the next file that is opened would take their number, and get what libraries print.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))


def replace_what_a_stream_lacks() -> None:
    """Let streams of few characters (PYTHONIOENCODING=ascii) print others as the nearest.

    A help text or a name would otherwise end in UnicodeEncodeError.
    """
    codecs.register_error("glsim.nearest", _nearest)
    for stream in (sys.stdout, sys.stderr):
        encoding = (getattr(stream, "encoding", None) or "").lower().replace("-", "")
        if not encoding.startswith("utf") and hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="glsim.nearest")


def _nearest(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    plain = (unicodedata.normalize("NFKD", c).encode("ascii", "ignore").decode() for c in text)
    return "".join(
        _IN_ASCII.get(c) or p or "?" for c, p in zip(text, plain, strict=True)
    ), error.end


def printable(text: str) -> str:
    """Return a text with its control characters written out: a name may hold a terminal's codes."""
    return "".join(
        c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text
    )
