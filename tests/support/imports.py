"""Imports of the code base: the modules that a file names, and that running code loads."""

import ast
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "glsim"


def all_modules() -> dict[str, Path]:
    """List all modules of ``glsim``: module name -> file."""
    found = {}
    for folder in (PACKAGE, *(ROOT / name for name in ("eval", "shaders", "train"))):
        for file in sorted(folder.rglob("*.py")):
            parts = file.relative_to(folder).with_suffix("").parts
            package = ("glsim",) if folder == PACKAGE else ("glsim", folder.name)
            found[".".join((*package, *parts)).removesuffix(".__init__")] = file
    return found


def imported_modules(source: str, modules: set[str]) -> set[str]:
    """Return the modules, out of ``modules``, that a source file imports or names in strings.

    Imports inside functions and under TYPE_CHECKING count. A string counts if it is the name of a
    module and no docstring: such names end in ``import_module``. Raises ValueError for a relative
    import.
    """
    tree = ast.parse(source)
    docstrings = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {_nearest(alias.name, modules) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                raise ValueError(f"line {node.lineno}: relative import")
            base = node.module or ""
            found |= {_nearest(f"{base}.{alias.name}", modules) for alias in node.names}
        elif isinstance(node, ast.Constant) and id(node) not in docstrings:
            dotted = isinstance(node.value, str) and "." in node.value
            found.add(node.value if dotted and node.value in modules else "")
    return found - {""}


def _nearest(name: str, modules: set[str]) -> str:
    """Return the module of a dotted name, or the module that contains it; "" if of no module."""
    while name and name not in modules:
        name = name.rpartition(".")[0]
    return name


def third_party(source: str) -> set[str]:
    """Return the names of all third-party packages that a source file imports."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names.add((node.module or "").partition(".")[0])
    return names


def loaded_after(code: str) -> set[str]:
    """Return the names of the modules that a new interpreter has loaded after ``code``."""
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(' '.join(sys.modules))"],
        capture_output=True,
        text=True,
        check=True,
    )
    return set(done.stdout.split())
