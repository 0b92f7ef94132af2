"""Common style of figures, and delayed import of Matplotlib (the extra ``eval``)."""

from __future__ import annotations

import importlib
import io
import logging
import textwrap
from types import ModuleType
from typing import Any

from glsim.core.errors import GlsimError, pip_install


def matplotlib(part: str) -> ModuleType:
    """Import a module of Matplotlib. Raises GlsimError if it is not installed."""
    logging.getLogger("matplotlib").setLevel(logging.WARNING)  # its DEBUG log lists all fonts
    try:
        return importlib.import_module(f"matplotlib.{part}")
    except ImportError:
        cure = f"{pip_install('eval')}, or give --no-figures"
        raise GlsimError(f"figures need Matplotlib: {cure}") from None


def new_figure(width_in: float, height_in: float) -> Any:
    """Create an empty figure in the common style, without a display or global state."""
    figure = matplotlib("figure").Figure(figsize=(width_in, height_in), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.02, h_pad=0.02, wspace=0.02, hspace=0.02)
    return figure


def add_note(figure: Any, text: str) -> None:
    """Write a small note below a figure, wrapped to the figure's width."""
    width = int(figure.get_figwidth() * _NOTE_LETTERS_PER_IN)
    lines = "\n".join(textwrap.wrap(text, width))
    figure.supxlabel(lines, fontsize=_NOTE_SIZE, color="#555555")


#: Font size of notes, points, and number of letters of this size per inch.
_NOTE_SIZE, _NOTE_LETTERS_PER_IN = 6, 17
#: Colours of methods in the order of the tables, which colour-blind readers can distinguish (Okabe
#: and Ito). Further methods reuse the colours with other line styles.
_COLOURS = ("#000000", "#e69f00", "#56b4e9", "#009e73", "#d55e00", "#0072b2", "#cc79a7", "#999900")
_DASHES = ("-", "--", ":")


def method_style(number: int) -> dict[str, str]:
    """Return colour and line style of method number n, the same in every figure."""
    rounds, colour = divmod(number, len(_COLOURS))
    return {"color": _COLOURS[colour], "linestyle": _DASHES[rounds % len(_DASHES)]}


def to_png(figure: Any, dpi: int = 200) -> bytes:
    """Convert a figure to the bytes of a PNG file; equal figures give equal bytes."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=dpi, metadata={"Software": None})
    return stream.getvalue()
