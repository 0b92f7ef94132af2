"""What a format of ``glsim export`` is."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from glsim.exports.frames import ExportFrame


@dataclass(frozen=True)
class Export:
    """A format for the frames of a data set: give ``encode`` or ``write``.

    Args:
        name: as in ``--to``.
        help: what the format is, in one line.
        encode: returns the files of one frame, each as the end of its name and its bytes.
        write: writes all frames to a new path and returns their number.
        file: name of what ``write`` makes in the output folder.
        library: package that it imports; it comes with glsim[formats].
        replaces: whether ``write`` replaces an older file.
    """

    name: str
    help: str
    encode: Callable[[ExportFrame], Iterable[tuple[str, bytes]]] | None = None
    write: Callable[[Iterator[ExportFrame], Path], int] | None = None
    file: str = ""
    library: str = ""
    replaces: bool = True
