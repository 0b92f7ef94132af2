"""Standard streams that may be closed, and text for a terminal."""

from __future__ import annotations

import os
import sys


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


def printable(text: str) -> str:
    """Return a text with its control characters written out: a name may hold a terminal's codes."""
    return "".join(
        c if c.isprintable() or c == "\n" else c.encode("unicode_escape").decode() for c in text
    )
