"""Notebooks of tutorials and gallery, as sphinx-gallery writes them, install themselves and run."""

from __future__ import annotations

import json
import os
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.support.imports import ROOT

SCRIPTS = sorted(
    file for folder in ("tutorials", "gallery") for file in (ROOT / "docs" / folder).glob("*.py")
)
SETUP = runpy.run_path(str(ROOT / "docs" / "conf.py"))["NOTEBOOK_SETUP"]


def notebook(script: Path) -> dict[str, Any]:
    """The notebook of a script, as the site writes it."""
    gallery = pytest.importorskip("sphinx_gallery.notebook", reason="needs the extra docs")
    from sphinx_gallery.gen_gallery import DEFAULT_GALLERY_CONF
    from sphinx_gallery.py_source_parser import split_code_and_text_blocks

    _, blocks = split_code_and_text_blocks(str(script))
    conf = {**DEFAULT_GALLERY_CONF, "first_notebook_cell": SETUP}
    written: dict[str, Any] = gallery.jupyter_notebook(blocks, conf, str(script.parent))
    return json.loads(json.dumps(written))  # type: ignore[no-any-return]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.name)
def test_a_notebook_is_valid_and_begins_with_its_installation(script: Path) -> None:
    nbformat = pytest.importorskip("nbformat", reason="needs nbformat")
    cells = notebook(script)["cells"]
    assert "".join(cells[0]["source"]) == SETUP
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert len(code) >= (4 if script.parent.name == "tutorials" else 2)
    transform = pytest.importorskip("IPython.core.inputtransformer2").TransformerManager()
    for cell in code:
        compile(transform.transform_cell("".join(cell["source"])), script.name, "exec")
    node = nbformat.from_dict(notebook(script))
    nbformat.validate(node, relax_add_props=True)


#: Runs the first cell in IPython, with commands that are written down instead of run.
RUN = """
import importlib.util, os, sys
from IPython.core.interactiveshell import InteractiveShell
os.environ.setdefault("MPLBACKEND", "agg")
shell = InteractiveShell.instance()
shell.system = lambda command: print("SYSTEM", command)
shell.register_magic_function(lambda line: print("PIP", line), "line", "pip")
shell.register_magic_function(lambda line: None, "line", "matplotlib")
if sys.argv[1] == "missing":
    found = importlib.util.find_spec
    importlib.util.find_spec = lambda name: None if name == "glsim" else found(name)
result = shell.run_cell(sys.argv[2])
assert result.success, result.error_in_exec
"""


@pytest.mark.parametrize(("state", "calls"), [("missing", 2), ("there", 0)])
def test_the_first_cell_installs_what_is_missing(state: str, calls: int, tmp_path: Path) -> None:
    pytest.importorskip("IPython", reason="needs IPython")
    done = subprocess.run(
        [sys.executable, "-c", RUN, state, SETUP],
        capture_output=True, text=True, check=False, cwd=tmp_path,
        env={"PATH": "/usr/bin:/bin", "IPYTHONDIR": str(tmp_path), "GLSIM_PIP": "mine.whl[eval]"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr + done.stdout
    lines = [line for line in done.stdout.splitlines() if line.startswith(("SYSTEM", "PIP"))]
    assert len(lines) == calls
    if calls:
        assert "libegl1" in lines[0]
        assert lines[1].split()[-1].strip('"') == "mine.whl[eval]"


#: Runs all cells of a notebook one after the other, as a kernel does.
RUN_ALL = """
import json, os, sys
os.environ["MPLBACKEND"] = "agg"
from IPython.core.interactiveshell import InteractiveShell
shell = InteractiveShell.instance()
shell.register_magic_function(lambda line: None, "line", "matplotlib")
for cell in json.load(open(sys.argv[1]))["cells"]:
    if cell["cell_type"] == "code":
        result = shell.run_cell("".join(cell["source"]))
        assert result.success, result.error_in_exec or result.error_before_exec
print("ALL CELLS RAN", len(__import__("matplotlib.pyplot").pyplot.get_fignums()))
"""


@pytest.mark.long
@pytest.mark.parametrize("name", ["2_noise_stage.py", "05_own_stage.py"])
def test_a_notebook_runs_from_its_first_cell_to_its_last(name: str, tmp_path: Path) -> None:
    pytest.importorskip("IPython", reason="needs IPython")
    (script,) = (script for script in SCRIPTS if script.name == name)
    (tmp_path / "notebook.ipynb").write_text(json.dumps(notebook(script)))
    done = subprocess.run(
        [sys.executable, "-c", RUN_ALL, "notebook.ipynb"],
        capture_output=True, text=True, check=False, cwd=tmp_path, timeout=600,
        env=os.environ | {"IPYTHONDIR": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr + done.stdout
    assert "ALL CELLS RAN 1" in done.stdout
