"""Reference of the public Python names: directives that autodoc fills from docstrings."""

from __future__ import annotations

import enum
import importlib
import inspect

from scripts.reference.markdown import block

#: Modules whose ``__all__`` is public.
MODULES = ("glsim", "glsim.train")


def pages() -> dict[str, str]:
    """Return page name -> Markdown: one page per module."""
    return {f"python_{name.replace('.', '_')}": _page(name) for name in MODULES}


def _page(module_name: str) -> str:
    module = importlib.import_module(module_name)
    title = f"# Python: `{module_name}`\n\n"
    parts = [f"{title}`from {module_name} import ...`; nothing deeper is public.\n\n"]
    for name in sorted(module.__all__):
        value = getattr(module, name)
        lines = [f".. {_directive(value)}:: {module_name}.{name}"]
        if inspect.isclass(value) and not issubclass(value, BaseException):
            lines += ["   :members:", "   :member-order: bysource"]
            if issubclass(value, enum.Enum):
                lines.append("   :undoc-members:")
        parts.append(f"## `{name}`\n\n" + block("\n".join(lines), "{eval-rst}"))
    return "".join(parts)


def _directive(value: object) -> str:
    if inspect.isclass(value):
        return "autoexception" if issubclass(value, BaseException) else "autoclass"
    return "autofunction"
