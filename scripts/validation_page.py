"""Writes the tables and the figure of docs/validation.md anew: python scripts/validation_page.py

About three minutes on two cores. Tables stand between <!-- sensor --> and <!-- end -->.
"""

from __future__ import annotations

import re
from pathlib import Path

from glsim.gl.context import open_context
from glsim.validate import Bench, Lab, Report, examine, figure

DOCS = Path(__file__).resolve().parents[1] / "docs"
SENSORS = ("kinect-v2", "kinect-v2-fast", "kinect-v2-fankhauser", "kinect-v1", "kinect-v2-paper")


def main() -> None:
    """Validate every sensor and put the results into the page."""
    page = DOCS / "validation.md"
    text = page.read_text()
    context = open_context()
    reports: list[Report] = []
    for sensor in SENSORS:
        lab = Lab(Bench(sensor, context))
        reports.append(examine(lab))
        text = _filled(text, sensor, reports[-1].as_markdown())
        if sensor == "kinect-v2":
            (DOCS / "figures").mkdir(exist_ok=True)
            (DOCS / "figures" / f"{sensor}-validation.png").write_bytes(figure(lab))
    page.write_text(_filled(text, "summary", _summary(reports)))


def _summary(reports: list[Report]) -> str:
    lines = ["| sensor | checks of the | pass | exception | fail | n/a |", "|---" * 6 + "|"]
    for r in reports:
        counts = (r.count("pass"), r.count("exception"), r.count("FAIL"), r.count("n/a"))
        lines.append(f"| {r.sensor} | {r.sheet} | {' | '.join(map(str, counts))} |")
    return "\n".join(lines) + "\n"


def _filled(text: str, name: str, table: str) -> str:
    pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end -->)", re.DOTALL)
    filled, count = pattern.subn(lambda found: found[1] + "\n" + table + "\n" + found[2], text)
    if count != 1:
        raise SystemExit(f"docs/validation.md: no place for {name!r}")
    return filled


if __name__ == "__main__":
    main()
