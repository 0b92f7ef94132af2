"""Check the links of the built site: ``python -m scripts.check_site docs/_build/html``.

Every link, picture, style and script of a page that is on the site must be there, anchors
included. Sphinx checks what it resolves itself; this also finds what pages name as plain HTML.
"""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

#: No pages: the theme keeps templates here.
_STATIC = "_static"


class _Page(HTMLParser):
    """A page's link targets and its anchors."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value and name in ("href", "src"):
                self.targets.append(value)
            elif value and (name == "id" or (name == "name" and tag == "a")):
                self.anchors.add(value)


def find_broken_links(folder: Path) -> list[str]:
    """Return one line for each link target that the folder of the site lacks, sorted."""
    folder = folder.resolve()
    files = [path for path in folder.rglob("*.html") if _STATIC not in path.parts]
    pages = {file: _Page(file.read_text("utf-8")) for file in files}
    broken = set()
    for file, page in pages.items():
        for target in page.targets:
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            other = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            if not other.exists():
                broken.add(f"{file.relative_to(folder)}: {target} is not there")
            elif parts.fragment and other in pages:
                anchor = unquote(parts.fragment)
                if anchor not in pages[other].anchors:
                    broken.add(f"{file.relative_to(folder)}: {target} has no such anchor")
    return sorted(broken)


def main() -> int:
    """Print the broken links; return the exit status."""
    folder = Path(sys.argv[1])
    broken = find_broken_links(folder)
    sys.stderr.writelines(f"{line}\n" for line in broken)
    sys.stdout.write(f"{folder}: {len(broken)} broken links\n")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
