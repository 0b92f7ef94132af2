"""``python -m tools.heads OUT.npz``: sculpt the heads and write their arrays."""

import sys
from pathlib import Path

from tools.heads.bake import write_heads

if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit("usage: python -m tools.heads OUT.npz")
    write_heads(Path(sys.argv[1]))
