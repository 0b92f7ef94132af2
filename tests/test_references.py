"""Texts name what there is: options of commands, files, modules, and names of the code.

Read are the strings, docstrings and comments of the code, shipped TOML files, shaders and docs.
"""

import ast
import builtins
import io
import keyword
import re
import subprocess
import sys
import tokenize
from collections.abc import Iterator
from functools import cache

import pytest

from glsim.core.plugins import GROUPS
from scripts.reference.commands import commands, options_of
from tests.support.imports import ROOT, all_modules, imported_modules

MODULES = all_modules()
SOURCE = {module: file.read_text(encoding="utf-8") for module, file in MODULES.items()}
#: Options of glsim itself, of pip and of Ray.
OTHER_OPTIONS = {
    "--version", "--show-completion", "--install-completion", "--no-deps", "--only-binary",
    "--dest", "--index-url", "--disable-pip-version-check", "--head",
}  # fmt: skip
#: These modules write command lines of other commands.
WRITERS = {"glsim.cli.verify", "glsim.cli.tune_page.tuning", "glsim.cli.tune_page.topbar"}
#: Groups of entry points, and files, whose names begin with ``glsim.``.
OTHER_NAMES = {*GROUPS, "NAME", "sif", "def", "css"}
#: Words of .obj files, keywords of SciPy's and other packages' functions.
FOREIGN = {"usemtl", "mtllib", "Kd", "structural_similarity", "datasets", "manual_seed", "text"}
_OPTION = re.compile(r"(?<![\w-])--[a-z0-9]+(?:-[a-z0-9]+)*(?!.*-->)")
_COMMAND = re.compile(r"\bglsim ([a-z][a-z0-9-]+)(?: (\w+))?|\b(generate)\b")
_PATH = re.compile(
    r"(?<![\w/.~$-])(?:glsim|train|eval|shaders|docs|scripts|benchmarks|tools)/[\w./*-]+\w"
)
_DOTTED = re.compile(r"(?<![\w/.-])(?:glsim|benchmarks|scripts)(?:\.[A-Za-z_]\w*)+")
_QUOTED = re.compile(r"``([A-Za-z_][\w.]*)(?:\(\))?``")
_WORD = re.compile(r"[A-Za-z_]\w*")


def python_texts(source: str) -> Iterator[str]:
    """Yield every string and comment of a source file; in an f-string {} for each value."""
    inside: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.JoinedStr):
            inside |= {id(part) for part in node.values}
            parts = [p.value if isinstance(p, ast.Constant) else "{}" for p in node.values]
            yield "".join(map(str, parts))
        elif isinstance(node, ast.Constant) and id(node) not in inside:
            yield node.value if isinstance(node.value, str) else ""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.string


def other_texts(*suffixes: str) -> dict[str, str]:
    """Return path -> content of the committed files with these suffixes, but for tests."""
    done = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    return {
        name: (ROOT / name).read_text(encoding="utf-8")
        for name in done.stdout.splitlines()
        if name.endswith(suffixes) and not name.startswith(("tests/", "CHANGELOG"))
    }


@cache
def options() -> dict[str, frozenset[str]]:
    """Return command -> its options."""
    return {name: frozenset(options_of(command)) for name, command in commands()}


@cache
def graph() -> dict[str, frozenset[str]]:
    """Return module -> the modules that it imports."""
    return {
        module: frozenset(imported_modules(source, set(MODULES)))
        for module, source in SOURCE.items()
    }


@cache
def speakers() -> dict[str, frozenset[str]]:
    """Return module -> the commands that load it and so can print its messages; or all."""
    found: dict[str, set[str]] = {module: set() for module in MODULES}
    for name in options():
        file = name.split()[0].replace("-", "_")
        todo = ["glsim.cli.import_" if file == "import" else f"glsim.cli.{file}"]
        while todo:
            module = todo.pop()
            if name not in found[module]:
                found[module].add(name)
                todo += graph()[module]
    return {
        module: frozenset(options() if not names or module in WRITERS else names)
        for module, names in found.items()
    }


def unknown_options(text: str, speaking: frozenset[str]) -> list[str]:
    """List the options of a text that none of the commands has of which it speaks.

    These are the last command that the line names before the option, else the one of "of glsim
    train" after it, else those that can print the text.
    """
    wrong = []
    for line in text.splitlines():
        for match in _OPTION.finditer(line):
            before = [*_COMMAND.finditer(line, 0, match.start())][-1:]
            after = _COMMAND.match(line, match.end() + len(" of ")) if not before else None
            named = [*before, after] if after else before
            names = speaking
            if named and (first := named[0][1] or named[0][3]):
                both = f"{first} {named[0][2]}"
                names = frozenset(n for n in options() if n == both or n.split()[0] == first)
            if match[0] not in OTHER_OPTIONS.union(*(options()[name] for name in names)):
                wrong.append(f"{match[0]}: {line.strip()}")
    return wrong


def test_options_in_toml_files_and_docs_exist() -> None:
    everyone = frozenset(options())
    for name, text in other_texts(".toml").items():
        text = "" if name == "pyproject.toml" else text
        assert unknown_options(text, everyone) == [], name
    for name, text in other_texts(".md").items():
        for span in re.findall(r"`((?:glsim |--)[^`\n]+)`", text):
            assert unknown_options(span, everyone) == [], name


@cache
def names_in(module: str) -> frozenset[str]:
    """Return every name in the code of a module, and every word of its strings."""
    tree = ast.parse(SOURCE[module])
    docstrings = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
    names: set[str] = set()
    for node in ast.walk(tree):
        for attribute in ("name", "id", "attr", "arg", "asname"):
            names.update(_WORD.findall(str(getattr(node, attribute, ""))))
        if isinstance(node, ast.Constant) and id(node) not in docstrings:
            names.update(_WORD.findall(str(node.value)))
    return frozenset(names)


@cache
def names_everywhere() -> frozenset[str]:
    """Return the names that a text may use: of the code, settings, shaders and Python."""
    names = {*dir(builtins), *keyword.kwlist, *sys.stdlib_module_names, *FOREIGN}
    for module in MODULES:
        names.update(module.split("."), names_in(module))
    for text in other_texts(".toml").values():
        names.update(_WORD.findall(re.sub(r"#.*", "", text)))
    for text in other_texts(".glsl", ".vert", ".frag").values():
        names.update(_WORD.findall(re.sub(r"//.*", "", text)))
    return frozenset(names)


def unknown_quotes(text: str) -> list[str]:
    """List the ``names`` of a text that stand nowhere in the code."""
    found, known = [match[1] for match in _QUOTED.finditer(text)], names_everywhere()
    files = (".png", ".yaml", ".obj", ".npz", ".cal", ".onnx")
    return [n for n in found if not n.endswith(files) and not known.issuperset(n.split("."))]


def unknown_places(text: str) -> list[str]:
    """List the paths and the dotted names of the repository in a text that lead nowhere."""
    wrong = []
    for path in {match[0] for match in _PATH.finditer(text)}:
        built = path.startswith(("docs/_build", "docs/generated"))
        if not built and not any(next(ROOT.glob(p), None) for p in (path, f"{path}.py")):
            wrong.append(path)
    for name in {match[0] for match in _DOTTED.finditer(text)}:
        module = name
        while module and module not in MODULES:
            module = module.rpartition(".")[0]
        if not module:
            place = ROOT / name.replace(".", "/")
            known = place.is_dir() or place.with_suffix(".py").is_file()
        else:  # a name of that module
            word = name[len(module) + 1 :].partition(".")[0]
            known = not word or word in names_in(module) | OTHER_NAMES or word.startswith("__")
        if not known:
            wrong.append(name)
    return wrong


@pytest.mark.parametrize("module", sorted(MODULES))
def test_a_module_names_what_there_is(module: str) -> None:
    declared = set[str]().union(*options().values())
    for text in python_texts(SOURCE[module]):
        if text not in declared:
            assert unknown_options(text, speakers()[module]) == []
        assert unknown_quotes(text) == []
        assert unknown_places(text) == []


def test_places_in_shaders_toml_files_docs_and_scripts_exist() -> None:
    for name, text in other_texts(".glsl", ".vert", ".frag", ".toml", ".md", ".sh").items():
        if not name.startswith("docs/reference/"):  # has the texts of the code
            assert unknown_places(text) == [], name


def test_what_is_gone_is_noticed() -> None:
    everyone = frozenset(options())
    for text in ("generate with --crop {}", "changes, as --sets of glsim train"):
        assert unknown_options(text, everyone), text
    assert unknown_options("glsim train face --set data.crop=64", everyone) == []
    assert unknown_quotes("count in ``beyond_px`` only")
    for text in ("specs of ``glsim.denoise.load``", "drivers, see glsim/gl/arithmetic.py."):
        assert unknown_places(text), text
