"""Write the pages of the reference and print their names."""

from __future__ import annotations

import sys

from scripts.reference import write_pages

for file in write_pages():
    sys.stdout.write(f"wrote {file}\n")
