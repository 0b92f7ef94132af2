"""Read files one by one under a limit of memory, and print what each costs.

``python -m tests.support.hostile_reader INTACT HOSTILE...`` prints a line of JSON for each hostile
file: peak memory, MB, above the peak of the intact file; CPU seconds; the line of the error.
"""

import json
import resource
import sys
import time
from pathlib import Path

#: Address space above what is used after the intact file, bytes: the machine stays usable.
ROOM = 3 << 30


def peak_mb() -> float:
    """Return the peak of resident memory since it was last reset."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) / 1000


def read(path: Path) -> None:
    """Read a file as the commands do."""
    from glsim.data.maps import open_maps
    from glsim.faces.meshes.load import read_mesh
    from glsim.faces.meshes.obj import EXTENSIONS

    if path.suffix in EXTENSIONS:
        read_mesh(path)
    else:
        beside = path.parent / "depth_0.png"
        assert open_maps(path.parent if beside.exists() else path).frames[0].measured_mm.size


def main() -> None:
    from glsim.core.errors import GlsimError

    intact, *hostile = map(Path, sys.argv[1:])
    read(intact)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + ROOM, resource.RLIM_INFINITY))
    for path in hostile:
        Path("/proc/self/clear_refs").write_text("5")
        before, start, line = peak_mb(), time.process_time(), ""
        try:
            read(path)
        except GlsimError as error:
            line = str(error)
        except BaseException as error:
            line = f"uncaught\n{error!r:.300}"
        cost = {"mb": peak_mb() - before, "s": time.process_time() - start, "line": line}
        sys.stdout.write(json.dumps(cost) + "\n")


if __name__ == "__main__":
    main()
