"""Generated faces: an endless supply of people who perform FACS sequences."""

from __future__ import annotations

from abc import abstractmethod
from collections import OrderedDict
from collections.abc import Sequence
from functools import cached_property
from typing import Any, ClassVar, Final, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from glsim.core.errors import ConfigError
from glsim.core.seeds import rng_for
from glsim.faces.face_source import ComputedKeys, FaceKey, FaceSettings, FaceSource, Topology
from glsim.faces.performance import performance_for, sequence_name, sequence_number

#: Default number of frames of a generated sequence.
DEFAULT_SEQUENCE: Final = 30
_CACHED_PEOPLE: Final = 4

_Person = TypeVar("_Person")


class GeneratorSettings(FaceSettings):
    """The [[source]] table of a generator of people and sequences."""

    endless: ClassVar[bool] = True

    frames_per_sequence: int | None = Field(
        None, ge=1, le=100_000, description="length of a generated sequence; default: 30"
    )
    frames_per_second: float | None = Field(
        None,
        gt=0,
        le=1000,
        description="a generated sequence is a part of a performance at this rate, at a random "
        "time; default: the whole performance, evenly spaced",
    )

    @property
    def timing(self) -> tuple[int, float | None]:
        """Number of frames per sequence, and frames per second or None."""
        return self.frames_per_sequence or DEFAULT_SEQUENCE, self.frames_per_second


class GeneratedFaces(FaceSource, Generic[_Person]):
    """A source of endless people "x0000", "x0001", ..., whose meshes share one topology.

    A performance runs from neutral to neutral. Without ``frames_per_second``, each sequence (also a
    shorter last sequence) shows the whole performance and includes its peak. With it, a sequence
    shows a part of the performance that starts at a random time; a longer sequence shows all of it,
    then a neutral face. ``seed`` determines each identity and performance.
    """

    #: First letter of the subjects' names.
    letter: ClassVar[str]

    def __init__(
        self, seed: int = 0, frames_per_sequence: int = DEFAULT_SEQUENCE,
        frames_per_second: float | None = None,
    ) -> None:  # fmt: skip
        self.seed, self.frames_per_sequence = seed, frames_per_sequence
        self.frames_per_second = frames_per_second

    def __getstate__(self) -> dict[str, Any]:
        """Return the settings only; each worker process loads its own model and people."""
        return {name: value for name, value in self.__dict__.items() if not name.startswith("_")}

    @property
    @abstractmethod
    def topology(self) -> Topology:
        """Triangles, regions and landmarks, shared by all people."""

    @abstractmethod
    def neutral(self, subject: str) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return a subject's resting vertices (V, 3) float32 mm and triangles (F, 3)."""

    @abstractmethod
    def make_person(self, name: str) -> _Person:
        """Make a person; a pure function of the seed and the name."""

    def subjects(self, count: int | None) -> list[str]:
        """Return the first ``count`` subjects. Raises ConfigError for None (endless source)."""
        if count is None:
            raise ConfigError(f"{self.name} faces never end: set source.subjects")
        return [f"{self.letter}{number:04d}" for number in range(count)]

    def frames(self, subject: str, count: int | None) -> PerformanceKeys:
        """Return a subject's first ``count`` keys. Raises ConfigError for None: it is endless."""
        if count is None:
            raise ConfigError(f"{self.name} faces never end: set source.frames_per_subject")
        return PerformanceKeys(
            self.seed, subject, count, self.frames_per_sequence, self.frames_per_second
        )

    def expression(self, key: FaceKey) -> dict[str, float]:
        """Return a frame's expression: action unit -> intensity, no zeros. Raises ConfigError."""
        try:
            number = sequence_number(key.sequence)
        except ValueError as error:
            raise ConfigError(f"{key.subject}: {error}") from None
        return performance_for(self.seed, key.subject, number).at(key.time_s)

    def person(self, name: str) -> _Person:
        """Return a cached or new person. Raises ConfigError for an invalid name."""
        people = self._people
        if name not in people:
            if not (name.startswith(self.letter) and name[1:].isdigit()):
                first = ", ".join(self.subjects(2))
                raise ConfigError(f"no subject {name!r} of {self.name}: they are {first}, ...")
            people[name] = self.make_person(name)
            while len(people) > _CACHED_PEOPLE:
                people.popitem(last=False)
        people.move_to_end(name)
        return people[name]

    @cached_property
    def _people(self) -> OrderedDict[str, _Person]:
        return OrderedDict()


class PerformanceKeys(ComputedKeys):
    """The keys of a generated subject's frames, computed from its performances."""

    def __init__(
        self, seed: int, subject: str, count: int, length: int, rate: float | None
    ) -> None:
        super().__init__(count, seed, subject, count, length, rate)
        self._seed, self._subject = seed, subject
        self._length, self._rate = length, rate
        self._last: tuple[int, Sequence[FaceKey]] = -1, ()

    def _key(self, number: int) -> FaceKey:
        sequence, frame = divmod(number, self._length)
        if self._last[0] != sequence:  # cached, since callers mostly read keys in order
            self._last = sequence, self._sequence(sequence)
        return self._last[1][frame]

    def _sequence(self, number: int) -> list[FaceKey]:
        """Compute the keys of all frames in sequence ``number``."""
        length = min(self._length, self._count - number * self._length)
        performance = performance_for(self._seed, self._subject, number)
        name = sequence_name(number, performance)
        times = performance.frame_times(length)
        if self._rate is not None:
            free_s = max(0.0, performance.duration_s - (self._length - 1) / self._rate)
            start_s = free_s * rng_for(self._seed, "clip", self._subject, number).random()
            times = start_s + np.arange(length) / self._rate
        return [FaceKey(self._subject, name, frame, float(t)) for frame, t in enumerate(times)]
