"""``python -m glsim``."""

import sys

from glsim.cli import main

sys.exit(main())
