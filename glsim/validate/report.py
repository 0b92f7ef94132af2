"""Checks with their bands, measurements and results, and the report as JSON and Markdown."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from glsim.errors import ConfigError
from glsim.files.markdown import markdown_table

#: Kinds of sources. measured: on real devices, published or on our real frames. datasheet: a
#: manufacturer's document or the decoder's source. derived: computed from these or from physics.
KINDS = ("measured", "datasheet", "derived")
#: Columns of the table of a report.
COLUMNS = ("#", "check", "measured", "band", "source", "kind", "", "note")


@dataclass(frozen=True)
class Band:
    """The interval in which one measured number must lie.

    Attributes:
        key: name of the number in the measurement.
        low: least value, in ``unit``.
        high: largest value.
        unit: of the number.
        kind: of its source, one of KINDS; "" for that of its check.

    """

    key: str
    low: float
    high: float
    unit: str = ""
    kind: str = ""

    def holds(self, value: float) -> bool:
        """Return whether a value lies inside; NaN does not."""
        return self.low <= value <= self.high

    @property
    def text(self) -> str:
        """The band as text, such as: 1.3 to 2.1 mm."""
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
    """One line of a validation sheet.

    Attributes:
        number: of the check.
        description: the checked quantity.
        bands: of its numbers.
        source: origin of the bands.
        kind: of that source, one of KINDS; a band may have another.

    """

    number: str
    description: str
    bands: tuple[Band, ...]
    source: str
    kind: str = "derived"

    def kind_of(self, band: Band) -> str:
        """Return the kind of source of one band."""
        return band.kind or self.kind

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of source of all bands, in the order of KINDS."""
        own = {self.kind_of(band) for band in self.bands}
        return tuple(kind for kind in KINDS if kind in own)

    @property
    def kind_text(self) -> str:
        """The kinds as text, such as "measured: a; derived: b"."""
        if len(self.kinds) == 1:
            return self.kinds[0]
        return "; ".join(
            f"{kind}: {', '.join(b.key for b in self.bands if self.kind_of(b) == kind)}"
            for kind in self.kinds
        )


@dataclass(frozen=True)
class Measurement:
    """Measured numbers of a check.

    Attributes:
        values: key of the band -> number; None if it does not apply to this sensor.
        note: remark for the reader.
        why_not: reason why the whole check does not apply.
        exception: measured reason why a failure is not the sensor's fault.

    """

    values: Mapping[str, float | None] = field(default_factory=dict)
    note: str = ""
    why_not: str = ""
    exception: str = ""


#: A decorated function: takes the captures of a sensor, returns check number -> measurement.
CheckFunction = Callable[[Any], dict[str, Measurement]]


def validation_check(sheet: str, *checks: Check) -> Callable[[CheckFunction], CheckFunction]:
    """Declare a function that measures checks.

    Args:
        sheet: the sensor whose validation sheet has the checks; other sensors without a sheet of
            their own are checked as a kinect-v2.
        checks: what is checked; the function takes the ``Captures`` of a sensor and returns a
            measurement for the number of each.
    """

    def mark(function: CheckFunction) -> CheckFunction:
        function.sheet, function.checks = sheet, checks  # type: ignore[attr-defined]
        return function

    return mark


@dataclass(frozen=True)
class CheckResult:
    """A check with its measurement."""

    check: Check
    measured: Measurement

    @property
    def applicable(self) -> bool:
        """Whether the check applies to this sensor."""
        return not self.measured.why_not

    @property
    def passed(self) -> bool:
        """Whether every number that applies lies in its band."""
        return all(band.holds(self.value(band)) for band in self.bands)

    @property
    def bands(self) -> list[Band]:
        """The bands that apply to this sensor."""
        if not self.applicable:
            return []
        return [b for b in self.check.bands if self.measured.values.get(b.key, 0) is not None]

    def value(self, band: Band) -> float:
        """Return the number for a band; NaN if it could not be measured."""
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
        """All remarks in one line."""
        accepted = self.measured.exception if self.state == "exception" else ""
        parts = (self.measured.why_not, accepted, self.measured.note)
        return "; ".join(part for part in parts if part)

    def as_json(self) -> dict[str, Any]:
        """Convert to values for JSON; a number that could not be measured is null."""
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
                    "kind": self.check.kind_of(band),
                }
            )
        return {
            "number": self.check.number,
            "check": self.check.description,
            "source": self.check.source,
            "kinds": list(self.check.kinds),
            "state": self.state,
            "note": self.note,
            "numbers": numbers,
        }


@dataclass(frozen=True)
class ValidationReport:
    """Results of all checks of one sensor; ``sheet`` is the title of its validation sheet."""

    sensor: str
    title: str
    sheet: str
    seed: int
    frames: int
    seconds: float
    results: tuple[CheckResult, ...]

    @property
    def passed(self) -> bool:
        """Whether no check failed, except documented exceptions."""
        return all(result.state != "FAIL" for result in self.results)

    def count(self, state: str) -> int:
        """Count the results in a state: pass, exception, FAIL or n/a."""
        return sum(result.state == state for result in self.results)

    @property
    def summary(self) -> str:
        """One line with the counts of all states."""
        states = ("pass", "exception", "FAIL", "n/a")
        counts = ", ".join(f"{self.count(s)} {s}" for s in states if self.count(s))
        return f"{self.sensor}: {len(self.results)} checks: {counts} ({self.seconds:.0f} s)"

    @property
    def sources(self) -> str:
        """One line: number of checks per kind of source; a check of several kinds is mixed."""
        kinds = [r.check.kinds for r in self.results]
        counts = {kind: sum(own == (kind,) for own in kinds) for kind in KINDS}
        counts["of mixed kind"] = sum(len(own) > 1 for own in kinds)
        return "sources: " + ", ".join(f"{n} {kind}" for kind, n in counts.items() if n)

    def as_json(self) -> dict[str, Any]:
        """Convert to values for a JSON file."""
        return {
            "sensor": self.sensor,
            "title": self.title,
            "sheet": self.sheet,
            "seed": self.seed,
            "frames": self.frames,
            "passed": self.passed,
            "sources": self.sources,
            "checks": [result.as_json() for result in self.results],
        }

    def as_markdown(self, columns: Sequence[str] = COLUMNS) -> str:
        """Return a Markdown table with a row per check; ``columns`` are some of COLUMNS."""
        rows = []
        for result in self.results:
            texts = (
                result.check.number,
                result.check.description,
                "<br>".join(measured_texts(result)),
                "<br>".join(band_texts(result)),
                result.check.source,
                result.check.kind_text,
                result.state,
                result.note,
            )
            cells = dict(zip(COLUMNS, texts, strict=True))
            rows.append([cells[column].replace("|", "\\|") for column in columns])
        return "\n".join(markdown_table(columns, rows)) + "\n"


def measured_texts(result: CheckResult) -> list[str]:
    """Format the numbers, one text per band; a number outside its band is marked with !."""
    texts = []
    for band in result.bands:
        value = result.value(band)
        number = "?" if math.isnan(value) else f"{value:.3g}"
        texts.append(f"{band.key} {number}{'' if band.holds(value) else ' !'}")
    return texts


def band_texts(result: CheckResult) -> list[str]:
    """Format the bands, one text per band."""
    return [band.text for band in result.bands]


def match_measurements(
    checks: Sequence[Check], measurements: Mapping[str, Measurement]
) -> tuple[CheckResult, ...]:
    """Pair checks with measurements by number. Raises ConfigError for checks without one."""
    missing = [check.number for check in checks if check.number not in measurements]
    if missing:
        raise ConfigError(f"no measurement for the checks {', '.join(missing)}")
    return tuple(CheckResult(check, measurements[check.number]) for check in checks)


def _number(value: float) -> str:
    return f"{value:.4g}"
