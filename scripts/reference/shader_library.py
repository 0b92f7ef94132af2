"""Reference of the functions that noise stages include, from the sources in shaders/lib."""

from __future__ import annotations

import re

from scripts.reference.markdown import block, plain
from scripts.reference.stages import header_text

_INTRODUCTION = """\
# Shader library

A stage includes a file by `#include "lib/random.glsl"` and calls its functions. Depths are metres,
0 = no depth; `u_seed` is a `uint` that differs for each frame and stage; distances in the image
are pixels. Same pixel, seed and draw: same random number.

"""
#: A function at the start of a line, with the comment above it.
_FUNCTION = re.compile(r"((?:^//[^\n]*\n)*)^(\w+ \w+\([^)]*\)) \{", re.MULTILINE)


def pages() -> dict[str, str]:
    """Return page name -> Markdown: one page with all functions of shaders/lib."""
    from scripts.reference import ROOT

    parts = [_INTRODUCTION]
    for file in sorted((ROOT / "shaders" / "lib").glob("*.glsl")):
        source = file.read_text(encoding="utf-8")
        functions = _FUNCTION.findall(source)
        if not functions:
            continue
        parts.append(f"## `lib/{file.name}`\n\n" + header_text("\n" + source))
        for comment, signature in functions:
            parts.append(block(" ".join(signature.split()), "glsl"))
            if comment and not source.startswith(comment):
                parts.append(plain(comment.replace("\n//", " ").removeprefix("//")) + "\n\n")
    return {"shader_library": "".join(parts)}
