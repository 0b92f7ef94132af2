"""Sphinx's configuration: ``make docs`` builds the site into docs/_build/html."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
ROOT = DOCS.parent
sys.path.insert(0, str(ROOT))  # glsim, and the writers of the reference in scripts/

_PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
project = "glsim"
author = "the authors of glsim"
release = version = _PROJECT["version"]

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx_design",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = [
    "_build", "tutorials/*.rst", "gallery", "generated/tutorials/*.py", "generated/gallery/*.py",
    "**/sg_execution_times.rst",
]  # fmt: skip
nitpicky = False
suppress_warnings = [
    "config.cache",  # functions below are no plain values
    "myst.header",  # model_card.md has several titles
]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
myst_dmath_allow_digits = False

toc_object_entries = False  # each name of the reference has its own heading
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True

html_theme = "pydata_sphinx_theme"
html_title = f"glsim {release}"
html_static_path = ["_static"]
templates_path = ["_templates"]
html_css_files = ["glsim.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "header_links_before_dropdown": 6,
    "secondary_sidebar_items": {
        "**": ["page-toc"],
        **dict.fromkeys(("index", "generated/tutorials/index", "generated/gallery/index"), ()),
    },
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
copyright = "the authors of glsim, MIT licence"
html_sidebars = {"**": ["groups"]}

#: First cell of the notebooks: a hosted notebook is a fresh Debian or Ubuntu without glsim.
#: GLSIM_PIP names another source, such as a wheel file, as long as there is no release.
NOTEBOOK_SETUP = """\
# On a hosted notebook: Mesa's OpenGL, and glsim. Elsewhere this does nothing.
import importlib.util
import os

if importlib.util.find_spec("glsim") is None:
    !apt-get -qq update && apt-get -qq install -y libegl1 libgl1 libgl1-mesa-dri
    source = os.environ.get("GLSIM_PIP", "glsim[eval,train]")
    %pip install -q "{source}"
%matplotlib inline"""

sphinx_gallery_conf = {
    "first_notebook_cell": NOTEBOOK_SETUP,
    "examples_dirs": ["tutorials", "gallery"],
    "thumbnail_size": (600, 400),
    "gallery_dirs": ["generated/tutorials", "generated/gallery"],
    "filename_pattern": r"/\d+_",  # all are run
    "ignore_pattern": r"__init__\.py",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "remove_config_comments": True,
    "min_reported_time": 1e9,
    "write_computation_times": False,
    "plot_gallery": "True",
    "show_api_usage": False,
}


_ARGUMENT = re.compile(r"(\w+(?:, \w+)*): (.*)")


def _format_docstring(
    _app: Any, _what: str, _name: str, _value: Any, _options: Any, lines: list[str]
) -> None:
    """Turn the plain text of a docstring into reStructuredText, in place.

    Lines "name: meaning" become a list, and indented blocks after an empty line become code.
    """
    done: list[str] = []
    item = block = False
    for number, line in enumerate(lines):
        after_empty = number == 0 or not lines[number - 1].strip()
        argument = _ARGUMENT.match(line)
        if not line.strip():
            item = False
        elif line.startswith("    ") and (block or (after_empty and not item)):
            if not block:
                done += [".. code-block:: python", ""]
            block = True
        elif argument:
            if not item:
                done.append("")
            item, block = True, False
            line = f"* ``{argument[1]}``: {argument[2]}"
        else:
            block = False
            line = ("  " if item else "") + line.strip()
        done.append(line)
    lines[:] = done


def _write_reference(_app: Any) -> None:
    from scripts.reference import write_pages

    write_pages()


def setup(app: Any) -> None:
    """Write the pages from the code before Sphinx looks for pages."""
    app.connect("builder-inited", _write_reference, priority=100)
    app.connect("autodoc-process-docstring", _format_docstring)
