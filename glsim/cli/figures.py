"""Whether figures can be drawn, asked before the work: they need the extra ``eval``."""

from __future__ import annotations

from importlib.util import find_spec

from glsim.cli.common import print_message

#: Package -> its name in a sentence. report.html comes from a template of Jinja2.
_NEEDED = {"matplotlib": "Matplotlib", "jinja2": "Jinja2"}


def figures_wanted(asked: bool) -> bool:
    """Return whether to draw figures: as asked, unless a library is missing, which is said."""
    if not asked:
        return False
    missing = [name for package, name in _NEEDED.items() if find_spec(package) is None]
    if missing:
        print_message(
            f"no figures and no report.html, tables alone: they need {' and '.join(missing)}: "
            "pip install 'glsim[eval]'"
        )
    return not missing
