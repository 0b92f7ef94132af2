"""``python -m glsim``, and the command ``glsim``."""

import sys
from importlib.util import find_spec


def main() -> int:
    """Run the command line of this process and return its exit status.

    The command line takes a tenth of a second to import: Ctrl-C works then, too.
    """
    if find_spec("glsim.shaders") is None:  # a checkout: the folder lies beside the package
        sys.stderr.write(
            "glsim: error: glsim is not installed: run pip install -e . in its folder\n"
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
