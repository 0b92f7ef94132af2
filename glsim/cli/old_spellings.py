"""Old spellings of commands: they still work, and the new one is printed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple


class Moved(NamedTuple):
    """A command that moved.

    Attributes:
        old: name of the command before.
        flag: option that asked for it, "" if the whole command moved.
        new: words of the new command.
        keeps: the option is kept, under its name in ``_RENAMED``; else its value is an argument.
    """

    old: str
    flag: str
    new: tuple[str, ...]
    keeps: bool = False


#: The first that matches counts.
_MOVED = (
    Moved("reproduce", "--figures", ("paper", "figures")),
    Moved("reproduce", "--findings", ("paper", "findings")),
    Moved("reproduce", "--filter-page", ("paper", "protocols")),
    Moved("reproduce", "", ("paper", "reproduce")),
    Moved("study", "", ("paper", "study")),
    Moved("eval", "--real", ("eval-real",)),
    Moved("eval", "--ssim-readings", ("paper", "ssim")),
    Moved("eval", "--photo-runs", ("paper", "photographs"), keeps=True),
    Moved("eval", "--paper-table", ("paper", "tables"), keeps=True),
)

#: Options of the commands that score: old name -> new name.
_RENAMED = {
    "--paper-table": "--table",
    "--tune": "--tune-filters",
    "--probes": "--baselines",
    "--no-probes": "--no-baselines",
}
_SCORING = (("eval",), ("eval-real",), ("paper", "tables"))

#: Commands whose folder was an option and is an argument.
_FOLDER_ARGUMENT = (("paper", "figures"), ("paper", "findings"), ("paper", "protocols"))


def new_spelling(arguments: Sequence[str]) -> list[str]:
    """Return the arguments of ``glsim`` in the present spelling."""
    command, words = tuple(arguments[:1]), [part for word in arguments[1:] for part in _split(word)]
    if command == ("paper",):
        command, words = (*command, *words[:1]), words[1:]
    for moved in _MOVED:
        if command == (moved.old,) and (not moved.flag or moved.flag in words):
            command = moved.new
            if not moved.keeps:
                words = [word for word in words if word != moved.flag]
            if command in _FOLDER_ARGUMENT:
                words = [word for word in words if word not in ("-o", "--out")]
            break
    if command in _SCORING:
        words = [_RENAMED.get(word, word) for word in words]
    return [*command, *words]


def _split(word: str) -> list[str]:
    """Split an option that moved from its value: --real=folder."""
    name, equals, value = word.partition("=")
    moved = {moved.flag for moved in _MOVED if moved.flag} | set(_RENAMED) | {"--out"}
    return [name, value] if equals and name in moved else [word]
