"""One script of the modules in assets/, for pages without a server.

Browsers read no modules beside a page that is opened from a disk.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ASSETS = Path(__file__).parent / "assets"
_IMPORT = re.compile(r'^import (?:(\{[^}]*\}) from )?"[./]*([\w./]+)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?(?:function|class|const) (\w+))", re.MULTILINE)


def join_script(facts: dict[str, Any], modules: Sequence[str]) -> str:
    """Return a page's one script; each module is a function, so that names do not collide.

    Args:
        facts: become ``window.glsimFacts``.
        modules: files of assets/, each after those that it imports.
    """
    parts = [f"'use strict';\nwindow.glsimFacts = {script_json(facts)};\nconst modules = {{}};\n"]
    for name in modules:
        text = (ASSETS / name).read_text()
        exported = [match[2] for match in _EXPORT.finditer(text)]
        text = _IMPORT.sub(_take, text)
        text = _EXPORT.sub(r"\1", text)
        given = f"return {{ {', '.join(exported)} }};"
        parts.append(f'modules["{Path(name).name}"] = (() => {{\n{text}{given}\n}})();\n')
    return "".join(parts)


def _take(match: re.Match[str]) -> str:
    names, file = match.groups()
    return f'const {names} = modules["{Path(file).name}"];\n' if names else ""


def script_json(value: Any) -> str:
    """Return a value as JSON for a script."""
    # "<" is escaped, so that no text ends a script element.
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
