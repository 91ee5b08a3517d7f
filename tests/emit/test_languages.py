"""Languages besides C and CasADi: each has a module, its templates and one line in a table; nothing else names it."""

from __future__ import annotations

import ast
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from emit.c_tools import IDENTITY
from emit.planar import planar_model
from rrrgen.base.errors import BackendError
from rrrgen.emit.package import emit
from rrrgen.robot.file.fields import EMIT, LANGUAGES

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_language_costs_four_files(language):
    module = ROOT / "rrrgen" / "emit" / "targets" / f"{language}.py"
    others = [path for path in (ROOT / "rrrgen").rglob("*.py") if path != module and language in names(path)]
    users = {"generate.py", "playground.py"}  # which add the controller as a crate, and run JavaScript in the page
    others = [path for path in others if path.name not in users]
    assert [path.name for path in others] == ["fields.py"]
    templates = [path for path in (ROOT / "templates" / language).rglob("*") if path.is_file()]
    assert len([module, *others, *templates]) <= 4
    assert language in EMIT


@cache
def names(path: Path) -> set[str]:
    """The languages whose module the code of a file imports, or whose name it has as a constant."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    constants = {node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    modules = {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    imported = {language for language in LANGUAGES if f"rrrgen.emit.targets.{language}" in modules}
    if path.parent.name == "targets":  # a package for another tool may contain the language
        return constants.intersection(LANGUAGES) - imported
    return constants.intersection(LANGUAGES) | imported


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_language_prints_files_of_its_own(language):
    model = planar_model()
    backend = import_module(f"rrrgen.emit.targets.{language}").BACKEND
    files = backend.assemble(model, IDENTITY, [task() for task in backend.tasks(model, IDENTITY, "double")])
    assert files
    assert len({path.split("/")[0] for path in files}) == 1


def test_an_unknown_language():
    with pytest.raises(BackendError, match="unknown language 'fortran': " + ", ".join(LANGUAGES)):
        emit(planar_model(), languages=["fortran"])
