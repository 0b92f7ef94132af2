"""What a validation finds: checks with bands as data, outcomes, and their table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from glsim.errors import ConfigError


@dataclass(frozen=True)
class Band:
    """What one measured number must be: low <= value <= high, in ``unit``.

    key: the name under which a measurement reports it.
    """

    key: str
    low: float
    high: float
    unit: str = ""

    def holds(self, value: float) -> bool:
        """Whether a value lies inside. NaN does not."""
        return self.low <= value <= self.high

    @property
    def text(self) -> str:
        """The band in words, such as: 1.3 to 2.1 mm."""
        if self.low == self.high:
            number = _number(self.low)
        elif math.isinf(self.high):
            number = f">= {_number(self.low)}"
        elif math.isinf(self.low):
            number = f"<= {_number(self.high)}"
        else:
            number = f"{_number(self.low)} to {_number(self.high)}"
        return f"{number} {self.unit}".strip()


@dataclass(frozen=True)
class Check:
    """One line of a validation sheet."""

    number: str
    what: str
    bands: tuple[Band, ...]
    source: str


@dataclass(frozen=True)
class Measured:
    """Numbers by the keys of a check's bands, and what a reader should know.

    A number of None makes no sense for this sensor. why_not: set instead of numbers where the
    whole check does not. exception: why a failure is no fault of the sensor, if that was found out.
    """

    values: Mapping[str, float | None] = field(default_factory=dict)
    note: str = ""
    why_not: str = ""
    exception: str = ""


@dataclass(frozen=True)
class Outcome:
    """A check with what was measured."""

    check: Check
    measured: Measured

    @property
    def applicable(self) -> bool:
        """Whether the check makes sense for this sensor."""
        return not self.measured.why_not

    @property
    def passed(self) -> bool:
        """Whether every number that makes sense lies in its band."""
        return all(band.holds(self.value(band)) for band in self.bands)

    @property
    def bands(self) -> list[Band]:
        """The bands that make sense for this sensor."""
        if not self.applicable:
            return []
        return [b for b in self.check.bands if self.measured.values.get(b.key, 0) is not None]

    def value(self, band: Band) -> float:
        """The number for a band; NaN if it could not be measured."""
        value = self.measured.values.get(band.key)
        return math.nan if value is None else float(value)

    @property
    def state(self) -> str:
        """pass, FAIL, exception or n/a."""
        if not self.applicable:
            return "n/a"
        if self.passed:
            return "pass"
        return "exception" if self.measured.exception else "FAIL"

    @property
    def note(self) -> str:
        """Everything a reader should know, in one line."""
        accepted = self.measured.exception if self.state == "exception" else ""
        parts = (self.measured.why_not, accepted, self.measured.note)
        return "; ".join(part for part in parts if part)

    def as_json(self) -> dict[str, Any]:
        """Plain values; a number that could not be measured is null."""
        numbers = []
        for band in self.bands:
            value = self.value(band)
            numbers.append(
                {
                    "key": band.key,
                    "measured": value if math.isfinite(value) else None,
                    "low": band.low if math.isfinite(band.low) else None,
                    "high": band.high if math.isfinite(band.high) else None,
                    "unit": band.unit,
                    "inside": band.holds(value),
                }
            )
        return {
            "number": self.check.number,
            "check": self.check.what,
            "source": self.check.source,
            "state": self.state,
            "note": self.note,
            "numbers": numbers,
        }


@dataclass(frozen=True)
class Report:
    """All outcomes of one sensor.

    sheet: whose checks these are. seconds: wall time. seed, frames: as asked for.
    """

    sensor: str
    title: str
    sheet: str
    seed: int
    frames: int
    seconds: float
    outcomes: tuple[Outcome, ...]

    @property
    def passed(self) -> bool:
        """Whether nothing failed but documented exceptions."""
        return all(outcome.state != "FAIL" for outcome in self.outcomes)

    def count(self, state: str) -> int:
        """How many outcomes are in a state."""
        return sum(outcome.state == state for outcome in self.outcomes)

    @property
    def summary(self) -> str:
        """One line."""
        states = ("pass", "exception", "FAIL", "n/a")
        counts = ", ".join(f"{self.count(s)} {s}" for s in states if self.count(s))
        return f"{self.sensor}: {len(self.outcomes)} checks: {counts} ({self.seconds:.0f} s)"

    def as_json(self) -> dict[str, Any]:
        """Plain values for a file."""
        return {
            "sensor": self.sensor,
            "title": self.title,
            "sheet": self.sheet,
            "seed": self.seed,
            "frames": self.frames,
            "passed": self.passed,
            "checks": [outcome.as_json() for outcome in self.outcomes],
        }

    def as_markdown(self) -> str:
        """The table for a page of documentation."""
        lines = ["| # | check | measured | band | source | | note |", "|---" * 7 + "|"]
        for outcome in self.outcomes:
            cells = (
                outcome.check.number,
                outcome.check.what,
                "<br>".join(measured_texts(outcome)),
                "<br>".join(band_texts(outcome)),
                outcome.check.source,
                outcome.state,
                outcome.note,
            )
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
        return "\n".join(lines) + "\n"


def measured_texts(outcome: Outcome) -> list[str]:
    """One text a band; a number outside its band is marked with !."""
    texts = []
    for band in outcome.bands:
        value = outcome.value(band)
        number = "?" if math.isnan(value) else f"{value:.3g}"
        texts.append(f"{band.key} {number}{'' if band.holds(value) else ' !'}")
    return texts


def band_texts(outcome: Outcome) -> list[str]:
    """One text a band."""
    return [band.text for band in outcome.bands]


def complete(checks: Sequence[Check], found: Mapping[str, Measured]) -> tuple[Outcome, ...]:
    """Checks with what was measured for them. Raises ConfigError for a check nobody measured."""
    missing = [check.number for check in checks if check.number not in found]
    if missing:
        raise ConfigError(f"no measurement for the checks {', '.join(missing)}")
    return tuple(Outcome(check, found[check.number]) for check in checks)


def _number(value: float) -> str:
    return f"{value:.4g}"
