"""What no file of the project may contain: unfinished work, evaluation of text, and hidden silencing of checks."""

from __future__ import annotations

import ast
import pkgutil
import re
from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("rrrgen", "bench", "templates")
SOURCES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file())
PYTHON = [path for path in SOURCES if path.suffix == ".py"]
TEXT = [path for path in SOURCES if path.suffix in {".py", ".j2", ".c", ".h", ".yaml", ".html", ".css"}]

UNFINISHED = re.compile(r"\b(TODO|FIXME|XXX|HACK|raise NotImplementedError)\b")
# by click and Jinja
CALLED_BY_LIBRARIES = {
    *("list_commands", "get_command", "format_commands", "format_options", "format_epilog", "write_heading"),  # click
    *("load_bytecode", "dump_bytecode"),  # Jinja
    *("end_headers", "log_message"),  # http.server
    *("_repr_html_", "_repr_latex_"),  # notebooks
}
EVALUATION = {"eval", "exec", "sympify", "parse_expr", "literal_eval", "lambdify"}


def identify(path: Path) -> str:
    return str(path.relative_to(ROOT))


def test_there_is_something_to_read():
    assert len(PYTHON) > 100
    assert len(TEXT) > len(PYTHON)


def test_nothing_is_unfinished():
    assert [identify(path) for path in TEXT if UNFINISHED.search(path.read_text(encoding="utf-8"))] == []


def strict(call: ast.Call) -> bool:
    """SymPy's ``sympify(..., strict=True)`` converts numbers and refuses text."""
    return any(keyword.arg == "strict" and ast.unparse(keyword.value) == "True" for keyword in call.keywords)


@dataclass(frozen=True)
class Source:
    """What a Python file calls, the functions, methods, classes and constants that it defines, and its docstrings.

    ``defined_twice`` are names that the module itself gives to two things, ``functions`` its functions and methods
    without properties, ``variables`` what it assigns to but for fields, and parameters.
    """

    called: set[str]
    defined: set[str]
    defined_twice: set[str]
    functions: set[str]
    variables: set[str]
    docstrings: dict[str, str]
    module_docstring: str
    lines: int


@cache
def source(path: Path) -> Source:
    """Read a file once for all tests; its syntax tree is not kept, since garbage collection would visit all of them."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    fields = {
        id(line.target)
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
        for line in node.body
        if isinstance(line, ast.AnnAssign)
    }
    called, docstrings, functions, variables = set(), {}, set(), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute) and not strict(node):
            called.add(node.func.id if isinstance(node.func, ast.Name) else node.func.attr)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            docstrings[node.name] = ast.get_docstring(node) or ""
            if not isinstance(node, ast.ClassDef) and "property" not in "".join(map(ast.unparse, node.decorator_list)):
                functions.add(node.name)
        elif isinstance(node, ast.arg):
            variables.add(node.arg)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and id(node) not in fields:
            variables.add(node.id)
    constants = [
        target.id
        for node in tree.body
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name)
    ]
    definitions = [node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)]
    twice = {name for name, count in Counter(constants + definitions).items() if count > 1}
    defined, about = set(constants) | set(docstrings), ast.get_docstring(tree) or ""
    return Source(called, defined, twice, functions, variables, docstrings, about, len(text.splitlines()))


def prints(path: Path) -> bool:
    return "cli" in path.relative_to(ROOT).parts or path == ROOT / "bench" / "__main__.py"


def test_text_is_never_evaluated():
    """But the text of the methods, which is made from the table of model functions alone."""
    assert {
        identify(path): source(path).called & EVALUATION for path in PYTHON if source(path).called & EVALUATION
    } == {"rrrgen/runtime/functions/methods.py": {"exec"}}


def test_a_module_says_what_it_is_about():
    assert [identify(path) for path in PYTHON if source(path).lines and not source(path).module_docstring] == []


def test_only_the_command_line_prints_or_exits():
    ends = {"print", "exit"}
    assert [identify(path) for path in PYTHON if source(path).called & ends and not prints(path)] == []


def test_what_is_defined_is_used():
    """By the package, or by a reader of a page; a test is no use of its own."""
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    words = Counter(word for path in [*TEXT, *pages] for word in re.findall(r"\w+", path.read_text(encoding="utf-8")))
    unused = {
        f"{identify(path)}: {name}"
        for path in PYTHON
        for name in source(path).defined - CALLED_BY_LIBRARIES
        if words[name] < 2 and not name.startswith("__")
    }
    assert not unused


def test_no_module_gives_a_name_to_two_things():
    """The second would silently take the place of the first, also in the functions between them."""
    assert {identify(path): names for path in PYTHON if (names := source(path).defined_twice)} == {}


FRAGMENTS = re.compile(r"(Of|From|See|Likewise|As :|As in|The same\.|Like :)\b")


VAGUE = {"found", "each", "own", "told"}
PARTICIPLE = re.compile(r"_*([a-z]+ed|built|chosen|drawn|found|given|held|kept|known|made|shown|taken|told|written)_*")
NOUNS = {"feed", "need", "seed", "speed"}


def test_names_say_what_they_hold_and_functions_what_they_do():
    """A variable is the noun of its thing, a function a verb or a noun; properties may be participles."""
    package = [path for path in PYTHON if ROOT / "rrrgen" in path.parents]
    assert {identify(path): source(path).variables & VAGUE for path in package if source(path).variables & VAGUE} == {}
    participles = {
        f"{identify(path)}: {name}"
        for path in package
        for name in source(path).functions
        if PARTICIPLE.fullmatch(name) and name.strip("_") not in NOUNS
    }
    assert participles == set()


def test_docstrings_say_what_the_thing_is():
    """Not a fragment that continues the name of the function, nor a pointer to another docstring."""
    fragments = {
        f"{identify(path)}: {name}": text.splitlines()[0]
        for path in PYTHON
        for name, text in source(path).docstrings.items()
        if FRAGMENTS.match(text)
    }
    assert fragments == {}


GROUPS_OF_ENTRY_POINTS = {"rrrgen.targets", "rrrgen.robots", "rrrgen.commands"}
DOTTED = re.compile(r"(?<![\w./])rrrgen(?:\.[a-z_0-9]+)+(?:\.[A-Za-z_]\w*)?")


def exists(name: str) -> bool:
    """Whether a dotted name is a module of the package, or an attribute of one."""
    try:
        pkgutil.resolve_name(name)
    except (ImportError, AttributeError):
        return False
    return True


def test_names_of_modules_that_pages_and_docstrings_state_exist():
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")]
    stated = {
        name
        for path in [*(path for path in PYTHON if "rrrgen" in path.relative_to(ROOT).parts), *pages]
        for name in re.findall(
            r"(?<![\w./])rrrgen(?:\.[a-z_0-9]+)+(?:\.[A-Za-z_]\w*)?", path.read_text(encoding="utf-8")
        )
    }
    assert {name for name in stated - GROUPS_OF_ENTRY_POINTS if not exists(name)} == set()
