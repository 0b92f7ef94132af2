"""What a format of ``glsim export`` is."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from glsim.data.export.frames import ExportFrame


@dataclass(frozen=True)
class Export:
    """A format for the frames of a data set.

    Args:
        name: as in ``--to``.
        help: what the format is, in one line.
        encode: returns the files of one frame, each as the end of its name and its bytes.
        library: package that it imports; it comes with glsim[formats].
    """

    name: str
    help: str
    encode: Callable[[ExportFrame], Iterable[tuple[str, bytes]]]
    library: str = ""
