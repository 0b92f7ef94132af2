"""Parts of a data set: the share of its chunks that one of several jobs makes.

The jobs may run on many machines, at the same time or not, if they write one folder.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from glsim.core.errors import ConfigError


@dataclass(frozen=True)
class Part:
    """The chunks whose number modulo ``of`` is ``number`` modulo ``of``.

    Both 0 to of - 1 and 1 to of name all parts: of/of and 0/of are the same.
    """

    number: int
    of: int

    def chunks(self, count: int) -> range:
        """Return the numbers of this part's chunks among ``count``."""
        return range(self.number % self.of, count, self.of)

    @property
    def name(self) -> str:
        """The name of its files: the same for every spelling of the part."""
        return f"{self.number % self.of}-of-{self.of}"

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"


def parse_part(text: str) -> Part:
    """Parse "3/16". Raises ConfigError."""
    match = re.fullmatch(r"(\d{1,9})/([1-9]\d{0,8})", text, re.ASCII)
    if match is None:
        raise ConfigError(f"--part {text}: give the number of the part and of all, such as 3/16")
    number, of = int(match[1]), int(match[2])
    if number > of:
        raise ConfigError(f"--part {text}: parts are numbered 0 to {of - 1}, or from 1")
    return Part(number, of)
