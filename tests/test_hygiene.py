"""What no file of the project may contain: unfinished work, evaluation of text, and hidden silencing of checks."""

from __future__ import annotations

import ast
import re
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("rrrgen", "bench", "templates")
SOURCES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file())
PYTHON = [path for path in SOURCES if path.suffix == ".py"]
TEXT = [path for path in SOURCES if path.suffix in {".py", ".j2", ".c", ".h", ".yaml", ".html", ".css"}]
MOST_LINES = 400

UNFINISHED = re.compile(r"\b(TODO|FIXME|XXX|HACK|raise NotImplementedError)\b")
# by click and Jinja
CALLED_BY_LIBRARIES = {
    *("list_commands", "get_command", "format_commands", "format_epilog", "write_heading"),  # click
    *("load_bytecode", "dump_bytecode"),  # Jinja
    *("_repr_html_", "_repr_latex_"),  # notebooks
}
EVALUATION = {"eval", "exec", "sympify", "parse_expr", "literal_eval", "lambdify"}


def identify(path: Path) -> str:
    return str(path.relative_to(ROOT))


def test_there_is_something_to_read():
    assert len(PYTHON) > 100
    assert len(TEXT) > len(PYTHON)


@pytest.mark.parametrize("path", TEXT, ids=identify)
def test_nothing_is_unfinished(path):
    assert not UNFINISHED.search(path.read_text(encoding="utf-8"))


def strict(call: ast.Call) -> bool:
    """SymPy's ``sympify(..., strict=True)`` converts numbers and refuses text."""
    return any(keyword.arg == "strict" and ast.unparse(keyword.value) == "True" for keyword in call.keywords)


@pytest.mark.parametrize("path", PYTHON, ids=identify)
def test_python_files(path):
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    called = {
        node.func.id if isinstance(node.func, ast.Name) else node.func.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute) and not strict(node)
    }
    assert not called & EVALUATION, "text is never evaluated"
    assert ast.get_docstring(tree) or not text.strip(), "a module says what it is about"
    assert len(text.splitlines()) <= MOST_LINES
    printing = "cli" in path.relative_to(ROOT).parts or path == ROOT / "bench" / "__main__.py"
    assert printing or not called & {"print", "exit"}, "only the command line prints or exits"


def definitions(path: Path) -> set[str]:
    """Names of the functions, methods, classes and constants of a module."""
    kinds = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
    tree = ast.parse(path.read_text(encoding="utf-8"))
    constants = {
        target.id
        for node in tree.body
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    return constants | {node.name for node in ast.walk(tree) if isinstance(node, kinds)}


def test_what_is_defined_is_used():
    """By the package, or by a reader of a page; a test is no use of its own."""
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    words = Counter(word for path in [*TEXT, *pages] for word in re.findall(r"\w+", path.read_text(encoding="utf-8")))
    unused = {
        f"{identify(path)}: {name}"
        for path in PYTHON
        for name in definitions(path) - CALLED_BY_LIBRARIES
        if words[name] < 2 and not name.startswith("__")
    }
    assert not unused


FRAGMENTS = re.compile(r"(Of|From|See|Likewise|As :|As in|The same\.|Like :)\b")


@pytest.mark.parametrize("path", PYTHON, ids=identify)
def test_docstrings_say_what_the_thing_is(path):
    """Not a fragment that continues the name of the function, nor a pointer to another docstring."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    kinds = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
    found = {node.name: ast.get_docstring(node) or "" for node in ast.walk(tree) if isinstance(node, kinds)}
    assert {name: text.splitlines()[0] for name, text in found.items() if FRAGMENTS.match(text)} == {}
