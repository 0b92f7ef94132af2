"""``python -m glsim``, and the command ``glsim``."""

import sys
from importlib.util import find_spec

#: Least address space that NumPy, OpenCV and their threads load in, bytes. Measured on two cores:
#: a crash at 512 MB, an error at 614 MB, none at 717 MB.
_LEAST_MEMORY = 700 << 20


def _memory_limit() -> int:
    """Return the limit of this process's address space, bytes; -1 without one."""
    try:
        import resource
    except ImportError:  # Windows
        return -1
    return resource.getrlimit(resource.RLIMIT_AS)[0]


def main() -> int:
    """Run the command line of this process and return its exit status.

    The command line takes a tenth of a second to import: Ctrl-C works then, too.
    """
    if find_spec("glsim.shaders") is None:  # a checkout: the folder lies beside the package
        sys.stderr.write(
            "glsim: error: glsim is not installed: run pip install -e . in its folder\n"
        )
        return 1
    if 0 <= _memory_limit() < _LEAST_MEMORY:
        sys.stderr.write(
            f"glsim: error: this process may use {_memory_limit() >> 20} MB (ulimit -v); the "
            f"libraries crash below {_LEAST_MEMORY >> 20} MB: raise the limit\n"
        )
        return 1
    try:
        from glsim.cli import main as run

        return run()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        return 1


if __name__ == "__main__":
    sys.exit(main())
