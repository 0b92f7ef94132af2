"""Run one of the stress tests of this folder by its name."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

NAMES = sorted(
    file.stem
    for file in Path(__file__).parent.glob("*.py")
    if not file.stem.startswith("_") and "\ndef main(" in file.read_text(encoding="utf-8")
)


def run() -> int:
    if len(sys.argv) < 2 or sys.argv[1] not in NAMES:
        print(f"usage: python -m benchmarks.stress {{{','.join(NAMES)}}} [options] (-h: help)")
        return 2
    module = importlib.import_module(f"benchmarks.stress.{sys.argv[1]}")
    return int(module.main(sys.argv[2:]))


if __name__ == "__main__":
    sys.exit(run())
