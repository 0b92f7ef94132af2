"""Rewrite the tables and the figure of docs/validation.md: python scripts/validation_page.py.

About three minutes on two cores. Tables stand between <!-- sensor --> and <!-- end -->.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from glsim.files.markdown import markdown_table
from glsim.gl.context import open_context
from glsim.validate import Captures, ValidationReport, VirtualCamera, draw_figure, run_checks
from glsim.validate.report import COLUMNS

DOCS = Path(__file__).resolve().parents[1] / "docs"
SENSORS = (
    "kinect-v2",
    "kinect-v2-fast",
    "kinect-v2-fankhauser",
    "kinect-v1",
    "kinect-v2-paper",
    "azure-kinect",
    "realsense-d435",
    "realsense-d455",
    "realsense-d415",
    "truedepth",
    "kinect-v1-pattern",
)


def main() -> None:
    """Validate every sensor and write the results into the page."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    page = DOCS / "validation.md"
    text = page.read_text()
    context = open_context()
    reports: list[ValidationReport] = []
    for sensor in SENSORS:
        captures = Captures(VirtualCamera(sensor, context))
        reports.append(run_checks(captures))
        text = _filled(text, sensor, _section(reports[-1]))
        if sensor == "kinect-v2":
            (DOCS / "figures").mkdir(exist_ok=True)
            (DOCS / "figures" / f"{sensor}-validation.png").write_bytes(draw_figure(captures))
    page.write_text(_filled(text, "summary", _summary(reports)))


def _section(report: ValidationReport) -> str:
    """Return a line per check, and the numbers with their bands and sources folded away."""
    folded = report.as_markdown([column for column in COLUMNS if column not in ("check", "")])
    summary = "<summary>Numbers, bands, sources and notes</summary>"
    short = report.as_markdown(("#", "check", ""))
    return f"{short}\n<details>\n{summary}\n\n{folded}\n</details>\n"


def _summary(reports: list[ValidationReport]) -> str:
    outcomes = ("pass", "exception", "FAIL", "n/a")
    rows = [
        [
            r.sensor,
            r.sheet,
            *(str(r.count(outcome)) for outcome in outcomes),
            r.sources.removeprefix("sources: "),
        ]
        for r in reports
    ]
    head = ["sensor", "checks of the", "pass", "exception", "fail", "n/a", "sources"]
    return "\n".join(markdown_table(head, rows)) + "\n"


def _filled(text: str, name: str, table: str) -> str:
    pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end -->)", re.DOTALL)
    filled, count = pattern.subn(lambda match: match[1] + "\n" + table + "\n" + match[2], text)
    if count != 1:
        raise SystemExit(f"docs/validation.md: no place for {name!r}")
    return filled


if __name__ == "__main__":
    main()
