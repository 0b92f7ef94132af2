"""``python -m glsim``, and the command ``glsim``."""

import sys


def main() -> int:
    """Run the command line of this process; returns its exit status.

    The command line takes a tenth of a second to import: Ctrl-C works then, too.
    """
    try:
        from glsim.cli import main as run

        return run()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        return 1


if __name__ == "__main__":
    sys.exit(main())
