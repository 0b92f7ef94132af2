"""Parts of a data set: the share of its chunks that one of several jobs makes.

The jobs may run on many machines, at the same time or not, if they write one folder.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from glsim.errors import ConfigError

#: Variables of systems that start arrays of jobs: number of the job, of all jobs, of the first job.
#: Slurm's and AWS Batch's manuals, SkyPilot's page "Distributed multi-node jobs".
_ARRAYS = (
    ("SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_COUNT", "SLURM_ARRAY_TASK_MIN"),
    ("AWS_BATCH_JOB_ARRAY_INDEX", "AWS_BATCH_JOB_ARRAY_SIZE", ""),
    ("SKYPILOT_NODE_RANK", "SKYPILOT_NUM_NODES", ""),
    ("JOB_COMPLETION_INDEX", "", ""),  # Kubernetes; its Job does not say how many there are
)


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


def named_part(name: str) -> Part:
    """Return the part of this ``name``."""
    number, _, of = name.partition("-of-")
    return Part(int(number), int(of))


def parse_part(text: str, environment: Mapping[str, str]) -> Part:
    """Parse "3/16"; "auto" asks the environment for both numbers, "auto/16" for the first.

    Raises ConfigError.
    """
    number, slash, of = text.partition("/")
    if number == "auto":
        index, count = _place_in_array(environment)
        of = of if slash else count
        if not of:
            raise ConfigError(
                "--part auto: Kubernetes does not say how many jobs there are: give --part auto/N "
                "with the number of completions"
            )
        number = index
    if not re.fullmatch(r"\d{1,9}", number) or not re.fullmatch(r"[1-9]\d{0,8}", of):
        raise ConfigError(f"--part {text}: give the number of the part and of all, such as 3/16")
    if int(number) > int(of):
        raise ConfigError(f"--part {number}/{of}: parts are numbered 0 to {int(of) - 1}, or from 1")
    return Part(int(number), int(of))


def _place_in_array(environment: Mapping[str, str]) -> tuple[str, str]:
    """Return the number of this job, and of all jobs; "" where that is not known."""
    for index, count, first in _ARRAYS:
        if index in environment:
            start = environment.get(first, "")
            if start.isdigit() and environment[index].isdigit():
                number = str(int(environment[index]) - int(start))
            else:
                number = environment[index]
            return number, environment.get(count, "")
    names = ", ".join(index for index, _, _ in _ARRAYS)
    raise ConfigError(f"--part auto: this is no job of an array: none of {names} is set")
