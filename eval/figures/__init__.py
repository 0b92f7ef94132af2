"""Pictures of results for papers, with Matplotlib (the extra ``eval``), imported lazily."""

from __future__ import annotations

import importlib
import io
import logging
from types import ModuleType
from typing import Any

from glsim.errors import GlsimError


def matplotlib(part: str) -> ModuleType:
    """A module of Matplotlib, or GlsimError where it is not installed."""
    logging.getLogger("matplotlib").setLevel(logging.WARNING)  # it lists all fonts at DEBUG
    try:
        return importlib.import_module(f"matplotlib.{part}")
    except ImportError:
        raise GlsimError(
            "figures need Matplotlib: pip install 'glsim[eval]', or give --no-figures"
        ) from None


def new_figure(width_in: float, height_in: float) -> Any:
    """An empty figure in the style of all of them; no display and no global state."""
    figure = matplotlib("figure").Figure(figsize=(width_in, height_in), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.02, h_pad=0.02, wspace=0.02, hspace=0.02)
    return figure


#: Of the methods in the order of the tables: Okabe and Ito's colours, which colour-blind readers
#: can tell apart, then again with other line styles.
_COLOURS = ("#000000", "#e69f00", "#56b4e9", "#009e73", "#d55e00", "#0072b2", "#cc79a7", "#999900")
_DASHES = ("-", "--", ":")


def style(number: int) -> dict[str, str]:
    """Colour and line style of the n-th method, in every figure the same."""
    rounds, place = divmod(number, len(_COLOURS))
    return {"color": _COLOURS[place], "linestyle": _DASHES[rounds % len(_DASHES)]}


def to_png(figure: Any, dpi: int = 200) -> bytes:
    """The bytes of a PNG file, the same for the same figure."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=dpi, metadata={"Software": None})
    return stream.getvalue()
