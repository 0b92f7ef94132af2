"""Validation checks and their bands, measurements, results, and the report of all results."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from glsim.core.files.atomic import without_nan
from glsim.core.files.markdown import markdown_table

#: States of a result, in the order of summaries.
STATES = ("pass", "exception", "FAIL", "n/a")
#: Columns of the table of a report.
COLUMNS = ("#", "check", "measured", "band", "source", "kind", "", "note")


@dataclass(frozen=True)
class Band:
    """Published interval, in ``unit``, for the measured number named ``key``."""

    key: str
    low: float
    high: float
    unit: str = ""

    def holds(self, value: float) -> bool:
        """Return whether a value lies inside the band; False for NaN."""
        return self.low <= value <= self.high

    @property
    def text(self) -> str:
        """The band as text, such as "1.3 to 2.1 mm"."""
        if self.low == self.high:
            number = f"{self.low:.4g}"
        elif math.isinf(self.high):
            number = f">= {self.low:.4g}"
        elif math.isinf(self.low):
            number = f"<= {self.high:.4g}"
        else:
            number = f"{self.low:.4g} to {self.high:.4g}"
        return f"{number} {self.unit}".strip()


@dataclass(frozen=True)
class Check:
    """A line of a validation sheet: a checked quantity and its bands.

    ``kind`` of the source: "measured" on devices, "datasheet" (or source code of a decoder), or
    "derived" from these or from physics.
    """

    number: str
    description: str
    bands: tuple[Band, ...]
    source: str
    kind: str = "derived"


@dataclass(frozen=True)
class Measurement:
    """Measured numbers of a check.

    Attributes:
        values: key of a band -> measured number; None if the band does not apply to this sensor.
        why_not: reason why the whole check does not apply.
        exception: measured reason why a failure is not the sensor's fault.
    """

    values: Mapping[str, float | None] = field(default_factory=dict)
    note: str = ""
    why_not: str = ""
    exception: str = ""


#: Takes the ``Captures`` of a sensor; returns check number -> measurement.
CheckFunction = Callable[[Any], dict[str, Measurement]]


def validation_check(sheet: str, *checks: Check) -> Callable[[CheckFunction], CheckFunction]:
    """Register a CheckFunction of the sheet of a sensor, ``sheet``.

    ``checks``: those that are not in a file of ``glsim/bench/validate/sheets``.
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
    def bands(self) -> list[Band]:
        """Bands that apply to this sensor."""
        if self.measured.why_not:
            return []
        return [b for b in self.check.bands if self.measured.values.get(b.key, 0) is not None]

    def value(self, band: Band) -> float:
        """Return the measured number for a band; NaN if it could not be measured."""
        value = self.measured.values.get(band.key)
        return math.nan if value is None else float(value)

    @property
    def state(self) -> str:
        """State (of STATES) of the check: "pass" if all numbers that apply lie in their bands."""
        if self.measured.why_not:
            return "n/a"
        if all(band.holds(self.value(band)) for band in self.bands):
            return "pass"
        return "exception" if self.measured.exception else "FAIL"

    @property
    def cells(self) -> tuple[str, ...]:
        """Texts of the cells in COLUMNS; "!" marks a number outside its band."""
        measured = []
        for band in self.bands:
            value = self.value(band)
            number = "?" if math.isnan(value) else f"{value:.3g}"
            measured.append(f"{band.key} {number}{'' if band.holds(value) else ' !'}")
        accepted = self.measured.exception if self.state == "exception" else ""
        notes = (self.measured.why_not, accepted, self.measured.note)
        return (
            self.check.number, self.check.description, "\n".join(measured),
            "\n".join(band.text for band in self.bands), self.check.source, self.check.kind,
            self.state, "; ".join(note for note in notes if note),
        )  # fmt: skip

    def as_json(self) -> dict[str, Any]:
        """Convert the result to JSON values; a number that is not finite becomes null."""
        numbers = [
            {"key": band.key, "measured": value, **asdict(band), "inside": band.holds(value)}
            for band, value in ((band, self.value(band)) for band in self.bands)
        ]
        names = ("number", "check", "source", "kind", "state", "note")
        texts = dict(zip(names, (self.cells[k] for k in (0, 1, 4, 5, 6, 7)), strict=True))
        return {**texts, "numbers": without_nan(numbers)}


@dataclass(frozen=True)
class ValidationReport:
    """Results of all checks of one sensor; ``sheet`` is the title of its validation sheet.

    ``real_frames``: AUC by which real frames are told from replays; "" if none were compared.
    """

    sensor: str
    title: str
    sheet: str
    seed: int
    frames: int
    seconds: float
    results: tuple[CheckResult, ...]
    real_frames: str = ""

    @property
    def passed(self) -> bool:
        """Whether no check failed, except documented exceptions."""
        return all(result.state != "FAIL" for result in self.results)

    @property
    def summary(self) -> str:
        """Line of text with the count of each state."""
        counts = {state: sum(r.state == state for r in self.results) for state in STATES}
        text = ", ".join(f"{count} {state}" for state, count in counts.items() if count)
        line = f"{self.sensor}: {len(self.results)} checks: {text} ({self.seconds:.0f} s)"
        told = f"; real frames are told from replays by AUC {self.real_frames}"
        return line + told if self.real_frames else line

    def as_json(self) -> dict[str, Any]:
        """Convert the report to values for a JSON file."""
        names = ("sensor", "title", "sheet", "seed", "frames", "passed", "real_frames")
        facts = {name: getattr(self, name) for name in names}
        return {**facts, "checks": [result.as_json() for result in self.results]}

    def as_markdown(self) -> str:
        """Return a Markdown table with a row per check."""
        rows = [
            [cell.replace("|", "\\|").replace("\n", "<br>") for cell in result.cells]
            for result in self.results
        ]
        return "\n".join(markdown_table(COLUMNS, rows)) + "\n"
